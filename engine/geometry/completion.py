"""Completion of depth maps with pixels without depth. Sensors leave such pixels on dark, glossy or thin things.

A completed pixel next to measured ones is as good as measured. The other completed pixels are doubtful: they are drawn
only where no view has a measured surface. Mixed pixels ("flying pixels"), with a depth half way between a surface and
the one that it hides, are completed like pixels without depth, and are doubtful too. The background model is built
from measured depth alone; only what a camera that moves adds to it has completed depth next to measured pixels, too,
because otherwise each frame would add slivers that fill the gaps of the last one.
"""

from __future__ import annotations

import dataclasses
import itertools
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..kernels.geometry import complete as kernels
from ..rig.frame import View
from .pyramid import empty_levels

__all__ = ["Completed", "complete", "completed_codes", "trusted"]

# Least confidence, of 255, that is not doubtful: a pixel within about two pixels of a measured one of the same colour.
# Any value between half of 255 and this gives the same pictures of a real capture.
_TRUSTED = 180
_CELL = 2  # side of the first level's cells, pixels (see `kernels.geometry.complete`)


class Completed(NamedTuple):
    """Depth codes uint16 [h, w], and uint8 [h, w] that is 1 where they are doubtful; None: all are measured."""

    codes: npt.NDArray[np.uint16]
    doubtful: npt.NDArray[np.uint8] | None


def complete(view: View, edge: float) -> Completed:
    """Depth for all pixels of a view. A view stays as it is if all of its pixels have depth, or none has.

    `edge`: disparity step between neighbours that is a depth edge, 1/m.
    """
    if not view.camera.depth.has_invalid or view.codes.all() or not view.codes.any():
        return Completed(view.codes, None)
    measured = np.empty_like(view.codes)
    kernels.drop_mixed(view.codes, edge / view.camera.depth.step, measured)
    codes, confidence = completed_codes(View(view.camera, view.texture, measured), edge)
    return Completed(codes, ((confidence < _TRUSTED) | (measured != view.codes)).astype(np.uint8))


def trusted(view: View, edge: float) -> View:
    """A view with the depth of `complete` where that is not doubtful, and without depth elsewhere."""
    codes, doubtful = complete(view, edge)
    return view if doubtful is None else dataclasses.replace(view, codes=np.where(doubtful, np.uint16(0), codes))


def completed_codes(view: View, edge: float) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint8]]:
    """Codes [h, w] and their confidence [h, w]: 255 is measured; it falls with the distance from measured pixels and
    with the difference from their colours. Code 0 means "no depth"; at least one pixel must be measured. `edge` as in
    `complete`."""
    texture, levels = view.texture, empty_levels(view.codes.shape, _CELL)
    kernels.first_level(view.codes, texture.y, texture.cb, texture.cr, levels[0])
    for fine, coarse in itertools.pairwise(levels):
        kernels.next_level(fine, coarse)
    for fine, coarse in zip(levels[-2::-1], levels[:0:-1], strict=True):
        kernels.push_level(coarse, fine)
    codes, confidence = np.empty_like(view.codes), np.empty(view.codes.shape, np.uint8)
    kernels.push_pixels(
        view.codes, texture.y, texture.cb, texture.cr, levels[0], edge / view.camera.depth.step, codes, confidence
    )
    return codes, confidence
