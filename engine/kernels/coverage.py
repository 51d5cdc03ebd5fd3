"""Which pixels of a view show something farther than an earlier view does (section 3.3.2)."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from .project import project_point, unproject_point

__all__ = ["keep_farther"]

U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
F64 = npt.NDArray[np.float64]


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
            if not (there > 0.0 and u >= 0.0 and v >= 0.0 and u < ew and v < eh):
                continue
            seen = earlier_codes[int(v), int(u)]
            if seen < earlier_coding[2]:
                continue
            if there <= 1.0 / (earlier_coding[0] + earlier_coding[1] * max(float(seen), earlier_coding[3])) + tolerance_m:
                keep[y, x] = 0
