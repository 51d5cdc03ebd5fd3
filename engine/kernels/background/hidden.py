"""Background triangles that no eye can see because other background hides them."""

from __future__ import annotations

import math

import numba

from ...support.array_types import F32, F64, I32, I64, U8
from ..base.jit import inlined, parallel, serial
from ..base.project import project_point
from ..base.tolerance import Delta, delta_at
from .culling import SAMPLES, SMALL_PX, extent_px, sample_point
from .lines import from_camera
from .rays import ROUNDING, Tracer, is_seen_from
from .standing import Present, standing_hit
from .surfaces import Triangles

__all__ = ["CELL", "flag_unseen", "mark_seen", "spread_seen"]


CELL = 4  # side of a cell of a source picture, pixels: seen or unseen as a whole; also how far "seen" spreads
_RUN = 64  # neighbouring triangles; each of them first asks the eye that saw the one before


@inlined
def _cells(uv: F32, triangle: I32, room: float, wraps: bool, cells: U8) -> tuple[int, int, int, int]:
    """First and last column and row of the cells of a triangle, and of `room` pixels around it."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    left = math.floor((min(uv[a, 0], uv[b, 0], uv[c, 0]) - room) / CELL)
    right = math.floor((max(uv[a, 0], uv[b, 0], uv[c, 0]) + room) / CELL)
    top = math.floor((min(uv[a, 1], uv[b, 1], uv[c, 1]) - room) / CELL)
    bottom = math.floor((max(uv[a, 1], uv[b, 1], uv[c, 1]) + room) / CELL)
    if not wraps:
        left, right = max(left, 0), min(right, cells.shape[1] - 1)
    return left, right, max(top, 0), min(bottom, cells.shape[0] - 1)


@inlined
def _is_beside(uv: F32, triangle: I32, wraps: bool, cells: U8) -> bool:
    """Whether a triangle of the source picture touches a cell that is set."""
    left, right, top, bottom = _cells(uv, triangle, 0.0, wraps, cells)
    found = False
    for y in range(top, bottom + 1):
        for x in range(left, right + 1):
            found |= cells[y, x % cells.shape[1]] != 0
    return found


@serial
def _sees(
    tracer: Tracer, eye: F64, x: float, y: float, z: float, surfaces: I64, present: Present, delta: Delta
) -> tuple[bool, int]:
    """Whether the surface that an eye sees in a point's direction is not nearer than the point by more than delta; and
    the number of rays."""
    dx, dy, dz = from_camera(eye, x, y, z)
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    free = 1.0 - max(delta_at(delta, distance) / distance, ROUNDING)
    if not free > 0.0:
        return True, 0
    if is_seen_from(tracer, eye, dx, dy, dz, free):  # most points are
        return True, 1
    u, v, distance = project_point(eye, x, y, z)
    shown, _hu, _hv, _geometry, _primitive, _length, rays = standing_hit(
        tracer, eye, u, v, surfaces, present, delta
    )
    return not 0.0 < shown < free * distance, rays + 1


@parallel
def mark_seen(
    tracer: Tracer, eyes: F64, mesh: Triangles, invalid: U8, surfaces: I64, present: Present, delta: Delta,
    wraps: bool, cells: U8, seen: U8,
) -> int:  # fmt: skip
    """Sets seen [m] to 1 for valid triangles of which one of the eyes (packed cameras with a full view [n,
    CAMERA_SIZE]) sees a sample point; returns the number of rays. Triangles that touch a cell that is set (see
    `spread_seen`) are skipped. surfaces, present and delta: see `standing_hit`."""
    rays = 0
    for run in numba.prange((invalid.shape[0] + _RUN - 1) // _RUN):
        triangles, last = mesh.triangles, 0
        for i in range(run * _RUN, min((run + 1) * _RUN, triangles.shape[0])):
            if invalid[i] != 0 or _is_beside(mesh.uv, triangles[i], wraps, cells):
                continue
            a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
            samples = 1 if extent_px(mesh, a, b, c) <= SMALL_PX else len(SAMPLES)
            for k in range(samples * eyes.shape[0]):
                x, y, z = sample_point(mesh, i, k // eyes.shape[0])
                eye = (last + k) % eyes.shape[0]
                found, cast = _sees(tracer, eyes[eye], x, y, z, surfaces, present, delta)
                rays += cast
                if found:
                    seen[i], last = 1, eye
                    break
    return rays


@parallel
def spread_seen(uv: F32, triangles: I32, seen: U8, wraps: bool, cells: U8) -> None:
    """Sets the cells [ceil(h / CELL), ceil(w / CELL)] of the source picture within CELL pixels of seen triangles."""
    for i in numba.prange(triangles.shape[0]):
        if seen[i] != 0:
            left, right, top, bottom = _cells(uv, triangles[i], CELL, wraps, cells)
            for y in range(top, bottom + 1):
                for x in range(left, right + 1):
                    cells[y, x % cells.shape[1]] = 1


@parallel
def flag_unseen(uv: F32, triangles: I32, wraps: bool, cells: U8, invalid: U8) -> int:
    """Flags valid triangles that touch no set cell as invalid; returns their number."""
    count = 0
    for i in numba.prange(triangles.shape[0]):
        if invalid[i] == 0 and not _is_beside(uv, triangles[i], wraps, cells):
            invalid[i] = 1
            count += 1
    return count
