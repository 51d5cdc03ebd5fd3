"""Shading: one colour for each pixel of a warped picture, fetched from the views that see its surface.

A pixel's disparity gives a point; the point is projected into each view, and a view that measured the same depth
there contributes its colour, interpolated over the texels that lie on that surface: bilinear, or cubic convolution
(Keys 1981), which keeps the sharpness that blending takes away. The weight favours views that look from nearly the
same direction (unstructured lumigraph, Buehler et al. 2001: angle), that resolve the surface at least as finely
(distance), whose texel is not a mixture of two surfaces, and fades near a picture's border.

A view table is float64 [n, TABLE_SIZE] (packed camera, then the fields below) beside int64 [n, 5], the addresses
of its C-contiguous arrays: codes, y, cb, cr (uint16) and, for views that are drawn, where their surface is cut (uint8,
the flags of `kernels.triangulate`). Chroma is 4:2:0 or of the size of the luma. The caller keeps the arrays alive.
"""

from __future__ import annotations

import math
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from . import triangulate
from .project import CAMERA_SIZE, PERSPECTIVE, arc_tangent, unproject_point
from .tone import LARGEST, TONE_SIZE, toned

__all__ = [
    "COLUMNS",
    "EDGE",
    "INVALID",
    "OFFSET",
    "PIXEL",
    "ROWS",
    "SHARPNESS",
    "STEP",
    "SUBSAMPLED",
    "TABLE_SIZE",
    "TOLERANCE",
    "TONE",
    "load_byte",
    "load_texel",
    "shade",
]

OFFSET = CAMERA_SIZE  # disparity of code 0
STEP = CAMERA_SIZE + 1  # disparity of a code step
INVALID = CAMERA_SIZE + 2  # 1 where code 0 means "no depth"
TOLERANCE = CAMERA_SIZE + 3  # codes within which a view agrees
EDGE = CAMERA_SIZE + 4  # code step between texels that is a depth edge
SHARPNESS = CAMERA_SIZE + 5  # pixels a radian, relative to the target's
COLUMNS = CAMERA_SIZE + 6  # columns a radian (equirectangular)
ROWS = CAMERA_SIZE + 7
PIXEL = CAMERA_SIZE + 8  # radians a pixel
SUBSAMPLED = CAMERA_SIZE + 9  # 1 where chroma is 4:2:0, 0 where it has the size of the luma
TONE = CAMERA_SIZE + 10  # a packed tone: what is done to the view's colours
TABLE_SIZE = TONE + TONE_SIZE

OUTSIDE = -1e300  # stands for the depth code of a point that a view has no pixel for
_CHUNKS = 64
_SMOOTH = 16  # codes between four texels within which linear interpolation is as good as cubic
_MIXED = 0.03  # weight of a texel at a depth edge: where no other view sees a surface, its rim is painted with it
_BORDER_PX = 8.0  # over which a view fades out near its border

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]
U16 = npt.NDArray[np.uint16]


def _element_of(bits: int) -> Any:
    """An intrinsic's signature and code: the unsigned element of so many bits at (address, index)."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = builder.inttoptr(args[0], ir.IntType(bits).as_pointer())
        value = builder.load(builder.gep(pointer, [args[1]]))
        return builder.zext(value, ir.IntType(64))

    return types.int64(types.int64, types.int64), codegen


@intrinsic
def load_texel(typingctx: Any, address: Any, index: Any) -> Any:
    """The uint16 at address + 2 * index: pictures of different views are reached through one table."""
    return _element_of(16)


@intrinsic
def load_byte(typingctx: Any, address: Any, index: Any) -> Any:
    """The uint8 at address + index."""
    return _element_of(8)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nnan", "nsz"})
def _unproject_row(camera: F64, y: int, disparity: F32, points: F64) -> None:
    """points [3, w] of a row's pixels, relative to the scene origin; of holes, at depth 1."""
    if camera[0] == PERSPECTIVE:  # free of branches and calls, so that it compiles to vector instructions
        fx, cx, z = 1.0 / camera[3], camera[5], (camera[6] - (y + 0.5)) / camera[4]
        for x in range(disparity.shape[0]):
            q = disparity[x]
            depth = 1.0 / (q if q > 0.0 else np.float32(1.0))
            side, up = (cx - (x + 0.5)) * fx * depth, z * depth
            points[0, x] = camera[7] * depth + camera[8] * side + camera[9] * up + camera[16]
            points[1, x] = camera[10] * depth + camera[11] * side + camera[12] * up + camera[17]
            points[2, x] = camera[13] * depth + camera[14] * side + camera[15] * up + camera[18]
        return
    for x in range(disparity.shape[0]):
        q = disparity[x]
        points[0, x], points[1, x], points[2, x] = unproject_point(
            camera, x + 0.5, y + 0.5, 1.0 / q if q > 0.0 else 1.0
        )


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nnan", "nsz"})
def _project_row(table: F64, k: int, points: F64, images: F64) -> None:
    """images [3, w]: u, v and depth code of points in view k; the code is OUTSIDE where the view has no pixel.

    Free of branches and calls, so that it compiles to vector instructions.
    """
    rxx, rxy, rxz = table[k, 7], table[k, 10], table[k, 13]
    ryx, ryy, ryz = table[k, 8], table[k, 11], table[k, 14]
    rzx, rzy, rzz = table[k, 9], table[k, 12], table[k, 15]
    ox, oy, oz = table[k, 16], table[k, 17], table[k, 18]
    width, height = table[k, 1], table[k, 2]
    offset, per_step = table[k, OFFSET], 1.0 / table[k, STEP]
    if table[k, 0] == PERSPECTIVE:
        fx, fy, mx, my = table[k, 3], table[k, 4], table[k, 5], table[k, 6]
        for x in range(points.shape[1]):
            dx, dy, dz = points[0, x] - ox, points[1, x] - oy, points[2, x] - oz
            depth = rxx * dx + rxy * dy + rxz * dz
            inverse = 1.0 / depth
            u = mx - fx * inverse * (ryx * dx + ryy * dy + ryz * dz)
            v = my - fy * inverse * (rzx * dx + rzy * dy + rzz * dz)
            inside = (depth > 0.0) & (u >= 0.0) & (v >= 0.0) & (u <= width) & (v <= height)
            images[0, x], images[1, x] = u, v
            images[2, x] = (inverse - offset) * per_step if inside else OUTSIDE
    else:
        left, top, columns, rows = table[k, 3], table[k, 5], table[k, COLUMNS], table[k, ROWS]
        turn, middle = 2.0 * math.pi * columns, 0.5 * width
        for x in range(points.shape[1]):
            dx, dy, dz = points[0, x] - ox, points[1, x] - oy, points[2, x] - oz
            cx = rxx * dx + rxy * dy + rxz * dz
            cy = ryx * dx + ryy * dy + ryz * dz
            cz = rzx * dx + rzy * dy + rzz * dz
            planar = cx * cx + cy * cy
            # The azimuth is known up to a turn: take the one nearest to the picture's middle.
            u = (left - arc_tangent(cy, cx)) * columns
            u = u - turn if u > middle + 0.5 * turn else u
            u = u + turn if u < middle - 0.5 * turn else u
            v = (top - arc_tangent(cz, math.sqrt(planar))) * rows
            inside = (u >= 0.0) & (v >= 0.0) & (u <= width) & (v <= height)
            images[0, x], images[1, x] = u, v
            images[2, x] = (1.0 / math.sqrt(planar + cz * cz) - offset) * per_step if inside else OUTSIDE


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nnan", "nsz"})
def _weigh_row(table: F64, k: int, eye: F64, points: F64, images: F64, weights: F64) -> None:
    """weights [2, w] of view k's clean and mixed texels: small angle between its ray and the eye's, fine sampling,
    off the border. Where the two rays are within a pixel of each other, a mixed texel is what the eye sees."""
    sharpness, width, height = table[k, SHARPNESS] * table[k, SHARPNESS], table[k, 1], table[k, 2]
    softest = 1.0 if table[k, 19] > 0.0 else 0.02  # a picture that wraps has no border
    pixel2 = table[k, PIXEL] * table[k, PIXEL]
    for x in range(weights.shape[1]):
        ex, ey, ez = points[0, x] - eye[16], points[1, x] - eye[17], points[2, x] - eye[18]
        vx, vy, vz = points[0, x] - table[k, 16], points[1, x] - table[k, 17], points[2, x] - table[k, 18]
        ee, vv = ex * ex + ey * ey + ez * ez, vx * vx + vy * vy + vz * vz
        cx, cy, cz = ey * vz - ez * vy, ez * vx - ex * vz, ex * vy - ey * vx
        both = ee * vv
        sine2 = cx * cx + cy * cy + cz * cz  # times both
        sine2 = 2.0 * both - sine2 if ex * vx + ey * vy + ez * vz < 0.0 else sine2
        finer = min(vv, ee * sharpness)  # times vv
        u, v = images[0, x], images[1, x]
        border = min(min(u, width - u), min(v, height - v)) * (1.0 / _BORDER_PX)
        border = min(1.0, max(softest, border))
        weight = border * (0.1 * vv + finer) * ee / (3e-5 * both + sine2)
        same, apart = pixel2 * both, sine2
        alike = same * same / (same * same + apart * apart)
        weights[0, x], weights[1, x] = weight, weight * (_MIXED + (1.0 - _MIXED) * alike)


@intrinsic
def _sum_4x4(typingctx: Any, address: Any, width: Any, at: Any, across: Any, down: Any) -> Any:
    """Of the uint16 plane at an address, sample `at` and its neighbours from one to the left and above to two to the
    right and below: the sum weighted by four shares across and four down, a row at a time in a vector register."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        plane, stride, index, columns, rows = args
        single, integers = ir.FloatType(), ir.VectorType(ir.IntType(16), 4)
        vector = ir.VectorType(single, 4)
        pointer = builder.inttoptr(plane, ir.IntType(16).as_pointer())

        def share(shares: Any, k: int) -> Any:
            return builder.fptrunc(builder.extract_value(shares, k), single)

        total = ir.Constant(vector, None)
        at = builder.sub(index, builder.add(stride, ir.Constant(stride.type, 1)))
        for k in range(4):
            row = builder.bitcast(builder.gep(pointer, [at]), integers.as_pointer())
            samples = builder.uitofp(builder.load(row, align=2), vector)
            spread = ir.Constant(vector, ir.Undefined)
            for lane in range(4):
                spread = builder.insert_element(spread, share(rows, k), ir.IntType(32)(lane))
            total = builder.fadd(total, builder.fmul(samples, spread))
            at = builder.add(at, stride)
        result = ir.Constant(single, 0.0)
        for lane in range(4):
            column = builder.extract_element(total, ir.IntType(32)(lane))
            result = builder.fadd(result, builder.fmul(column, share(columns, lane)))
        return builder.fpext(result, ir.DoubleType())

    shares = types.containers.UniTuple(types.float64, 4)
    return types.float64(types.int64, types.int64, types.int64, shares, shares), codegen


@numba.njit(inline="always", cache=True, error_model="numpy")
def _cubic_shares(f: float) -> tuple[float, float, float, float]:
    """Of the samples at -1, 0, 1 and 2 for a place f in [0, 1): cubic convolution with a = -1/2."""
    g = 1.0 - f
    return -0.5 * f * g * g, 1.0 + f * f * (1.5 * f - 2.5), 1.0 + g * g * (1.5 * g - 2.5), -0.5 * g * f * f


@numba.njit(inline="always", cache=True)
def _is_whole(cuts: int, at: int, width: int) -> bool:
    """Whether the surface is cut nowhere between a texel and those to its right and below."""
    right, down = triangulate.CUT_RIGHT, triangulate.CUT_DOWN
    here, beside, below = load_byte(cuts, at), load_byte(cuts, at + 1), load_byte(cuts, at + width)
    return ((here & (right | down)) | (beside & down) | (below & right)) == 0


@numba.njit(inline="always", cache=True, error_model="numpy")
def _chroma_index(u: float, v: float, width: int, height: int, subsampled: int) -> int:
    """The chroma sample whose pixels (2x2 or one) hold (u, v): replicated up, as the reference renderers do."""
    x, y = min(max(int(u), 0), width - 1), min(max(int(v), 0), height - 1)
    return (y >> subsampled) * ((width + subsampled) >> subsampled) + (x >> subsampled)


@numba.njit(inline="always", cache=True, error_model="numpy")
def _fetch(
    table: F64, addresses: I64, k: int, u: float, v: float, code: float, nearest: bool
) -> tuple[float, float, float, float]:
    """Colour of view k at (u, v) and how much of it lies on the surface of that depth code (0 to 1).

    With `nearest` the texel closest in depth is taken whatever its depth: for the view that drew the pixel.
    """
    width, height = int(table[k, 1]), int(table[k, 2])
    y = min(max(v - 0.5, 0.0), height - 1.0)
    iy = min(int(y), max(height - 2, 0))
    if table[k, 19] > 0.0:
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
    share = 1.0
    if high - low <= table[k, EDGE] and (low > 0 or not invalid):
        if not nearest and abs(wa * ca + wb * cb + wc * cc + wd * cd - code) > table[k, TOLERANCE]:
            return 0.0, 0.0, 0.0, 0.0
    else:
        # An edge runs between the texels: take those of the wanted surface only.
        limit = 0.5 * table[k, EDGE] + table[k, TOLERANCE]
        ka = wa if abs(ca - code) <= limit and not (invalid and ca == 0) else 0.0
        kb = wb if abs(cb - code) <= limit and not (invalid and cb == 0) else 0.0
        kc = wc if abs(cc - code) <= limit and not (invalid and cc == 0) else 0.0
        kd = wd if abs(cd - code) <= limit and not (invalid and cd == 0) else 0.0
        share = ka + kb + kc + kd
        if share < 1e-3:
            if not nearest:
                return 0.0, 0.0, 0.0, 0.0
            best = min(min(abs(ca - code), abs(cb - code)), min(abs(cc - code), abs(cd - code)))
            ka = 1.0 if abs(ca - code) == best else 0.0
            kb = 1.0 if abs(cb - code) == best else 0.0
            kc = 1.0 if abs(cc - code) == best else 0.0
            kd = 1.0 if abs(cd - code) == best else 0.0
            share = ka + kb + kc + kd
        inverse = 1.0 / share
        wa, wb, wc, wd = ka * inverse, kb * inverse, kc * inverse, kd * inverse
        # Chroma from the middle of the texels taken.
        u = x0 + 0.5 + wb + wd
        v = iy + 0.5 + wc + wd
    y_ = addresses[k, 1]
    luma = wa * load_texel(y_, a) + wb * load_texel(y_, b) + wc * load_texel(y_, c) + wd * load_texel(y_, d)
    at = _chroma_index(u, v, width, height, int(table[k, SUBSAMPLED]))
    return luma, float(load_texel(addresses[k, 2], at)), float(load_texel(addresses[k, 3], at)), min(share, 1.0)


@numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _gather_row(
    table: F64, addresses: I64, k: int, blend: int, cubic: bool, images: F64, weights: F64, taken: U8, sums: F64
) -> int:
    """Add view k to the row's sums [4, w] (weight, y, cb, cr) where it agrees; returns the pixels thus finished."""
    finished = 0
    us, vs, codes, weight, ys, bs, rs = images[0], images[1], images[2], sums[0], sums[1], sums[2], sums[3]
    width, height, subsampled = int(table[k, 1]), int(table[k, 2]), int(table[k, SUBSAMPLED])
    half, pitch = (width + subsampled) >> subsampled, 0.5 if subsampled else 1.0  # of the chroma
    shift = 0.5 * pitch - 0.5
    tolerance = table[k, TOLERANCE]
    depth, luma, chroma_b, chroma_r = addresses[k, 0], addresses[k, 1], addresses[k, 2], addresses[k, 3]
    cuts, clean, mixed = addresses[k, 4], weights[0], weights[1]
    # Read once: to the compiler, what is written to the sums might change the table.
    tone = (
        table[k, TONE], table[k, TONE + 1], table[k, TONE + 2], table[k, TONE + 3],
        table[k, TONE + 4], table[k, TONE + 5], table[k, TONE + 6], table[k, TONE + 7],
    )  # fmt: skip
    blends = blend > 1
    # Where four by four samples of the chroma, and of the luma more so, lie inside the picture.
    last_x, last_y = (width if cubic else 0) - 7, height - 7
    for x in range(taken.shape[0]):
        code = codes[x]
        if taken[x] >= blend or code == OUTSIDE:
            continue
        u, v = us[x] - 0.5, vs[x] - 0.5
        # The common case first: four texels of one surface, well inside the picture.
        plain = (u >= 0.0) & (v >= 0.0) & (u < width - 1) & (v < height - 1)
        if plain:
            x0, y0 = int(u), int(v)
            at = y0 * width + x0
            plain = _is_whole(cuts, at, width)
        if plain:
            fx, fy = u - x0, v - y0
            ca, cb = load_texel(depth, at), load_texel(depth, at + 1)
            cc, cd = load_texel(depth, at + width), load_texel(depth, at + width + 1)
            top, bottom = ca + fx * (cb - ca), cc + fx * (cd - cc)
            if abs(top + fy * (bottom - top) - code) > tolerance:
                continue
            share = 1.0
            if blends:
                beside = load_byte(cuts, int(v + 0.5) * width + int(u + 0.5)) & triangulate.BROKEN
                share = mixed[x] if beside else clean[x]
            ya, yb = load_texel(luma, at), load_texel(luma, at + 1)
            yc, yd = load_texel(luma, at + width), load_texel(luma, at + width + 1)
            inner = (x0 >= 3) & (y0 >= 3) & (x0 < last_x) & (y0 < last_y)
            if inner and max(max(ya, yb), max(yc, yd)) - min(min(ya, yb), min(yc, yd)) > _SMOOTH:
                y = _sum_4x4(luma, width, at, _cubic_shares(fx), _cubic_shares(fy))
                cu, cv = pitch * u + shift, pitch * v + shift
                i, j = int(cu), int(cv)
                cu, cv, middle = cu - i, cv - j, j * half + i
                across, down = _cubic_shares(cu), _cubic_shares(cv)
                b = _sum_4x4(chroma_b, half, middle, across, down)
                r = _sum_4x4(chroma_r, half, middle, across, down)
            else:
                top, bottom = ya + fx * (yb - ya), yc + fx * (yd - yc)
                middle = (int(v + 0.5) >> subsampled) * half + (int(u + 0.5) >> subsampled)
                y = top + fy * (bottom - top)
                b, r = float(load_texel(chroma_b, middle)), float(load_texel(chroma_r, middle))
        else:
            y, b, r, share = _fetch(table, addresses, k, us[x], vs[x], code, False)
            if share <= 0.0:
                continue
            if blends:
                at = min(int(vs[x]), height - 1) * width + min(int(us[x]), width - 1)
                share *= mixed[x] if load_byte(cuts, at) & triangulate.BROKEN else clean[x]
        y, b, r = toned(tone, y, b, r)
        weight[x] += share
        ys[x] += share * y
        bs[x] += share * b
        rs[x] += share * r
        taken[x] += 1
        finished += taken[x] == blend
    return finished


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _finish_row(
    table: F64, addresses: I64, drawn: F32, winner: U8, points: F64, sums: F64,
    luma: F32, chroma_b: F32, chroma_r: F32,
) -> None:  # fmt: skip
    """Colours of a row; a pixel to which no view agreed asks the one that drew it."""
    point, image = np.empty((3, 1)), np.empty((3, 1))
    for x in range(drawn.shape[0]):
        if drawn[x] <= 0.0:
            continue
        if sums[0, x] <= 0.0:
            k = np.int64(winner[x])
            point[0, 0], point[1, 0], point[2, 0] = points[0, x], points[1, x], points[2, x]
            _project_row(table, k, point, image)
            y, b, r, _ = _fetch(table, addresses, k, image[0, 0], image[1, 0], image[2, 0], True)
            sums[1, x], sums[2, x], sums[3, x] = toned(table[k, TONE:], y, b, r)
            sums[0, x] = 1.0
        inverse = 1.0 / sums[0, x]
        # Tones and cubic convolution overshoot.
        luma[x] = min(max(sums[1, x] * inverse, 0.0), LARGEST)
        chroma_b[x] = min(max(sums[2, x] * inverse, 0.0), LARGEST)
        chroma_r[x] = min(max(sums[3, x] * inverse, 0.0), LARGEST)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def shade(
    disparity: F32, winner: U8, camera: F64, full: F64, full_addresses: I64, table: F64, addresses: I64,
    n_views: int, blend: int, cubic: bool,
    luma: F32, chroma_b: F32, chroma_r: F32,
) -> None:  # fmt: skip
    """Fill luma, chroma_b and chroma_r [h, w] where disparity > 0.

    `full` and `table` are the same views, at their full size and at that which suits the picture; where the latter has
    no texel of a surface, the former is asked.

    Rows 0..n_views-1 of the table are the warped views in order of worth; further rows are backdrops, which
    colour only the pixels that they won. At most `blend` agreeing views contribute to a pixel; with `cubic` they are
    interpolated by cubic convolution where a surface is whole and its colours are rough.
    """
    h, w = disparity.shape
    chunks = min(h, _CHUNKS)
    for chunk in numba.prange(chunks):
        points, images, sums = np.empty((3, w)), np.empty((3, w)), np.empty((4, w))
        weights, taken = np.ones((2, w)), np.empty(w, np.uint8)
        # Rows are dealt out in turn: expensive regions spread over the threads.
        for y in range(np.int64(chunk), h, chunks):
            _unproject_row(camera, y, disparity[y], points)
            sums[:] = 0.0
            open_pixels = 0
            for x in range(w):
                wanted = disparity[y, x] > 0.0 and winner[y, x] < n_views
                taken[x] = 0 if wanted else blend
                open_pixels += wanted
            for k in range(n_views):
                if open_pixels == 0:
                    break
                _project_row(table, k, points, images)
                if blend > 1:
                    _weigh_row(table, k, camera, points, images, weights)
                open_pixels -= _gather_row(table, addresses, k, blend, cubic, images, weights, taken, sums)
            _finish_row(
                full, full_addresses, disparity[y], winner[y], points, sums, luma[y], chroma_b[y], chroma_r[y]
            )
