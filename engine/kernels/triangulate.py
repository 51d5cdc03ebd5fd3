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
# those pixels' squares; or both without overlap.
SURFACE, RIMS, BOTH = 0, 1, 2

# Bits of a pixel's flags.
CUT_RIGHT = 1  # no surface between this pixel and its right neighbour
CUT_DOWN = 2
BROKEN = 4  # a cut or a change of the mask touches this pixel: never inside a merged triangle
KEPT = 8
VALID = 16


@numba.njit(inline="always", cache=True, error_model="numpy")
def _is_cut(a: int, b: int, before: int, after: int, edge: float) -> bool:
    """Whether the step from a to b is a depth edge: large, and not explained by the slope on either side."""
    step = abs(float(b) - float(a))
    if step <= edge:
        return False
    slope = min(abs(float(a) - float(before)), abs(float(after) - float(b)))
    return step > edge + 1.5 * slope


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def mark_broken(
    codes: U16, keep: U8, has_keep: bool, has_invalid: bool, edge: float, wraps: bool, flags: U8
) -> None:
    """Fill flags [h, w]: cuts to the right and downwards, validity, mask and pixels that must stay single."""
    h, w = codes.shape
    for y in numba.prange(h):
        for x in range(w):
            flag = 0
            c = codes[y, x]
            valid = c > 0 or not has_invalid
            if valid:
                flag |= VALID
            if not has_keep or keep[y, x] != 0:
                flag |= KEPT
            if x + 1 < w or wraps:
                right = (x + 1) % w
                r = codes[y, right]
                if not valid or (r == 0 and has_invalid):
                    flag |= CUT_RIGHT
                else:
                    before = codes[y, x - 1] if x > 0 else (codes[y, w - 1] if wraps else c)
                    after = codes[y, (right + 1) % w] if (right + 1 < w or wraps) else r
                    if has_invalid:
                        before = before if before > 0 else c
                        after = after if after > 0 else r
                    if _is_cut(c, r, before, after, edge):
                        flag |= CUT_RIGHT
            if y + 1 < h:
                d = codes[y + 1, x]
                if not valid or (d == 0 and has_invalid):
                    flag |= CUT_DOWN
                else:
                    before = codes[y - 1, x] if y > 0 else c
                    after = codes[y + 2, x] if y + 2 < h else d
                    if has_invalid:
                        before = before if before > 0 else c
                        after = after if after > 0 else d
                    if _is_cut(c, d, before, after, edge):
                        flag |= CUT_DOWN
            flags[y, x] = flag
    for y in numba.prange(h):
        for x in range(w):
            flag = flags[y, x]
            left = flags[y, x - 1] if x > 0 else (flags[y, w - 1] if wraps else flag & ~CUT_RIGHT)
            up = flags[y - 1, x] if y > 0 else flag & ~CUT_DOWN
            right = flags[y, (x + 1) % w] if (x + 1 < w or wraps) else flag
            down = flags[y + 1, x] if y + 1 < h else flag
            cut = (flag & (CUT_RIGHT | CUT_DOWN)) | (left & CUT_RIGHT) | (up & CUT_DOWN)
            mask = ((flag ^ left) | (flag ^ up) | (flag ^ right) | (flag ^ down)) & KEPT
            if cut or mask or not flag & VALID:
                # The neighbouring rows read the other bits of this flag only.
                flags[y, x] = flag | BROKEN


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


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def split_errors(codes: U16, flags: U8, block: int, wraps: bool, error: F32) -> None:
    """Fill error [rows * block + 1, columns * block + 1] (see the module's text), in depth codes."""
    h, w = codes.shape
    gh, gw = error.shape
    s = 1
    while s < block:
        # Middles of the sides of squares of size 2s: exactly one coordinate is odd in units of s.
        for row in numba.prange((gh + s - 1) // s):
            y = row * s
            for x in range(0 if row % 2 else s, gw, 2 * s):
                if row % 2 == 0:
                    own = _deviation(codes, x, y, x - s, y, x + s, y, w, h, wraps)
                else:
                    own = _deviation(codes, x, y, x, y - s, x, y + s, w, h, wraps)
                if y < h and (x < w or wraps) and flags[y, x % w] & BROKEN:
                    own = math.inf
                if s > 1:
                    c = s // 2
                    own += max(
                        max(_error_at(error, x - c, y - c), _error_at(error, x + c, y - c)),
                        max(_error_at(error, x - c, y + c), _error_at(error, x + c, y + c)),
                    )
                error[y, x] = own
        if wraps and w < gw:  # the first and the last column are the same pixels
            for y in range(0, gh, s):
                error[y, 0] = error[y, w] = max(error[y, 0], error[y, w])
        # Centres: both coordinates odd.
        for row in numba.prange(gh // (2 * s)):
            y = (2 * row + 1) * s
            for column in range(gw // (2 * s)):
                x = (2 * column + 1) * s
                if (row + column) % 2 == 0:
                    own = _deviation(codes, x, y, x - s, y - s, x + s, y + s, w, h, wraps)
                else:
                    own = _deviation(codes, x, y, x + s, y - s, x - s, y + s, w, h, wraps)
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
            if not flags[y, x % w] & BROKEN or not _quad_is_cut(flags, x, y, w):
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
