"""Directions through the pixels of an eye's picture: a part for each column, and one for each row."""

from __future__ import annotations

import math

from ...support.array_types import F32, F64
from ...support.packed import CX, CY, FX, FY, KIND, PERSPECTIVE, PHI_MAX, RADIANS_A_COLUMN, RADIANS_A_ROW, THETA_MAX
from ..base.jit import inlined, serial

__all__ = ["column_directions", "row_direction"]


@serial
def column_directions(camera: F64, width: int, across: F32 | F64) -> None:
    """across [2, >= width]: the part of the eye's directions that depends on the column (`row_direction`)."""
    for x in range(width):
        if camera[KIND] == PERSPECTIVE:
            across[0, x], across[1, x] = 1.0, (camera[CX] - (x + 0.5)) / camera[FX]
        else:
            phi = camera[PHI_MAX] - (x + 0.5) * camera[RADIANS_A_COLUMN]
            across[0, x], across[1, x] = math.cos(phi), math.sin(phi)
    for x in range(width, across.shape[1]):
        across[0, x] = across[1, x] = 0.0


@inlined
def row_direction(camera: F64, y: int) -> tuple[float, float]:
    """Scale and height of a row: the direction of depth 1 is (scale * across[0], scale * across[1], height)."""
    if camera[KIND] == PERSPECTIVE:
        return 1.0, (camera[CY] - (y + 0.5)) / camera[FY]
    theta = camera[THETA_MAX] - (y + 0.5) * camera[RADIANS_A_ROW]
    return math.cos(theta), math.sin(theta)
