"""Triangles of a depth map, from the splits of its blocks (`kernels.geometry.splits`).

Triangles are first counted (`triangle_words`, `rims`), which gives every block its place in the mesh, and then written.
Vertices are numbered along a block's rows.
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F32, I32, I64, U16
from ...support.packed import Coding
from ..base import lanes
from ..base.jit import inlined, parallel, serial
from ..base.project import direction_in_world, position
from .records import BlockArrays, DepthMap, MeshArrays, Rays
from .rims import count_rims, write_rims
from .splits import BLOCK, EMPTY, MIXED, PLAIN, SIDE
from .triangle_words import SHAPES, TriangleList, count_listed, count_plain, list_triangles, new_list, read_flags

__all__ = ["BOTH", "RIMS", "SURFACE", "count_triangles", "emit_triangles"]

# The parts that are made: the surface, which ends at the centres of pixels at depth edges; the rims, which are the rest
# of those pixels' squares; or both. These overlap by at most half a quad, where a merged triangle reaches into a quad
# with a cut.
SURFACE, RIMS, BOTH = 0, 1, 2


@serial
def _write_listed(
    found: TriangleList, n: int, used: I64, numbers: I32, second: int, triangles: I32, t: int
) -> int:
    """Write the triangles of a list of n words from triangle t on; returns the next number. numbers [33]: the number of
    each row's first vertex."""
    words, ys, shapes = found
    for k in range(n):
        shape, y, word = SHAPES[shapes[k]], ys[k], words[k]
        ax, bx, cx = shape[0], shape[2], shape[4]
        row_a, row_b, row_c = used[y + shape[1]], used[y + shape[3]], used[y + shape[5]]
        first_a, first_b, first_c = numbers[y + shape[1]], numbers[y + shape[3]], numbers[y + shape[5]]
        while word != 0:
            x = lanes.lowest(word)
            word &= word - 1
            triangles[t, 0] = first_a + lanes.ones(row_a & ((1 << (x + ax)) - 1))
            triangles[t, second] = first_b + lanes.ones(row_b & ((1 << (x + bx)) - 1))
            triangles[t, 3 - second] = first_c + lanes.ones(row_c & ((1 << (x + cx)) - 1))
            t += 1
    return t


@parallel
def count_triangles(depth: DepthMap, blocks: BlockArrays, parts: int, counts: I64) -> None:
    """Fill counts [blocks, 2], the vertices and triangles of every block, and the blocks' used words. parts: SURFACE,
    RIMS or BOTH. Blocks that are not remade stay."""
    h, w = depth.flags.shape
    block_rows, block_columns = blocks.states.shape
    limit = w if depth.wraps else w - 1
    for row in numba.prange(block_rows):
        i = int(np.int64(row))
        bits, found = np.empty((4, SIDE), np.int64), new_list()
        for j in range(block_columns):
            x0, y0, b = j * BLOCK, i * BLOCK, i * block_columns + j
            if blocks.remade[i, j] == 0:
                continue
            counts[b, 0], counts[b, 1] = 0, 0
            state = blocks.states[i, j]
            if state == EMPTY:
                continue
            splits, used = blocks.splits[i, j], blocks.used[i, j]
            read_flags(depth.flags, x0, y0, depth.wraps, state, bits)
            columns, rows = min(SIDE, limit + 1 - x0), min(SIDE, h - y0)
            if parts != RIMS and state == PLAIN:
                counts[b, 0], counts[b, 1] = count_plain(splits, used)
            elif parts != RIMS:
                n = list_triangles(splits, bits, (i + j) % 2, columns, rows, parts == BOTH, found)
                counts[b, 0], counts[b, 1] = count_listed(found, n, used)
            if parts != SURFACE and state == MIXED:
                quarters = count_rims(bits, columns, rows)
                counts[b, 0] += 4 * quarters
                counts[b, 1] += 2 * quarters


@serial(fastmath={"contract"})
def _write_used(
    codes: U16, x0: int, y0: int, used: I64, coding: Coding, rays: Rays, mesh: MeshArrays, numbers: I32, index: int
) -> int:
    """Write the block's grid vertices from number `index` on; returns the next number. numbers [33]: filled with the
    number of each row's first vertex."""
    camera, across, down = rays
    points, uv = mesh.points, mesh.uv
    w, (offset, step, least) = codes.shape[1], (coding.offset, coding.step, coding.min_code)
    ox, oy, oz = position(camera)
    for y in range(SIDE):
        numbers[y] = index
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
            points[index, 0] = ox + depth * (a * ax + b * bx + cx)
            points[index, 1] = oy + depth * (a * ay + b * by + cy)
            points[index, 2] = oz + depth * (a * az + b * bz + cz)
            if uv.shape[0] > 0:
                uv[index, 0], uv[index, 1] = x + 0.5, v + 0.5
            index += 1
    return index


@inlined
def _copied(target: F32, source: F32, first: int, before: int, count: int) -> None:
    """Copy `count` rows of an array, from `before` on, to `first` on in another one."""
    # As one row each: of that loop LLVM makes vectors.
    to, given = target[first : first + count].reshape(-1), source[before : before + count].reshape(-1)
    for k in range(to.shape[0]):
        to[k] = given[k]


@serial
def _copy_blocks(before: I64, old: MeshArrays, start: I64, end: I64, mesh: MeshArrays) -> None:
    """Copy neighbouring blocks' vertices and triangles from `before` [2] on in the old mesh to `start` [2] .. `end` [2]
    (excluded) in the new one, and renumber the vertices."""
    vertices, count = end[0] - start[0], end[1] - start[1]
    _copied(mesh.points, old.points, start[0], before[0], vertices)
    if mesh.uv.shape[0] > 0:
        _copied(mesh.uv, old.uv, start[0], before[0], vertices)
    moved = np.int32(start[0] - before[0])
    to, given = mesh.triangles[start[1] : end[1]].reshape(-1), old.triangles[before[1] : before[1] + count].reshape(-1)
    for k in range(to.shape[0]):
        to[k] = given[k] + moved


@inlined
def _unchanged(blocks: BlockArrays, i: int, j: int) -> int:
    """How many blocks from block (i, j) on, in its row, are not remade."""
    end = j
    while end < blocks.remade.shape[1] and blocks.remade[i, end] == 0:
        end += 1
    return end - j


@parallel
def emit_triangles(
    depth: DepthMap, blocks: BlockArrays, parts: int, starts: I64, coding: Coding, rays: Rays, second: int,
    mesh: MeshArrays, old_starts: I64, old: MeshArrays,
) -> None:  # fmt: skip
    """Fill a mesh with the counted triangles; starts [blocks + 1, 2]: where each block's vertices and triangles begin.

    second: 1, or 2 to wind triangles the other way. Blocks that are not remade are copied from the old mesh. Where `uv`
    is empty, that is left out.
    """
    h, w = depth.flags.shape
    block_rows, block_columns = blocks.states.shape
    limit = w if depth.wraps else w - 1
    for row in numba.prange(block_rows):
        i = int(np.int64(row))
        bits, found, numbers = np.empty((4, SIDE), np.int64), new_list(), np.empty(SIDE, np.int32)
        done = 0  # columns
        for j in range(block_columns):
            x0, y0, b = j * BLOCK, i * BLOCK, i * block_columns + j
            v, t = starts[b, 0], starts[b, 1]
            if j < done or starts[b + 1, 1] == t:
                continue
            same = _unchanged(blocks, i, j)
            if same > 0:
                _copy_blocks(old_starts[b], old, starts[b], starts[b + same], mesh)
                done = j + same
                continue
            state = blocks.states[i, j]
            read_flags(depth.flags, x0, y0, depth.wraps, state, bits)
            columns, rows = min(SIDE, limit + 1 - x0), min(SIDE, h - y0)
            if parts != RIMS:
                used = blocks.used[i, j]
                n = list_triangles(blocks.splits[i, j], bits, (i + j) % 2, columns, rows, parts == BOTH, found)
                v = _write_used(depth.codes, x0, y0, used, coding, rays, mesh, numbers, v)
                t = _write_listed(found, n, used, numbers, second, mesh.triangles, t)
            if parts != SURFACE and state == MIXED:
                write_rims(depth.codes, (x0, y0, columns, rows), bits, coding, rays, second, mesh, v, t)
