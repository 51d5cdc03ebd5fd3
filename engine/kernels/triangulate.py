"""Error-bounded triangulation of a depth map: a right-triangulated irregular network over pixel centres.

The picture is cut into squares of `block` quads. A square is halved along a diagonal and its triangles are
halved again and again at the middle of their longest side, down to half quads. Every grid vertex is the middle
of one longest side, so the question "split here?" belongs to the vertex: `error[v]` bounds how far any depth
code under the two triangles that meet at that side lies from their planes. It is the vertex' own deviation plus
the largest error of the (up to four) vertices that would split their halves: a bound, not an estimate, and as a
parent's error is never below its children's the mesh has no T-junctions.

Two kinds of vertices alternate: "centres" of squares of size 2s, on a diagonal, and "middles" of their sides.
The diagonal of the square with corner (i, j), in units of its size, goes down-right where i + j is even.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from .project import unproject_point

__all__ = ["count_block_triangles", "emit_block_triangles", "mark_broken", "split_errors", "unproject_vertices"]

U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]
F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]

# What is made: the surface, which ends at the centres of pixels at depth edges; the rims, which are what is left of
# those pixels' squares; or both, which share at most half a quad where a merged triangle reaches into a cut one.
SURFACE, RIMS, BOTH = 0, 1, 2

# Bits of a pixel's flags.
CUT_RIGHT = 1  # no surface between this pixel and its right neighbour
CUT_DOWN = 2
BROKEN = 4  # a cut or a change of the mask touches this pixel: never inside a merged triangle
KEPT = 8
VALID = 16


@numba.njit(inline="always", cache=True, error_model="numpy")
def _cut(before: int, a: int, b: int, after: int, edge: float, has_invalid: bool) -> Any:
    """Whether no surface joins pixels a and b of four in a row: one is invalid, or a depth edge lies between.

    A depth edge is a step that is large and not explained by the slope on either side. Free of branches.
    """
    step = abs(b - a)
    slope_a = 0 if has_invalid & (before == 0) else abs(a - before)
    slope_b = 0 if has_invalid & (after == 0) else abs(after - b)
    invalid = has_invalid & ((a == 0) | (b == 0))
    slope = min(slope_a, slope_b)
    return invalid | (np.float32(step) > edge + np.float32(1.5) * np.float32(slope))


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _mark_cuts_in_row(
    above: U16, row: U16, below: U16, below2: U16, keep: U8, has_keep: bool, has_invalid: bool, edge: float,
    last_row: bool, wraps: bool, flags: U8,
) -> None:  # fmt: skip
    """Cuts, validity and mask of a row; rows outside the picture are given as their nearest neighbours."""
    w = row.shape[0]
    for x in range(w):
        down = _cut(
            np.int32(above[x]), np.int32(row[x]), np.int32(below[x]), np.int32(below2[x]), edge, has_invalid
        ) & (not last_row)
        valid = (row[x] != 0) | (not has_invalid)
        flags[x] = (CUT_DOWN if down else 0) | (VALID if valid else 0)
    for x in range(1, w - 2):
        right = _cut(
            np.int32(row[x - 1]), np.int32(row[x]), np.int32(row[x + 1]), np.int32(row[x + 2]), edge, has_invalid
        )
        flags[x] |= CUT_RIGHT if right else 0
    for k in range(3):  # the columns whose neighbours may be round the seam, or missing
        x = 0 if k == 0 else w - k
        if x < 0 or (k > 0 and x == 0) or (x == w - 1 and not wraps):
            continue
        before = x - 1 if x > 0 else (w - 1 if wraps else 0)
        b = x + 1 if x + 1 < w else 0
        after = b + 1 if b + 1 < w else (0 if wraps else b)
        right = _cut(
            np.int32(row[before]), np.int32(row[x]), np.int32(row[b]), np.int32(row[after]), edge, has_invalid
        )
        flags[x] |= CUT_RIGHT if right else 0
    for x in range(w):
        flags[x] |= KEPT if not has_keep or keep[x] != 0 else 0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _mark_broken_in_row(first_row: bool, above: U8, flags: U8, below: U8, broken: U8, wraps: bool) -> None:
    """broken [w]: 1 where a cut or a change of the mask touches a pixel or it is invalid."""
    w = flags.shape[0]
    for x in range(w):
        flag, up = flags[x], above[x]
        up &= ~CUT_DOWN if first_row else 0xFF
        cut = (flag & (CUT_RIGHT | CUT_DOWN)) | (up & CUT_DOWN)
        mask = ((flag ^ up) | (flag ^ below[x])) & KEPT
        broken[x] = (cut != 0) | (mask != 0) | ((flag & VALID) == 0)
    for x in range(1, w):
        left = flags[x - 1]
        broken[x] |= ((left & CUT_RIGHT) != 0) | (((flags[x] ^ left) & KEPT) != 0)
    for x in range(w - 1):
        broken[x] |= ((flags[x] ^ flags[x + 1]) & KEPT) != 0
    if wraps:
        seam = ((flags[0] ^ flags[w - 1]) & KEPT) != 0
        broken[0] |= seam | ((flags[w - 1] & CUT_RIGHT) != 0)
        broken[w - 1] |= seam


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def mark_broken(
    codes: U16, keep: U8, has_keep: bool, has_invalid: bool, edge: float, wraps: bool, flags: U8
) -> None:
    """Fill flags [h, w]: cuts to the right and downwards, validity, mask and pixels that must stay single."""
    h, w = codes.shape
    threshold = np.float32(edge)
    for row in numba.prange(h):
        y = int(np.int64(row))
        _mark_cuts_in_row(
            codes[max(y - 1, 0)], codes[y], codes[min(y + 1, h - 1)], codes[min(y + 2, h - 1)],
            keep[y if has_keep else 0], has_keep, has_invalid, threshold, y == h - 1, wraps, flags[y],
        )  # fmt: skip
    for row in numba.prange(h):
        y = int(np.int64(row))
        broken = np.empty(w, np.uint8)
        _mark_broken_in_row(y == 0, flags[max(y - 1, 0)], flags[y], flags[min(y + 1, h - 1)], broken, wraps)
        for x in range(w):
            # The neighbouring rows read the other bits of this flag only.
            flags[y, x] |= BROKEN if broken[x] else 0


@numba.njit(inline="always", cache=True, error_model="numpy")
def _deviation(codes: U16, x: int, y: int, ax: int, ay: int, bx: int, by: int, w: int, h: int, wraps: bool) -> float:
    """Distance of the code at (x, y) from the middle of two others; infinite where one is outside."""
    if ay < 0 or by < 0 or ay >= h or by >= h or y >= h:
        return math.inf
    if wraps:
        if max(ax, bx, x) > w:
            return math.inf
        ax, bx, x = ax % w, bx % w, x % w
    elif max(ax, bx, x) >= w:
        return math.inf
    if ax < 0 or bx < 0:
        return math.inf
    return abs(float(codes[y, x]) - 0.5 * (float(codes[ay, ax]) + float(codes[by, bx])))


@numba.njit(inline="always", cache=True)
def _error_at(error: F32, x: int, y: int) -> float:
    if y < 0 or x < 0 or y >= error.shape[0] or x >= error.shape[1]:
        return 0.0
    return error[y, x]


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _any_kept(flags: U8, x0: int, y0: int, x1: int, y1: int) -> bool:
    """Whether a pixel of the rectangle is kept, its last column and row included (round the seam, if beyond)."""
    w = flags.shape[1]
    found = np.uint8(0)
    for y in range(y0, min(y1, flags.shape[0] - 1) + 1):
        for x in range(x0, min(x1, w - 1) + 1):
            found |= flags[y, x]
        found |= flags[y, x1 % w]
    return (found & KEPT) != 0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _needed_blocks(flags: U8, block: int, rows: int, columns: int, wraps: bool) -> U8:
    """Which blocks [rows + 1, columns + 1] hold vertices of blocks with kept pixels: their own, or on the sides to
    the left and above."""
    needed = np.zeros((rows + 1, columns + 1), np.uint8)
    for i in range(rows):
        for j in range(columns):
            if _any_kept(flags, j * block, i * block, (j + 1) * block, (i + 1) * block):
                needed[i : i + 2, j : j + 2] = 1
                if wraps and j == columns - 1:
                    needed[i : i + 2, 0] = 1
                if wraps and j == 0:
                    needed[i : i + 2, columns - 1 :] = 1
    return needed


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def split_errors(codes: U16, flags: U8, block: int, wraps: bool, error: F32) -> None:
    """Fill error [rows * block + 1, columns * block + 1] (see the module's text), in depth codes.

    Left as it is where no pixel is kept.
    """
    h, w = codes.shape
    gh, gw = error.shape
    needed = _needed_blocks(flags, block, gh // block, gw // block, wraps)
    s = 1
    while s < block:
        # Middles of the sides of squares of size 2s: exactly one coordinate is odd in units of s.
        for row_ in numba.prange((gh + s - 1) // s):
            row = int(np.int64(row_))
            y = row * s
            for column in range(needed.shape[1]):
                if needed[y // block, column] == 0:
                    continue
                first = column * block + (0 if row % 2 else s)
                for x in range(first, min((column + 1) * block, gw), 2 * s):
                    c = s // 2
                    if s <= x < w - s and s <= y < h - s:  # well inside: no index needs a check
                        if row % 2 == 0:
                            a, b = codes[y, x - s], codes[y, x + s]
                        else:
                            a, b = codes[y - s, x], codes[y + s, x]
                        own = abs(float(codes[y, x]) - 0.5 * (float(a) + float(b)))
                        own = math.inf if flags[y, x] & BROKEN else own
                        if s > 1:
                            own += max(
                                max(error[y - c, x - c], error[y - c, x + c]),
                                max(error[y + c, x - c], error[y + c, x + c]),
                            )
                        error[y, x] = own
                        continue
                    if row % 2 == 0:
                        own = _deviation(codes, x, y, x - s, y, x + s, y, w, h, wraps)
                    else:
                        own = _deviation(codes, x, y, x, y - s, x, y + s, w, h, wraps)
                    if y < h and (x < w or wraps) and flags[y, x % w] & BROKEN:
                        own = math.inf
                    if s > 1:
                        own += max(
                            max(_error_at(error, x - c, y - c), _error_at(error, x + c, y - c)),
                            max(_error_at(error, x - c, y + c), _error_at(error, x + c, y + c)),
                        )
                    error[y, x] = own
        if wraps and w < gw:  # the first and the last column are the same pixels
            for y in range(0, gh, s):
                error[y, 0] = error[y, w] = max(error[y, 0], error[y, w])
        # Centres: both coordinates odd.
        for row_ in numba.prange(gh // (2 * s)):
            row = int(np.int64(row_))
            y = (2 * row + 1) * s
            for column in range(needed.shape[1]):
                if needed[y // block, column] == 0:
                    continue
                for x in range(column * block + s, min((column + 1) * block, gw), 2 * s):
                    down = s if (row + x // (2 * s)) % 2 == 0 else -s
                    if x < w - s and y < h - s:
                        a, b = codes[y - down, x - s], codes[y + down, x + s]
                        own = abs(float(codes[y, x]) - 0.5 * (float(a) + float(b)))
                        own = math.inf if flags[y, x] & BROKEN else own
                        error[y, x] = own + max(
                            max(error[y - s, x], error[y + s, x]), max(error[y, x - s], error[y, x + s])
                        )
                        continue
                    own = _deviation(codes, x, y, x - s, y - down, x + s, y + down, w, h, wraps)
                    if y < h and (x < w or wraps) and flags[y, x % w] & BROKEN:
                        own = math.inf
                    own += max(
                        max(error[y - s, x], error[y + s, x]), max(error[y, x - s], error[y, x + s])
                    )
                    error[y, x] = own
        s *= 2


@numba.njit(inline="always", cache=True)
def _vertex(table: I32, block: int, lx: int, ly: int, count: int) -> tuple[int, int]:
    """The block's number for a local grid vertex, and the count after it."""
    at = ly * (block + 1) + lx
    if table[at] < 0:
        table[at] = count
        count += 1
    return table[at], count


@numba.njit(inline="always", cache=True)
def _push(stack: I64, at: int, ax: int, ay: int, bx: int, by: int, cx: int, cy: int) -> None:
    stack[at, 0], stack[at, 1], stack[at, 2] = ax, ay, bx
    stack[at, 3], stack[at, 4], stack[at, 5] = by, cx, cy


@numba.njit(inline="always", cache=True)
def _cut_between(flags: U8, ax: int, ay: int, bx: int, by: int, w: int) -> bool:
    """Whether a depth edge lies between two 4-neighbours; the second is to the right of or below the first."""
    bit = CUT_RIGHT if ay == by else CUT_DOWN
    return flags[ay, ax % w] & bit != 0


@numba.njit(inline="always", cache=True)
def _quad_is_cut(flags: U8, x: int, y: int, w: int) -> bool:
    return (
        _cut_between(flags, x, y, x + 1, y, w)
        or _cut_between(flags, x, y + 1, x + 1, y + 1, w)
        or _cut_between(flags, x, y, x, y + 1, w)
        or _cut_between(flags, x + 1, y, x + 1, y + 1, w)
    )


@numba.njit(inline="always", cache=True)
def _leaf_is_surface(
    flags: U8, ax: int, ay: int, bx: int, by: int, cx: int, cy: int, w: int, extend: bool
) -> bool:
    """Whether a half quad is emitted: legs c-a and c-b without a depth edge, a corner kept."""
    if not (flags[ay, ax % w] | flags[by, bx % w] | flags[cy, cx % w]) & KEPT:
        return False
    if extend:
        return not _quad_is_cut(flags, min(ax, bx), min(ay, by), w)
    for px, py in ((ax, ay), (bx, by)):
        if px < cx or py < cy:
            if _cut_between(flags, px, py, cx, cy, w):
                return False
        elif _cut_between(flags, cx, cy, px, py, w):
            return False
    return True


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _walk_block(
    flags: U8, error: F32, tolerance: float, block: int, bx: int, by: int, wraps: bool, parts: int,
    table: I32, vertices: I32, triangles: I32, vertex_base: int, triangle_base: int, emit: bool,
) -> tuple[int, int]:  # fmt: skip
    """Visit the triangles of one block; returns its counts of vertices and triangles."""
    h, w = flags.shape
    limit = w if wraps else w - 1  # largest x of a vertex
    n_vertices, n_triangles = 0, 0
    if parts != SURFACE:
        n_vertices, n_triangles = _walk_cut_quads(
            flags, bx * block, by * block, min((bx + 1) * block, limit), min((by + 1) * block, h - 1), w,
            vertices, triangles, vertex_base, triangle_base, emit,
        )  # fmt: skip
    if parts == RIMS:
        return n_vertices, n_triangles
    table[:] = -1
    stack = np.empty((64, 6), np.int64)
    x0, y0, x1, y1 = bx * block, by * block, (bx + 1) * block, (by + 1) * block
    # Longest side first (a, b), then the right angle c; wound counter-clockwise on screen (v down).
    if (bx + by) % 2 == 0:
        _push(stack, 0, x0, y0, x1, y1, x1, y0)
        _push(stack, 1, x1, y1, x0, y0, x0, y1)
    else:
        _push(stack, 0, x0, y1, x1, y0, x0, y0)
        _push(stack, 1, x1, y0, x0, y1, x1, y1)
    top = 2
    while top > 0:
        top -= 1
        ax, ay, bx_ = stack[top, 0], stack[top, 1], stack[top, 2]
        by_, cx, cy = stack[top, 3], stack[top, 4], stack[top, 5]
        if min(ax, bx_, cx) > limit or min(ay, by_, cy) > h - 1:
            continue
        leaf = abs(ax - bx_) + abs(ay - by_) == 2 and ax != bx_ and ay != by_
        outside = max(ax, bx_, cx) > limit or max(ay, by_, cy) > h - 1
        mx, my = (ax + bx_) // 2, (ay + by_) // 2
        if not leaf and (outside or error[my, mx] > tolerance):
            _push(stack, top, cx, cy, ax, ay, mx, my)
            _push(stack, top + 1, bx_, by_, cx, cy, mx, my)
            top += 2
            continue
        if outside:
            continue
        if leaf:
            if not _leaf_is_surface(flags, ax, ay, bx_, by_, cx, cy, w, parts == BOTH):
                continue
        elif not flags[ay, ax % w] & KEPT or not flags[ay, ax % w] & VALID:
            continue
        i, n_vertices = _vertex(table, block, ax - x0, ay - y0, n_vertices)
        j, n_vertices = _vertex(table, block, bx_ - x0, by_ - y0, n_vertices)
        k, n_vertices = _vertex(table, block, cx - x0, cy - y0, n_vertices)
        if emit:
            for number, px, py in ((i, ax, ay), (j, bx_, by_), (k, cx, cy)):
                at = vertex_base + number
                vertices[at, 0], vertices[at, 1] = 2 * px, 2 * py
                vertices[at, 2], vertices[at, 3] = py, px % w
                vertices[at, 4], vertices[at, 5] = py, px % w
            at = triangle_base + n_triangles
            triangles[at, 0], triangles[at, 1], triangles[at, 2] = (
                vertex_base + i, vertex_base + j, vertex_base + k,
            )  # fmt: skip
        n_triangles += 1
    return n_vertices, n_triangles


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _walk_cut_quads(
    flags: U8, x0: int, y0: int, x1: int, y1: int, w: int, vertices: I32, triangles: I32,
    vertex_base: int, triangle_base: int, emit: bool,
) -> tuple[int, int]:  # fmt: skip
    """Rims: in quads that a depth edge crosses every valid corner keeps its quarter, and so a pixel its square."""
    n_vertices, n_triangles = 0, 0
    for y in range(y0, y1):
        for x in range(x0, x1):
            if not (flags[y, x % w] | flags[y + 1, (x + 1) % w]) & BROKEN or not _quad_is_cut(flags, x, y, w):
                continue
            for dy in range(2):
                for dx in range(2):
                    px, py = x + dx, y + dy
                    if not flags[py, px % w] & KEPT or not flags[py, px % w] & VALID:
                        continue
                    if emit:
                        sx, sy = 1 - 2 * dx, 1 - 2 * dy  # towards the quad's middle
                        side = not _cut_between(flags, x, py, x + 1, py, w)
                        along = not _cut_between(flags, px, y, px, y + 1, w)
                        ox = (px + sx) % w if side else px % w
                        oy = py + sy if along else py
                        _quarter(
                            vertices, triangles, vertex_base + n_vertices, triangle_base + n_triangles,
                            px, py, sx, sy, ox, oy, w,
                        )  # fmt: skip
                    n_vertices += 4
                    n_triangles += 2
    return n_vertices, n_triangles


@numba.njit(inline="always", cache=True)
def _quarter(
    vertices: I32, triangles: I32, v: int, t: int, px: int, py: int, sx: int, sy: int, ox: int, oy: int, w: int
) -> None:
    """Two triangles over a pixel's quarter of a quad; depth goes half way to a neighbour on the same surface."""
    own = px % w
    for k in range(4):
        right, down = k & 1, k >> 1
        vertices[v + k, 0], vertices[v + k, 1] = 2 * px + sx * right, 2 * py + sy * down
        vertices[v + k, 2], vertices[v + k, 3] = py, own
        # The vertex' code is the mean of two pixels' codes.
        vertices[v + k, 4] = oy if down and not (right and ox != own) else py
        vertices[v + k, 5] = ox if right else own
    flip = sx * sy > 0
    triangles[t, 0], triangles[t, 1], triangles[t, 2] = v, v + (2 if flip else 1), v + 3
    triangles[t + 1, 0], triangles[t + 1, 1], triangles[t + 1, 2] = v, v + 3, v + (1 if flip else 2)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def count_block_triangles(
    flags: U8, error: F32, tolerance: float, block: int, wraps: bool, parts: int, counts: I64
) -> None:
    """Fill counts [blocks, 2]: vertices and triangles of every block; `parts` as listed above."""
    columns = (error.shape[1] - 1) // block
    nothing = np.empty((0, 6), np.int32)
    no_triangles = np.empty((0, 3), np.int32)
    for b in numba.prange(counts.shape[0]):
        x, y = b % columns * block, b // columns * block
        if not _any_kept(flags, x, y, x + block, y + block):
            counts[b, 0], counts[b, 1] = 0, 0
            continue
        table = np.empty((block + 1) * (block + 1), np.int32)
        counts[b, 0], counts[b, 1] = _walk_block(
            flags, error, tolerance, block, b % columns, b // columns, wraps, parts,
            table, nothing, no_triangles, 0, 0, False,
        )  # fmt: skip


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def emit_block_triangles(
    flags: U8, error: F32, tolerance: float, block: int, wraps: bool, parts: int, starts: I64,
    vertices: I32, triangles: I32,
) -> None:  # fmt: skip
    """Fill vertices [n, 6] (twice u and v, then two pixels whose codes are averaged) and triangles [m, 3]."""
    columns = (error.shape[1] - 1) // block
    for b in numba.prange(starts.shape[0] - 1):
        if starts[b + 1, 1] == starts[b, 1]:
            continue
        table = np.empty((block + 1) * (block + 1), np.int32)
        _walk_block(
            flags, error, tolerance, block, b % columns, b // columns, wraps, parts,
            table, vertices, triangles, starts[b, 0], starts[b, 1], True,
        )  # fmt: skip


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def unproject_vertices(
    codes: U16, camera: F64, offset: float, step: float, min_code: int, vertices: I32, points: F32, uv: F32
) -> None:
    """Vertices [n, 6] -> points relative to the scene origin and source picture coordinates."""
    for i in numba.prange(vertices.shape[0]):
        a = max(int(codes[vertices[i, 2], vertices[i, 3]]), min_code)
        b = max(int(codes[vertices[i, 4], vertices[i, 5]]), min_code)
        u, v = 0.5 * vertices[i, 0] + 0.5, 0.5 * vertices[i, 1] + 0.5
        x, y, z = unproject_point(camera, u, v, 1.0 / (offset + step * 0.5 * (a + b)))
        points[i, 0], points[i, 1], points[i, 2] = x, y, z
        uv[i, 0], uv[i, 1] = u, v
