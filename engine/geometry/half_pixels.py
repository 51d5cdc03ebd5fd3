"""Rays through every half pixel of a camera's picture, where points of meshes may lie."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import numpy.typing as npt

from ..kernels.geometry.records import Rays
from ..rig.camera import Camera, Perspective, Projection
from ..support.array_types import F64

__all__ = ["half_pixel_rays"]


def half_pixel_rays(camera: Camera, origin: npt.ArrayLike) -> Rays:
    """Directions at every half pixel, and the packed camera relative to the origin."""
    return Rays(camera.packed(origin), *_directions(camera.projection))


@lru_cache(maxsize=32)  # the cameras of a rig mostly share them; 100 KB for a view of 2048 x 2048 pixels
def _directions(projection: Projection) -> tuple[F64, F64]:
    """Directions across [2 w + 1, 2] and down [2 h - 1, 2] (see `kernels.geometry.records.Rays`)."""
    width, height = projection.width, projection.height
    u, v = 0.5 * np.arange(2 * width + 1) + 0.5, 0.5 * np.arange(2 * height - 1) + 0.5
    if isinstance(projection, Perspective):
        across = np.stack([np.ones_like(u), (projection.cx - u) / projection.fx], axis=-1)
        return across, np.stack([np.ones_like(v), (projection.cy - v) / projection.fy], axis=-1)
    (right, left), (bottom, top) = projection.hor_range, projection.ver_range
    phi, theta = left - u * ((left - right) / width), top - v * ((top - bottom) / height)
    across, down = (np.stack([np.cos(angle), np.sin(angle)], axis=-1) for angle in (phi, theta))
    return across, down
