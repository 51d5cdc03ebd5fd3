"""What a view shows at sixteen pixels of a picture: whether it sees their surface, how well, and in which colour.

A pixel is a direction from the eye and a disparity q. All geometry is in the view's axes, relative to its centre and
times q, which neither angles nor ratios of lengths notice: there the pixel's point is M direction + q t, float32. That
is exact to a few thousandths of a pixel at 8192 columns.

A lens is float32 [LENS_SIZE]: what a view table's row (`kernels.base.view_table`) says, as seen from one eye.
"""

from __future__ import annotations

import math

import numpy as np

from ...support.array_types import F32, F64
from ...support.packed import (
    CX,
    CY,
    FORWARD_X,
    FORWARD_Y,
    FORWARD_Z,
    FX,
    FY,
    HEIGHT,
    KIND,
    PERSPECTIVE,
    PHI_MAX,
    POSITION_X,
    POSITION_Y,
    POSITION_Z,
    THETA_MAX,
    WIDTH,
    WRAPS,
)
from ..base import view_table as t
from ..base.jit import inlined_late, serial
from ..base.simd import (
    Floats,
    Integers,
    Truths,
    any_of,
    evens,
    gather_bytes,
    gather_halves,
    gather_quads,
    load_float,
    load_integer,
    maximum,
    minimum,
    odds,
    prefetch,
    select,
    spread,
    square_root,
    sum_pairs,
    to_floats,
    to_integers,
    zipped,
    zipped_rest,
)
from ..base.tone import TONE_SIZE
from ..geometry.cuts import BROKEN, CUT_DOWN, CUT_RIGHT

__all__ = [
    "CAREFUL",
    "LENS_SIZE",
    "OUTSIDE",
    "ROUGH",
    "SMOOTH",
    "TONE_AT",
    "aim",
    "chroma_between",
    "chroma_nearest",
    "is_inside_chroma",
    "look",
    "make_lens",
]

# Of a lens. Rotation, view from eye, 3 x 3 and row-major (_XY: what an eye's y adds to the view's x), and shift.
_XX, _XY, _XZ, _YX, _YY, _YZ, _ZX, _ZY, _ZZ = range(9)
_ROTATION = _XX
_SHIFT_X, _SHIFT_Y, _SHIFT_Z = 9, 10, 11
_WIDTH, _HEIGHT, _OFFSET, _PER_STEP, _KIND, _WRAPS = 12, 13, 14, 15, 16, 17
_FX, _CX, _FY, _CY = 18, 19, 20, 21  # or columns, left, rows, top
_EDGE, _TOLERANCE, _LEAST = 22, 23, 24  # codes; the least valid one
_SHARPNESS2, _PIXEL2, _SUBSAMPLED = 25, 26, 27
TONE_AT = 28
LENS_SIZE = TONE_AT + TONE_SIZE

SMOOTH, ROUGH, CAREFUL = 0.0, 1.0, 2.0  # how a pixel's colours vary round it; careful: other surfaces are near

OUTSIDE = -1e9  # stands for the depth code of a point that a view has no pixel for
_RANGE = 16  # codes between four texels within which linear interpolation is as good as cubic
_MIXED = 0.03  # weight of a texel at a depth edge: where no other view sees a surface, its rim is painted with it
_BORDER_PX = 8.0  # over which a view fades out near its border


@serial
def make_lens(row: F64, camera: F64, lens: F32) -> None:
    """Fill a lens from a view table's row, for the eye of a packed camera."""
    for i in range(3):
        for j in range(3):
            lens[_ROTATION + 3 * i + j] = (
                row[FORWARD_X + i] * camera[FORWARD_X + j] + row[FORWARD_Y + i] * camera[FORWARD_Y + j]
                + row[FORWARD_Z + i] * camera[FORWARD_Z + j]
            )  # fmt: skip
        lens[_SHIFT_X + i] = (
            row[FORWARD_X + i] * (camera[POSITION_X] - row[POSITION_X])
            + row[FORWARD_Y + i] * (camera[POSITION_Y] - row[POSITION_Y])
            + row[FORWARD_Z + i] * (camera[POSITION_Z] - row[POSITION_Z])
        )
    lens[_WIDTH], lens[_HEIGHT] = row[WIDTH], row[HEIGHT]
    lens[_OFFSET], lens[_PER_STEP] = row[t.OFFSET], 1.0 / row[t.STEP]
    lens[_KIND], lens[_WRAPS] = row[KIND], row[WRAPS]
    if row[KIND] == PERSPECTIVE:
        lens[_FX], lens[_CX], lens[_FY], lens[_CY] = row[FX], row[CX], row[FY], row[CY]
    else:
        lens[_FX], lens[_CX], lens[_FY], lens[_CY] = row[t.COLUMNS], row[PHI_MAX], row[t.ROWS], row[THETA_MAX]
    lens[_EDGE], lens[_TOLERANCE], lens[_LEAST] = row[t.EDGE], row[t.TOLERANCE], row[t.INVALID]
    lens[_SHARPNESS2], lens[_PIXEL2] = row[t.SHARPNESS] * row[t.SHARPNESS], row[t.PIXEL] * row[t.PIXEL]
    lens[_SUBSAMPLED] = row[t.SUBSAMPLED]
    for k in range(TONE_SIZE):
        lens[TONE_AT + k] = row[t.TONE + k]


@inlined_late
def _absolute(x: Floats) -> Floats:
    return maximum(x, -x)


@inlined_late
def _angle(ratio: Floats, steep: Truths, negative: Truths) -> Floats:
    """Arc tangent of a ratio in [0, 1] or, where it is `steep`, of its inverse, by a minimax polynomial: within
    3e-7 rad, a thousandth of a pixel."""
    s = ratio * ratio
    r = 0.0218629205 - 0.00405455675 * s
    r = 0.0964219347 + s * (-0.0559122734 + s * r)
    r = 0.199465654 + s * (-0.139086281 + s * r)
    r = ratio * (0.999999336 + s * (-0.333298608 + s * r))
    r = select(steep, 0.5 * math.pi - r, r)
    return select(negative, -r, r)


@inlined_late
def _project(lens: int, q: Floats, x: Floats, y: Floats, z: Floats) -> tuple[Floats, Floats, Floats]:
    """Points in the view's axes, times q -> u, v and depth code; the code is OUTSIDE where there is no image."""
    if load_float(lens, _KIND) == PERSPECTIVE:
        inverse = 1.0 / x
        u = load_float(lens, _CX) - load_float(lens, _FX) * y * inverse
        v = load_float(lens, _CY) - load_float(lens, _FY) * z * inverse
        near = q * inverse
    else:
        planar = x * x + y * y
        root, length = square_root(planar), square_root(planar + z * z)
        ax, ay, az = _absolute(x), _absolute(y), _absolute(z)
        longer, higher = maximum(maximum(ax, ay), 1e-20), maximum(maximum(root, az), 1e-20)
        inverse = 1.0 / (longer * higher * length)  # one division for three
        across = _angle(minimum(ax, ay) * higher * length * inverse, ay > ax, (x < 0.0) ^ (y < 0.0))
        across = select(x < 0.0, select(y < 0.0, -math.pi + across, math.pi + across), across)
        up = _angle(minimum(root, az) * longer * length * inverse, az > root, z < 0.0)
        u = (load_float(lens, _CX) - across) * load_float(lens, _FX)
        v = (load_float(lens, _CY) - up) * load_float(lens, _FY)
        near = q * longer * higher * inverse
        # The azimuth is known up to a turn: take the one nearest to the picture's middle.
        turn = np.float32(2.0 * math.pi) * load_float(lens, _FX)
        most = np.float32(0.5) * (load_float(lens, _WIDTH) + turn)
        u = select(u > most, u - turn, u)
        u = select(u < most - turn, u + turn, u)
    inside = (near > 0.0) & (u >= 0.0) & (v >= 0.0) & (u <= load_float(lens, _WIDTH)) & (v <= load_float(lens, _HEIGHT))
    return u, v, select(inside, (near - load_float(lens, _OFFSET)) * load_float(lens, _PER_STEP), OUTSIDE)


@inlined_late
def _weigh(lens: int, q: Floats, ex: Floats, ey: Floats, ez: Floats, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Weights of the view's clean and mixed texels: small angle between its ray and the eye's (e), fine sampling,
    off the border. Where the two rays are within a pixel of each other, a mixed texel is what the eye sees."""
    tx, ty, tz = load_float(lens, _SHIFT_X), load_float(lens, _SHIFT_Y), load_float(lens, _SHIFT_Z)
    vx, vy, vz = ex + tx * q, ey + ty * q, ez + tz * q
    ee, vv = ex * ex + ey * ey + ez * ez, vx * vx + vy * vy + vz * vz
    # The rays span what the eye's and the shift do, which does not cancel where they are nearly the same.
    cx, cy, cz = ey * tz - ez * ty, ez * tx - ex * tz, ex * ty - ey * tx
    both = ee * vv
    sine2 = q * q * (cx * cx + cy * cy + cz * cz)  # times both
    sine2 = select(ex * vx + ey * vy + ez * vz < 0.0, 2.0 * both - sine2, sine2)
    finer = minimum(vv, ee * load_float(lens, _SHARPNESS2))  # times vv
    # A picture that wraps has no border.
    softest = np.float32(1.0) if load_float(lens, _WRAPS) > 0.0 else np.float32(0.02)
    width, height = load_float(lens, _WIDTH), load_float(lens, _HEIGHT)
    border = minimum(minimum(u, width - u), minimum(v, height - v)) * np.float32(1.0 / _BORDER_PX)
    border = minimum(maximum(border, softest), 1.0)
    same = load_float(lens, _PIXEL2) * both
    apart, beside = 3e-5 * both + sine2, same * same + sine2 * sine2
    inverse = 1.0 / maximum(apart * beside, 1e-37)
    weight = border * (0.1 * vv + finer) * ee * beside * inverse
    return weight, weight * (_MIXED + (1.0 - _MIXED) * same * same * apart * inverse)


@inlined_late
def aim(
    lens: int, q: Floats, dx: Floats, dy: Floats, dz: Floats, blends: bool
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Where a view would see pixels of disparity q in directions d from the eye: u, v and depth code, which is OUTSIDE
    where it does not; and, if it `blends` with others, weights of its clean and its mixed texels there.

    lens: address of the view's lens."""
    ex = load_float(lens, _XX) * dx + load_float(lens, _XY) * dy + load_float(lens, _XZ) * dz
    ey = load_float(lens, _YX) * dx + load_float(lens, _YY) * dy + load_float(lens, _YZ) * dz
    ez = load_float(lens, _ZX) * dx + load_float(lens, _ZY) * dy + load_float(lens, _ZZ) * dz
    x = ex + load_float(lens, _SHIFT_X) * q
    y = ey + load_float(lens, _SHIFT_Y) * q
    z = ez + load_float(lens, _SHIFT_Z) * q
    u, v, code = _project(lens, q, x, y, z)
    clean, mixed = spread(1.0), spread(1.0)
    if blends:
        clean, mixed = _weigh(lens, q, ex, ey, ez, u, v)
    return u, v, code, clean, mixed


@inlined_late
def _halves(address: int, at: Integers, last: int, mask: Truths) -> Integers:
    """Single uint16 of an array whose last index is given: not even a byte beyond it is read."""
    start = minimum(at, last - 1)
    return (gather_halves(address, start, mask) >> ((at - start) << 4)) & 0xFFFF


@inlined_late
def _bytes(address: int, at: Integers, last: int, mask: Truths) -> Integers:
    """As `_halves`, of uint8: that at the index and the next ones as far as there are any."""
    start = minimum(at, last - 3)
    return gather_bytes(address, start, mask) >> ((at - start) << 3)


@inlined_late
def _pairs(
    address: int, at: Integers, width: int, seam: Truths, crosses: bool, mask: Truths
) -> tuple[Integers, Integers]:
    """uint16 texels and those to their right; across the seam where `at` is one left of a row's last two."""
    pair = gather_halves(address, at, mask)
    left, right = pair & 0xFFFF, pair >> 16
    if crosses:
        round_ = gather_halves(address, at - (width - 2), mask & seam) & 0xFFFF
        left, right = select(seam, right, left), select(seam, round_, right)
    return left, right


@inlined_late
def _cubic_shares(f: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Of the samples at -1, 0, 1 and 2 for a place f in [0, 1): cubic convolution with a = -1/2."""
    g = 1.0 - f
    return -0.5 * f * g * g, 1.0 + f * f * (1.5 * f - 2.5), 1.0 + g * g * (1.5 * g - 2.5), -0.5 * g * f * f


@inlined_late
def _pair_of_shares(a: Floats, b: Floats) -> Integers:
    """Two shares as int16, in 2^-14."""
    return (to_integers(a * 16384.0) & 0xFFFF) | (to_integers(b * 16384.0) << 16)


@serial
def _cubic(address: int, at: Integers, width: int, fx: Floats, fy: Floats, mask: Truths) -> Floats:
    """Cubic convolution of a uint16 plane of colour codes between the sample `at` and those right of it and below.

    Across in integers, exact to a twentieth of a code: the four samples of a row are two pairs, each in a lane of its
    own, so that eight pixels fill a vector.
    """
    a, b, c, d = _cubic_shares(fx)
    left, right = _pair_of_shares(a, b), _pair_of_shares(c, d)
    shares, more_shares = zipped(left, right), zipped_rest(left, right)
    start = at - (width + 1)
    total, rest = spread(0.0), spread(0.0)
    for down in _cubic_shares(fy):
        samples, more_samples = gather_quads(address, start, mask)
        total += zipped(down, down) * to_floats(sum_pairs(samples, shares))
        rest += zipped_rest(down, down) * to_floats(sum_pairs(more_samples, more_shares))
        start += width
    return (evens(total, rest) + odds(total, rest)) * np.float32(1.0 / 16384.0)


@inlined_late
def _is_cut(cuts: int, at: Integers, width: int, last: int, mask: Truths) -> Truths:
    """Whether the surface is cut anywhere between a texel and those to its right and below."""
    here, below = _bytes(cuts, at, last, mask), _bytes(cuts, at + width, last, mask)
    return ((here & (CUT_RIGHT | CUT_DOWN | (CUT_DOWN << 8))) | (below & CUT_RIGHT)) != 0


@inlined_late
def look(
    lens: int, addresses: int, seen: Truths, u: Floats, v: Floats, code: Floats, clean: Floats, mixed: Floats,
    blends: bool, cubic: bool,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:  # fmt: skip
    """What a view shows at (u, v), where surfaces of these depth codes are seen or hidden, with these weights (`aim`).

    lens: address of its lens; addresses: that of the addresses [5] of its codes, y, cb, cr and cuts. Returns its weight
    (0: it does not see the surface), its luma, where its chroma is to be fetched (u, v), and how (SMOOTH, ROUGH,
    CAREFUL). With `cubic` luma is interpolated by cubic convolution where it is rough.
    """
    nothing, tolerance = spread(0.0), load_float(lens, _TOLERANCE)
    width, height = int(load_float(lens, _WIDTH)), int(load_float(lens, _HEIGHT))
    last = width * height - 1
    x, y = u - 0.5, minimum(maximum(v - 0.5, 0.0), load_float(lens, _HEIGHT) - np.float32(1.0))
    crosses = False
    if load_float(lens, _WRAPS) > 0.0:
        x = select(x < 0.0, x + load_float(lens, _WIDTH), x)
        seam = seen & (x >= load_float(lens, _WIDTH) - np.float32(1.0))
        crosses = any_of(seam)
    else:
        x = minimum(maximum(x, 0.0), load_float(lens, _WIDTH) - np.float32(1.0))
        seam = x < 0.0
    column = minimum(to_integers(x), width - 1)
    x0, y0 = minimum(column, width - 2), minimum(to_integers(y), height - 2)
    fx, fy = x - to_floats(select(seam, column, x0)), y - to_floats(y0)
    at = y0 * width + x0
    # The next rows of the picture will look below.
    prefetch(load_integer(addresses, 0), at + 3 * width)
    prefetch(load_integer(addresses, 1), at + 3 * width)
    prefetch(load_integer(addresses, 4), (at + 3 * width) >> 1)
    a, b = _pairs(load_integer(addresses, 0), at, width, seam, crosses, seen)
    c, d = _pairs(load_integer(addresses, 0), at + width, width, seam, crosses, seen)
    low, high = minimum(minimum(a, b), minimum(c, d)), maximum(maximum(a, b), maximum(c, d))
    ca, cb, cc, cd = to_floats(a), to_floats(b), to_floats(c), to_floats(d)
    top, bottom = ca + fx * (cb - ca), cc + fx * (cd - cc)
    off = top + fy * (bottom - top) - code
    agrees = maximum(off, -off) <= tolerance
    least = load_float(lens, _LEAST)
    whole = (to_floats(high - low) <= load_float(lens, _EDGE)) & (to_floats(low) >= least)
    gx, gy = 1.0 - fx, 1.0 - fy
    wa, wb, wc, wd = gx * gy, fx * gy, gx * fy, fx * fy
    manner = nothing
    if any_of(seen & ~whole):
        # An edge runs between the texels, or a slope: of an edge take those of the wanted surface only.
        inner = ~seam & ~_is_cut(load_integer(addresses, 4), at, width, last, seen & ~whole)
        whole |= inner & (to_floats(low) >= least)
        limit = np.float32(0.5) * load_float(lens, _EDGE) + tolerance
        ka = select((maximum(ca - code, code - ca) <= limit) & (ca >= least), wa, 0.0)
        kb = select((maximum(cb - code, code - cb) <= limit) & (cb >= least), wb, 0.0)
        kc = select((maximum(cc - code, code - cc) <= limit) & (cc >= least), wc, 0.0)
        kd = select((maximum(cd - code, code - cd) <= limit) & (cd >= least), wd, 0.0)
        some = ka + kb + kc + kd
        inverse = 1.0 / maximum(some, 1e-3)
        wa, wb = select(whole, wa, ka * inverse), select(whole, wb, kb * inverse)
        wc, wd = select(whole, wc, kc * inverse), select(whole, wd, kd * inverse)
        share = select(whole, select(agrees, spread(1.0), 0.0), select(some >= 1e-3, minimum(some, 1.0), 0.0))
        share = select(seen, share, 0.0)
        manner = select(whole, spread(SMOOTH), CAREFUL)
    else:
        share = select(seen & agrees, spread(1.0), 0.0)
    found = share > 0.0
    if not any_of(found):
        return nothing, nothing, nothing, nothing, nothing
    # Of what is seen, not of what was found: to wait for that costs more.
    a, b = _pairs(load_integer(addresses, 1), at, width, seam, crosses, seen)
    c, d = _pairs(load_integer(addresses, 1), at + width, width, seam, crosses, seen)
    luma = wa * to_floats(a) + wb * to_floats(b) + wc * to_floats(c) + wd * to_floats(d)
    if cubic:
        contrast = maximum(maximum(a, b), maximum(c, d)) - minimum(minimum(a, b), minimum(c, d))
        # Four by four samples of the chroma, and of the luma more so, must lie inside the picture.
        inside = (x0 >= 3) & (y0 >= 3) & (x0 < width - 7) & (y0 < height - 7)
        rough = found & whole & inside & (contrast > _RANGE)
        if any_of(rough):
            luma = select(rough, _cubic(load_integer(addresses, 1), at, width, fx, fy, rough), luma)
            manner = select(rough, spread(ROUGH), manner)
    if blends:
        nearest = minimum(to_integers(v), height - 1) * width + minimum(to_integers(u), width - 1)
        broken = (_bytes(load_integer(addresses, 4), nearest, last, seen) & BROKEN) != 0
        share *= select(broken, mixed, clean)
        manner = select(broken, spread(CAREFUL), manner)
    # Chroma from the middle of the texels taken.
    chosen = manner == CAREFUL
    u = select(chosen & ~whole, to_floats(column) + 0.5 + wb + wd, u)
    v = select(chosen & ~whole, to_floats(y0) + 0.5 + wc + wd, v)
    return share, luma, u, v, manner


@inlined_late
def chroma_nearest(lens: int, addresses: int, u: Floats, v: Floats, mask: Truths) -> tuple[Floats, Floats]:
    """The chroma sample whose pixels (2x2 or one) hold (u, v): replicated up, as the reference renderers do."""
    width, height, shift = (
        int(load_float(lens, _WIDTH)),
        int(load_float(lens, _HEIGHT)),
        int(load_float(lens, _SUBSAMPLED)),
    )
    x, y = (
        to_integers(minimum(u, load_float(lens, _WIDTH) - np.float32(1.0))),
        to_integers(minimum(v, load_float(lens, _HEIGHT) - np.float32(1.0))),
    )
    pitch, rows = (width + shift) >> shift, (height + shift) >> shift
    at, last = (y >> shift) * pitch + (x >> shift), pitch * rows - 1
    prefetch(load_integer(addresses, 2), at + 2 * pitch)
    prefetch(load_integer(addresses, 3), at + 2 * pitch)
    return to_floats(_halves(load_integer(addresses, 2), at, last, mask)), to_floats(
        _halves(load_integer(addresses, 3), at, last, mask)
    )


@inlined_late
def _chroma_place(lens: int, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Where (u, v) lies among the chroma samples, from the middle of the first one: column and row."""
    scale = np.float32(0.5) if load_float(lens, _SUBSAMPLED) > 0.0 else np.float32(1.0)
    return scale * u - 0.5, scale * v - 0.5


@inlined_late
def is_inside_chroma(lens: int, u: Floats, v: Floats) -> Truths:
    """Whether the picture has all four by four chroma samples round (u, v), as `chroma_between` needs; not if NaN."""
    shift = 1 if load_float(lens, _SUBSAMPLED) > 0.0 else 0
    columns = (int(load_float(lens, _WIDTH)) + shift) >> shift
    rows = (int(load_float(lens, _HEIGHT)) + shift) >> shift
    x, y = _chroma_place(lens, u, v)
    # One sample before the place, and two behind it.
    return (x >= 1.0) & (y >= 1.0) & (x < np.float32(columns - 2)) & (y < np.float32(rows - 2))


@inlined_late
def chroma_between(lens: int, addresses: int, u: Floats, v: Floats, mask: Truths) -> tuple[Floats, Floats]:
    """Chroma at (u, v) by cubic convolution, where the mask is true: only where `is_inside_chroma` is."""
    shift = 1 if load_float(lens, _SUBSAMPLED) > 0.0 else 0
    pitch = (int(load_float(lens, _WIDTH)) + shift) >> shift
    x, y = _chroma_place(lens, select(mask, u, 0.0), select(mask, v, 0.0))
    i, j = to_integers(x), to_integers(y)
    fx, fy, at = x - to_floats(i), y - to_floats(j), j * pitch + i
    return _cubic(load_integer(addresses, 2), at, pitch, fx, fy, mask), _cubic(
        load_integer(addresses, 3), at, pitch, fx, fy, mask
    )
