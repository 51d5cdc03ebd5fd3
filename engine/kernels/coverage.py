"""Which pixels of a view show something farther than an earlier view does (section 3.3.2)."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from .project import project_point, unproject_point

__all__ = ["keep_farther"]

U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
F64 = npt.NDArray[np.float64]


@numba.njit(inline="always", cache=True, error_model="numpy")
def _hides_all(codes: U16, coding: F64, wraps: bool, u: float, v: float, limit: float) -> bool:
    """Whether there are four pixels around (u, v), and all see something at least as far as `limit`, metres.

    All four, so that meshes overlap by a pixel where one ends at the rim of something nearer or of its picture.
    """
    h, w = codes.shape
    x0, y0 = math.floor(u - 0.5), math.floor(v - 0.5)
    if y0 < 0 or y0 + 1 >= h or (not wraps and (x0 < 0 or x0 + 1 >= w)):
        return False
    for k in range(4):
        code = codes[y0 + (k >> 1), (x0 + (k & 1)) % w]
        if code < coding[2] or 1.0 / (coding[0] + coding[1] * max(float(code), coding[3])) < limit:
            return False
    return True


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def keep_farther(
    codes: U16, camera: F64, coding: F64, earlier_codes: U16, earlier_camera: F64, earlier_coding: F64,
    tolerance_m: float, keep: U8,
) -> None:  # fmt: skip
    """Clears keep [h, w] where an earlier view sees the pixel's point, or something about as far or farther.

    A coding is [offset, step, smallest valid code, smallest usable code]; cameras are packed.
    """
    h, w = codes.shape
    eh, ew = earlier_codes.shape
    for y in numba.prange(h):
        for x in range(w):
            code = codes[y, x]
            if keep[y, x] == 0 or code < coding[2]:
                continue
            depth = 1.0 / (coding[0] + coding[1] * max(float(code), coding[3]))
            px, py, pz = unproject_point(camera, x + 0.5, y + 0.5, depth)
            u, v, there = project_point(earlier_camera, px, py, pz)
            if there > 0.0 and u >= 0.0 and v >= 0.0 and u < ew and v < eh:
                limit = there - tolerance_m
                if _hides_all(earlier_codes, earlier_coding, earlier_camera[19] != 0.0, u, v, limit):
                    keep[y, x] = 0
