"""Disocclusion filling (paper section 3.4.3)."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..geometry.prepared_view import pixels_per_radian
from ..geometry.pyramid import empty_levels
from ..kernels.rendering import fill as kernels
from ..kernels.rendering import structure
from ..kernels.rendering.records import Planes
from ..kernels.rendering.tiles import TILE
from ..rig.camera import Camera
from ..support.array_types import I32
from .tiles import HoleMap, Tiles

__all__ = ["fill", "rise_per_pixel"]

_FADE_PX = 8.0  # how far structure is carried into a hole before half of it has faded into something smooth
_LAYERS = 32  # pixels from the rim beyond which all is smooth
_DISC = structure.disc_weights(2.5, 2.0)
_BLOCK = 64  # pixels a side: a block without holes, beside none that has any, gives nothing to what fills them
_FEW = 50_000  # elements of a level below which threads cost more than they bring

Plane = npt.NDArray[np.float32]


def rise_per_pixel(target: Camera, views: Sequence[Camera]) -> float:
    """Disparity (1/m) by which what hides a hole is nearer than what goes on there, for each pixel between them.

    Two surfaces of disparities p and q part by (p - q) b f pixels for a viewer who is b metres from the camera that
    saw them, f the pixels a radian; b is the farthest view's here.
    """
    position = np.array(target.pose.position)
    baselines = [float(np.linalg.norm(position - view.pose.position)) for view in views]
    return 1.0 / (pixels_per_radian(target) * max(*baselines, 1e-6, 1e-6))


def fill(
    disparity: Plane, planes: tuple[Plane, Plane, Plane], rise: float, holes: HoleMap | None = None, *,
    structured: bool = True,
) -> I32:  # fmt: skip
    """Colour the holes of [h, w] planes in place from their neighbourhood, farther surfaces first.

    Where disparity (1/m) is 0 nothing was drawn; somewhere something must have been. `holes`: where, if known.
    `rise` tells what is hidden from what hides it (see `rise_per_pixel`). With `structured` what is hidden goes on
    along its structure near its rims; otherwise all is smooth. Returns the holes' rows and columns int32 [n, 2] in
    reading order.
    """
    holes = holes or HoleMap.of(disparity)
    places, index = holes.listed(disparity)
    depths, layer = np.empty((len(places), 2), np.float32), np.zeros(disparity.shape, np.int32)
    listed = structure.Holes(places, index, holes.rims(disparity, index))
    structure.spread_depths(disparity, listed, rise, depths)
    if structured:
        structure.continue_structure(disparity, listed, depths, _LAYERS, _DISC, layer, Planes(*planes))
    smooth = _smooth_level(disparity, planes, holes.neighbourhood(_BLOCK // TILE))
    kernels.fade_into_smooth(places, layer, smooth, _FADE_PX, disparity, *planes)
    return places


def _smooth_level(disparity: Plane, planes: tuple[Plane, Plane, Plane], near: Tiles) -> Plane:
    """The finest level of the pyramid, complete in blocks of pixels that are `near` holes."""
    levels = empty_levels(disparity.shape, kernels.CELL)
    kernels.first_level(disparity, *planes, near, _BLOCK // kernels.CELL, levels[0])
    for fine, coarse in itertools.pairwise(levels):
        (kernels.next_level if fine.size > _FEW else kernels.next_level_serially)(fine, coarse)
    for fine, coarse in zip(levels[-2::-1], levels[:0:-1], strict=True):
        (kernels.refine_level if fine.size > _FEW else kernels.refine_level_serially)(coarse, fine)
    return levels[0]
