"""Triangle rasteriser: meshes into a disparity z-buffer (3D warping, paper section 3.4.2).

The target holds disparity (1 / depth, as the target camera measures depth; 0 where nothing was drawn) and the number of
the view that won. Meshes are drawn in the order of their views' usefulness. A later mesh wins a pixel only where it is
nearer by more than a margin, so that the pixels of a surface do not alternate between views.

The screen is divided into bands of rows. Triangles are sorted into bands (`sorting`, `spherical`), and the bands are
drawn in parallel, each by one thread.
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F32, F64, I32
from ...support.packed import CX, CY
from ..base.interleave import interleaved
from ..base.jit import parallel, serial
from ..base.simd import LANES
from .records import Bands, DepthBuffer, Rows
from .sorting import winding
from .strips import (
    CLIPPED,
    SET_UP_SIZE,
    SPECKS_SIZE,
    draw_speck,
    draw_triangle,
    find_specks,
    pixels_of,
    prepared,
    row_count,
    set_up,
)

__all__ = ["draw_bands"]


@serial
def _clip(screen: F32, corners: I32, camera: F64, near: float, polygon: F32) -> int:
    """Clip a triangle at the plane `near` in front of the eye into polygon [4, 4] (points as in `screen`); returns the
    number of its corners. Triangles with a common side get the same corners on it."""
    n = 0
    for k in range(3):
        i, j = corners[k], corners[(k + 1) % 3]
        if screen[i, 3] >= near:
            for c in range(4):  # to copy a row as a whole, with its check of shapes, takes two seconds to compile
                polygon[n, c] = screen[i, c]
            n += 1
        if (screen[i, 3] >= near) != (screen[j, 3] >= near):
            front, back = (i, j) if screen[i, 3] >= near else (j, i)
            xf, xb = float(screen[front, 3]), float(screen[back, 3])
            t = (near - xf) / (xb - xf)
            # Picture coordinates times depth are affine in space, so they are linear between the corners.
            uf, vf = (screen[front, 0] - camera[CX]) * xf, (screen[front, 1] - camera[CY]) * xf
            ub, vb = (screen[back, 0] - camera[CX]) * xb, (screen[back, 1] - camera[CY]) * xb
            polygon[n, 0] = camera[CX] + (uf + t * (ub - uf)) / near
            polygon[n, 1] = camera[CY] + (vf + t * (vb - vf)) / near
            polygon[n, 2], polygon[n, 3] = 1.0 / near, near
            n += 1
    return n


@serial
def _draw_clipped(
    screen: F32, triangle: I32, camera: F64, near: float, rows: Rows, view: int, margin: float, buffer: DepthBuffer
) -> None:
    """Draw a triangle that crosses the plane of the eye: the one or two triangles that clipping leaves."""
    disparity, winner = buffer
    polygon, ready = np.empty((4, 4), np.float32), np.empty(SET_UP_SIZE, np.float32)
    fan, both = np.array([[0, 1, 2], [0, 2, 3]], np.int32), np.array([0, 1], np.int32)
    h, w = disparity.shape
    count = max(_clip(screen, triangle, camera, near, polygon) - 2, 0)
    set_up(
        polygon.ctypes.data, fan.ctypes.data, np.int64(both.ctypes.data), count, winding(camera), np.float32(0.0), rows,
        (w, h), ready.ctypes.data,
    )  # fmt: skip
    for lane in range(count):
        draw_triangle(
            prepared(ready.ctypes.data, lane), disparity.ctypes.data, winner.ctypes.data, w, margin, view
        )


@serial
def _draw_listed(
    screen: F32, triangles: I32, listed: I32, camera: F64, near: float, rows: Rows, view: int, margin: float,
    buffer: DepthBuffer, room: F32,
) -> None:  # fmt: skip
    """Draw listed triangles into the rows `rows`; room [SET_UP_SIZE + SPECKS_SIZE]: scratch memory."""
    disparity, winner = buffer
    h, w = disparity.shape
    count, second, numbers = listed.shape[0], winding(camera), listed.ctypes.data
    near_, margin_ = np.float32(near), np.float32(margin)
    ready, specks = room.ctypes.data, room.ctypes.data + 4 * SET_UP_SIZE
    for k in range(0, count, LANES):
        n = min(LANES, count - k)
        set_up(
            screen.ctypes.data, triangles.ctypes.data, numbers + 4 * k, n, second, near_, rows, (w, h),
            ready,
        )  # fmt: skip
        find_specks(ready, specks)
        for lane in range(n):
            triangle, pixels = prepared(ready, lane), pixels_of(specks, lane)
            if pixels >= 0:
                if pixels > 0:
                    draw_speck(triangle, specks, lane, disparity, winner, margin_, view)
            elif row_count(triangle) == CLIPPED:
                _draw_clipped(screen, triangles[listed[k + lane]], camera, near, rows, view, margin_, buffer)
            else:
                draw_triangle(triangle, disparity.ctypes.data, winner.ctypes.data, w, margin_, view)


@parallel
def draw_bands(
    screen: F32, triangles: I32, camera: F64, near: float, bands: Bands, view: int, margin: float, buffer: DepthBuffer
) -> None:
    """Draw sorted triangles; `margin`: how much nearer than a drawn surface they must be to win, disparity (1/m)."""
    count, height = bands.counts.shape[1], buffer.disparity.shape[0]
    for task in numba.prange(count):
        band = interleaved(np.int64(task), count, 2)
        rows = (band * bands.rows, min((band + 1) * bands.rows, height) - 1)
        room = np.empty(SET_UP_SIZE + SPECKS_SIZE, np.float32)
        for chunk in range(bands.counts.shape[0]):
            listed = bands.lists[chunk, band, : bands.counts[chunk, band]]
            _draw_listed(screen, triangles, listed, camera, near, rows, view, margin, buffer, room)


