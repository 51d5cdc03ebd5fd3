"""Colours of a cell, 8 x 8 pixels: four squares of luma (parts), and one vector of chroma for its 4 x 4 blocks of 2 x 2
pixels.

The samples of a cell in the views (`kernels.rendering.look`) are kept until all views have been asked: only then is the
share of each view in a pixel's colour known. Chroma, a quarter of the samples, is fetched at the pixels' places in the
views, or once by cubic convolution for a block that is smooth in a view.

All arrays are given by address, as float32 [..., PARTS, LANES].
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base.jit import inlined_late, serial
from ..base.memory import load, load_f32, store
from ..base.simd import LANES, Floats, any_of, evens, maximum, odds, select, spread
from ..base.tone import CB_FROM_Y, CB_GAIN, CB_OFFSET, CR_FROM_Y, CR_GAIN, CR_OFFSET, Y_GAIN, Y_OFFSET
from ..base.view_table import ROW_OF_ADDRESSES
from ..base.windows import lower_rows, upper_rows
from .lens import OUTSIDE, TONE_AT, aim, lens_at
from .look import ROUGH, look
from .texels import chroma_between, chroma_nearest, is_inside_chroma

__all__ = ["CELL", "FIELDS", "PARTS", "Sources", "colour_cell", "see_cell"]

PARTS = 4
CELL = 8  # side, pixels
_SHARE, _LUMA, _U, _V, _MANNER, _CODE, _CLEAN, _MIXED = range(8)  # fields of a view's samples
FIELDS = 8
_APART_PX = 3.0  # largest distance of a block's pixels in a view at which they share chroma


class Sources(NamedTuple):
    """Views that colour a picture: addresses of their lenses and of their planes' addresses, and how to use them."""

    lenses: int
    addresses: int
    view_count: int
    blend: int  # largest number of views that contribute to a pixel
    cubic: bool  # interpolate by cubic convolution where a surface is whole and its colours are rough


@inlined_late
def addresses_of(sources: Sources, k: int) -> int:
    """The address of the addresses of view k's planes."""
    return sources.addresses + k * ROW_OF_ADDRESSES


@inlined_late
def _field(seen: int, k: int, part: int, field: int) -> Floats:
    return load(seen, ((k * FIELDS + field) * PARTS + part) * LANES)


@inlined_late
def _put(seen: int, k: int, part: int, field: int, values: Floats) -> None:
    store(seen, ((k * FIELDS + field) * PARTS + part) * LANES, values)


@inlined_late
def _by_block(a: Floats, b: Floats, c: Floats, d: Floats) -> Floats:
    """Sums of each block's four pixels, from a cell's four parts."""
    top, bottom = evens(a, b) + odds(a, b), evens(c, d) + odds(c, d)
    return upper_rows(top, bottom) + lower_rows(top, bottom)


@inlined_late
def _shared(seen: int, k: int, part: int, field: int) -> Floats:
    """A field times the pixels' shares; pixels without a share may hold anything, even NaN."""
    share = _field(seen, k, part, _SHARE)
    return select(share > 0.0, share * _field(seen, k, part, field), 0.0)


@inlined_late
def _sum(seen: int, k: int, field: int) -> Floats:
    """For each block in view k, the sum of a field, weighted by the pixels' shares."""
    return _by_block(
        _shared(seen, k, 0, field), _shared(seen, k, 1, field), _shared(seen, k, 2, field), _shared(seen, k, 3, field)
    )


@inlined_late
def _of_seen(seen: int, k: int, part: int, field: int, sign: float) -> Floats:
    return select(_field(seen, k, part, _SHARE) > 0.0, sign * _field(seen, k, part, field), -1e9)


@inlined_late
def _most(seen: int, k: int, field: int, sign: float) -> Floats:
    """For each block in view k, the largest value of a field, times a sign, among the pixels that the view sees."""
    a, b = _of_seen(seen, k, 0, field, sign), _of_seen(seen, k, 1, field, sign)
    c, d = _of_seen(seen, k, 2, field, sign), _of_seen(seen, k, 3, field, sign)
    top, bottom = maximum(evens(a, b), odds(a, b)), maximum(evens(c, d), odds(c, d))
    return maximum(upper_rows(top, bottom), lower_rows(top, bottom))


@inlined_late
def _nearest(lens: int, addresses: int, seen: int, k: int, part: int) -> tuple[Floats, Floats]:
    """The chroma samples nearest to a part's pixels in view k, times the pixels' shares."""
    share = _field(seen, k, part, _SHARE)
    b, r = chroma_nearest(lens, addresses, _field(seen, k, part, _U), _field(seen, k, part, _V), share > 0.0)
    return share * b, share * r


@serial
def _chroma_of_pixels(lens: int, addresses: int, seen: int, k: int) -> tuple[Floats, Floats]:
    """Chroma of each block in view k: the sum over its pixels of the nearest sample times the pixel's share."""
    b0, r0 = _nearest(lens, addresses, seen, k, 0)
    b1, r1 = _nearest(lens, addresses, seen, k, 1)
    b2, r2 = _nearest(lens, addresses, seen, k, 2)
    b3, r3 = _nearest(lens, addresses, seen, k, 3)
    return _by_block(b0, b1, b2, b3), _by_block(r0, r1, r2, r3)


@serial
def _colour_blocks(lens: int, addresses: int, cubic: bool, seen: int, k: int, weight: Floats) -> tuple[Floats, Floats]:
    """Chroma of a cell's blocks in view k, times their weight: from each pixel; or, if the block is smooth in the view
    but its colours are rough, by cubic convolution at its middle, if the view has all samples for that."""
    between, b, r = weight < 0.0, spread(0.0), spread(0.0)
    if cubic:
        between = _most(seen, k, _MANNER, 1.0) == np.float32(ROUGH)
        if any_of(between):
            between &= _most(seen, k, _U, 1.0) + _most(seen, k, _U, -1.0) <= np.float32(_APART_PX)
            between &= _most(seen, k, _V, 1.0) + _most(seen, k, _V, -1.0) <= np.float32(_APART_PX)
            # Smooth pixels of a rough block may be nearer to the border than rough ones, and so may the block's middle.
            u, v = _sum(seen, k, _U) / weight, _sum(seen, k, _V) / weight
            between &= is_inside_chroma(lens, u, v)
            b, r = chroma_between(lens, addresses, u, v, between)
            b, r = select(between, b * weight, 0.0), select(between, r * weight, 0.0)
    if any_of((weight > 0.0) & ~between):
        near_b, near_r = _chroma_of_pixels(lens, addresses, seen, k)
        b, r = select(between, b, near_b), select(between, r, near_r)
    return b, r


@serial
def colour_cell(sources: Sources, n: int, seen: int, inverses: int) -> tuple[Floats, Floats, Floats]:
    """Chroma of a cell's sixteen blocks: sums of cb and cr over the pixels that the first n views coloured, and the
    number of these pixels.

    inverses [PARTS, LANES]: 1 / sum of each pixel's weights."""
    count, sum_b, sum_r = spread(0.0), spread(0.0), spread(0.0)
    for k in range(n):
        for part in range(PARTS):  # shares of the pixels' colours
            _put(seen, k, part, _SHARE, _field(seen, k, part, _SHARE) * load(inverses, part * LANES))
        weight = _by_block(
            _field(seen, k, 0, _SHARE), _field(seen, k, 1, _SHARE), _field(seen, k, 2, _SHARE),
            _field(seen, k, 3, _SHARE),
        )  # fmt: skip
        if any_of(weight > 0.0):
            lens = lens_at(sources.lenses, k)
            b, r = _colour_blocks(lens, addresses_of(sources, k), sources.cubic, seen, k, weight)
            luma = _sum(seen, k, _LUMA)
            on_b, on_r = load_f32(lens, TONE_AT + CB_FROM_Y), load_f32(lens, TONE_AT + CR_FROM_Y)
            shift_b, shift_r = load_f32(lens, TONE_AT + CB_OFFSET), load_f32(lens, TONE_AT + CR_OFFSET)
            sum_b += load_f32(lens, TONE_AT + CB_GAIN) * b + on_b * luma + shift_b * weight
            sum_r += load_f32(lens, TONE_AT + CR_GAIN) * r + on_r * luma + shift_r * weight
            count += weight
    return sum_b, sum_r, count


@serial
def _aim_cell(lens: int, blends: bool, pixels: int, seen: int, k: int) -> None:
    """Writes the places of a cell's pixels in view k.

    It is a function of its own, without fetches that wait for memory: its parts do not depend on each other, and the
    processor works on several parts at once if they are short."""
    for part in range(PARTS):
        q, dx = load(pixels, part * LANES), load(pixels, (PARTS + part) * LANES)
        dy, dz = load(pixels, (2 * PARTS + part) * LANES), load(pixels, (3 * PARTS + part) * LANES)
        u, v, code, clean, mixed = aim(lens, q, dx, dy, dz, blends)
        _put(seen, k, part, _U, u)
        _put(seen, k, part, _V, v)
        _put(seen, k, part, _CODE, code)
        _put(seen, k, part, _CLEAN, clean)
        _put(seen, k, part, _MIXED, mixed)


@serial
def _look_cell(lens: int, addresses: int, blend: int, cubic: bool, pixels: int, seen: int, k: int, sums: int) -> bool:
    """Ask view k for the pixels of a cell that still need views; returns whether any are left after it."""
    left = spread(0.0)
    for part in range(PARTS):
        count = load(sums, part * LANES)
        wanted = (count < np.float32(blend)) & (load(pixels, part * LANES) > 0.0)
        u, v, code = _field(seen, k, part, _U), _field(seen, k, part, _V), _field(seen, k, part, _CODE)
        clean, mixed = _field(seen, k, part, _CLEAN), _field(seen, k, part, _MIXED)
        share, luma, u, v, manner = look(
            lens, addresses, wanted & (code > np.float32(OUTSIDE)), u, v, code, clean, mixed, blend > 1, cubic
        )  # fmt: skip
        _put(seen, k, part, _SHARE, share)
        _put(seen, k, part, _LUMA, luma)
        _put(seen, k, part, _U, u)
        _put(seen, k, part, _V, v)
        _put(seen, k, part, _MANNER, manner)
        count += select(share > 0.0, spread(1.0), 0.0)
        toned_luma = load_f32(lens, TONE_AT + Y_GAIN) * luma + load_f32(lens, TONE_AT + Y_OFFSET)
        store(sums, part * LANES, count)
        store(sums, (PARTS + part) * LANES, load(sums, (PARTS + part) * LANES) + share)
        store(sums, (2 * PARTS + part) * LANES, load(sums, (2 * PARTS + part) * LANES) + share * toned_luma)
        left += select(wanted & (count < np.float32(blend)), spread(1.0), 0.0)
    return any_of(left > 0.0)


@serial
def see_cell(sources: Sources, pixels: int, seen: int, sums: int) -> int:
    """Ask views for a cell; returns the number of views asked.

    pixels [4, PARTS, LANES]: disparity and direction; seen [views, FIELDS, PARTS, LANES]: filled for the views asked;
    sums [3, PARTS, LANES]: filled with the number of views that agree, the sum of their weights, and the weighted sum
    of their luma.
    """
    largest = spread(0.0)
    for part in range(PARTS):
        largest = maximum(largest, load(pixels, part * LANES))
    for i in range(3 * PARTS):
        store(sums, i * LANES, spread(0.0))
    k, any_left = 0, any_of(largest > 0.0)
    while any_left and k < sources.view_count:
        lens = lens_at(sources.lenses, k)
        _aim_cell(lens, sources.blend > 1, pixels, seen, k)
        any_left = _look_cell(
            lens, addresses_of(sources, k), sources.blend, sources.cubic, pixels, seen, k, sums
        )
        k += 1
    return k
