"""Triangles of a depth map whose blocks' splits are known (`kernels.geometry.splits`).

A block's triangles are found a row of equal ones at a time, by operations on words: one is there where the vertex at
its right angle is split and the middle of its longest side is not. Of half quads, the smallest, those that a depth
edge crosses are left out. Vertices are numbered along a block's rows.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from ...support.array_types import F32, F64, I32, I64, U8, U16
from ...support.packed import Coding
from ..base import lanes
from ..base.jit import inlined, parallel, serial
from ..base.project import direction_in_world, position
from .cuts import CUT_DOWN, CUT_RIGHT, KEPT, VALID
from .splits import BLOCK, EMPTY, EVEN, MIXED, ODD, PLAIN, SIDE

__all__ = ["BOTH", "RIMS", "SURFACE", "count_triangles", "emit_triangles"]


# What is made: the surface, which ends at the centres of pixels at depth edges; the rims, which are what is left of
# those pixels' squares; or both, which share at most half a quad where a merged triangle reaches into a cut one.
SURFACE, RIMS, BOTH = 0, 1, 2

_RIGHT, _DOWN, _KEPT, _VALID = 0, 1, 2, 3  # words of a row of pixels
_ALL = (1 << SIDE) - 1
_CORNERS = 1 | 1 << BLOCK
_INNER = _ALL & ~_CORNERS


def _shapes() -> npt.NDArray[np.int64]:
    """Corners a, b, c as offsets (x, y) of every shape of triangle, wound counter-clockwise on screen (v down).

    First the four half quads, from their quad; then, for s from 1 on, the four quarters of a square of size 2s, from
    its middle, and the four halves of one, likewise.
    """
    halves = np.array([(0, 0, 1, 1, 1, 0), (1, 1, 0, 0, 0, 1), (0, 1, 1, 0, 0, 0), (1, 0, 0, 1, 1, 1)])
    quarters = np.array([(-1, -1, 0, 0, 1, -1), (1, 1, 0, 0, -1, 1), (-1, 1, 0, 0, -1, -1), (1, -1, 0, 0, 1, 1)])
    sizes = [s * part for s in (1, 2, 4, 8, 16) for part in (quarters, 2 * halves - 1)]
    return np.concatenate([halves, *sizes])


SHAPES = _shapes()
_LEVELS, _A_LEVEL = 6, 8  # of half quads and of s = 1 to 16; shapes of each of the latter
_LISTED = 8 * (BLOCK - 1) + 4 * BLOCK + 1  # longest list, and a place to spare
# By s: the middles of squares of size 2s in even columns.
FALLING = ODD[np.minimum(2 * np.arange(SIDE), BLOCK)] >> np.arange(SIDE)


@serial
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


@inlined
def _note(word: int, y: int, shape: int, words: I64, rows: I32, shapes: I32, count: int) -> int:
    """Add a word to a list if it has bits; returns the list's length."""
    words[count], rows[count], shapes[count] = word, y, shape
    return count + (word != 0)


@serial
def _list_triangles(
    splits: I64, bits: I64, parity: int, columns: int, rows: int, whole: bool, words: I64, ys: I32, shapes: I32
) -> int:
    """List a block's triangles as words of the places, in a row, of triangles of one shape; returns their number.

    columns and rows: of the block's vertices that lie in the picture. With `whole` there are no half quads in quads
    that a depth edge crosses anywhere.
    """
    inside, n = (1 << columns) - 1, 0
    for level in range(1, _LEVELS):
        s = 1 << level - 1
        first = 4 + _A_LEVEL * (level - 1)
        for y in range(s, min(BLOCK, rows), 2 * s):
            here = ODD[s] & bits[_KEPT, y]
            split, single = here & splits[y] & inside, here & ~splits[y]
            if split != 0:  # round it, triangles with a side of the square
                for k, other in enumerate((splits[y - s], splits[y + s], splits[y] << s, splits[y] >> s)):
                    n = _note(split & ~other, y, first + k, words, ys, shapes, n)
            # Halves of squares: the vertex at their right angle is split, or they are the block's own.
            root = 2 * s == BLOCK
            above, below = (-1, -1) if root else (splits[y - s], splits[y + s])
            if single != 0 and (above | below) != 0:
                falls = (y // (2 * s) + (parity if root else 0)) % 2 == 0
                falling = single & (FALLING[s] if falls else ~FALLING[s])
                rising = single & ~falling
                for k, half in enumerate(
                    (falling & (above >> s), falling & (below << s), rising & (above << s), rising & (below >> s))
                ):
                    n = _note(half, y, first + 4 + k, words, ys, shapes, n)
    quads = (1 << (columns - 1)) - 1
    for y in range(rows - 1):
        over, under = splits[y], splits[y + 1]
        if (over | under) == 0:
            continue
        falling = EVEN[1] if y % 2 == 0 else ODD[1]  # diagonals join pixels with even x + y
        top, bottom, left, right = bits[_RIGHT, y], bits[_RIGHT, y + 1], bits[_DOWN, y], bits[_DOWN, y] >> 1
        if whole:
            top = bottom = left = right = top | bottom | left | right
        a, b, c, d = bits[_KEPT, y], bits[_KEPT, y] >> 1, bits[_KEPT, y + 1], bits[_KEPT, y + 1] >> 1
        for k, half in enumerate((
            falling & (over >> 1) & ~(top | right) & (a | b | d), falling & under & ~(bottom | left) & (a | c | d),
            ~falling & over & ~(top | left) & (a | b | c), ~falling & (under >> 1) & ~(bottom | right) & (b | c | d),
        )):  # fmt: skip
            n = _note(half & quads, y, k, words, ys, shapes, n)
    return n


@inlined
def _moved(word: int, columns: int) -> int:
    """A word's bits so many columns to the right."""
    return word << columns if columns >= 0 else word >> -columns


@serial
def _count_listed(words: I64, ys: I32, shapes: I32, n: int, used: I64) -> tuple[int, int]:
    """How many vertices and triangles there are in a list; used [33]: words of these vertices."""
    used[:] = 0
    vertices, triangles = 0, 0
    for k in range(n):
        word, y, shape = words[k], ys[k], SHAPES[shapes[k]]
        triangles += lanes.ones(word)
        used[y + shape[1]] |= _moved(word, shape[0])
        used[y + shape[3]] |= _moved(word, shape[2])
        used[y + shape[5]] |= _moved(word, shape[4])
    for y in range(SIDE):
        vertices += lanes.ones(used[y])
    return vertices, triangles


@serial
def _count_plain(splits: I64, used: I64) -> tuple[int, int]:
    """As `_count_listed`, of a block that lies in the picture and has no depth edges: every split adds a triangle on
    either side."""
    vertices, triangles = 4, 2
    for y in range(SIDE):
        split = splits[y] & (_INNER if y % BLOCK == 0 else _ALL)
        used[y] = split | (_CORNERS if y % BLOCK == 0 else 0)
        vertices += lanes.ones(split)
        triangles += lanes.ones(split & _INNER) + (lanes.ones(split) if y % BLOCK != 0 else 0)
    return vertices, triangles


@serial
def _write_listed(
    words: I64, ys: I32, shapes: I32, n: int, used: I64, numbers: I32, second: int, triangles: I32, at: int
) -> int:
    """Write a list's triangles from number `at` on, and return the next; numbers [33]: of each row's first vertex."""
    for k in range(n):
        shape, y, word = SHAPES[shapes[k]], ys[k], words[k]
        ax, bx, cx = shape[0], shape[2], shape[4]
        row_a, row_b, row_c = used[y + shape[1]], used[y + shape[3]], used[y + shape[5]]
        first_a, first_b, first_c = numbers[y + shape[1]], numbers[y + shape[3]], numbers[y + shape[5]]
        while word != 0:
            x = lanes.lowest(word)
            word &= word - 1
            triangles[at, 0] = first_a + lanes.ones(row_a & ((1 << (x + ax)) - 1))
            triangles[at, second] = first_b + lanes.ones(row_b & ((1 << (x + bx)) - 1))
            triangles[at, 3 - second] = first_c + lanes.ones(row_c & ((1 << (x + cx)) - 1))
            at += 1
    return at


@inlined
def _cut_quads(bits: I64, y: int, columns: int) -> int:
    """The quads of row y that a depth edge crosses."""
    crossed = bits[_RIGHT, y] | bits[_RIGHT, y + 1] | bits[_DOWN, y] | (bits[_DOWN, y] >> 1)
    return crossed & ((1 << (columns - 1)) - 1)


@inlined
def _corner(bits: I64, x: int, y: int) -> int:
    """The quads of row y whose corner (x, y) is kept and valid."""
    return (bits[_KEPT, y] & bits[_VALID, y]) >> x


@serial
def _count_rims(bits: I64, columns: int, rows: int) -> int:
    """How many quarters of quads the rims are."""
    quarters = 0
    for y in range(rows - 1):
        crossed = _cut_quads(bits, y, columns)
        if crossed != 0:
            for k in range(4):
                quarters += lanes.ones(crossed & _corner(bits, k & 1, y + (k >> 1)))
    return quarters


@parallel
def count_triangles(
    flags: U8, splits: I64, states: U8, wraps: bool, parts: int, remade: U8, used: I64, counts: I64
) -> None:
    """Fill counts [blocks, 2], vertices and triangles of every block, and used [rows, columns, 33], words of the grid
    vertices that its surface's triangles have; `parts` as listed above. Blocks that are not remade stay."""
    h, w = flags.shape
    block_columns = splits.shape[1]
    limit = w if wraps else w - 1
    for row in numba.prange(splits.shape[0]):
        i = int(np.int64(row))
        bits, words = np.empty((4, SIDE), np.int64), np.empty(_LISTED, np.int64)
        ys, shapes = np.empty(_LISTED, np.int32), np.empty(_LISTED, np.int32)
        for j in range(block_columns):
            x0, y0, b = j * BLOCK, i * BLOCK, i * block_columns + j
            if remade[i, j] == 0:
                continue
            counts[b, 0], counts[b, 1] = 0, 0
            if states[i, j] == EMPTY:
                continue
            _read_flags(flags, x0, y0, wraps, states[i, j], bits)
            columns, rows = min(SIDE, limit + 1 - x0), min(SIDE, h - y0)
            if parts != RIMS and states[i, j] == PLAIN:
                counts[b, 0], counts[b, 1] = _count_plain(splits[i, j], used[i, j])
            elif parts != RIMS:
                n = _list_triangles(
                    splits[i, j], bits, (i + j) % 2, columns, rows, parts == BOTH, words, ys, shapes
                )
                counts[b, 0], counts[b, 1] = _count_listed(words, ys, shapes, n, used[i, j])
            if parts != SURFACE and states[i, j] == MIXED:
                quarters = _count_rims(bits, columns, rows)
                counts[b, 0] += 4 * quarters
                counts[b, 1] += 2 * quarters


@serial(fastmath={"contract"})
def _write_used(
    codes: U16, x0: int, y0: int, used: I64, coding: Coding, camera: F64, across: F64, down: F64,
    points: F32, uv: F32, numbers: I32, at: int,
) -> int:  # fmt: skip
    """The block's grid vertices; numbers [33]: of each row's first one."""
    w, (offset, step, least) = codes.shape[1], (coding.offset, coding.step, coding.min_code)
    ox, oy, oz = position(camera)
    for y in range(SIDE):
        numbers[y] = at
        word = used[y]
        if word == 0:
            continue
        v = y0 + y
        planar, rise = down[2 * v, 0], down[2 * v, 1]
        ax, ay, az = direction_in_world(camera, planar, 0.0, 0.0)
        bx, by, bz = direction_in_world(camera, 0.0, planar, 0.0)
        cx, cy, cz = direction_in_world(camera, 0.0, 0.0, rise)
        while word != 0:
            x = x0 + lanes.lowest(word)
            word &= word - 1
            a, b = across[2 * x, 0], across[2 * x, 1]
            code = max(int(codes[v, x if x < w else x - w]), least)
            depth = 1.0 / (offset + step * code)
            points[at, 0] = ox + depth * (a * ax + b * bx + cx)
            points[at, 1] = oy + depth * (a * ay + b * by + cy)
            points[at, 2] = oz + depth * (a * az + b * bz + cz)
            uv[at, 0], uv[at, 1] = x + 0.5, v + 0.5
            at += 1
    return at


@inlined
def _write_point(
    camera: F64, across: F64, down: F64, twice_u: int, twice_v: int, depth: float, points: F32, uv: F32, at: int
) -> None:
    """A vertex at a place of the picture in half pixels from the first pixel's centre."""
    planar = down[twice_v, 0] * depth
    x, y, z = direction_in_world(
        camera, planar * across[twice_u, 0], planar * across[twice_u, 1], down[twice_v, 1] * depth
    )
    ox, oy, oz = position(camera)
    points[at, 0], points[at, 1], points[at, 2] = x + ox, y + oy, z + oz
    uv[at, 0], uv[at, 1] = 0.5 * twice_u + 0.5, 0.5 * twice_v + 0.5


@serial
def _write_rims(
    codes: U16, x0: int, y0: int, bits: I64, columns: int, rows: int, coding: Coding, camera: F64,
    across: F64, down: F64, second: int, points: F32, uv: F32, triangles: I32, v: int, t: int,
) -> None:  # fmt: skip
    """In quads that a depth edge crosses every valid corner keeps its quarter, and so a pixel its square.

    Depth goes half way to a neighbour on the same surface.
    """
    w = codes.shape[1]
    least = coding.min_code
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
                    depth = 1.0 / (coding.offset + coding.step * 0.5 * (own + other))
                    _write_point(
                        camera, across, down, 2 * px + sx * right, 2 * py + sy * lower, depth, points, uv, v + corner
                    )
                k, m = (second, 3 - second) if sx * sy < 0 else (3 - second, second)
                triangles[t, 0], triangles[t, k], triangles[t, m] = v, v + 1, v + 3
                triangles[t + 1, 0], triangles[t + 1, k], triangles[t + 1, m] = v, v + 3, v + 2
                v += 4
                t += 2


@serial
def _copy_block(
    old: I64, old_points: F32, old_uv: F32, old_triangles: I32, start: I64, end: I64,
    points: F32, uv: F32, triangles: I32,
) -> None:  # fmt: skip
    """Copy a block's vertices and triangles, which have other numbers now."""
    moved = np.int32(start[0] - old[0])
    for k in range(end[0] - start[0]):
        for axis in range(3):
            points[start[0] + k, axis] = old_points[old[0] + k, axis]
        for axis in range(2):
            uv[start[0] + k, axis] = old_uv[old[0] + k, axis]
    for k in range(end[1] - start[1]):
        for corner in range(3):
            triangles[start[1] + k, corner] = old_triangles[old[1] + k, corner] + moved


@parallel
def emit_triangles(
    codes: U16, flags: U8, splits: I64, states: U8, wraps: bool, parts: int, used: I64, starts: I64,
    coding: Coding, camera: F64, across: F64, down: F64, second: int, points: F32, uv: F32, triangles: I32,
    remade: U8, old_starts: I64, old_points: F32, old_uv: F32, old_triangles: I32,
) -> None:  # fmt: skip
    """Fill points [n, 3] relative to the scene origin, uv [n, 2] and triangles [m, 3] of what was counted.

    across [2 w + 1, 2] and down [2 h - 1, 2] tell the
    direction of places half a pixel apart, from the first pixel's centre, in the camera's axes: it is
    (down[., 0] * across[., 0], down[., 0] * across[., 1], down[., 1]). second: 1, or 2 to wind triangles the other way.
    Blocks that are not remade [rows, columns] are copied from an older mesh.
    """
    h, w = flags.shape
    block_columns = splits.shape[1]
    limit = w if wraps else w - 1
    for row in numba.prange(splits.shape[0]):
        i = int(np.int64(row))
        bits, words, numbers = np.empty((4, SIDE), np.int64), np.empty(_LISTED, np.int64), np.empty(SIDE, np.int32)
        ys, shapes = np.empty(_LISTED, np.int32), np.empty(_LISTED, np.int32)
        for j in range(block_columns):
            x0, y0, b = j * BLOCK, i * BLOCK, i * block_columns + j
            v, t = starts[b, 0], starts[b, 1]
            if starts[b + 1, 1] == t:
                continue
            if remade[i, j] == 0:
                _copy_block(
                    old_starts[b], old_points, old_uv, old_triangles, starts[b], starts[b + 1], points, uv, triangles
                )
                continue
            _read_flags(flags, x0, y0, wraps, states[i, j], bits)
            columns, rows = min(SIDE, limit + 1 - x0), min(SIDE, h - y0)
            if parts != RIMS:
                n = _list_triangles(
                    splits[i, j], bits, (i + j) % 2, columns, rows, parts == BOTH, words, ys, shapes
                )
                v = _write_used(codes, x0, y0, used[i, j], coding, camera, across, down, points, uv, numbers, v)
                t = _write_listed(words, ys, shapes, n, used[i, j], numbers, second, triangles, t)
            if parts != SURFACE and states[i, j] == MIXED:
                _write_rims(
                    codes, x0, y0, bits, columns, rows, coding, camera, across, down, second, points, uv, triangles,
                    v, t,
                )
