"""A camera's part of the P-PBS: which pixels belong to it, and what its triangles inherit (section 3.3.3)."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from .rays import farthest_hit

__all__ = ["accept_candidates", "clear_culled", "inherit_marks", "paint_triangles"]

U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
U64 = npt.NDArray[np.uint64]
F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]

# A candidate needs this many of its eight neighbours to be in the P-PBS, or accepted, as well: what someone uncovers
# is a region, a wrong depth mostly a lone pixel. A corner of two by two pixels has three.
_NEIGHBOURS = 3
_ACCEPTED, _CONFIRMED = 2, 3  # in `kept`, while candidates are looked at


@numba.njit(inline="always", cache=True)
def _neighbours(kept: U8, y: int, x: int) -> int:
    """How many of the eight pixels around one are kept."""
    count = 0
    for row in range(max(y - 1, 0), min(y + 2, kept.shape[0])):
        for column in range(max(x - 1, 0), min(x + 2, kept.shape[1])):
            count += kept[row, column] != 0
    return count - 1


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def accept_candidates(
    function: int, scene: int, camera: F64, bounds: F64, coding: F64, codes: U16, updated: U8, kept: U8,
    delta: float, counts: I64,
) -> None:  # fmt: skip
    """The filter of Fig. 6b: an updated pixel is kept if its point is more than delta behind the farthest hit.

    Clears `updated` [h, w], but for lone pixels: these are candidates again next time. counts [h, 3]: candidates,
    accepted ones, and pixels that were kept before and have changed. coding as in `coverage.keep_farther`.
    """
    h, w = codes.shape
    for y in numba.prange(h):
        candidates, changed = 0, 0
        for x in range(w):
            if updated[y, x] == 0:
                continue
            updated[y, x] = 0
            candidates += 1
            if kept[y, x] != 0:
                changed += 1
                continue
            # Off the outermost pixels' centres, where the mesh ends: rays there may just miss it.
            u, v = min(max(x + 0.5, 0.51), w - 0.51), min(max(y + 0.5, 0.51), h - 0.51)
            distance, _u, _v, _geometry, _primitive, length = farthest_hit(function, scene, camera, bounds, u, v)
            depth = 1.0 / (coding[0] + coding[1] * max(float(codes[y, x]), coding[3]))
            if distance < 0.0:
                kept[y, x] = _CONFIRMED  # a hole in the PBS is filled, be it a pixel's
            elif depth * length > distance + delta:
                kept[y, x] = _ACCEPTED
        counts[y, 0], counts[y, 1], counts[y, 2] = candidates, 0, changed
    for y in numba.prange(h):
        for x in range(w):
            if kept[y, x] == _ACCEPTED and _neighbours(kept, y, x) >= _NEIGHBOURS:
                kept[y, x] = _CONFIRMED  # still not zero, which is all that its neighbours ask
    for y in numba.prange(h):
        for x in range(w):
            if kept[y, x] == _CONFIRMED:
                kept[y, x] = 1
                counts[y, 1] += 1
            elif kept[y, x] == _ACCEPTED:
                kept[y, x] = 0
                updated[y, x] = 1


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def paint_triangles(uv: F32, triangles: I32, invalid: U8, wraps: bool, numbers: I32) -> None:
    """Writes each valid triangle's number to all pixels whose centre it covers or touches; the rest are left."""
    h, w = numbers.shape
    for i in numba.prange(triangles.shape[0]):
        if invalid[i] != 0:
            continue
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        ax, ay, bx, by = uv[a, 0], uv[a, 1], uv[b, 0], uv[b, 1]
        cx, cy = uv[c, 0], uv[c, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        sign = 1.0 if area > 0 else -1.0
        for y in range(max(0, math.ceil(min(ay, by, cy) - 0.5)), min(h - 1, math.floor(max(ay, by, cy) - 0.5)) + 1):
            for x in range(math.ceil(min(ax, bx, cx) - 0.5), math.floor(max(ax, bx, cx) - 0.5) + 1):
                px, py = x + 0.5, y + 0.5
                if (
                    sign * ((bx - ax) * (py - ay) - (by - ay) * (px - ax)) >= 0.0
                    and sign * ((cx - bx) * (py - by) - (cy - by) * (px - bx)) >= 0.0
                    and sign * ((ax - cx) * (py - cy) - (ay - cy) * (px - cx)) >= 0.0
                    and (wraps or (x >= 0 and x < w))
                ):
                    numbers[y, x % w] = i


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def clear_culled(numbers: I32, kept: U8) -> None:
    """A kept pixel that no valid triangle touches any more is kept no longer."""
    for y in numba.prange(kept.shape[0]):
        for x in range(kept.shape[1]):
            if numbers[y, x] < 0:
                kept[y, x] = 0


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def inherit_marks(uv: F32, triangles: I32, numbers: I32, old: U64, new: U64) -> None:
    """A new triangle gets the marks of the old one at its centroid, or none."""
    h, w = numbers.shape
    for i in numba.prange(triangles.shape[0]):
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        x = int((uv[a, 0] + uv[b, 0] + uv[c, 0]) / 3.0) % w
        y = min(int((uv[a, 1] + uv[b, 1] + uv[c, 1]) / 3.0), h - 1)
        before = numbers[y, x]
        for word in range(new.shape[1]):
            new[i, word] = old[before, word] if before >= 0 else numba.uint64(0)
