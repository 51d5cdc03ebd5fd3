"""Where the points of a view lie in the pictures of other cameras: which views build the S-PBS (section 3.3.2)."""

from __future__ import annotations

import math

import numba

from ...support.array_types import F64, U8, U16
from ...support.packed import HEIGHT, WIDTH, Coding
from ..base.jit import parallel
from ..base.project import project_point, unproject_point
from .farther_only import depth_of_code

__all__ = ["cover_cells"]


@parallel
def cover_cells(codes: U16, camera: F64, coding: Coding, stride: int, others: F64, covered: U8) -> None:
    """Sets the cells covered[k] [n, n] of the pictures of other cameras [k, CAMERA_SIZE] in which points of the view
    lie. Only every stride-th pixel of the view in both directions is projected."""
    h, w = codes.shape
    n = covered.shape[1]
    for k in numba.prange(others.shape[0]):
        for y in range(0, h, stride):
            for x in range(0, w, stride):
                if codes[y, x] < coding.least:
                    continue
                px, py, pz = unproject_point(camera, x + 0.5, y + 0.5, depth_of_code(codes[y, x], coding))
                u, v, there = project_point(others[k], px, py, pz)
                column, row = math.floor(u * n / others[k, WIDTH]), math.floor(v * n / others[k, HEIGHT])
                if there > 0.0 and column >= 0 and row >= 0 and column < n and row < n:
                    covered[k, row, column] = 1
