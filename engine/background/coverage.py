"""Coverage selection chooses the views that build the S-PBS, the farther-only test their pixels (section 3.3.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..kernels.background import coverage as kernels
from ..kernels.background import farther_only
from ..kernels.base.tolerance import Delta
from ..rig.frame import View
from ..support.packed import Coding

__all__ = ["Coverage", "choose_views"]

# Views are warped as a grid of about _SAMPLES x _SAMPLES samples into _CELLS x _CELLS cells, not pixel by pixel: the
# order of the views depends on the share of a picture that is covered, not on the outline of that part.
_SAMPLES = 64
_CELLS = 32


def choose_views(views: Sequence[View], count: int) -> list[int]:
    """Indices of up to `count` views that overlap little (section 3.3.2), beginning with the first view.

    The next view is always the one whose picture is covered least by the chosen views warped into it.
    """
    packed = np.array([view.camera.packed() for view in views])
    chosen: list[int] = []
    covered = np.zeros((len(views), _CELLS, _CELLS), np.uint8)
    for _ in range(min(count, len(views))):
        share = covered.mean(axis=(1, 2))
        share[chosen] = np.inf
        chosen.append(int(np.argmin(share)))
        view = views[chosen[-1]]
        stride = max(1, math.ceil(max(view.codes.shape) / _SAMPLES))
        kernels.cover_cells(view.codes, packed[chosen[-1]], view.camera.depth.packed(), stride, packed, covered)
    return chosen


class _Added(NamedTuple):
    view: farther_only.DepthView
    coding: Coding
    edge: float  # in codes


class Coverage:
    """The surfaces in the views that have been added so far.

    `delta`: surfaces within this distance count as one; `origin`: the scene's, metres in the world.
    """

    def __init__(self, delta: Delta, origin: npt.ArrayLike = (0.0, 0.0, 0.0)) -> None:
        self._delta, self._origin = delta, origin
        self._added: list[_Added] = []

    def keep_farther(self, view: View, edge: float) -> npt.NDArray[np.uint8]:  # [h, w]
        """Adds a view; 1 where it shows a surface to be kept: at that place, no earlier view shows the same surface, or
        one about as far or farther. (The paper tests the three corners of a triangle, this tests each pixel.)

        `edge`: the disparity step between neighbouring pixels that is a depth edge, 1/m.
        """
        codes, coding = view.codes, view.camera.depth.packed()
        blocks = [max(1, math.ceil((size - 1) / farther_only.BLOCK)) for size in codes.shape]
        smooth = np.empty(blocks, np.uint8)
        farther_only.mark_smooth(codes, coding, self._delta, smooth)
        depth = farther_only.DepthView(codes, view.camera.packed(self._origin), smooth)
        new = _Added(depth, coding, edge / coding.step)
        keep = np.ones(codes.shape, np.uint8)
        for old in self._added:
            farther_only.keep_farther(depth, coding, *old, self._delta, keep)
        self._added.append(new)
        return keep
