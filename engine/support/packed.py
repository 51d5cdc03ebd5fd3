"""Records as kernels take them: the layout of a packed camera, and how a view codes depth.

Nothing else knows at which place of a record a number lies. Neither Numba nor any other room is needed to read it:
a program that only describes cameras loads no compiler.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = [
    "CAMERA_SIZE",
    "CX",
    "CY",
    "EQUIRECTANGULAR",
    "FX",
    "FY",
    "HEIGHT",
    "KIND",
    "PERSPECTIVE",
    "PHI_MAX",
    "POSITION",
    "RADIANS_A_COLUMN",
    "RADIANS_A_ROW",
    "ROTATION",
    "THETA_MAX",
    "WIDTH",
    "WRAPS",
    "Coding",
]

# A packed camera is float64 [CAMERA_SIZE]; its position is relative to the scene's origin, metres.
KIND, WIDTH, HEIGHT = 0, 1, 2
FX, FY, CX, CY = 3, 4, 5, 6  # of a perspective camera, pixels
PHI_MAX, RADIANS_A_COLUMN, THETA_MAX, RADIANS_A_ROW = 3, 4, 5, 6  # of an equirectangular one
ROTATION = 7  # 3 x 3, row-major: world from camera
POSITION = 16  # 3
WRAPS = 19  # 1 where the picture's first and last column are neighbours
CAMERA_SIZE = 20

PERSPECTIVE, EQUIRECTANGULAR = 0.0, 1.0  # kinds


class Coding(NamedTuple):
    """How depth is coded: disparity, 1/m, is offset + step * max(code, min_code); what is below `least` is no depth."""

    offset: float
    step: float
    least: int  # the least code that is a depth: 1 where code 0 means "no depth", else 0
    min_code: int  # the least code that stands for a finite depth
    max_code: int
