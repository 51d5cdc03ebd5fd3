"""What queries of the model read and write: its surfaces, when cameras last saw them, and the answers."""

from __future__ import annotations

import math
from typing import NamedTuple

from ...support.array_types import F32, F64, I32, I64, U16
from ...support.packed import Coding
from ..base.jit import serial
from ..base.memory import load_u32
from ..base.tolerance import Delta, delta_at
from .surfaces import CAPTURE
from .triangles import corners_of, place_in_picture, point_of

__all__ = ["COLUMNS", "ROWS", "SEEN_SIZE", "STAMPS", "STEP", "Found", "Queried", "note_seen", "write_found"]

# A table of sightings is int64 [captures, SEEN_SIZE]: the address of a capture's stamps, int32 [rows, columns] (0: it
# has none), and how many rows and columns there are. A stamp is for STEP x STEP pixels of the capture's picture: the
# number of the last frame in which its camera has seen the surface in their middle, counted from 1; 0: not yet.
STAMPS, ROWS, COLUMNS = range(3)
SEEN_SIZE = 3
STEP = 16


class Queried(NamedTuple):
    """A model as queries see it.

    surfaces: see `surfaces`; invalid int64 [geometries]: addresses of a flag uint8 for each triangle, not 0 where it is
    culled; seen: a table of sightings, by number of capture; origin [3]: the scene's, metres in the world; frame: the
    number of the newest frame, counted from 1.
    """

    surfaces: I64
    invalid: I64
    seen: I64
    origin: F64
    frame: int


class Found(NamedTuple):
    """Answers: distances [n], metres (infinity: nothing was found); points [n, 3], metres in the world, and unit
    normals [n, 3] (NaN where nothing was found); ages [n] in frames (-1: not known, or nothing was found)."""

    distances: F32
    points: F64
    normals: F32
    ages: I32


@serial
def write_found(
    queried: Queried, geometry: int, primitive: int, weights: tuple[float, float],
    back: tuple[float, float, float], k: int, found: Found,
) -> None:  # fmt: skip
    """Writes normal and age of answer k: the triangle's normal on the side of the direction `back`, and the age at the
    place with these weights of the triangle's second and third corner."""
    surface = queried.surfaces[geometry]
    a, b, c = corners_of(surface, primitive)
    ax, ay, az = point_of(surface, a)
    bx, by, bz = point_of(surface, b)
    cx, cy, cz = point_of(surface, c)
    ex, ey, ez, fx, fy, fz = bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az
    nx, ny, nz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    if nx * back[0] + ny * back[1] + nz * back[2] < 0.0:
        length = -length
    found.normals[k, 0], found.normals[k, 1], found.normals[k, 2] = nx / length, ny / length, nz / length
    capture, found.ages[k] = surface[CAPTURE], -1
    if capture < queried.seen.shape[0] and queried.seen[capture, STAMPS] != 0:
        u, v = place_in_picture(surface, primitive, weights[0], weights[1])
        row = min(max(int(v) // STEP, 0), queried.seen[capture, ROWS] - 1)
        column = min(max(int(u) // STEP, 0), queried.seen[capture, COLUMNS] - 1)
        stamp = load_u32(queried.seen[capture, STAMPS], row * queried.seen[capture, COLUMNS] + column)
        if stamp > 0:
            found.ages[k] = max(queried.frame - stamp, 0)  # the next frame may be on its way


@serial
def note_seen(codes: U16, farthest: U16, coding: Coding, delta: Delta, frame: int, stamps: I32) -> None:
    """Stamps [rows, columns] become `frame` where a view's codes [h, w] show, in the middle of STEP x STEP pixels, the
    surface of the maximum depth image (`farthest` [h, w]), or something less than delta nearer, and nothing else."""
    h, w = codes.shape
    for row in range(stamps.shape[0]):
        for column in range(stamps.shape[1]):
            y, x = min(row * STEP + STEP // 2, h - 1), min(column * STEP + STEP // 2, w - 1)
            if codes[y, x] < coding.least or farthest[y, x] < coding.least:
                continue
            disparity = coding.offset + coding.step * max(farthest[y, x], coding.min_code)
            if not disparity > 0.0:  # infinitely far
                if codes[y, x] <= farthest[y, x]:
                    stamps[row, column] = frame
                continue
            depth = 1.0 / disparity
            nearest = depth - delta_at(delta, depth)
            if not nearest > 0.0 or coding.offset + coding.step * max(codes[y, x], coding.min_code) <= 1.0 / nearest:
                stamps[row, column] = frame
