"""Fetching texels of a view's pictures for sixteen pixels: single texels, pairs, or by cubic convolution.

Pictures are given by the addresses of their arrays, C-contiguous; texels are counted along their rows.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base.jit import inlined_late, serial
from ..base.memory import gather_bytes, gather_halves, gather_quads, load_f32, load_i64, prefetch
from ..base.simd import (
    Floats,
    Integers,
    Mask,
    evens,
    minimum,
    odds,
    select,
    spread,
    sum_pairs,
    to_floats,
    to_integers,
    zipped,
    zipped_rest,
)
from ..base.view_table import CB, CR
from ..base.windows import (
    WINDOW_COLUMNS,
    WINDOW_ROWS,
    Window,
    extent_of,
    fast_windows,
    quads_within,
    window_of_halves,
)
from ..geometry.cuts import CUT_DOWN, CUT_RIGHT
from .lens import PICTURE_HEIGHT, PICTURE_WIDTH, SUBSAMPLED

__all__ = [
    "Spot",
    "bytes_at",
    "chroma_between",
    "chroma_nearest",
    "cubic_convolution",
    "cubic_convolution_within",
    "is_cut",
    "is_inside_chroma",
    "pairs_at",
    "spot_of",
]


_WIDEST = 65535  # pixels, of pictures whose windows are used: `extent_of` knows no larger numbers


class Spot(NamedTuple):
    """Where the texels of sixteen lanes lie in a picture, if a window holds them all."""

    fits: bool  # the window has each lane's texel, and those to its right and below
    fits_cubic: bool  # it also has one more to the left and above, and one more to the right and below
    start: int  # number of the window's first texel
    places: Integers  # of the lanes' texels in the window


@inlined_late
def spot_of(x: Integers, y: Integers, width: int, height: int, among: Mask) -> Spot:
    """The spot of texels (x, y) of a picture; lanes that are not `among` do not count."""
    left, top, right, bottom = extent_of(x, y, among)
    fits, column, row = False, 0, 0
    sized = WINDOW_COLUMNS <= width <= _WIDEST and WINDOW_ROWS <= height <= _WIDEST
    if fast_windows() and sized and left <= right:
        column, row = min(max(left - 1, 0), width - WINDOW_COLUMNS), min(max(top - 1, 0), height - WINDOW_ROWS)
        fits = right - column < WINDOW_COLUMNS - 1 and bottom - row < WINDOW_ROWS - 1
    cubic = fits and right - column < WINDOW_COLUMNS - 2 and bottom - row < WINDOW_ROWS - 2
    places = ((y - row) * WINDOW_COLUMNS) + (x - column)
    return Spot(fits, cubic, row * width + column, places)


@inlined_late
def _halves_at(address: int, index: Integers, last: int, mask: Mask) -> Integers:
    """Single uint16 of an array; `last`: its last index, beyond which not even a byte is read."""
    start = minimum(index, last - 1)
    return (gather_halves(address, start, mask) >> ((index - start) << 4)) & 0xFFFF


@inlined_late
def bytes_at(address: int, index: Integers, last: int, mask: Mask) -> Integers:
    """As `_halves_at` for uint8: the byte at the index, and the next bytes as far as the array goes."""
    start = minimum(index, last - 3)
    return gather_bytes(address, start, mask) >> ((index - start) << 3)


@inlined_late
def pairs_at(
    address: int, index: Integers, width: int, seam: Mask, crosses: bool, mask: Mask
) -> tuple[Integers, Integers]:
    """uint16 texels and their right neighbours; where `seam` is set, `index` is one left of a row's last texel, and the
    pair is the last and the first texel of the row."""
    pair = gather_halves(address, index, mask)
    left, right = pair & 0xFFFF, pair >> 16
    if crosses:
        first_of_row = gather_halves(address, index - (width - 2), mask & seam) & 0xFFFF
        left, right = select(seam, right, left), select(seam, first_of_row, right)
    return left, right


@inlined_late
def _cubic_shares(f: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Weights of the samples at -1, 0, 1 and 2 for a place f in [0, 1): cubic convolution with a = -1/2."""
    g = 1.0 - f
    return -0.5 * f * g * g, 1.0 + f * f * (1.5 * f - 2.5), 1.0 + g * g * (1.5 * g - 2.5), -0.5 * g * f * f


@inlined_late
def _shares_of_row(fx: Floats) -> tuple[Integers, Integers]:
    """The shares of a row's four samples, as `sum_pairs` takes them, of the first eight lanes and of the others."""
    a, b, c, d = _cubic_shares(fx)
    left, right = _pair_of_shares(a, b), _pair_of_shares(c, d)
    return zipped(left, right), zipped_rest(left, right)


@inlined_late
def _pair_of_shares(a: Floats, b: Floats) -> Integers:
    """Two shares as int16, in units of 2^-14."""
    return (to_integers(a * 16384.0) & 0xFFFF) | (to_integers(b * 16384.0) << 16)


@serial
def cubic_convolution(address: int, index: Integers, width: int, fx: Floats, fy: Floats, mask: Mask) -> Floats:
    """Cubic convolution of a uint16 plane of colour codes between the sample at `index` and those to its right and
    below; fx, fy: the place between them, [0, 1).

    Rows are convolved in integers, exact to a twentieth of a code: the four samples of a row are two pairs, each in a
    lane of its own, so that eight pixels fill a vector.
    """
    shares, more_shares = _shares_of_row(fx)
    start = index - (width + 1)
    total, rest = spread(0.0), spread(0.0)
    for down in _cubic_shares(fy):
        samples, more_samples = gather_quads(address, start, mask)
        total += zipped(down, down) * to_floats(sum_pairs(samples, shares))
        rest += zipped_rest(down, down) * to_floats(sum_pairs(more_samples, more_shares))
        start += width
    return (evens(total, rest) + odds(total, rest)) * np.float32(1.0 / 16384.0)


@serial
def cubic_convolution_within(window: Window, places: Integers, fx: Floats, fy: Floats) -> Floats:
    """`cubic_convolution` at places of a window; it must hold all 4 x 4 samples of lanes that count."""
    shares, more_shares = _shares_of_row(fx)
    start = places - (WINDOW_COLUMNS + 1)
    total, rest = spread(0.0), spread(0.0)
    for down in _cubic_shares(fy):
        samples, more_samples = quads_within(window, start)
        total += zipped(down, down) * to_floats(sum_pairs(samples, shares))
        rest += zipped_rest(down, down) * to_floats(sum_pairs(more_samples, more_shares))
        start += WINDOW_COLUMNS
    return (evens(total, rest) + odds(total, rest)) * np.float32(1.0 / 16384.0)


@inlined_late
def is_cut(cuts: int, index: Integers, width: int, last: int, mask: Mask) -> Mask:
    """Whether the surface is cut anywhere between a texel and those to its right and below."""
    here, below = bytes_at(cuts, index, last, mask), bytes_at(cuts, index + width, last, mask)
    return ((here & (CUT_RIGHT | CUT_DOWN | (CUT_DOWN << 8))) | (below & CUT_RIGHT)) != 0


@inlined_late
def chroma_nearest(lens: int, addresses: int, u: Floats, v: Floats, mask: Mask) -> tuple[Floats, Floats]:
    """The chroma sample of the pixel at (u, v), not interpolated, as in the reference renderers."""
    width, height, shift = (
        int(load_f32(lens, PICTURE_WIDTH)),
        int(load_f32(lens, PICTURE_HEIGHT)),
        int(load_f32(lens, SUBSAMPLED)),
    )
    x, y = (
        to_integers(minimum(u, load_f32(lens, PICTURE_WIDTH) - np.float32(1.0))),
        to_integers(minimum(v, load_f32(lens, PICTURE_HEIGHT) - np.float32(1.0))),
    )
    pitch, rows = (width + shift) >> shift, (height + shift) >> shift
    index, last = (y >> shift) * pitch + (x >> shift), pitch * rows - 1
    prefetch(load_i64(addresses, CB), index + 2 * pitch)
    prefetch(load_i64(addresses, CR), index + 2 * pitch)
    return to_floats(_halves_at(load_i64(addresses, CB), index, last, mask)), to_floats(
        _halves_at(load_i64(addresses, CR), index, last, mask)
    )


@inlined_late
def _chroma_place(lens: int, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Column and row of (u, v) among the chroma samples, from the middle of the first one."""
    scale = np.float32(0.5) if load_f32(lens, SUBSAMPLED) > 0.0 else np.float32(1.0)
    return scale * u - 0.5, scale * v - 0.5


@inlined_late
def is_inside_chroma(lens: int, u: Floats, v: Floats) -> Mask:
    """Whether the picture has all 4 x 4 chroma samples round (u, v) that `chroma_between` needs; False for NaN."""
    shift = 1 if load_f32(lens, SUBSAMPLED) > 0.0 else 0
    columns = (int(load_f32(lens, PICTURE_WIDTH)) + shift) >> shift
    rows = (int(load_f32(lens, PICTURE_HEIGHT)) + shift) >> shift
    x, y = _chroma_place(lens, u, v)
    # They begin one sample before the place and end two behind it.
    return (x >= 1.0) & (y >= 1.0) & (x < np.float32(columns - 2)) & (y < np.float32(rows - 2))


@inlined_late
def chroma_between(lens: int, addresses: int, u: Floats, v: Floats, mask: Mask) -> tuple[Floats, Floats]:
    """Chroma at (u, v) by cubic convolution where the mask is true; `is_inside_chroma` must be true there."""
    shift = 1 if load_f32(lens, SUBSAMPLED) > 0.0 else 0
    pitch = (int(load_f32(lens, PICTURE_WIDTH)) + shift) >> shift
    x, y = _chroma_place(lens, select(mask, u, 0.0), select(mask, v, 0.0))
    i, j = to_integers(x), to_integers(y)
    fx, fy, index = x - to_floats(i), y - to_floats(j), j * pitch + i
    rows = (int(load_f32(lens, PICTURE_HEIGHT)) + shift) >> shift
    spot = spot_of(i, j, pitch, rows, mask)
    if spot.fits_cubic:
        return cubic_convolution_within(
            window_of_halves(load_i64(addresses, CB), spot.start, pitch), spot.places, fx, fy
        ), cubic_convolution_within(window_of_halves(load_i64(addresses, CR), spot.start, pitch), spot.places, fx, fy)
    return cubic_convolution(load_i64(addresses, CB), index, pitch, fx, fy, mask), cubic_convolution(
        load_i64(addresses, CR), index, pitch, fx, fy, mask
    )
