"""Shading: one colour for each pixel of a warped picture, fetched from the views that see its surface.

A pixel's disparity gives a point, which is projected into each view. A view that measured the same depth there
contributes its colour, interpolated over the texels of that surface: bilinear, or by cubic convolution (Keys 1981),
which keeps the sharpness that blending would reduce. The weight is higher for views that look from nearly the same
direction (angle: unstructured lumigraph, Buehler et al. 2001), that resolve the surface at least as finely (distance),
and for texels that are not a mixture of two surfaces; it falls near a picture's border.

Pictures are processed by strips of eight rows, and these by `cells`.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F32, F64, I64, U8
from ..base.jit import inlined, inlined_late, parallel, serial
from ..base.memory import VECTOR_BYTES, load, store
from ..base.simd import LANES, Floats, Mask, any_of, maximum, minimum, select, zipped, zipped_rest
from ..base.tone import LARGEST
from ..base.view_table import Views
from ..base.windows import load_square, store_square
from .cells import CELL, FIELDS, PARTS, Sources, colour_cell, see_cell
from .eye_directions import column_directions, row_direction
from .lens import LENS_SIZE, make_lens
from .records import DepthBuffer, Planes
from .winner_colour import shade_by_winner

__all__ = ["shade"]

_CHUNKS = 64
_SQUARE = 4  # side of a part of a cell, pixels
_PIXELS = 4  # vectors per part for a cell's pixels
_ROOM = 7  # vectors per part for a cell's pixels and sums


@serial
def _shade_strip(
    width: int, near: int, across: int, rises: int, sources: Sources, room: int, lumas: int, chromas: int
) -> None:
    """Colour a strip of CELL rows of `width` pixels, a multiple of a cell. Addresses of float32 arrays: near [CELL,
    width]: disparity of the pixels to be coloured; across [2, width]: see `column_directions`; rises [2, 2, LANES]: for
    each square in a column of a cell, `row_direction` of its pixels; lumas [CELL, width]: filled, -1 where no view
    agrees; chromas [CELL / 2, 3, width / 2]: filled for each block with sums of cb and cr over the pixels coloured, and
    their number; room [ROOM + views FIELDS, PARTS, LANES]."""
    pixels, sums, seen = room, room + _PIXELS * PARTS * VECTOR_BYTES, room + _ROOM * PARTS * VECTOR_BYTES
    half = width >> 1
    for x in range(0, width, CELL):
        for part in range(PARTS):
            lower, column = part >> 1, x + (part & 1) * _SQUARE
            scale = load(rises, 2 * lower * LANES)
            store(pixels, part * LANES, load_square(near, lower * _SQUARE * width + column, width))
            store(pixels, (PARTS + part) * LANES, load_square(across, column, 0) * scale)
            store(pixels, (2 * PARTS + part) * LANES, load_square(across, width + column, 0) * scale)
            store(pixels, (3 * PARTS + part) * LANES, load(rises, (2 * lower + 1) * LANES))
        asked = see_cell(sources, pixels, seen, sums)
        for part in range(PARTS):
            total, luma = load(sums, (PARTS + part) * LANES), load(sums, (2 * PARTS + part) * LANES)
            inverse = 1.0 / maximum(total, 1e-30)
            store(sums, (PARTS + part) * LANES, inverse)
            place = (part >> 1) * _SQUARE * width + x + (part & 1) * _SQUARE
            store_square(lumas, place, width, select(total > 0.0, luma * inverse, -1.0))
        b, r, count = colour_cell(sources, asked, seen, sums + PARTS * VECTOR_BYTES)
        store_square(chromas, x >> 1, 3 * half, b)
        store_square(chromas, half + (x >> 1), 3 * half, r)
        store_square(chromas, width + (x >> 1), 3 * half, count)


@inlined
def _are_coloured(drawn: int, luma: int, x: int) -> bool:
    """Whether all drawn ones of sixteen pixels are coloured (luma not below 0)."""
    return not any_of((load(drawn, x) > 0.0) & (load(luma, x) < 0.0))


@serial
def _ask_winners(
    views: Views, camera: F64, y: int, drawn: F32, winner: U8, luma: F32, chromas: F32
) -> None:
    """Give the pixels of a row that no view has coloured the colour of the view that drew them."""
    w = drawn.shape[0]
    for start in range(0, w, LANES):
        if start + LANES <= w and _are_coloured(drawn.ctypes.data, luma.ctypes.data, start):
            continue
        for x in range(start, min(start + LANES, w)):
            if luma[x] < np.float32(0.0) and drawn[x] > np.float32(0.0):
                tone, b, r = shade_by_winner(views, np.int64(winner[x]), camera, y, x, drawn[x])
                luma[x] = max(tone, 0.0)
                chromas[0, x >> 1] += b
                chromas[1, x >> 1] += r
                chromas[2, x >> 1] += 1.0


@inlined_late
def _store_where(mask: Mask, address: int, x: int, values: Floats) -> None:
    store(address, x, select(mask, values, load(address, x)))


@serial
def _write_cell(drawn: int, luma: int, chroma_b: int, chroma_r: int, out: int, out_b: int, out_r: int, x: int) -> None:
    """Write the drawn ones of 32 pixels of a row; chroma_b and chroma_r are of its blocks."""
    left, right = load(drawn, x) > 0.0, load(drawn, x + LANES) > 0.0
    b, r = load(chroma_b, x >> 1), load(chroma_r, x >> 1)
    # Clipped, as tones and cubic convolution overshoot.
    _store_where(left, out, x, minimum(maximum(load(luma, x), 0.0), np.float32(LARGEST)))
    _store_where(right, out, x + LANES, minimum(maximum(load(luma, x + LANES), 0.0), np.float32(LARGEST)))
    _store_where(left, out_b, x, zipped(b, b))
    _store_where(right, out_b, x + LANES, zipped_rest(b, b))
    _store_where(left, out_r, x, zipped(r, r))
    _store_where(right, out_r, x + LANES, zipped_rest(r, r))


@serial
def _write_row(drawn: F32, luma: F32, chroma_b: F32, chroma_r: F32, out: F32, out_b: F32, out_r: F32) -> None:
    """Write the drawn pixels of a row, clipped to the range of codes."""
    w = drawn.shape[0]
    whole = w - w % (2 * LANES)
    for x in range(0, whole, 2 * LANES):
        _write_cell(
            drawn.ctypes.data, luma.ctypes.data, chroma_b.ctypes.data, chroma_r.ctypes.data,
            out.ctypes.data, out_b.ctypes.data, out_r.ctypes.data, x,
        )  # fmt: skip
    for x in range(whole, w):
        if drawn[x] > 0.0:
            out[x], out_b[x], out_r[x] = min(max(luma[x], 0.0), LARGEST), chroma_b[x >> 1], chroma_r[x >> 1]


class _Lenses(NamedTuple):
    """The arrays behind `cells.Sources`, which keeps only addresses: they must live as long as it is used."""

    lenses: F32  # [views, LENS_SIZE]
    addresses: I64  # [views or more, PLANE_COUNT]
    blend: int
    cubic: bool


@serial
def _set_out(camera: F64, y: int, rows: int, buffer: DepthBuffer, n: int, near: F32, rises: F32) -> None:
    """Fill `near` and `rises`, as `_shade_strip` takes them, for the strip of `rows` rows from row y on; nothing is
    drawn in others. n: number of the views."""
    disparity, winner = buffer
    w = disparity.shape[1]
    for row in range(CELL):
        scale, height = row_direction(camera, y + row)
        for k in range(_SQUARE):
            lane = row % _SQUARE * _SQUARE + k
            rises[row // _SQUARE, 0, lane], rises[row // _SQUARE, 1, lane] = scale, height
        for x in range(near.shape[1]):
            near[row, x] = np.float32(0.0)
        if row < rows:
            for x in range(w):
                near[row, x] = disparity[y + row, x] if winner[y + row, x] < n else np.float32(0.0)


@serial
def _divide(chromas: F32) -> None:
    """Sums of chroma -> means, clipped to the range of codes."""
    zero, largest = np.float32(0.0), np.float32(LARGEST)
    for pair in range(chromas.shape[0]):
        for i in range(chromas.shape[2]):
            inverse = np.float32(1.0) / chromas[pair, 2, i]
            chromas[pair, 0, i] = min(max(chromas[pair, 0, i] * inverse, zero), largest)
            chromas[pair, 1, i] = min(max(chromas[pair, 1, i] * inverse, zero), largest)


@serial
def _shade_rows(
    first: int, last: int, buffer: DepthBuffer, camera: F64, across: F32, full: Views, lenses: _Lenses, planes: Planes
) -> None:
    """Shade the strips of CELL rows `first` to `last` (excluded)."""
    n = lenses.lenses.shape[0]
    sources = Sources(lenses.lenses.ctypes.data, lenses.addresses.ctypes.data, n, lenses.blend, lenses.cubic)
    disparity, winner = buffer
    luma, chroma_b, chroma_r = planes
    h, padded = disparity.shape[0], across.shape[1]
    near, lumas = np.empty((CELL, padded), np.float32), np.empty((CELL, padded), np.float32)
    chromas, rises = np.empty((CELL // 2, 3, padded // 2), np.float32), np.empty((2, 2, LANES), np.float32)
    room = np.empty((_ROOM + n * FIELDS) * PARTS * LANES, np.float32)
    for y in range(CELL * first, min(CELL * last, h), CELL):
        rows = min(CELL, h - y)
        _set_out(camera, y, rows, buffer, n, near, rises)
        _shade_strip(
            padded, near.ctypes.data, across.ctypes.data, rises.ctypes.data, sources, room.ctypes.data,
            lumas.ctypes.data, chromas.ctypes.data,
        )  # fmt: skip
        for row in range(rows):
            v = y + row
            _ask_winners(full, camera, v, disparity[v], winner[v], lumas[row], chromas[row >> 1])
        _divide(chromas)
        for row in range(rows):
            v, (b, r, _) = y + row, chromas[row >> 1]
            _write_row(disparity[v], lumas[row], b, r, luma[v], chroma_b[v], chroma_r[v])


@parallel
def shade(
    buffer: DepthBuffer, camera: F64, full: Views, views: Views, n_views: int, blend: int, cubic: bool, planes: Planes
) -> None:
    """Colour the planes where something was drawn; a block of 2 x 2 pixels has one chroma.

    `full` and `views`: the same views, at full size and at a size that suits the picture. Where the latter have no
    texel of a surface, the former are used.

    The first n_views are the warped views, the most useful first; further ones are backdrops, which colour only the
    pixels that they won. At most `blend` agreeing views contribute to a pixel; with `cubic` they are interpolated by
    cubic convolution where a surface is whole and its colours are rough.
    """
    h, w = buffer.disparity.shape
    strips, padded = (h + CELL - 1) // CELL, (w + CELL - 1) // CELL * CELL
    lenses, across = np.empty((n_views, LENS_SIZE), np.float32), np.empty((2, padded), np.float32)
    for k in range(n_views):
        make_lens(views.table[k], camera, lenses[k])
    column_directions(camera, w, across)
    asked = _Lenses(lenses, views.addresses, blend, cubic)
    chunks = min(strips, _CHUNKS)
    for chunk in numba.prange(chunks):
        # Chunks of neighbouring rows, as they read the same texels.
        first, last = np.int64(chunk) * strips // chunks, (np.int64(chunk) + 1) * strips // chunks
        _shade_rows(first, last, buffer, camera, across, full, asked, planes)
