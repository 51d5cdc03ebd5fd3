"""Triangle rasteriser: meshes into a disparity z-buffer (3D warping, paper section 3.4.2).

The target holds disparity (1 / depth as the target camera measures depth, 0 where nothing was drawn) and the
number of the view that won. Meshes are drawn in the order of their views' worth: a later one wins a pixel only
where it is nearer by more than a margin, so that views of one surface do not fight for it.

The screen is cut into bands of rows. Triangles are set up once, sorted into bands, and the bands are drawn in
parallel, each by one thread.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from .project import PERSPECTIVE
from .simd import LANES
from .strips import draw_strip

__all__ = [
    "HOLE",
    "SILHOUETTE",
    "TILE",
    "bound_blocks",
    "draw_bands",
    "draw_bands_serially",
    "mark_hole_tiles",
    "mark_nearer",
    "mark_nearer_serially",
    "mark_open_tiles",
    "sort_into_bands",
    "sort_into_bands_serially",
    "transform_points",
    "transform_points_serially",
    "visible_blocks",
]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]

# Pixels by which a triangle's sides are moved outwards: rounding opens no cracks between neighbours.
_SIDE_PX = 1e-3
TILE = 8  # pixels
SILHOUETTE, HOLE = 1, 2  # marks of tiles (`mark_open_tiles`)
# A triangle no larger than this hides nothing between its corners that they do not tell of.
_SMALL_PX = 3.0


@numba.njit(cache=True, nogil=True, error_model="numpy")
def bound_blocks(points: F32, starts: I64, spheres: F32) -> None:
    """spheres [b, 4]: a sphere round each block's points, its radius negative where there are none."""
    for b in range(spheres.shape[0]):
        low, high = np.full(3, np.float32(np.inf)), np.full(3, np.float32(-np.inf))
        for i in range(starts[b, 0], starts[b + 1, 0]):
            for axis in range(3):
                low[axis] = min(low[axis], points[i, axis])
                high[axis] = max(high[axis], points[i, axis])
        if low[0] > high[0]:
            spheres[b, 0], spheres[b, 1], spheres[b, 2], spheres[b, 3] = 0.0, 0.0, 0.0, -1.0
            continue
        radius2 = 0.0
        for axis in range(3):
            spheres[b, axis] = 0.5 * (low[axis] + high[axis])
            radius2 += (0.5 * (float(high[axis]) - float(low[axis]))) ** 2
        spheres[b, 3] = math.sqrt(radius2) * (1.0 + 1e-5)


@numba.njit(inline="always", cache=True, error_model="numpy")
def _sphere_touches_hole(camera: F64, tiles: U8, x: float, y: float, z: float, r: float) -> bool:
    """Whether the box round a sphere's picture touches a marked tile; the sphere lies before the eye."""
    width, height = int(camera[1]), int(camera[2])
    u_low, u_high, v_low, v_high = math.inf, -math.inf, math.inf, -math.inf
    for k in range(4):
        inverse = 1.0 / (x - r if k & 1 else x + r)
        side = -r if k & 2 else r
        u, v = camera[5] - camera[3] * (y + side) * inverse, camera[6] - camera[4] * (z + side) * inverse
        u_low, u_high = min(u_low, u), max(u_high, u)
        v_low, v_high = min(v_low, v), max(v_high, v)
    if u_high < 0.0 or v_high < 0.0 or u_low > width or v_low > height:
        return False
    i0, i1 = int(max(u_low - 1.0, 0.0)) // TILE, int(min(u_high + 1.0, width - 1.0)) // TILE
    j0, j1 = int(max(v_low - 1.0, 0.0)) // TILE, int(min(v_high + 1.0, height - 1.0)) // TILE
    for j in range(j0, j1 + 1):
        for i in range(i0, i1 + 1):
            if tiles[j, i]:
                return True
    return False


@numba.njit(cache=True, nogil=True, error_model="numpy")
def visible_blocks(spheres: F32, camera: F64, near: float, tiles: U8, visible: I64) -> int:
    """List the blocks that a perspective picture may show (all, for another one); returns their number.

    Unless `tiles` is empty, only those that touch a marked tile.
    """
    count = 0
    perspective = camera[0] == PERSPECTIVE
    fx, fy, cx, cy = camera[3], camera[4], camera[5], camera[6]
    for b in range(spheres.shape[0]):
        r = float(spheres[b, 3])
        if r < 0.0:
            continue
        if perspective:
            dx, dy, dz = spheres[b, 0] - camera[16], spheres[b, 1] - camera[17], spheres[b, 2] - camera[18]
            x = camera[7] * dx + camera[10] * dy + camera[13] * dz
            y = camera[8] * dx + camera[11] * dy + camera[14] * dz
            z = camera[9] * dx + camera[12] * dy + camera[15] * dz
            if x + r < near:
                continue
            # Distances to the planes u = 0, u = w, v = 0, v = h, positive inside.
            left = (cx * x - fx * y) / math.hypot(cx, fx)
            right = ((camera[1] - cx) * x + fx * y) / math.hypot(camera[1] - cx, fx)
            top = (cy * x - fy * z) / math.hypot(cy, fy)
            bottom = ((camera[2] - cy) * x + fy * z) / math.hypot(camera[2] - cy, fy)
            if min(min(left, right), min(top, bottom)) < -r:
                continue
            if tiles.size > 0 and x - r > near and not _sphere_touches_hole(camera, tiles, x, y, z, r):
                continue
        visible[count] = b
        count += 1
    return count


def _transform_points(points: F32, starts: I64, visible: I64, camera: F64, screen: F32) -> None:
    """Points of visible blocks -> screen [n, 4]: u, v, disparity, and the depth along the view axis.

    The depth's sign tells what is behind. For an equirectangular target screen holds the direction in camera axes
    instead (x, y, z, unused).
    """
    perspective = camera[0] == PERSPECTIVE
    for k in numba.prange(visible.shape[0]):
        for i in range(starts[visible[k], 0], starts[visible[k] + 1, 0]):
            dx, dy, dz = points[i, 0] - camera[16], points[i, 1] - camera[17], points[i, 2] - camera[18]
            x = camera[7] * dx + camera[10] * dy + camera[13] * dz
            y = camera[8] * dx + camera[11] * dy + camera[14] * dz
            z = camera[9] * dx + camera[12] * dy + camera[15] * dz
            if perspective:
                # On the eye's plane itself nothing is projected: a hair beside it clipping finds the way back.
                x = x if abs(x) > 1e-20 else 1e-20
                inverse = 1.0 / x
                screen[i, 0] = camera[5] - camera[3] * y * inverse
                screen[i, 1] = camera[6] - camera[4] * z * inverse
                screen[i, 2] = inverse
                screen[i, 3] = x
            else:
                screen[i, 0], screen[i, 1], screen[i, 2], screen[i, 3] = x, y, z, 0.0


# One thread is quicker where there is little to draw.
transform_points = numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy", fastmath={"contract"})(
    _transform_points
)
transform_points_serially = numba.njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})(
    _transform_points
)


@numba.njit(inline="always", cache=True, error_model="numpy")
def _rows_perspective(screen: F32, a: int, b: int, c: int, width: int, height: int, near: float) -> tuple[int, int]:
    """First and last row that a triangle may touch; an empty range where it is culled."""
    xa, xb, xc = screen[a, 3], screen[b, 3], screen[c, 3]
    if min(xa, min(xb, xc)) < near:
        if max(xa, max(xb, xc)) < near:
            return 1, 0
        return 0, height - 1  # crosses the plane of the eye: clipped when drawn
    ua, va, ub, vb, uc, vc = screen[a, 0], screen[a, 1], screen[b, 0], screen[b, 1], screen[c, 0], screen[c, 1]
    if (ub - ua) * (vc - va) - (uc - ua) * (vb - va) >= 0.0:
        return 1, 0  # seen from behind
    if max(ua, max(ub, uc)) < 0.5 - _SIDE_PX or min(ua, min(ub, uc)) > width - 0.5 + _SIDE_PX:
        return 1, 0
    low, high = min(va, min(vb, vc)), max(va, max(vb, vc))
    if high < 0.0 or low > height:
        return 1, 0
    first, last = math.ceil(low - 0.5 - _SIDE_PX), math.floor(high - 0.5 + _SIDE_PX)
    return max(0, int(first)), min(height - 1, int(last))


@numba.njit(inline="always", cache=True)
def _near_in_angle(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> bool:
    """Whether two directions are less than 45 degrees apart."""
    dot = ax * bx + ay * by + az * bz
    return dot > 0.0 and 2.0 * dot * dot > (ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)


@numba.njit(inline="always", cache=True, error_model="numpy")
def _rows_spherical(screen: F32, a: int, b: int, c: int, camera: F64) -> tuple[int, int]:
    """As for a perspective target, in elevation; a triangle round a pole reaches the picture's edge."""
    height = int(camera[2])
    ax, ay, az = float(screen[a, 0]), float(screen[a, 1]), float(screen[a, 2])
    bx, by, bz = float(screen[b, 0]), float(screen[b, 1]), float(screen[b, 2])
    cx, cy, cz = float(screen[c, 0]), float(screen[c, 1]), float(screen[c, 2])
    nx = (by - ay) * (cz - az) - (bz - az) * (cy - ay)
    ny = (bz - az) * (cx - ax) - (bx - ax) * (cz - az)
    nz = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if nx * ax + ny * ay + nz * az >= 0.0:
        return 1, 0
    ta = math.atan2(az, math.hypot(ax, ay))
    tb = math.atan2(bz, math.hypot(bx, by))
    tc = math.atan2(cz, math.hypot(cx, cy))
    # A side bulges towards the pole by less than its own length.
    bulge = 0.5 * (max(ta, max(tb, tc)) - min(ta, min(tb, tc))) + 2 * camera[6]
    high, low = max(ta, max(tb, tc)) + bulge, min(ta, min(tb, tc)) - bulge
    if not (_near_in_angle(ax, ay, az, bx, by, bz) and _near_in_angle(bx, by, bz, cx, cy, cz)):
        return 0, height - 1
    spread = max(abs(ax * by - ay * bx), max(abs(bx * cy - by * cx), abs(cx * ay - cy * ax)))
    planar = min(ax * ax + ay * ay, min(bx * bx + by * by, cx * cx + cy * cy))
    if spread > 0.05 * planar:  # wide in azimuth: near a pole
        high, low = (math.pi / 2, low - 0.2) if az > 0 else (high + 0.2, -math.pi / 2)
    first = math.ceil((camera[5] - high) / camera[6] - 0.5)
    last = math.floor((camera[5] - low) / camera[6] - 0.5)
    return max(0, int(first)), min(height - 1, int(last))


@numba.njit(cache=True, nogil=True)
def _by_tile(found: U8, tiles: U8) -> None:
    """tiles [ceil(w / TILE)]: what was found in a tile's columns of found [w]."""
    for i in range(tiles.shape[0]):
        some = np.uint8(0)
        for x in range(TILE * i, min(TILE * (i + 1), found.shape[0])):
            some |= found[x]
        tiles[i] = some


@numba.njit(cache=True, nogil=True)
def _mark_holes(row: F32, found: U8) -> None:
    for x in range(row.shape[0]):
        found[x] |= np.uint8(1) if row[x] <= np.float32(0.0) else np.uint8(0)


@numba.njit(cache=True, parallel=True, nogil=True)
def mark_hole_tiles(disparity: F32, tiles: U8) -> None:
    """tiles [ceil(h / TILE), ceil(w / TILE)]: 1 where a tile has a pixel that nothing was drawn to."""
    h, w = disparity.shape
    for row in numba.prange(tiles.shape[0]):
        j = int(np.int64(row))
        found = np.zeros(w, np.uint8)
        for y in range(TILE * j, min(TILE * (j + 1), h)):
            _mark_holes(disparity[y], found)
        _by_tile(found, tiles[j])


@numba.njit(inline="always", cache=True, error_model="numpy")
def _touches(screen: F32, a: int, b: int, c: int, tiles: U8, marks: int, first: int, last: int) -> bool:
    """Whether the box round a triangle touches a tile with one of some marks."""
    low = min(screen[a, 0], min(screen[b, 0], screen[c, 0])) - 1.0
    high = max(screen[a, 0], max(screen[b, 0], screen[c, 0])) + 1.0
    i0, i1 = max(0, int(low)) // TILE, min(tiles.shape[1] - 1, max(0, int(high)) // TILE)
    for j in range(first // TILE, last // TILE + 1):
        for i in range(i0, i1 + 1):
            if tiles[j, i] & marks:
                return True
    return False


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _mark_open_row(above: F32, row: F32, below: F32, step: float, found: U8) -> None:
    """found [w]: HOLE where nothing was drawn, SILHOUETTE where disparities bend by more than `step`."""
    w = row.shape[0]
    left, right = row[: w - 2], row[2:]
    for x in range(w):
        bend = abs(above[x] - row[x] - row[x] + below[x])
        found[x] |= np.uint8(SILHOUETTE) if bend > step else np.uint8(0)
        found[x] |= np.uint8(HOLE) if row[x] <= np.float32(0.0) else np.uint8(0)
    for x in range(w - 2):
        bend = abs(left[x] - row[x + 1] - row[x + 1] + right[x])
        found[x + 1] |= np.uint8(SILHOUETTE) if bend > step else np.uint8(0)


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def mark_open_tiles(disparity: F32, step: float, tiles: U8) -> None:
    """tiles [ceil(h / TILE), ceil(w / TILE)]: HOLE where a tile has a pixel that nothing was drawn to, SILHOUETTE where
    it has one of those, or both.

    There a triangle may show between surfaces though its corners lie behind them.
    """
    h, w = disparity.shape
    least = np.float32(step)
    for row in numba.prange(tiles.shape[0]):
        j = int(np.int64(row))
        found = np.zeros(w, np.uint8)
        for y in range(TILE * j, min(TILE * (j + 1), h)):
            _mark_open_row(disparity[max(y - 1, 0)], disparity[y], disparity[min(y + 1, h - 1)], least, found)
        _by_tile(found, tiles[j])


def _mark_nearer(screen: F32, starts: I64, visible: I64, disparity: F32, margin: float, nearer: U8) -> None:
    """nearer [n]: 1 for points of visible blocks that lie before what is drawn to their pixel, or outside the picture.

    By point and not by triangle: a point belongs to six of them, and what it waits for is memory.
    """
    height, width = np.float32(disparity.shape[0]), np.float32(disparity.shape[1])
    for k in numba.prange(visible.shape[0]):
        for i in range(starts[visible[k], 0], starts[visible[k] + 1, 0]):
            u, v = screen[i, 0], screen[i, 1]
            found = True
            if (u >= np.float32(0.0)) & (v >= np.float32(0.0)) & (u < width) & (v < height):
                drawn = disparity[int(v), int(u)]
                found = (drawn <= np.float32(0.0)) | (screen[i, 2] > drawn + margin)
            nearer[i] = found


mark_nearer = numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")(_mark_nearer)
mark_nearer_serially = numba.njit(cache=True, nogil=True, error_model="numpy")(_mark_nearer)


@numba.njit(inline="always", cache=True, error_model="numpy")
def _may_win(screen: F32, a: int, b: int, c: int, nearer: U8, open_tiles: U8, height: int) -> bool:
    """Whether a triangle may win a pixel: by a corner, beside a hole or, unless it is small, beside a silhouette."""
    if (nearer[a] | nearer[b] | nearer[c]) != 0:
        return True
    left, right = min(screen[a, 0], min(screen[b, 0], screen[c, 0])), max(screen[a, 0], max(screen[b, 0], screen[c, 0]))
    top, bottom = min(screen[a, 1], min(screen[b, 1], screen[c, 1])), max(screen[a, 1], max(screen[b, 1], screen[c, 1]))
    marks = HOLE if max(right - left, bottom - top) <= _SMALL_PX else HOLE | SILHOUETTE
    return _touches(screen, a, b, c, open_tiles, marks, max(int(top), 0), min(int(bottom), height - 1))


def _sort_into_bands(
    screen: F32, triangles: I32, starts: I64, visible: I64, shares: I64, camera: F64, near: float, band_rows: int,
    tiles: U8, open_tiles: U8, nearer: U8, counts: I64, lists: I32, drawn: I64,
) -> None:  # fmt: skip
    """Sort visible blocks' triangles into bands; counts [chunks, bands], lists [chunks, bands, capacity].

    Chunk c takes the visible blocks shares[c] to shares[c + 1] - 1 and counts its triangles in drawn[c].

    Culled are triangles outside the picture, behind the eye or seen from behind and, for a perspective target and
    unless `tiles` is empty, those that touch no marked tile; and unless `open_tiles` (see `mark_open_tiles`) is, those
    that cannot win a pixel, `nearer` being what `mark_nearer` gives. A triangle over several bands stands in each.
    """
    chunks, bands = counts.shape[0], counts.shape[1]
    width, height = int(camera[1]), int(camera[2])
    perspective = camera[0] == PERSPECTIVE
    second = 2 if perspective and camera[3] * camera[4] < 0.0 else 1  # a mirrored picture winds the other way
    for chunk in numba.prange(chunks):
        drawn[chunk] = 0
        for band in range(bands):
            counts[chunk, band] = 0
        for k in range(shares[chunk], shares[chunk + 1]):
            block = visible[k]
            for t in range(starts[block, 1], starts[block + 1, 1]):
                a, b, c = triangles[t, 0], triangles[t, second], triangles[t, 3 - second]
                if perspective:
                    first, last = _rows_perspective(screen, a, b, c, width, height, near)
                else:
                    first, last = _rows_spherical(screen, a, b, c, camera)
                if last < first:
                    continue
                before = perspective and min(screen[a, 3], min(screen[b, 3], screen[c, 3])) >= near
                if tiles.size > 0 and before and not _touches(screen, a, b, c, tiles, 255, first, last):
                    continue
                if open_tiles.size > 0 and before and not _may_win(screen, a, b, c, nearer, open_tiles, height):
                    continue
                drawn[chunk] += 1
                for band in range(first // band_rows, last // band_rows + 1):
                    lists[chunk, band, counts[chunk, band]] = t
                    counts[chunk, band] += 1


# One thread is quicker where there is little to draw.
sort_into_bands = numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")(_sort_into_bands)
sort_into_bands_serially = numba.njit(cache=True, nogil=True, error_model="numpy")(_sort_into_bands)


@numba.njit(inline="always", cache=True, error_model="numpy", fastmath={"contract", "nnan"})
def _draw_projected(
    ua: float, va: float, qa: float, ub: float, vb: float, qb: float, uc: float, vc: float, qc: float,
    first: int, last: int, view: int, margin: float, push: float, disparity: F32, winner: U8,
) -> None:  # fmt: skip
    """Scan-convert one triangle in rows first..last; disparity is affine on the screen."""
    # A side from p to r is rise * (u - pu) - run * (v - pv), 0 or more inside.
    rise_a, rise_b, rise_c = vb - va, vc - vb, va - vc
    run_a, run_b, run_c = ub - ua, uc - ub, ua - uc
    area = run_c * rise_a - run_a * rise_c  # twice it; below 0 as the eye sees it
    if area >= 0.0:
        return
    width = disparity.shape[1]
    inverse = -1.0 / area
    q_du = ((qb - qa) * rise_c + (qc - qa) * rise_a) * inverse
    q_dv = -((qb - qa) * run_c + (qc - qa) * run_a) * inverse
    q_low, q_high = min(qa, min(qb, qc)), max(qa, max(qb, qc))
    u_low, u_high = min(ua, min(ub, uc)), max(ua, max(ub, uc))
    v_low, v_high = min(va, min(vb, vc)), max(va, max(vb, vc))
    first = max(first, math.ceil(v_low - 0.5 - _SIDE_PX))
    last = min(last, math.floor(v_high - 0.5 + _SIDE_PX))
    x0, x1 = max(0, math.ceil(u_low - 0.5 - _SIDE_PX)), min(width - 1, math.floor(u_high - 0.5 + _SIDE_PX))
    slack_a = _SIDE_PX * (abs(rise_a) + abs(run_a)) - rise_a * ua + run_a * va
    slack_b = _SIDE_PX * (abs(rise_b) + abs(run_b)) - rise_b * ub + run_b * vb
    slack_c = _SIDE_PX * (abs(rise_c) + abs(run_c)) - rise_c * uc + run_c * vc
    near, won, v = disparity.ctypes.data, winner.ctypes.data, first + 0.5
    for x in range(x0, x1 + 1, LANES):
        u, at = x + 0.5, first * width + x
        draw_strip(
            near + 4 * at, won + at, width, x1 + 1 - x, last + 1 - first,
            (
                rise_a * u - run_a * v + slack_a, rise_a, -run_a, rise_b * u - run_b * v + slack_b, rise_b, -run_b,
                rise_c * u - run_c * v + slack_c, rise_c, -run_c,
            ),
            (qa + q_du * (u - ua) + q_dv * (v - va), q_du, q_dv, q_low, q_high), margin, push, view,
        )  # fmt: skip


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _draw_clipped(
    screen: F32, a: int, b: int, c: int, camera: F64, near: float, first: int, last: int,
    view: int, margin: float, push: float, disparity: F32, winner: U8,
) -> None:  # fmt: skip
    """Clip a triangle at the plane `near` in front of the eye and draw the one or two triangles that are left."""
    polygon = np.empty((4, 3))
    n = 0
    for k in range(3):
        i = a if k == 0 else (b if k == 1 else c)
        j = b if k == 0 else (c if k == 1 else a)
        xi, xj = float(screen[i, 3]), float(screen[j, 3])
        yi, zi = (camera[5] - screen[i, 0]) * xi / camera[3], (camera[6] - screen[i, 1]) * xi / camera[4]
        yj, zj = (camera[5] - screen[j, 0]) * xj / camera[3], (camera[6] - screen[j, 1]) * xj / camera[4]
        if xi >= near:
            polygon[n, 0], polygon[n, 1], polygon[n, 2] = xi, yi, zi
            n += 1
        if (xi >= near) != (xj >= near):
            t = (near - xi) / (xj - xi)
            polygon[n, 0], polygon[n, 1], polygon[n, 2] = near, yi + t * (yj - yi), zi + t * (zj - zi)
            n += 1
    for k in range(n):
        q = 1.0 / polygon[k, 0]
        polygon[k, 1] = camera[5] - camera[3] * polygon[k, 1] * q
        polygon[k, 2] = camera[6] - camera[4] * polygon[k, 2] * q
        polygon[k, 0] = q
    for k in range(1, n - 1):
        _draw_projected(
            polygon[0, 1], polygon[0, 2], polygon[0, 0], polygon[k, 1], polygon[k, 2], polygon[k, 0],
            polygon[k + 1, 1], polygon[k + 1, 2], polygon[k + 1, 0],
            first, last, view, margin, push, disparity, winner,
        )  # fmt: skip


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _draw_spherical(
    screen: F32, a: int, b: int, c: int, camera: F64, columns: F32, rows: F32, first: int, last: int,
    view: int, margin: float, push: float, disparity: F32, winner: U8,
) -> None:  # fmt: skip
    """Draw on the sphere: a pixel is inside where its direction is on the inner side of three planes."""
    width = disparity.shape[1]
    ax, ay, az = float(screen[a, 0]), float(screen[a, 1]), float(screen[a, 2])
    bx, by, bz = float(screen[b, 0]), float(screen[b, 1]), float(screen[b, 2])
    cx, cy, cz = float(screen[c, 0]), float(screen[c, 1]), float(screen[c, 2])
    sides = np.empty((3, 4))
    for k in range(3):
        px, py, pz = (ax, ay, az) if k == 0 else ((bx, by, bz) if k == 1 else (cx, cy, cz))
        rx, ry, rz = (bx, by, bz) if k == 0 else ((cx, cy, cz) if k == 1 else (ax, ay, az))
        sides[k, 0], sides[k, 1], sides[k, 2] = ry * pz - rz * py, rz * px - rx * pz, rx * py - ry * px
        length = math.sqrt(sides[k, 0] ** 2 + sides[k, 1] ** 2 + sides[k, 2] ** 2)
        sides[k, 3] = -_SIDE_PX * camera[6] * length
    nx = (by - ay) * (cz - az) - (bz - az) * (cy - ay)
    ny = (bz - az) * (cx - ax) - (bx - ax) * (cz - az)
    nz = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    inverse = 1.0 / (nx * ax + ny * ay + nz * az)
    pa, pb, pc = math.atan2(ay, ax), math.atan2(by, bx), math.atan2(cy, cx)
    turn = 2.0 * math.pi
    pb -= turn * math.floor((pb - pa) / turn + 0.5)
    pc -= turn * math.floor((pc - pa) / turn + 0.5)
    high, low = max(pa, max(pb, pc)), min(pa, min(pb, pc))
    if high - low > 0.05:  # near a pole: every column may be touched
        x0, x1 = 0, width - 1
    else:
        x0 = math.ceil((camera[3] - high) / camera[4] - 1.5)
        x1 = math.floor((camera[3] - low) / camera[4] + 0.5)
    period = round(turn / camera[4])
    for y in range(first, last + 1):
        planar, z = rows[y, 0], rows[y, 1]
        for column in range(x0, x1 + 1):
            x = column
            if x < 0 or x >= width:
                x = x % period
                if x >= width:
                    continue
            dx, dy = planar * columns[x, 0], planar * columns[x, 1]
            if (
                sides[0, 0] * dx + sides[0, 1] * dy + sides[0, 2] * z >= sides[0, 3]
                and sides[1, 0] * dx + sides[1, 1] * dy + sides[1, 2] * z >= sides[1, 3]
                and sides[2, 0] * dx + sides[2, 1] * dy + sides[2, 2] * z >= sides[2, 3]
            ):
                q = (nx * dx + ny * dy + nz * z) * inverse
                q = q / (1.0 + push * q)
                if q > disparity[y, x] + (margin if disparity[y, x] > 0.0 else 0.0):
                    disparity[y, x] = q
                    winner[y, x] = view


def _draw_bands(
    screen: F32, triangles: I32, camera: F64, columns: F32, rows: F32, near: float, band_rows: int,
    counts: I64, lists: I32, view: int, margin: float, push: float, disparity: F32, winner: U8,
) -> None:  # fmt: skip
    """Draw sorted triangles; `margin` is the disparity by which a drawn surface must be beaten, `push` metres
    move the mesh away from the eye (the backdrop's offset). columns [w, 2] and rows [h, 2] are the cosines and
    sines of an equirectangular target's azimuths and elevations."""  # fmt: skip
    bands = counts.shape[1]
    height = disparity.shape[0]
    perspective = camera[0] == PERSPECTIVE
    second = 2 if perspective and camera[3] * camera[4] < 0.0 else 1
    for task in numba.prange(bands):
        # Neighbouring tasks go to one thread: deal the bands out so that each gets some of every region.
        half = (bands + 1) // 2
        band = 2 * task if task < half else 2 * (task - half) + 1
        first, last = band * band_rows, min((band + 1) * band_rows, height) - 1
        for chunk in range(counts.shape[0]):
            for k in range(counts[chunk, band]):
                t = lists[chunk, band, k]
                a, b, c = triangles[t, 0], triangles[t, second], triangles[t, 3 - second]
                if not perspective:
                    _draw_spherical(
                        screen, a, b, c, camera, columns, rows, first, last,
                        view, margin, push, disparity, winner,
                    )  # fmt: skip
                elif min(screen[a, 3], min(screen[b, 3], screen[c, 3])) < near:
                    _draw_clipped(
                        screen, a, b, c, camera, near, first, last, view, margin, push, disparity, winner
                    )
                else:
                    _draw_projected(
                        screen[a, 0], screen[a, 1], screen[a, 2], screen[b, 0], screen[b, 1], screen[b, 2],
                        screen[c, 0], screen[c, 1], screen[c, 2],
                        first, last, view, margin, push, disparity, winner,
                    )  # fmt: skip


# One thread is quicker where there is little to draw.
draw_bands = numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")(_draw_bands)
draw_bands_serially = numba.njit(cache=True, nogil=True, error_model="numpy")(_draw_bands)
