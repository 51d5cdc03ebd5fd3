"""Completion of depth maps that have pixels without depth, as sensors leave them on what is dark, glossy or thin.

A completed pixel next to measured ones is as good as measured. The others are doubtful: they are drawn only where no
view has a surface that was measured. So are mixed pixels, whose depth lies half way between a surface and the one
that it hides ("flying pixels"), and which are completed like those without depth. The background model is built from
measured depth alone.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..kernels.geometry import complete as kernels
from ..rig.frame import View
from .pyramid import empty_levels

__all__ = ["Completed", "complete", "completed_codes"]

# Of 255: within about two pixels of a measured one of the same colour. Anything between half and this makes no
# difference in pictures of a real capture.
_TRUSTED = 180
_CELL = 2  # pixels a side of the first level's cells (see `kernels.geometry.complete`)


class Completed(NamedTuple):
    """Depth codes uint16 [h, w] and which of them are doubtful, uint8 [h, w], 1 where so; None: all are measured."""

    codes: npt.NDArray[np.uint16]
    doubtful: npt.NDArray[np.uint8] | None


def complete(view: View, edge: float) -> Completed:
    """Depth for all pixels of a view; a view that lacks none, or has none at all, is left as it is.

    `edge`: disparity step between neighbours that is a depth edge, 1/m.
    """
    if not view.camera.depth.has_invalid or view.codes.all() or not view.codes.any():
        return Completed(view.codes, None)
    measured = np.empty_like(view.codes)
    kernels.drop_mixed(view.codes, edge / view.camera.depth.step, measured)
    codes, confidence = completed_codes(View(view.camera, view.texture, measured), edge)
    return Completed(codes, ((confidence < _TRUSTED) | (measured != view.codes)).astype(np.uint8))


def completed_codes(view: View, edge: float) -> tuple[npt.NDArray[np.uint16], npt.NDArray[np.uint8]]:
    """Codes [h, w] and their confidence [h, w], 255: measured; less with distance from measured pixels and where
    colours differ from theirs. Code 0 is taken as no depth; something must be measured."""
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
