"""Sorting of a perspective picture's triangles into bands of rows, sixteen triangles at once."""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F32, F64, I32, I64
from ...support.packed import FX, FY, HEIGHT, WIDTH
from ..base.jit import inlined, parallel, serial
from ..base.memory import VECTOR_BYTES, gather_bytes, store_packed
from ..base.records import gather_records
from ..base.simd import (
    LANES,
    Floats,
    Integers,
    Mask,
    any_of,
    lane_numbers,
    maximum,
    minimum,
    select,
    spread,
    to_integers,
)
from .records import Bands, Regions, VisibleBlocks
from .strips import Corners, corners, corners_side_by_side, extent
from .tiles import HOLE, SILHOUETTE, TILE

__all__ = ["sort_into_bands", "winding"]

# For triangles up to this size, testing the three corners is enough.
_SMALL_PX = 3.0
_TILE_BITS = TILE.bit_length() - 1

Box = tuple[Floats, Floats, Floats, Floats]  # left, right, top, bottom


@inlined
def winding(camera: F64) -> int:
    """`second` of `strips.corners` for a perspective target: a mirrored picture winds the other way."""
    return 2 if camera[FX] * camera[FY] < 0.0 else 1


@serial
def _touch(tiles: int, columns: int, rows: int, box: Box, marks: Integers, among: Mask) -> Mask:
    """Whether boxes touch a tile with one of the marks; tiles: address of uint8 [rows, columns] and 3 more bytes."""
    left = to_integers(maximum(box[0] - 1.0, 0.0)) >> _TILE_BITS
    right = minimum(to_integers(maximum(box[1] + 1.0, 0.0)) >> _TILE_BITS, columns - 1)
    bottom = minimum(to_integers(maximum(box[3], 0.0)) >> _TILE_BITS, rows - 1)
    i, j, found = left, to_integers(maximum(box[2], 0.0)) >> _TILE_BITS, among & ~among
    walks = among & (i <= right) & (j <= bottom)
    while any_of(walks):
        found |= walks & ((gather_bytes(tiles, j * columns + i, walks) & marks) != 0)
        i += 1
        ends = i > right
        i, j = select(ends, left, i), select(ends, j + 1, j)
        walks &= ~found & (j <= bottom)
    return found


@serial
def _may_win(
    points: Corners, nearer: int, tiles: int, columns: int, rows: int, box: Box, among: Mask
) -> Mask:
    """Whether triangles may win a pixel: at a corner, near a hole or, unless they are small, near a silhouette."""
    marked = gather_bytes(nearer, points[0], among) | gather_bytes(nearer, points[1], among)
    marked |= gather_bytes(nearer, points[2], among)
    found = among & ((marked & 1) != 0)
    small = maximum(box[1] - box[0], box[3] - box[2]) <= np.float32(_SMALL_PX)
    marks = select(small, (points[0] & 0) + HOLE, HOLE | SILHOUETTE)
    return found | _touch(tiles, columns, rows, box, marks, among & ~found)


@serial
def _look_at(
    screen: int, points: Corners, among: Mask, size: tuple[int, int], near: float, regions: Regions
) -> tuple[Mask, Floats, Floats]:
    """For sixteen triangles with these corners: whether they are to be drawn, and the first and last row that they may
    touch."""
    (width, height), (tiles, open_tiles, nearer) = size, regions
    ua, va, _, xa = gather_records(screen, points[0], among)
    ub, vb, _, xb = gather_records(screen, points[1], among)
    uc, vc, _, xc = gather_records(screen, points[2], among)
    before = among & (minimum(xa, minimum(xb, xc)) >= np.float32(near))
    crosses = among & ~before & (maximum(xa, maximum(xb, xc)) >= np.float32(near))  # clipped when drawn
    (first_column, last_column), (first, last) = extent(ua, ub, uc, width), extent(va, vb, vc, height)
    shows = before & ((ub - ua) * (vc - va) - (uc - ua) * (vb - va) < 0.0)
    shows &= (first_column <= last_column) & (first <= last)
    if any_of(shows):
        low, high = minimum(va, minimum(vb, vc)), maximum(va, maximum(vb, vc))
        limits = (minimum(ua, minimum(ub, uc)), maximum(ua, maximum(ub, uc)), low, high)
        if tiles.size > 0:
            box, marks = (limits[0], limits[1], first, last), (points[0] & 0) + 255
            shows = _touch(tiles.ctypes.data, tiles.shape[1], tiles.shape[0], box, marks, shows)
        if open_tiles.size > 0:
            shows = _may_win(
                points, nearer.ctypes.data, open_tiles.ctypes.data, open_tiles.shape[1], open_tiles.shape[0], limits,
                shows,
            )  # fmt: skip
    return shows | crosses, select(crosses, spread(0.0), first), select(crosses, spread(height - 1), last)


@parallel
def sort_into_bands(
    screen: F32, triangles: I32, blocks: VisibleBlocks, camera: F64, near: float, regions: Regions, bands: Bands,
    drawn: I64,
) -> None:  # fmt: skip
    """Sort visible blocks' triangles into bands; chunk c counts its triangles in drawn[c].

    It culls triangles that are outside the picture or between pixels, behind the eye or seen from behind, that touch no
    marked tile, and, unless `regions.open_tiles` is empty, that cannot win a pixel.
    """
    starts, visible, shares = blocks
    band_rows, counts, lists = bands
    size, second = (int(camera[WIDTH]), int(camera[HEIGHT])), winding(camera)
    bands_a_row = np.float32(1.0 / band_rows)  # times a row's middle: rounding never takes it across
    for chunk in numba.prange(counts.shape[0]):
        drawn[chunk] = 0
        for band in range(counts.shape[1]):
            counts[chunk, band] = 0
        found = np.empty((3, LANES), np.int32)
        for k in range(shares[chunk], shares[chunk + 1]):
            block = visible[k]
            for t in range(starts[block, 1], starts[block + 1, 1], LANES):
                among = lane_numbers() < np.float32(starts[block + 1, 1] - t)
                number = to_integers(lane_numbers()) + t
                if t + LANES <= triangles.shape[0]:
                    points = corners_side_by_side(triangles.ctypes.data, t, second)
                else:
                    points = corners(triangles.ctypes.data, number, second, among)
                shows, first, last = _look_at(screen.ctypes.data, points, among, size, near, regions)
                n = store_packed(found.ctypes.data, number, shows)
                store_packed(found.ctypes.data + VECTOR_BYTES, to_integers((first + 0.5) * bands_a_row), shows)
                store_packed(found.ctypes.data + 2 * VECTOR_BYTES, to_integers((last + 0.5) * bands_a_row), shows)
                drawn[chunk] += n
                for i in range(n):
                    for band in range(found[1, i], found[2, i] + 1):
                        lists[chunk, band, counts[chunk, band]] = found[0, i]
                        counts[chunk, band] += 1


