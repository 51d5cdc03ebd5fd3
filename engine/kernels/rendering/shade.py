"""Shading: one colour for each pixel of a warped picture, fetched from the views that see its surface.

A pixel's disparity gives a point, which is projected into each view. A view that measured the same depth there
contributes its colour, interpolated over the texels of that surface: bilinear, or by cubic convolution (Keys 1981),
which keeps the sharpness that blending would reduce. The weight is higher for views that look from nearly the same
direction (angle: unstructured lumigraph, Buehler et al. 2001), that resolve the surface at least as finely (distance),
and for texels that are not a mixture of two surfaces; it falls near a picture's border.

Pictures are processed by pairs of rows, and these by `cells`.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F32, F64, I64, U8
from ..base.jit import inlined, inlined_late, parallel, serial
from ..base.memory import VECTOR_BYTES, load, store
from ..base.simd import LANES, Floats, Mask, any_of, maximum, minimum, select, spread, zipped, zipped_rest
from ..base.tone import LARGEST
from ..base.view_table import Views
from .cells import CELL, FIELDS, PARTS, Sources, colour_cell, see_cell
from .eye_directions import column_directions, row_direction
from .lens import LENS_SIZE, make_lens
from .records import DepthBuffer, Planes
from .winner_colour import shade_by_winner

__all__ = ["shade"]

_CHUNKS = 64
_PIXELS = 4  # vectors per part for a cell's pixels
_ROOM = 7  # vectors per part for a cell's pixels and sums


@serial
def _shade_pair(
    camera: F64, y: int, width: int, near: int, across: int, sources: Sources, room: int, lumas: int, chromas: int
) -> None:
    """Colour two rows of `width` pixels, a multiple of a cell. Addresses of float32 arrays: near [2, width]: disparity
    of the pixels to be coloured; across [2, width]: see `column_directions`; lumas [2, width]: filled, -1 where no view
    agrees; chromas [3, width / 2]: filled for each block with sums of cb and cr over the pixels coloured, and their
    number; room [ROOM + views FIELDS, PARTS, LANES]."""
    scale, height = row_direction(camera, y)
    scale_below, height_below = row_direction(camera, y + 1)
    pixels, sums, seen = room, room + _PIXELS * PARTS * VECTOR_BYTES, room + _ROOM * PARTS * VECTOR_BYTES
    for x in range(0, width, CELL):
        for part in range(PARTS):
            below, column = part >= 2, x + (part & 1) * LANES
            s = np.float32(scale_below if below else scale)
            store(pixels, part * LANES, load(near, column + width if below else column))
            store(pixels, (PARTS + part) * LANES, load(across, column) * s)
            store(pixels, (2 * PARTS + part) * LANES, load(across, width + column) * s)
            store(pixels, (3 * PARTS + part) * LANES, spread(height_below if below else height))
        asked = see_cell(sources, pixels, seen, sums)
        for part in range(PARTS):
            total, luma = load(sums, (PARTS + part) * LANES), load(sums, (2 * PARTS + part) * LANES)
            inverse = 1.0 / maximum(total, 1e-30)
            store(sums, (PARTS + part) * LANES, inverse)
            column = x + (part & 1) * LANES
            store(lumas, column + width if part >= 2 else column, select(total > 0.0, luma * inverse, -1.0))
        b, r, count = colour_cell(sources, asked, seen, sums + PARTS * VECTOR_BYTES)
        store(chromas, x >> 1, b)
        store(chromas, (width + x) >> 1, r)
        store(chromas, width + (x >> 1), count)


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
    whole = w - w % CELL
    for x in range(0, whole, CELL):
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
def _shade_rows(
    first: int, last: int, buffer: DepthBuffer, camera: F64, across: F32, full: Views, lenses: _Lenses, planes: Planes
) -> None:
    """Shade the pairs of rows `first` to `last` (excluded)."""
    n = lenses.lenses.shape[0]
    sources = Sources(lenses.lenses.ctypes.data, lenses.addresses.ctypes.data, n, lenses.blend, lenses.cubic)
    disparity, winner = buffer
    luma, chroma_b, chroma_r = planes
    h, w = disparity.shape
    padded = across.shape[1]
    near, lumas = np.zeros((2, padded), np.float32), np.empty((2, padded), np.float32)
    chromas = np.empty((3, padded // 2), np.float32)
    room = np.empty((_ROOM + n * FIELDS) * PARTS * LANES, np.float32)
    zero, largest = np.float32(0.0), np.float32(LARGEST)
    for y in range(2 * first, min(2 * last, h), 2):
        rows = min(2, h - y)
        if rows == 1:
            for x in range(w):
                near[1, x] = zero
        for row in range(rows):
            for x in range(w):
                near[row, x] = disparity[y + row, x] if winner[y + row, x] < n else zero
        _shade_pair(
            camera, y, padded, near.ctypes.data, across.ctypes.data, sources, room.ctypes.data, lumas.ctypes.data,
            chromas.ctypes.data,
        )  # fmt: skip
        for row in range(rows):
            v = y + row
            _ask_winners(full, camera, v, disparity[v], winner[v], lumas[row], chromas)
        for i in range(chromas.shape[1]):
            inverse = np.float32(1.0) / chromas[2, i]
            chromas[0, i] = min(max(chromas[0, i] * inverse, zero), largest)
            chromas[1, i] = min(max(chromas[1, i] * inverse, zero), largest)
        for row in range(rows):
            v = y + row
            _write_row(disparity[v], lumas[row], chromas[0], chromas[1], luma[v], chroma_b[v], chroma_r[v])


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
    pairs, padded = (h + 1) // 2, (w + CELL - 1) // CELL * CELL
    lenses, across = np.empty((n_views, LENS_SIZE), np.float32), np.empty((2, padded), np.float32)
    for k in range(n_views):
        make_lens(views.table[k], camera, lenses[k])
    column_directions(camera, w, across)
    asked = _Lenses(lenses, views.addresses, blend, cubic)
    chunks = min(pairs, _CHUNKS)
    for chunk in numba.prange(chunks):
        # Chunks of neighbouring rows, as they read the same texels.
        first, last = np.int64(chunk) * pairs // chunks, (np.int64(chunk) + 1) * pairs // chunks
        _shade_rows(first, last, buffer, camera, across, full, asked, planes)
