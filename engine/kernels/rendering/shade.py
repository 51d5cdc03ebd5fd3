"""Shading: one colour for each pixel of a warped picture, fetched from the views that see its surface.

A pixel's disparity gives a point; the point is projected into each view, and a view that measured the same depth
there contributes its colour, interpolated over the texels that lie on that surface: bilinear, or cubic convolution
(Keys 1981), which keeps the sharpness that blending takes away. The weight favours views that look from nearly the
same direction (unstructured lumigraph, Buehler et al. 2001: angle), that resolve the surface at least as finely
(distance), whose texel is not a mixture of two surfaces, and fades near a picture's border.

Work goes by cells of 2 x 32 pixels: four vectors of luma (parts), and one of chroma for its blocks of 2 x 2 pixels.
What the views show of a cell (`kernels.rendering.look`) is kept until all have been asked: only then is it known how
much of a pixel's colour comes from each. Chroma, a quarter of the samples, is fetched by pixels' places in the views,
or by cubic convolution once for a block that is smooth in a view.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, F64, I64, U8
from ...support.packed import (
    CX,
    CY,
    FX,
    FY,
    HEIGHT,
    KIND,
    PERSPECTIVE,
    PHI_MAX,
    RADIANS_A_COLUMN,
    RADIANS_A_ROW,
    THETA_MAX,
    WIDTH,
    WRAPS,
)
from ..base.jit import inlined, inlined_late, parallel, serial
from ..base.project import project_point, unproject_point
from ..base.simd import (
    LANES,
    Floats,
    Truths,
    any_of,
    evens,
    load,
    load_float,
    maximum,
    minimum,
    odds,
    select,
    spread,
    store,
    zipped,
    zipped_rest,
)
from ..base.tone import CB_FROM_Y, CB_GAIN, CB_OFFSET, CR_FROM_Y, CR_GAIN, CR_OFFSET, LARGEST, Y_GAIN, Y_OFFSET, toned
from ..base.view_table import EDGE, INVALID, OFFSET, STEP, SUBSAMPLED, TOLERANCE, TONE, load_texel
from .look import (
    LENS_SIZE,
    OUTSIDE,
    ROUGH,
    TONE_AT,
    aim,
    chroma_between,
    chroma_nearest,
    is_inside_chroma,
    look,
    make_lens,
)

__all__ = ["shade"]

_CHUNKS = 64
_PARTS = 4
_CELL = 2 * LANES  # columns
_SHARE, _LUMA, _U, _V, _MANNER, _CODE, _CLEAN, _MIXED, _FIELDS = 0, 1, 2, 3, 4, 5, 6, 7, 8  # of what a view shows
_ROOM = 7  # vectors a part for a cell's pixels and sums
_FARTHEST_PX = 1e15  # from a view's picture: what is farther is in no direction that has a place in it
_APART_PX = 3.0  # between a block's pixels in a view, beyond which they have no chroma in common


@inlined
def _colour_of_winner(
    table: F64, addresses: I64, k: int, u: float, v: float, code: float
) -> tuple[float, float, float]:
    """Colour of view k at (u, v), of those of the four texels round it that are of about that depth code, or else of
    that which is nearest in depth: it drew the pixel."""
    width, height = int(table[k, WIDTH]), int(table[k, HEIGHT])
    if not (abs(u) < _FARTHEST_PX and abs(v) < _FARTHEST_PX):  # nowhere in particular: no number, or no integer
        u, v = 0.0, 0.0
    y = min(max(v - 0.5, 0.0), height - 1.0)
    iy = min(int(y), max(height - 2, 0))
    if table[k, WRAPS] > 0.0:
        x = u - 0.5 if u >= 0.5 else u - 0.5 + width
        x0 = min(int(x), width - 1)
        x1 = x0 + 1 if x0 + 1 < width else 0
    else:
        x = min(max(u - 0.5, 0.0), width - 1.0)
        x0 = min(int(x), max(width - 2, 0))
        x1 = min(x0 + 1, width - 1)
    fx, fy = x - x0, y - iy
    below = width if iy + 1 < height else 0
    a, b = iy * width + x0, iy * width + x1
    c, d = a + below, b + below
    codes = addresses[k, 0]
    ca, cb, cc, cd = load_texel(codes, a), load_texel(codes, b), load_texel(codes, c), load_texel(codes, d)
    wa, wb, wc, wd = (1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy
    low, high = min(min(ca, cb), min(cc, cd)), max(max(ca, cb), max(cc, cd))
    invalid = table[k, INVALID] > 0.0
    if high - low > table[k, EDGE] or (low == 0 and invalid):
        # An edge runs between the texels: take those of the wanted surface only.
        limit = 0.5 * table[k, EDGE] + table[k, TOLERANCE]
        ka = wa if abs(ca - code) <= limit and not (invalid and ca == 0) else 0.0
        kb = wb if abs(cb - code) <= limit and not (invalid and cb == 0) else 0.0
        kc = wc if abs(cc - code) <= limit and not (invalid and cc == 0) else 0.0
        kd = wd if abs(cd - code) <= limit and not (invalid and cd == 0) else 0.0
        if ka + kb + kc + kd < 1e-3:
            best = min(min(abs(ca - code), abs(cb - code)), min(abs(cc - code), abs(cd - code)))
            ka = 1.0 if abs(ca - code) == best else 0.0
            kb = 1.0 if abs(cb - code) == best else 0.0
            kc = 1.0 if abs(cc - code) == best else 0.0
            kd = 1.0 if abs(cd - code) == best else 0.0
        inverse = 1.0 / (ka + kb + kc + kd)
        wa, wb, wc, wd = ka * inverse, kb * inverse, kc * inverse, kd * inverse
        # Chroma from the middle of the texels taken.
        u = x0 + 0.5 + wb + wd
        v = iy + 0.5 + wc + wd
    y_ = addresses[k, 1]
    luma = wa * load_texel(y_, a) + wb * load_texel(y_, b) + wc * load_texel(y_, c) + wd * load_texel(y_, d)
    shift = int(table[k, SUBSAMPLED])
    column, row = min(max(int(u), 0), width - 1) >> shift, min(max(int(v), 0), height - 1) >> shift
    at = row * ((width + shift) >> shift) + column
    return luma, float(load_texel(addresses[k, 2], at)), float(load_texel(addresses[k, 3], at))


@serial
def _shade_by_winner(
    table: F64, addresses: I64, k: int, camera: F64, y: int, x: int, disparity: float
) -> tuple[float, float, float]:
    """Colour of a pixel from the view that drew it, whatever depth that measured there."""
    px, py, pz = unproject_point(camera, x + 0.5, y + 0.5, 1.0 / disparity)
    u, v, depth = project_point(table[k], px, py, pz)
    code = (1.0 / depth - table[k, OFFSET]) / table[k, STEP]
    luma, b, r = _colour_of_winner(table, addresses, k, u, v, code)
    return toned(table[k, TONE:], luma, b, r)


@serial
def _directions(camera: F64, width: int, across: F32) -> None:
    """across [2, >= width]: what a column adds to the eye's directions (`_row_of_directions`)."""
    for x in range(width):
        if camera[KIND] == PERSPECTIVE:
            across[0, x], across[1, x] = 1.0, (camera[CX] - (x + 0.5)) / camera[FX]
        else:
            phi = camera[PHI_MAX] - (x + 0.5) * camera[RADIANS_A_COLUMN]
            across[0, x], across[1, x] = math.cos(phi), math.sin(phi)
    across[:, width:] = 0.0


@inlined
def _row_of_directions(camera: F64, y: int) -> tuple[float, float]:
    """Scale and height of a row: the direction of depth 1 is (scale * across[0], scale * across[1], height)."""
    if camera[KIND] == PERSPECTIVE:
        return 1.0, (camera[CY] - (y + 0.5)) / camera[FY]
    theta = camera[THETA_MAX] - (y + 0.5) * camera[RADIANS_A_ROW]
    return math.cos(theta), math.sin(theta)


@inlined_late
def _field(seen: int, k: int, part: int, field: int) -> Floats:
    return load(seen, ((k * _FIELDS + field) * _PARTS + part) * LANES)


@inlined_late
def _put(seen: int, k: int, part: int, field: int, values: Floats) -> None:
    store(seen, ((k * _FIELDS + field) * _PARTS + part) * LANES, values)


@inlined_late
def _by_block(left: Floats, right: Floats) -> Floats:
    """Sums of two columns each."""
    return evens(left, right) + odds(left, right)


@inlined_late
def _sum(seen: int, k: int, field: int) -> Floats:
    """Of each block in view k, a field's sum by the pixels' shares; what has none may be anything, even no number."""
    total = spread(0.0)
    for part in range(0, _PARTS, 2):
        left, right = _field(seen, k, part, _SHARE), _field(seen, k, part + 1, _SHARE)
        of_left = select(left > 0.0, left * _field(seen, k, part, field), 0.0)
        total += _by_block(of_left, select(right > 0.0, right * _field(seen, k, part + 1, field), 0.0))
    return total


@inlined_late
def _most(seen: int, k: int, field: int, sign: float) -> Floats:
    """Of each block in view k, the largest of a field, times a sign, among the pixels that the view sees."""
    most = spread(-1e9)
    for part in range(0, _PARTS, 2):
        left, right = sign * _field(seen, k, part, field), sign * _field(seen, k, part + 1, field)
        left = select(_field(seen, k, part, _SHARE) > 0.0, left, -1e9)
        right = select(_field(seen, k, part + 1, _SHARE) > 0.0, right, -1e9)
        most = maximum(most, maximum(evens(left, right), odds(left, right)))
    return most


@serial
def _nearest(lens: int, addresses: int, seen: int, k: int) -> tuple[Floats, Floats]:
    """Chroma of each block in view k as the sum over its pixels, each with the sample nearest to it."""
    sum_b, sum_r = spread(0.0), spread(0.0)
    for part in range(0, _PARTS, 2):
        left, right = _field(seen, k, part, _SHARE), _field(seen, k, part + 1, _SHARE)
        a, b = _field(seen, k, part, _U), _field(seen, k, part, _V)
        left_b, left_r = chroma_nearest(lens, addresses, a, b, left > 0.0)
        a, b = _field(seen, k, part + 1, _U), _field(seen, k, part + 1, _V)
        right_b, right_r = chroma_nearest(lens, addresses, a, b, right > 0.0)
        sum_b += _by_block(left * left_b, right * right_b)
        sum_r += _by_block(left * left_r, right * right_r)
    return sum_b, sum_r


@serial
def _colour_blocks(lens: int, addresses: int, cubic: bool, seen: int, k: int, weight: Floats) -> tuple[Floats, Floats]:
    """Chroma of a cell's blocks in view k, times their weight: that of each pixel or, where the block is smooth in the
    view but its colours are rough, that of its middle by cubic convolution if the view has all samples for it."""
    between, b, r = weight < 0.0, spread(0.0), spread(0.0)
    if cubic:
        between = _most(seen, k, _MANNER, 1.0) == np.float32(ROUGH)
        if any_of(between):
            between &= _most(seen, k, _U, 1.0) + _most(seen, k, _U, -1.0) <= np.float32(_APART_PX)
            between &= _most(seen, k, _V, 1.0) + _most(seen, k, _V, -1.0) <= np.float32(_APART_PX)
            # Smooth pixels of a rough block may lie nearer to the border than rough ones, and so may its middle.
            u, v = _sum(seen, k, _U) / weight, _sum(seen, k, _V) / weight
            between &= is_inside_chroma(lens, u, v)
            b, r = chroma_between(lens, addresses, u, v, between)
            b, r = select(between, b * weight, 0.0), select(between, r * weight, 0.0)
    if any_of((weight > 0.0) & ~between):
        near_b, near_r = _nearest(lens, addresses, seen, k)
        b, r = select(between, b, near_b), select(between, r, near_r)
    return b, r


@serial
def _colour_cell(
    lenses: int, addresses: int, n: int, cubic: bool, seen: int, inverses: int
) -> tuple[Floats, Floats, Floats]:
    """Chroma of a cell's sixteen blocks: sums of cb and cr over the pixels that views coloured, and their number.

    inverses [PARTS, LANES]: of the sums of the pixels' weights."""
    count, sum_b, sum_r = spread(0.0), spread(0.0), spread(0.0)
    for k in range(n):
        weight = spread(0.0)
        for part in range(0, _PARTS, 2):  # shares of the pixels' colours
            left = _field(seen, k, part, _SHARE) * load(inverses, part * LANES)
            right = _field(seen, k, part + 1, _SHARE) * load(inverses, (part + 1) * LANES)
            _put(seen, k, part, _SHARE, left)
            _put(seen, k, part + 1, _SHARE, right)
            weight += _by_block(left, right)
        if any_of(weight > 0.0):
            lens = lenses + k * 4 * LENS_SIZE
            b, r = _colour_blocks(lens, addresses + k * 40, cubic, seen, k, weight)
            luma = _sum(seen, k, _LUMA)
            on_b, on_r = load_float(lens, TONE_AT + CB_FROM_Y), load_float(lens, TONE_AT + CR_FROM_Y)
            shift_b, shift_r = load_float(lens, TONE_AT + CB_OFFSET), load_float(lens, TONE_AT + CR_OFFSET)
            sum_b += load_float(lens, TONE_AT + CB_GAIN) * b + on_b * luma + shift_b * weight
            sum_r += load_float(lens, TONE_AT + CR_GAIN) * r + on_r * luma + shift_r * weight
            count += weight
    return sum_b, sum_r, count


@serial
def _aim_cell(lens: int, blends: bool, pixels: int, seen: int, k: int) -> None:
    """Where view k would see a cell's pixels.

    By itself, as what waits for pictures waits for all: parts do not depend on each other, and the processor works on
    several at once if they are short."""
    for part in range(_PARTS):
        q, dx = load(pixels, part * LANES), load(pixels, (_PARTS + part) * LANES)
        dy, dz = load(pixels, (2 * _PARTS + part) * LANES), load(pixels, (3 * _PARTS + part) * LANES)
        u, v, code, clean, mixed = aim(lens, q, dx, dy, dz, blends)
        _put(seen, k, part, _U, u)
        _put(seen, k, part, _V, v)
        _put(seen, k, part, _CODE, code)
        _put(seen, k, part, _CLEAN, clean)
        _put(seen, k, part, _MIXED, mixed)


@serial
def _look_cell(lens: int, addresses: int, blend: int, cubic: bool, pixels: int, seen: int, k: int, sums: int) -> bool:
    """Ask view k for the pixels of a cell that are still open; returns whether any are left."""
    left = spread(0.0)
    for part in range(_PARTS):
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
        toned_luma = load_float(lens, TONE_AT + Y_GAIN) * luma + load_float(lens, TONE_AT + Y_OFFSET)
        store(sums, part * LANES, count)
        store(sums, (_PARTS + part) * LANES, load(sums, (_PARTS + part) * LANES) + share)
        store(sums, (2 * _PARTS + part) * LANES, load(sums, (2 * _PARTS + part) * LANES) + share * toned_luma)
        left += select(wanted & (count < np.float32(blend)), spread(1.0), 0.0)
    return any_of(left > 0.0)


@serial
def _see_cell(lenses: int, addresses: int, n: int, blend: int, cubic: bool, pixels: int, seen: int, sums: int) -> int:
    """Ask n views for a cell; returns how many were asked.

    pixels [4, PARTS, LANES]: disparity and direction; seen [n, FIELDS, PARTS, LANES]: filled for those asked;
    sums [3, PARTS, LANES]: filled with the number of views that agree, their weights, and their luma by weight.
    """
    open_ = spread(0.0)
    for part in range(_PARTS):
        open_ = maximum(open_, load(pixels, part * LANES))
    for i in range(3 * _PARTS):
        store(sums, i * LANES, spread(0.0))
    k, some = 0, any_of(open_ > 0.0)
    while some and k < n:
        lens = lenses + k * 4 * LENS_SIZE
        _aim_cell(lens, blend > 1, pixels, seen, k)
        some = _look_cell(lens, addresses + k * 40, blend, cubic, pixels, seen, k, sums)
        k += 1
    return k


@serial
def _shade_pair(
    camera: F64, y: int, width: int, near: int, across: int, lenses: int, addresses: int, n: int, blend: int,
    cubic: bool, room: int, lumas: int, chromas: int,
) -> None:  # fmt: skip
    """Colour two rows of so many pixels, a multiple of a cell, from n views. Addresses of float32 arrays: near [2, w]:
    disparity of the pixels to be coloured; across [2, w]: see `_directions`; lumas [2, w]: filled, -1 where no view
    agrees; chromas [3, w / 2]: filled for each block with sums of cb and cr over the pixels coloured, and their number;
    room [ROOM + n FIELDS, PARTS, LANES]."""
    scale, height = _row_of_directions(camera, y)
    scale_below, height_below = _row_of_directions(camera, y + 1)
    pixels, sums, seen = room, room + 4 * _PARTS * LANES * 4, room + _ROOM * _PARTS * LANES * 4
    for x in range(0, width, _CELL):
        for part in range(_PARTS):
            below, column = part >= 2, x + (part & 1) * LANES
            s = np.float32(scale_below if below else scale)
            store(pixels, part * LANES, load(near, column + width if below else column))
            store(pixels, (_PARTS + part) * LANES, load(across, column) * s)
            store(pixels, (2 * _PARTS + part) * LANES, load(across, width + column) * s)
            store(pixels, (3 * _PARTS + part) * LANES, spread(height_below if below else height))
        asked = _see_cell(lenses, addresses, n, blend, cubic, pixels, seen, sums)
        for part in range(_PARTS):
            total, luma = load(sums, (_PARTS + part) * LANES), load(sums, (2 * _PARTS + part) * LANES)
            inverse = 1.0 / maximum(total, 1e-30)
            store(sums, (_PARTS + part) * LANES, inverse)
            at = x + (part & 1) * LANES
            store(lumas, at + width if part >= 2 else at, select(total > 0.0, luma * inverse, -1.0))
        b, r, count = _colour_cell(lenses, addresses, asked, cubic, seen, sums + _PARTS * LANES * 4)
        store(chromas, x >> 1, b)
        store(chromas, (width + x) >> 1, r)
        store(chromas, width + (x >> 1), count)


@inlined
def _are_coloured(drawn: int, luma: int, x: int) -> bool:
    """Whether none of sixteen pixels was drawn but not coloured (luma below 0)."""
    return not any_of((load(drawn, x) > 0.0) & (load(luma, x) < 0.0))


@serial
def _ask_winners(
    table: F64, addresses: I64, camera: F64, y: int, drawn: F32, winner: U8, luma: F32, chromas: F32
) -> None:
    """What no view has coloured of a row takes the colour of the view that drew it."""
    w = drawn.shape[0]
    for start in range(0, w, LANES):
        if start + LANES <= w and _are_coloured(drawn.ctypes.data, luma.ctypes.data, start):
            continue
        for x in range(start, min(start + LANES, w)):
            if luma[x] < np.float32(0.0) and drawn[x] > np.float32(0.0):
                tone, b, r = _shade_by_winner(table, addresses, np.int64(winner[x]), camera, y, x, drawn[x])
                luma[x] = max(tone, 0.0)
                chromas[0, x >> 1] += b
                chromas[1, x >> 1] += r
                chromas[2, x >> 1] += 1.0


@inlined_late
def _store_where(some: Truths, address: int, x: int, values: Floats) -> None:
    store(address, x, select(some, values, load(address, x)))


@serial
def _write_cell(drawn: int, luma: int, chroma_b: int, chroma_r: int, out: int, out_b: int, out_r: int, x: int) -> None:
    """Write what is drawn of 32 pixels of a row; chroma_b and chroma_r are those of its blocks."""
    left, right = load(drawn, x) > 0.0, load(drawn, x + LANES) > 0.0
    b, r = load(chroma_b, x >> 1), load(chroma_r, x >> 1)
    # Tones and cubic convolution overshoot.
    _store_where(left, out, x, minimum(maximum(load(luma, x), 0.0), np.float32(LARGEST)))
    _store_where(right, out, x + LANES, minimum(maximum(load(luma, x + LANES), 0.0), np.float32(LARGEST)))
    _store_where(left, out_b, x, zipped(b, b))
    _store_where(right, out_b, x + LANES, zipped_rest(b, b))
    _store_where(left, out_r, x, zipped(r, r))
    _store_where(right, out_r, x + LANES, zipped_rest(r, r))


@serial
def _write_row(drawn: F32, luma: F32, chroma_b: F32, chroma_r: F32, out: F32, out_b: F32, out_r: F32) -> None:
    """Write what is drawn of a row, within the codes."""
    w = drawn.shape[0]
    whole = w - w % _CELL
    for x in range(0, whole, _CELL):
        _write_cell(
            drawn.ctypes.data, luma.ctypes.data, chroma_b.ctypes.data, chroma_r.ctypes.data,
            out.ctypes.data, out_b.ctypes.data, out_r.ctypes.data, x,
        )  # fmt: skip
    for x in range(whole, w):
        if drawn[x] > 0.0:
            out[x], out_b[x], out_r[x] = min(max(luma[x], 0.0), LARGEST), chroma_b[x >> 1], chroma_r[x >> 1]


@serial
def _shade_rows(
    first: int, last: int, disparity: F32, winner: U8, camera: F64, across: F32, full: F64, full_addresses: I64,
    lenses: F32, addresses: I64, blend: int, cubic: bool, luma: F32, chroma_b: F32, chroma_r: F32,
) -> None:  # fmt: skip
    """Shade pairs of rows from the first to before the last."""
    h, w = disparity.shape
    n, padded = lenses.shape[0], across.shape[1]
    near, lumas = np.zeros((2, padded), np.float32), np.empty((2, padded), np.float32)
    chromas = np.empty((3, padded // 2), np.float32)
    room = np.empty((_ROOM + n * _FIELDS) * _PARTS * LANES, np.float32)
    zero, largest = np.float32(0.0), np.float32(LARGEST)
    for y in range(2 * first, min(2 * last, h), 2):
        rows = min(2, h - y)
        near[rows:] = zero
        for row in range(rows):
            for x in range(w):
                near[row, x] = disparity[y + row, x] if winner[y + row, x] < n else zero
        _shade_pair(
            camera, y, padded, near.ctypes.data, across.ctypes.data, lenses.ctypes.data, addresses.ctypes.data, n,
            blend, cubic, room.ctypes.data, lumas.ctypes.data, chromas.ctypes.data,
        )  # fmt: skip
        for row in range(rows):
            v = y + row
            _ask_winners(full, full_addresses, camera, v, disparity[v], winner[v], lumas[row], chromas)
        for i in range(chromas.shape[1]):
            inverse = np.float32(1.0) / chromas[2, i]
            chromas[0, i] = min(max(chromas[0, i] * inverse, zero), largest)
            chromas[1, i] = min(max(chromas[1, i] * inverse, zero), largest)
        for row in range(rows):
            v = y + row
            _write_row(disparity[v], lumas[row], chromas[0], chromas[1], luma[v], chroma_b[v], chroma_r[v])


@parallel
def shade(
    disparity: F32, winner: U8, camera: F64, full: F64, full_addresses: I64, table: F64, addresses: I64,
    n_views: int, blend: int, cubic: bool,
    luma: F32, chroma_b: F32, chroma_r: F32,
) -> None:  # fmt: skip
    """Fill luma, chroma_b and chroma_r [h, w] where disparity > 0; chroma is that of a block of 2 x 2 pixels.

    `full` and `table` are the same views, at their full size and at that which suits the picture; where the latter has
    no texel of a surface, the former is asked.

    Rows 0..n_views-1 of the table are the warped views in order of worth; further rows are backdrops, which
    colour only the pixels that they won. At most `blend` agreeing views contribute to a pixel; with `cubic` they are
    interpolated by cubic convolution where a surface is whole and its colours are rough.
    """
    h, w = disparity.shape
    pairs, padded = (h + 1) // 2, (w + _CELL - 1) // _CELL * _CELL
    lenses, across = np.empty((n_views, LENS_SIZE), np.float32), np.empty((2, padded), np.float32)
    for k in range(n_views):
        make_lens(table[k], camera, lenses[k])
    _directions(camera, w, across)
    chunks = min(pairs, _CHUNKS)
    for chunk in numba.prange(chunks):
        # Rows next to each other look at the same texels.
        first, last = np.int64(chunk) * pairs // chunks, (np.int64(chunk) + 1) * pairs // chunks
        _shade_rows(
            first, last, disparity, winner, camera, across, full, full_addresses, lenses, addresses, blend, cubic,
            luma, chroma_b, chroma_r,
        )  # fmt: skip
