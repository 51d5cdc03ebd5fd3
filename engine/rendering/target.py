"""A virtual camera as kernels read it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..geometry.prepared_view import pixels_per_radian
from ..kernels.rendering.spherical import Directions
from ..rig.camera import Camera, Equirectangular

__all__ = ["Target"]


class Target:
    """A virtual camera as kernels read it."""

    def __init__(self, camera: Camera, origin: npt.NDArray[np.float64]) -> None:
        self.packed = camera.packed(origin)
        self.directions = _directions(camera)
        self.radians_a_pixel = 1.0 / pixels_per_radian(camera)


def _directions(camera: Camera) -> Directions:
    """Cosines and sines [w, 2] of an equirectangular camera's azimuths and [h, 2] of its elevations."""
    p = camera.projection
    if not isinstance(p, Equirectangular):
        return Directions(np.empty((0, 2), np.float32), np.empty((0, 2), np.float32))
    phi = p.hor_range[1] - (np.arange(p.width) + 0.5) * (p.hor_range[1] - p.hor_range[0]) / p.width
    theta = p.ver_range[1] - (np.arange(p.height) + 0.5) * (p.ver_range[1] - p.ver_range[0]) / p.height
    tables = (np.stack([np.cos(angle), np.sin(angle)], axis=-1) for angle in (phi, theta))
    columns, rows = (table.astype(np.float32) for table in tables)
    return Directions(columns, rows)
