"""A view's samples for sixteen pixels of a picture: whether it sees their surface, how well, and with which colour.

A `lens` projects the pixels' points into the view (`aim`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..base.jit import inlined, inlined_late
from ..base.memory import load_f32, load_i64
from ..base.simd import Floats, Integers, Mask, any_of, maximum, minimum, select, spread, to_floats, to_integers
from ..base.view_table import CODES, CUTS, Y
from ..base.windows import WINDOW_COLUMNS, lane_of, pairs_within, prefetch_window, window_of_bytes, window_of_halves
from ..geometry.cuts import BROKEN
from .lens import EDGE, LEAST, PICTURE_HEIGHT, PICTURE_WIDTH, PICTURE_WRAPS, TOLERANCE
from .texels import Spot, bytes_at, cubic_convolution, cubic_convolution_within, is_cut, pairs_at, spot_of

__all__ = ["CAREFUL", "ROUGH", "SMOOTH", "look"]

SMOOTH, ROUGH, CAREFUL = 0.0, 1.0, 2.0  # variation of colours round a pixel; CAREFUL: other surfaces are near

_RANGE = 16  # codes: if four texels differ by no more, linear interpolation is as good as cubic


class _Place(NamedTuple):
    """Places of points between four texels of a picture each."""

    texel: Integers  # number of the upper left texel along the rows; then its column and row
    x: Integers
    y: Integers
    column: Integers  # as x, but the last one where the point lies across the seam of a picture that wraps
    fx: Floats  # share of the right texels; then of the lower ones
    fy: Floats
    seam: Mask  # the point lies between the last column and the first one
    crosses: bool  # whether any point lies across the seam


@inlined_late
def _place(lens: int, width: int, height: int, seen: Mask, u: Floats, v: Floats) -> _Place:
    """Places of points (u, v) in a picture, clamped to the centres of its outermost pixels."""
    x, y = u - 0.5, minimum(maximum(v - 0.5, 0.0), load_f32(lens, PICTURE_HEIGHT) - np.float32(1.0))
    crosses = False
    if load_f32(lens, PICTURE_WRAPS) > 0.0:
        x = select(x < 0.0, x + load_f32(lens, PICTURE_WIDTH), x)
        seam = seen & (x >= load_f32(lens, PICTURE_WIDTH) - np.float32(1.0))
        crosses = any_of(seam)
    else:
        x = minimum(maximum(x, 0.0), load_f32(lens, PICTURE_WIDTH) - np.float32(1.0))
        seam = x < 0.0
    column = minimum(to_integers(x), width - 1)
    x0, y0 = minimum(column, width - 2), minimum(to_integers(y), height - 2)
    fx, fy = x - to_floats(select(seam, column, x0)), y - to_floats(y0)
    return _Place(y0 * width + x0, x0, y0, column, fx, fy, seam, crosses)


@inlined_late
def _four(
    address: int, place: _Place, spot: Spot, width: int, mask: Mask
) -> tuple[Integers, Integers, Integers, Integers]:
    """The uint16 texels round places: upper left, upper right, lower left, lower right."""
    if spot.fits:
        window = window_of_halves(address, spot.start, width)
        upper, lower = pairs_within(window, spot.places), pairs_within(window, spot.places + WINDOW_COLUMNS)
        return upper & 0xFFFF, upper >> 16, lower & 0xFFFF, lower >> 16
    a, b = pairs_at(address, place.texel, width, place.seam, place.crosses, mask)
    c, d = pairs_at(address, place.texel + width, width, place.seam, place.crosses, mask)
    return a, b, c, d


@inlined_late
def _shares(
    lens: int, addresses: int, place: _Place, spot: Spot, width: int, last: int, seen: Mask, code: Floats
) -> tuple[Floats, Mask, Floats, tuple[Floats, Floats, Floats, Floats]]:
    """The degree to which a view sees the surface of these depth codes, whether the four texels are one surface, how
    colours are to be fetched (SMOOTH, CAREFUL), and the share of each texel.

    last: number of the picture's last texel.
    """
    tolerance = load_f32(lens, TOLERANCE)
    a, b, c, d = _four(load_i64(addresses, CODES), place, spot, width, seen)
    low, high = minimum(minimum(a, b), minimum(c, d)), maximum(maximum(a, b), maximum(c, d))
    ca, cb, cc, cd = to_floats(a), to_floats(b), to_floats(c), to_floats(d)
    fx, fy = place.fx, place.fy
    top, bottom = ca + fx * (cb - ca), cc + fx * (cd - cc)
    off = top + fy * (bottom - top) - code
    agrees = maximum(off, -off) <= tolerance
    least = load_f32(lens, LEAST)
    whole = (to_floats(high - low) <= load_f32(lens, EDGE)) & (to_floats(low) >= least)
    gx, gy = 1.0 - fx, 1.0 - fy
    wa, wb, wc, wd = gx * gy, fx * gy, gx * fy, fx * fy
    manner = spread(0.0)
    if any_of(seen & ~whole):
        # There is an edge between the texels, or a slope. At an edge, take only texels of the wanted surface.
        inner = ~place.seam & ~is_cut(load_i64(addresses, CUTS), place.texel, width, last, seen & ~whole)
        whole |= inner & (to_floats(low) >= least)
        limit = np.float32(0.5) * load_f32(lens, EDGE) + tolerance
        ka = select((maximum(ca - code, code - ca) <= limit) & (ca >= least), wa, 0.0)
        kb = select((maximum(cb - code, code - cb) <= limit) & (cb >= least), wb, 0.0)
        kc = select((maximum(cc - code, code - cc) <= limit) & (cc >= least), wc, 0.0)
        kd = select((maximum(cd - code, code - cd) <= limit) & (cd >= least), wd, 0.0)
        total = ka + kb + kc + kd
        inverse = 1.0 / maximum(total, 1e-3)
        wa, wb = select(whole, wa, ka * inverse), select(whole, wb, kb * inverse)
        wc, wd = select(whole, wc, kc * inverse), select(whole, wd, kd * inverse)
        share = select(whole, select(agrees, spread(1.0), 0.0), select(total >= 1e-3, minimum(total, 1.0), 0.0))
        share = select(seen, share, 0.0)
        manner = select(whole, spread(SMOOTH), CAREFUL)
    else:
        share = select(seen & agrees, spread(1.0), 0.0)
    return share, whole, manner, (wa, wb, wc, wd)


@inlined
def _sharp(address: int, place: _Place, spot: Spot, width: int, rough: Mask) -> Floats:
    """Cubic convolution of a plane at the places that are rough; anything elsewhere."""
    if spot.fits_cubic:
        window = window_of_halves(address, spot.start, width)
        return cubic_convolution_within(window, spot.places, place.fx, place.fy)
    return cubic_convolution(address, place.texel, width, place.fx, place.fy, rough)


@inlined
def _marks(
    address: int, place: _Place, spot: Spot, x: Integers, y: Integers, width: int, last: int, seen: Mask
) -> Integers:
    """The bytes at texels (x, y), which are those of the places or next to them; more bytes may follow in a lane."""
    if spot.fits:
        nearest = spot.places + (y - place.y) * WINDOW_COLUMNS + (x - place.x)
        return pairs_within(window_of_bytes(address, spot.start, width), nearest)
    return bytes_at(address, y * width + x, last, seen)


@inlined_late
def _ahead(place: _Place, spot: Spot, width: int) -> int:
    """About the first texel that the same square of the cell after the next one will read, sixteen columns of the
    eye's picture on."""
    start = spot.start if spot.fits else lane_of(place.texel, 0) - width
    across, down = lane_of(place.x, 3) - lane_of(place.x, 0), lane_of(place.y, 3) - lane_of(place.y, 0)
    return start + (16 * down // 3) * width + 16 * across // 3


@inlined_late
def look(
    lens: int, addresses: int, seen: Mask, u: Floats, v: Floats, code: Floats, clean: Floats, mixed: Floats,
    blends: bool, cubic: bool,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:  # fmt: skip
    """A view's samples at (u, v) for surfaces with these depth codes; `clean` and `mixed` are the weights from `aim`.

    lens: address of the view's lens; addresses: address of the addresses of its planes (`base.view_table`). Returns the
    view's weight (0: it does not see the surface), its luma, the place (u, v) where its chroma is to be fetched, and
    how (SMOOTH, ROUGH, CAREFUL). With `cubic`, luma is interpolated by cubic convolution where it is rough.
    """
    nothing = spread(0.0)
    width, height = int(load_f32(lens, PICTURE_WIDTH)), int(load_f32(lens, PICTURE_HEIGHT))
    last = width * height - 1
    place = _place(lens, width, height, seen, u, v)
    spot = spot_of(place.x, place.y, width, height, seen)
    if place.crosses:
        spot = Spot(False, False, 0, place.x)
    ahead = _ahead(place, spot, width)
    prefetch_window(load_i64(addresses, CODES), ahead, width)
    prefetch_window(load_i64(addresses, Y), ahead, width)
    prefetch_window(load_i64(addresses, CUTS), ahead >> 1, width >> 1)
    share, whole, manner, (wa, wb, wc, wd) = _shares(lens, addresses, place, spot, width, last, seen, code)
    found = share > 0.0
    if not any_of(found):
        return nothing, nothing, nothing, nothing, nothing
    # For all points in the picture, not only for visible surfaces: waiting for that result costs more.
    a, b, c, d = _four(load_i64(addresses, Y), place, spot, width, seen)
    luma = wa * to_floats(a) + wb * to_floats(b) + wc * to_floats(c) + wd * to_floats(d)
    if cubic:
        contrast = maximum(maximum(a, b), maximum(c, d)) - minimum(minimum(a, b), minimum(c, d))
        # 4 x 4 samples of the chroma must lie inside the picture, and then those of the luma do, too.
        inside = (place.x >= 3) & (place.y >= 3) & (place.x < width - 7) & (place.y < height - 7)
        rough = found & whole & inside & (contrast > _RANGE)
        if any_of(rough):
            sharp = _sharp(load_i64(addresses, Y), place, spot, width, rough)
            luma, manner = select(rough, sharp, luma), select(rough, spread(ROUGH), manner)
    if blends:
        x, y = minimum(to_integers(u), width - 1), minimum(to_integers(v), height - 1)
        broken = (_marks(load_i64(addresses, CUTS), place, spot, x, y, width, last, seen) & BROKEN) != 0
        share *= select(broken, mixed, clean)
        manner = select(broken, spread(CAREFUL), manner)
    # Chroma is taken at the middle of the chosen texels.
    chosen = manner == CAREFUL
    u = select(chosen & ~whole, to_floats(place.column) + 0.5 + wb + wd, u)
    v = select(chosen & ~whole, to_floats(place.y) + 0.5 + wc + wd, v)
    return share, luma, u, v, manner
