"""Triangles of a depth map whose blocks' splits are known (`kernels.splits`).

A block's triangles are found a row of equal ones at a time, by operations on words: one is there where the vertex at
its right angle is split and the middle of its longest side is not. Of half quads, the smallest, those that a depth
edge crosses are left out. Vertices are numbered along a block's rows.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from . import lanes
from .cuts import BROKEN, CUT_DOWN, CUT_RIGHT, KEPT, VALID
from .splits import BLOCK, EMPTY, EVEN, MIXED, ODD, SIDE

__all__ = ["BOTH", "BROKEN", "CUT_DOWN", "CUT_RIGHT", "RIMS", "SURFACE", "count_triangles", "emit_triangles"]

U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]

# What is made: the surface, which ends at the centres of pixels at depth edges; the rims, which are what is left of
# those pixels' squares; or both, which share at most half a quad where a merged triangle reaches into a cut one.
SURFACE, RIMS, BOTH = 0, 1, 2

_RIGHT, _DOWN, _KEPT, _VALID = 0, 1, 2, 3  # words of a row of pixels
_ALL = (1 << SIDE) - 1


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _read_flags(flags: U8, x0: int, y0: int, wraps: bool, state: int, bits: I64) -> None:
    """bits [4, 33]: cuts, mask and validity of a block's pixels as words; of MIXED blocks only."""
    h, w = flags.shape
    bits[:2], bits[2:] = 0, _ALL
    if state != MIXED:
        return
    if x0 + BLOCK < w and y0 + BLOCK < h and (y0 + BLOCK) * w + x0 + lanes.LANES <= h * w:
        for y in range(SIDE):
            at = flags.ctypes.data + (y0 + y) * w + x0
            bits[_RIGHT, y] = lanes.bits_of(at, CUT_RIGHT) & _ALL
            bits[_DOWN, y] = lanes.bits_of(at, CUT_DOWN) & _ALL
            bits[_KEPT, y] = lanes.bits_of(at, KEPT) & _ALL
            bits[_VALID, y] = lanes.bits_of(at, VALID) & _ALL
        return
    bits[:] = 0
    limit = w if wraps else w - 1
    for y in range(min(SIDE, h - y0)):
        for x in range(min(SIDE, limit + 1 - x0)):
            flag = np.int64(flags[y0 + y, (x0 + x) % w])
            bits[_RIGHT, y] |= ((flag & CUT_RIGHT) != 0) << x
            bits[_DOWN, y] |= ((flag & CUT_DOWN) != 0) << x
            bits[_KEPT, y] |= ((flag & KEPT) != 0) << x
            bits[_VALID, y] |= ((flag & VALID) != 0) << x


@numba.njit(inline="always", cache=True)
def _moved(word: int, columns: int) -> int:
    """A word's bits so many columns to the right."""
    return word << columns if columns >= 0 else word >> -columns


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _put(
    word: int, y: int, ax: int, ay: int, bx: int, by: int, cx: int, cy: int,
    used: I64, numbers: I32, triangles: I32, at: int,
) -> int:  # fmt: skip
    """Triangles a, b, c at offsets from the bits of a word in row y, from number `at` on; returns the next number.

    With no room for triangles their vertices are marked as used instead.
    """
    if triangles.shape[0] == 0:
        used[y + ay] |= _moved(word, ax)
        used[y + by] |= _moved(word, bx)
        used[y + cy] |= _moved(word, cx)
        return at + lanes.ones(word)
    row_a, row_b, row_c = used[y + ay], used[y + by], used[y + cy]
    first_a, first_b, first_c = numbers[y + ay], numbers[y + by], numbers[y + cy]
    while word != 0:
        x = lanes.lowest(word)
        word &= word - 1
        triangles[at, 0] = first_a + lanes.ones(row_a & ((1 << (x + ax)) - 1))
        triangles[at, 1] = first_b + lanes.ones(row_b & ((1 << (x + bx)) - 1))
        triangles[at, 2] = first_c + lanes.ones(row_c & ((1 << (x + cx)) - 1))
        at += 1
    return at


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _put_merged(
    splits: I64, kept: I64, s: int, parity: int, columns: int, rows: int,
    used: I64, numbers: I32, triangles: I32, at: int,
) -> int:  # fmt: skip
    """Triangles with the middle of their longest side on a side or in the middle of a square of size 2s.

    columns and rows: of the block's vertices that lie in the picture. Wound counter-clockwise on screen (v down).
    """
    inside = (1 << columns) - 1
    n, root = -s, 2 * s == BLOCK
    for y in range(s, min(BLOCK, rows), 2 * s):
        here = splits[y] & ODD[s] & inside & kept[y]
        if here != 0:  # a square in four: those with whole sides
            for word, ax, ay, bx, by in (
                (here & ~splits[y - s], n, n, s, n), (here & ~splits[y + s], s, s, n, s),
                (here & ~(splits[y] << s), n, s, n, n), (here & ~(splits[y] >> s), s, n, s, s),
            ):  # fmt: skip
                if word != 0:
                    at = _put(word, y, ax, ay, 0, 0, bx, by, used, numbers, triangles, at)
        here = ~splits[y] & ODD[s] & kept[y]
        if here == 0:
            continue
        falling = ODD[2 * s] >> s
        if (y // (2 * s) + (parity if root else 0)) % 2 == 1:
            falling = ~falling
        # A square in two: the halves whose right angle's vertex is split, or that are the block's own.
        above, below = (-1, -1) if root else (splits[y - s], splits[y + s])
        for word, ax, ay, cx, cy in (
            (here & falling & (above >> s), n, n, s, n), (here & falling & (below << s), s, s, n, s),
            (here & ~falling & (above << s), n, s, n, n), (here & ~falling & (below >> s), s, n, s, s),
        ):  # fmt: skip
            if word != 0:
                at = _put(word, y, ax, ay, -ax, -ay, cx, cy, used, numbers, triangles, at)
    return at


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _put_half_quads(
    splits: I64, bits: I64, columns: int, rows: int, whole: bool, used: I64, numbers: I32, triangles: I32, at: int
) -> int:
    """The smallest triangles; with `whole`, none in quads that a depth edge crosses anywhere."""
    quads = (1 << (columns - 1)) - 1
    for y in range(rows - 1):
        if (splits[y] | splits[y + 1]) == 0:
            continue
        falling = EVEN[1] if y % 2 == 0 else ODD[1]  # diagonals join pixels with even x + y
        top, bottom = bits[_RIGHT, y], bits[_RIGHT, y + 1]
        left, right = bits[_DOWN, y], bits[_DOWN, y] >> 1
        if whole:
            top = bottom = left = right = top | bottom | left | right
        a, b, c, d = bits[_KEPT, y], bits[_KEPT, y] >> 1, bits[_KEPT, y + 1], bits[_KEPT, y + 1] >> 1
        for word, ax, ay, cx, cy in (
            (falling & (splits[y] >> 1) & ~(top | right) & (a | b | d), 0, 0, 1, 0),
            (falling & splits[y + 1] & ~(bottom | left) & (a | c | d), 1, 1, 0, 1),
            (~falling & splits[y] & ~(top | left) & (a | b | c), 0, 1, 0, 0),
            (~falling & (splits[y + 1] >> 1) & ~(bottom | right) & (b | c | d), 1, 0, 1, 1),
        ):
            if word & quads:
                at = _put(word & quads, y, ax, ay, 1 - ax, 1 - ay, cx, cy, used, numbers, triangles, at)
    return at


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _put_surface(
    splits: I64, bits: I64, parity: int, columns: int, rows: int, whole: bool,
    used: I64, numbers: I32, triangles: I32, at: int,
) -> int:  # fmt: skip
    """All triangles of a block's surface; see `_put`."""
    s = BLOCK // 2
    while s > 0:
        at = _put_merged(splits, bits[_KEPT], s, parity, columns, rows, used, numbers, triangles, at)
        s //= 2
    return _put_half_quads(splits, bits, columns, rows, whole, used, numbers, triangles, at)


@numba.njit(inline="always", cache=True)
def _cut_quads(bits: I64, y: int, columns: int) -> int:
    """The quads of row y that a depth edge crosses."""
    crossed = bits[_RIGHT, y] | bits[_RIGHT, y + 1] | bits[_DOWN, y] | (bits[_DOWN, y] >> 1)
    return crossed & ((1 << (columns - 1)) - 1)


@numba.njit(inline="always", cache=True)
def _corner(bits: I64, x: int, y: int) -> int:
    """The quads of row y whose corner (x, y) is kept and valid."""
    return (bits[_KEPT, y] & bits[_VALID, y]) >> x


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _count_rims(bits: I64, columns: int, rows: int) -> int:
    """How many quarters of quads the rims are."""
    quarters = 0
    for y in range(rows - 1):
        crossed = _cut_quads(bits, y, columns)
        if crossed != 0:
            for k in range(4):
                quarters += lanes.ones(crossed & _corner(bits, k & 1, y + (k >> 1)))
    return quarters


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def count_triangles(
    flags: U8, splits: I64, states: U8, wraps: bool, parts: int, used: I64, counts: I64
) -> None:
    """Fill counts [blocks, 2], vertices and triangles of every block, and used [rows, columns, 33], words of the grid
    vertices that its surface's triangles have; `parts` as listed above."""
    h, w = flags.shape
    block_columns = splits.shape[1]
    limit = w if wraps else w - 1
    nowhere, nothing = np.empty(0, np.int32), np.empty((0, 3), np.int32)
    for row in numba.prange(splits.shape[0]):
        i = int(np.int64(row))
        bits = np.empty((4, SIDE), np.int64)
        for j in range(block_columns):
            x0, y0, b = j * BLOCK, i * BLOCK, i * block_columns + j
            counts[b, 0], counts[b, 1] = 0, 0
            used[i, j] = 0
            if states[i, j] == EMPTY:
                continue
            _read_flags(flags, x0, y0, wraps, states[i, j], bits)
            columns, rows = min(SIDE, limit + 1 - x0), min(SIDE, h - y0)
            if parts != RIMS:
                counts[b, 1] = _put_surface(
                    splits[i, j], bits, (i + j) % 2, columns, rows, parts == BOTH, used[i, j], nowhere, nothing, 0
                )
                for y in range(SIDE):
                    counts[b, 0] += lanes.ones(used[i, j, y])
            if parts != SURFACE and states[i, j] == MIXED:
                quarters = _count_rims(bits, columns, rows)
                counts[b, 0] += 4 * quarters
                counts[b, 1] += 2 * quarters


@numba.njit(inline="always", cache=True, error_model="numpy")
def _write_point(
    camera: F64, across: F64, down: F64, twice_u: int, twice_v: int, depth: float, points: F32, uv: F32, at: int
) -> None:
    """A vertex at a place of the picture in half pixels from the first pixel's centre."""
    x, y = down[twice_v, 0] * across[twice_u, 0] * depth, down[twice_v, 0] * across[twice_u, 1] * depth
    z = down[twice_v, 1] * depth
    points[at, 0] = camera[7] * x + camera[8] * y + camera[9] * z + camera[16]
    points[at, 1] = camera[10] * x + camera[11] * y + camera[12] * z + camera[17]
    points[at, 2] = camera[13] * x + camera[14] * y + camera[15] * z + camera[18]
    uv[at, 0], uv[at, 1] = 0.5 * twice_u + 0.5, 0.5 * twice_v + 0.5


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _write_used(
    codes: U16, x0: int, y0: int, used: I64, coding: F64, camera: F64, across: F64, down: F64,
    points: F32, uv: F32, numbers: I32, at: int,
) -> int:  # fmt: skip
    """The block's grid vertices; numbers [33]: of each row's first one."""
    w = codes.shape[1]
    least = int(coding[2])
    for y in range(SIDE):
        numbers[y] = at
        word = used[y]
        while word != 0:
            x = x0 + lanes.lowest(word)
            word &= word - 1
            code = max(int(codes[y0 + y, x if x < w else x - w]), least)
            depth = 1.0 / (coding[0] + coding[1] * code)
            _write_point(camera, across, down, 2 * x, 2 * (y0 + y), depth, points, uv, at)
            at += 1
    return at


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _write_rims(
    codes: U16, x0: int, y0: int, bits: I64, columns: int, rows: int, coding: F64, camera: F64,
    across: F64, down: F64, points: F32, uv: F32, triangles: I32, v: int, t: int,
) -> None:  # fmt: skip
    """In quads that a depth edge crosses every valid corner keeps its quarter, and so a pixel its square.

    Depth goes half way to a neighbour on the same surface.
    """
    w = codes.shape[1]
    least = int(coding[2])
    for y in range(rows - 1):
        crossed = _cut_quads(bits, y, columns)
        for k in range(4 if crossed != 0 else 0):
            dx, dy = k & 1, k >> 1
            sx, sy = 1 - 2 * dx, 1 - 2 * dy  # towards the quad's middle
            beside, along = ~bits[_RIGHT, y + dy], ~(bits[_DOWN, y] >> dx)
            word = crossed & _corner(bits, dx, y + dy)
            while word != 0:
                x = lanes.lowest(word)
                word &= word - 1
                px, py = x0 + x + dx, y0 + y + dy
                side, under = (beside >> x) & 1, (along >> x) & 1
                own = max(int(codes[py, px % w]), least)
                other_x = max(int(codes[py, (px + sx * side) % w]), least)
                other_y = max(int(codes[py + sy * under, px % w]), least)
                for corner in range(4):
                    right, lower = corner & 1, corner >> 1
                    other = other_x if right and (side or not lower) else (other_y if lower else own)
                    depth = 1.0 / (coding[0] + coding[1] * 0.5 * (own + other))
                    _write_point(
                        camera, across, down, 2 * px + sx * right, 2 * py + sy * lower, depth, points, uv, v + corner
                    )
                flip = sx * sy > 0
                triangles[t, 0], triangles[t, 1], triangles[t, 2] = v, v + (2 if flip else 1), v + 3
                triangles[t + 1, 0], triangles[t + 1, 1], triangles[t + 1, 2] = v, v + 3, v + (1 if flip else 2)
                v += 4
                t += 2


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def emit_triangles(
    codes: U16, flags: U8, splits: I64, states: U8, wraps: bool, parts: int, used: I64, starts: I64,
    coding: F64, camera: F64, across: F64, down: F64, points: F32, uv: F32, triangles: I32,
) -> None:  # fmt: skip
    """Fill points [n, 3] relative to the scene origin, uv [n, 2] and triangles [m, 3] of what was counted.

    coding: disparity of code 0 and of a step, and the least code. across [2 w + 1, 2] and down [2 h - 1, 2] tell the
    direction of places half a pixel apart, from the first pixel's centre, in the camera's axes: it is
    (down[., 0] * across[., 0], down[., 0] * across[., 1], down[., 1]).
    """
    h, w = flags.shape
    block_columns = splits.shape[1]
    limit = w if wraps else w - 1
    for row in numba.prange(splits.shape[0]):
        i = int(np.int64(row))
        bits, numbers = np.empty((4, SIDE), np.int64), np.empty(SIDE, np.int32)
        for j in range(block_columns):
            x0, y0, b = j * BLOCK, i * BLOCK, i * block_columns + j
            v, t = starts[b, 0], starts[b, 1]
            if starts[b + 1, 1] == t:
                continue
            _read_flags(flags, x0, y0, wraps, states[i, j], bits)
            columns, rows = min(SIDE, limit + 1 - x0), min(SIDE, h - y0)
            if parts != RIMS:
                v = _write_used(codes, x0, y0, used[i, j], coding, camera, across, down, points, uv, numbers, v)
                t = _put_surface(
                    splits[i, j], bits, (i + j) % 2, columns, rows, parts == BOTH, used[i, j], numbers, triangles, t
                )
            if parts != SURFACE and states[i, j] == MIXED:
                _write_rims(
                    codes, x0, y0, bits, columns, rows, coding, camera, across, down, points, uv, triangles, v, t
                )
