"""Lines from cameras to points."""

from __future__ import annotations

from ...support.array_types import F64
from ...support.packed import POSITION_X, POSITION_Y, POSITION_Z
from ..base.jit import inlined

__all__ = ["along", "from_camera"]


@inlined
def from_camera(camera: F64, x: float, y: float, z: float) -> tuple[float, float, float]:
    """The vector from a camera (packed) to a point, in the world's axes, metres."""
    return x - camera[POSITION_X], y - camera[POSITION_Y], z - camera[POSITION_Z]


@inlined
def along(camera: F64, distance: float, dx: float, dy: float, dz: float) -> tuple[float, float, float]:
    """The point at a camera's position (packed) plus `distance` times a direction."""
    return (
        camera[POSITION_X] + distance * dx, camera[POSITION_Y] + distance * dy, camera[POSITION_Z] + distance * dz
    )  # fmt: skip
