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
from ..support.runtime import one_thread
from .tiles import HoleMap, Tiles

__all__ = ["fill", "rise_per_pixel"]

_FADE_PX = 8.0  # distance from the rim, pixels, at which half of the structure has faded into smooth colours
_LAYERS = 32  # distance from the rim, pixels, beyond which all is smooth
_DISC = structure.disc_weights(2.5, 2.0)
_BLOCK = 64  # side of blocks, pixels: only blocks with holes, and their neighbours, contribute to the filling
_FEW = 50_000  # elements of a level below which threads cost more time than they save

Plane = npt.NDArray[np.float32]


def rise_per_pixel(target: Camera, views: Sequence[Camera]) -> float:
    """Disparity (1/m), per pixel of a hole's width, by which the surface that hid it is nearer than the one behind.

    Two surfaces with disparities p and q move apart by (p - q) b f pixels for a viewer b metres away from the camera
    that saw them, with f pixels per radian. Here b is the distance of the farthest of the views.
    """
    position = np.array(target.pose.position)
    baselines = [float(np.linalg.norm(position - view.pose.position)) for view in views]
    return 1.0 / (pixels_per_radian(target) * max(*baselines, 1e-6, 1e-6))


def fill(
    disparity: Plane, planes: tuple[Plane, Plane, Plane], rise: float, holes: HoleMap | None = None, *,
    structured: bool = True,
) -> I32:  # fmt: skip
    """Colour the holes of [h, w] planes in place from their neighbourhood, farther surfaces first (section 3.4.3).

    Disparity (1/m) is 0 in holes; at least one pixel must have been drawn. `holes`: the holes, if known. `rise`
    distinguishes the hidden surface from the one that hides it (see `rise_per_pixel`). With `structured`, the hidden
    surface is continued along its structure near the rims; otherwise the filling is smooth. Returns the holes' rows and
    columns int32 [n, 2] in reading order.
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
    """The finest level of the pyramid, complete in the blocks with near != 0 (`HoleMap.neighbourhood`)."""
    levels = empty_levels(disparity.shape, kernels.CELL)
    kernels.first_level(disparity, *planes, near, _BLOCK // kernels.CELL, levels[0])
    for fine, coarse in itertools.pairwise(levels):
        with one_thread(fine.size <= _FEW):
            kernels.next_level(fine, coarse)
    for fine, coarse in zip(levels[-2::-1], levels[:0:-1], strict=True):
        with one_thread(fine.size <= _FEW):
            kernels.refine_level(coarse, fine)
    return levels[0]
