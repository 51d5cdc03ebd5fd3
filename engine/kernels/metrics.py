"""Corresponding pixel shift: how far each pixel is from the best match near its place in another picture."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["SEARCH_RANGE", "match_errors"]

SEARCH_RANGE = 2  # pixels each way: a 5x5 neighbourhood


@numba.njit(cache=True, error_model="numpy", parallel=True, nogil=True)
def match_errors(
    picture: npt.NDArray[np.uint16],  # [3, h, w]
    other: npt.NDArray[np.uint16],  # [3, h, w]
    shift: npt.NDArray[np.int64],  # [3], added to picture
    weights: npt.NDArray[np.int64],  # [3], of the squared errors when matches are compared
) -> npt.NDArray[np.int64]:  # [h, 3]
    """Squared errors of every pixel of `picture` to its best match in `other`, summed over each row."""
    _, height, width = picture.shape
    rows = np.zeros((height, 3), np.int64)
    for y in numba.prange(height):
        top, bottom = max(0, y - SEARCH_RANGE), min(height, y + SEARCH_RANGE + 1)
        sums = (np.int64(0), np.int64(0), np.int64(0))
        for x in range(width):
            left, right = max(0, x - SEARCH_RANGE), min(width, x + SEARCH_RANGE + 1)
            c0, c1, c2 = (
                picture[0, y, x] + shift[0],
                picture[1, y, x] + shift[1],
                picture[2, y, x] + shift[2],
            )
            least, best = np.iinfo(np.int64).max, sums
            for v in range(top, bottom):
                for u in range(left, right):
                    e0, e1, e2 = (
                        (c0 - other[0, v, u]) ** 2,
                        (c1 - other[1, v, u]) ** 2,
                        (c2 - other[2, v, u]) ** 2,
                    )
                    error = weights[0] * e0 + weights[1] * e1 + weights[2] * e2
                    if error < least:
                        least, best = error, (e0, e1, e2)
            sums = (sums[0] + best[0], sums[1] + best[1], sums[2] + best[2])
        rows[y, 0], rows[y, 1], rows[y, 2] = sums
    return rows
