"""How far the colour of a view's texels is trusted: at a depth edge it is a mixture of both surfaces' colours."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

__all__ = ["MIXED", "TRUSTED", "mark_mixed"]

TRUSTED = 255
MIXED = 8  # still something: where no other view sees a surface, its rim is painted with it

U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def mark_mixed(codes: U16, edge: float, confidence: U8) -> None:
    """confidence [h, w]: MIXED where a neighbour left, right, above or below is more than `edge` codes away."""
    h, w = codes.shape
    for row in numba.prange(h):
        y = np.int64(row)
        here, above, below, out = codes[y], codes[max(y - 1, np.int64(0))], codes[min(y + 1, h - 1)], confidence[y]
        for x in range(w):
            c = np.int32(here[x])
            up, down = abs(np.int32(above[x]) - c), abs(np.int32(below[x]) - c)
            left, right = abs(np.int32(here[max(x - 1, 0)]) - c), abs(np.int32(here[min(x + 1, w - 1)]) - c)
            out[x] = MIXED if max(max(up, down), max(left, right)) > edge else TRUSTED
