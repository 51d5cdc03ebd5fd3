"""Triangles on an equirectangular picture: sorted into bands and drawn one at a time, with directions for places."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from .strips import SIDE_PX

__all__ = ["draw_bands", "sort_into_bands"]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
I64 = npt.NDArray[np.int64]
U8 = npt.NDArray[np.uint8]


@numba.njit(inline="always", cache=True)
def _near_in_angle(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> bool:
    """Whether two directions are less than 45 degrees apart."""
    dot = ax * bx + ay * by + az * bz
    return dot > 0.0 and 2.0 * dot * dot > (ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz)


@numba.njit(inline="always", cache=True, error_model="numpy")
def _rows(screen: F32, a: int, b: int, c: int, camera: F64) -> tuple[int, int]:
    """First and last row that a triangle may touch, an empty range where it is culled; one round a pole reaches the
    picture's edge."""
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


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _draw_triangle(
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
        sides[k, 3] = -SIDE_PX * camera[6] * length
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


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def sort_into_bands(
    screen: F32, triangles: I32, starts: I64, visible: I64, shares: I64, camera: F64, band_rows: int,
    counts: I64, lists: I32, drawn: I64,
) -> None:  # fmt: skip
    """As `sorting.sort_into_bands`; culled are triangles outside the picture or seen from behind."""
    chunks, bands = counts.shape[0], counts.shape[1]
    for chunk in numba.prange(chunks):
        drawn[chunk] = 0
        for band in range(bands):
            counts[chunk, band] = 0
        for k in range(shares[chunk], shares[chunk + 1]):
            block = visible[k]
            for t in range(starts[block, 1], starts[block + 1, 1]):
                first, last = _rows(screen, triangles[t, 0], triangles[t, 1], triangles[t, 2], camera)
                drawn[chunk] += last >= first
                for band in range(first // band_rows, last // band_rows + 1 if last >= first else 0):
                    lists[chunk, band, counts[chunk, band]] = t
                    counts[chunk, band] += 1


@numba.njit(cache=True, parallel=True, nogil=True, error_model="numpy")
def draw_bands(
    screen: F32, triangles: I32, camera: F64, columns: F32, rows: F32, band_rows: int, counts: I64, lists: I32,
    view: int, margin: float, push: float, disparity: F32, winner: U8,
) -> None:  # fmt: skip
    """As `rasterise.draw_bands`; columns [w, 2] and rows [h, 2] are the cosines and sines of the picture's azimuths and
    elevations."""
    bands, height = counts.shape[1], disparity.shape[0]
    for band in numba.prange(bands):
        first, last = band * band_rows, min((band + 1) * band_rows, height) - 1
        for chunk in range(counts.shape[0]):
            for k in range(counts[chunk, band]):
                t = lists[chunk, band, k]
                _draw_triangle(
                    screen, triangles[t, 0], triangles[t, 1], triangles[t, 2], camera, columns, rows, first, last,
                    view, margin, push, disparity, winner,
                )  # fmt: skip
