"""Parts of captures' pictures, copied side by side into one picture (section 4.2: what is left of older captures)."""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, I32, I64, U16
from ..base.jit import inlined, parallel, serial
from ..base.memory import load_u16
from .captures import CB, CODES, CR, HEIGHT, WIDTH, WRAPS, Y

__all__ = [
    "COLUMN", "HIGH", "LEFT", "PART_SIZE", "ROW", "SOURCE", "TOP", "WIDE", "bound_parts", "copy_parts", "find_blocks",
    "renumber",
]  # fmt: skip

# Columns of a table of parts, int64 [n, PART_SIZE]: the source's row in a table of captures; the part's first column
# and row in the source's picture, its width and height, and its first column and row in the new picture. All but
# SOURCE are even, so that a part has whole samples of chroma.
SOURCE, LEFT, TOP, WIDE, HIGH, COLUMN, ROW = range(7)
PART_SIZE = 7


@serial
def find_blocks(uv: F32, corners: I64, source: I64, side: int, low: I64, size: I64, blocks: I64) -> None:
    """The block of each triangle's middle in its picture: blocks [m] are numbers below (the number of sources) * rows *
    columns.

    uv [n, 2]: of vertices; corners [m, 3]: their numbers; source [m]: number of the triangle's picture, from 0 on.
    Blocks are squares of `side` pixels; low [2]: column and row of the first block; size [2]: columns and rows.
    """
    for i in range(corners.shape[0]):
        a, b, c = corners[i, 0], corners[i, 1], corners[i, 2]
        column = math.floor((uv[a, 0] + uv[b, 0] + uv[c, 0]) / (3.0 * side)) - low[0]
        row = math.floor((uv[a, 1] + uv[b, 1] + uv[c, 1]) / (3.0 * side)) - low[1]
        column, row = min(max(column, 0), size[0] - 1), min(max(row, 0), size[1] - 1)
        blocks[i] = (source[i] * size[1] + row) * size[0] + column


@serial
def bound_parts(uv: F32, corners: I64, part: I64, bounds: F32) -> None:
    """bounds [n, 4]: the least u and v and the largest u and v of the triangles of each part; part [m]: theirs."""
    for i in range(bounds.shape[0]):
        bounds[i, 0] = bounds[i, 1] = np.inf
        bounds[i, 2] = bounds[i, 3] = -np.inf
    for i in range(corners.shape[0]):
        for k in range(3):
            for axis in range(2):
                at = uv[corners[i, k], axis]
                bounds[part[i], axis] = min(bounds[part[i], axis], at)
                bounds[part[i], 2 + axis] = max(bounds[part[i], 2 + axis], at)


@serial
def renumber(corners: I64, part: I64, starts: I64, room: I64, order: I64, numbers: I32, used: I64) -> int:
    """Gives each pair of a part and a vertex a number of its own, part by part; returns how many there are.

    corners, part: as above; starts [parts]: the number of triangles of all parts before; it is changed. room
    [vertices]: scratch memory, -1 everywhere. order [m]: the triangles part by part; numbers [m, 3]: the numbers of the
    corners of these; used [.., 2]: part and vertex of each number.
    """
    for i in range(corners.shape[0]):
        order[starts[part[i]]] = i
        starts[part[i]] += 1
    count, first = 0, 0  # first: of the present part's numbers
    for j in range(corners.shape[0]):
        i = order[j]
        if j > 0 and part[order[j - 1]] != part[i]:
            first = count
        for k in range(3):
            vertex = corners[i, k]
            if room[vertex] < first:  # of a part before
                room[vertex] = count
                used[count, 0], used[count, 1] = part[i], vertex
                count += 1
            numbers[j, k] = room[vertex]
    return count


@inlined
def _clamped(x: int, size: int, wraps: bool) -> int:
    """A column or row clamped to the picture, or wrapped round."""
    return x % size if wraps else min(max(x, 0), size - 1)


@serial
def _copy_plane(source: I64, plane: int, part: I64, half: int, out: U16) -> None:
    """Copies a part of one plane; half: 2 where the plane has half the picture's size, else 1."""
    width, height = (source[WIDTH] + half - 1) // half, (source[HEIGHT] + half - 1) // half
    left, top, column, row = part[LEFT] // half, part[TOP] // half, part[COLUMN] // half, part[ROW] // half
    for y in range(part[HIGH] // half):
        line = width * _clamped(top + y, height, False)
        for x in range(part[WIDE] // half):
            out[row + y, column + x] = load_u16(source[plane], line + _clamped(left + x, width, source[WRAPS] != 0))


@parallel
def copy_parts(sources: I64, parts: I64, codes: U16, y: U16, cb: U16, cr: U16) -> None:
    """Copies parts [n, PART_SIZE] of pictures (sources: a table of captures, `captures`) into a picture's planes.

    Beyond a source's border lies the nearest pixel, or, at the sides of a picture that wraps, the other side's.
    """
    for k in numba.prange(parts.shape[0]):
        source = sources[parts[np.int64(k), SOURCE]]
        _copy_plane(source, CODES, parts[np.int64(k)], 1, codes)
        _copy_plane(source, Y, parts[np.int64(k)], 1, y)
        _copy_plane(source, CB, parts[np.int64(k)], 2, cb)
        _copy_plane(source, CR, parts[np.int64(k)], 2, cr)
