"""Records as kernels take them: the layout of a packed camera, and how a view codes depth.

No other module knows the position of a number in a record. This module imports neither Numba nor another room, so a
program that only describes cameras loads no compiler.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = [
    "CAMERA_SIZE",
    "CX",
    "CY",
    "EQUIRECTANGULAR",
    "FORWARD_X",
    "FORWARD_Y",
    "FORWARD_Z",
    "FX",
    "FY",
    "HEIGHT",
    "KIND",
    "LEFT_X",
    "LEFT_Y",
    "LEFT_Z",
    "PERSPECTIVE",
    "PHI_MAX",
    "POSITION",
    "POSITION_SLICE",
    "POSITION_X",
    "POSITION_Y",
    "POSITION_Z",
    "PROJECTION_SLICE",
    "RADIANS_A_COLUMN",
    "RADIANS_A_ROW",
    "ROTATION",
    "ROTATION_SLICE",
    "THETA_MAX",
    "UP_X",
    "UP_Y",
    "UP_Z",
    "WIDTH",
    "WRAPS",
    "Coding",
]

# A packed camera is float64 [CAMERA_SIZE]; its position is relative to the scene's origin, metres.
KIND, WIDTH, HEIGHT = 0, 1, 2
FX, FY, CX, CY = 3, 4, 5, 6  # of a perspective camera, pixels
PHI_MAX, RADIANS_A_COLUMN, THETA_MAX, RADIANS_A_ROW = 3, 4, 5, 6  # of an equirectangular one
# Rotation, world from camera, 3 x 3 and row-major: its columns are the camera's axes in the world's.
FORWARD_X, LEFT_X, UP_X = 7, 8, 9
FORWARD_Y, LEFT_Y, UP_Y = 10, 11, 12
FORWARD_Z, LEFT_Z, UP_Z = 13, 14, 15
POSITION_X, POSITION_Y, POSITION_Z = 16, 17, 18
WRAPS = 19  # 1 where the picture's first and last column are neighbours
CAMERA_SIZE = 20
ROTATION, POSITION = FORWARD_X, POSITION_X  # where the rotation and the position begin
# Parts of arrays of cameras [..., CAMERA_SIZE].
PROJECTION_SLICE = slice(FX, ROTATION)  # 4
ROTATION_SLICE = slice(ROTATION, POSITION)  # 9
POSITION_SLICE = slice(POSITION, WRAPS)  # 3

PERSPECTIVE, EQUIRECTANGULAR = 0.0, 1.0  # kinds


class Coding(NamedTuple):
    """How a view codes depth, as kernels take it.

    The disparity of a code, 1/m, is offset + step * max(code, min_code). A code below `least` means "no depth".
    """

    offset: float  # 1/m
    step: float  # 1/m
    least: int  # the least code that is a depth: 1 where code 0 means "no depth", else 0
    min_code: int  # the least code that stands for a finite depth
    max_code: int
