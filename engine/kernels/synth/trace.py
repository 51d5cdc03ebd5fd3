"""Pictures of scenes of solids (`kernels.synth.solids`), ray-traced."""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F64, U16
from ...support.packed import FX, FY, KIND, PERSPECTIVE, RADIANS_A_COLUMN, RADIANS_A_ROW, Coding
from ..base.jit import parallel, serial
from ..base.project import position, unproject_point
from .patterns import pattern_colour
from .solids import (
    IndexArray,
    Solids,
    Vector,
    candidates,
    hit_normal,
    material_of,
    meets,
    nearest,
)

__all__ = ["LAMP_SIZE", "SceneArrays", "TracedPicture", "trace_picture"]

# Of a lamp: position and reach in metres; RED, GREEN and BLUE: the shares of its strength.
LAMP_X, LAMP_Y, LAMP_Z, STRENGTH, REACH, RED, GREEN, BLUE = range(8)
LAMP_SIZE = 8
AMBIENT = 0.38
TILE = 16  # pixels; the parts that a tile may see are searched once for all its rays


class SceneArrays(NamedTuple):
    """A scene as the ray tracer reads it."""

    parts: F64  # [n, PART_SIZE], as `solids` has them, and groups
    groups: F64  # [m, GROUP_SIZE]
    materials: F64  # [k, MATERIAL_SIZE], see `patterns`
    lamps: F64  # [l, LAMP_SIZE]


class TracedPicture(NamedTuple):
    """A 4:2:0 picture and its depth codes."""

    luma: U16  # [h, w]
    cb: U16  # [(h + 1) // 2, (w + 1) // 2]
    cr: U16
    codes: U16  # [h, w]


@serial
def _light(lamps: F64, p: Vector, n: Vector) -> Vector:
    """Diffuse light (red, green, blue) without shadows, so that static things keep their colours when somebody walks
    past."""
    red = green = blue = AMBIENT * (0.85 + 0.15 * n[2])
    for k in range(lamps.shape[0]):
        x, y, z = lamps[k, LAMP_X] - p[0], lamps[k, LAMP_Y] - p[1], lamps[k, LAMP_Z] - p[2]
        squared = x * x + y * y + z * z
        soft = 0.5 + 0.5 * (x * n[0] + y * n[1] + z * n[2]) / math.sqrt(squared)
        light = lamps[k, STRENGTH] * soft * soft / (1.0 + squared / (lamps[k, REACH] * lamps[k, REACH]))
        red, green, blue = red + lamps[k, RED] * light, green + lamps[k, GREEN] * light, blue + lamps[k, BLUE] * light
    return red, green, blue


@serial
def _shade(scene: SceneArrays, i: int, o: Vector, d: Vector, t: float, pixel_rad: float) -> Vector:
    """Linear colour of part i where a ray meets it; black where i is below 0."""
    if i < 0:
        return 0.0, 0.0, 0.0
    world = (o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2])
    n, p, (u, v, half_u, half_v) = hit_normal(scene.parts, i, world)
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    cosine = abs(n[0] * d[0] + n[1] * d[1] + n[2] * d[2]) / length
    footprint = max(pixel_rad * t * length / max(cosine, 0.1), 1e-6)
    r, g, b = pattern_colour(
        scene.materials, material_of(scene.parts, i), p[0], p[1], p[2], u, v, half_u, half_v, footprint
    )
    red, green, blue = _light(scene.lamps, world, n)
    return r * red, g * green, b * blue


@serial
def _ray(camera: F64, u: float, v: float) -> Vector:
    """Direction through a pixel coordinate, with the length of one unit of the camera's depth."""
    x, y, z = unproject_point(camera, u, v, 1.0)
    cx, cy, cz = position(camera)
    return x - cx, y - cy, z - cz


@serial
def _pixel_rad(camera: F64) -> float:
    if camera[KIND] == PERSPECTIVE:
        return float(1.0 / min(abs(camera[FX]), abs(camera[FY])))
    return float(max(camera[RADIANS_A_COLUMN], camera[RADIANS_A_ROW]))


@serial
def _block_meets(
    camera: F64, parts: F64, among: IndexArray, row: int, column: int, samples: int, spread: float
) -> bool:
    """Whether any ray of a block of 2 x 2 pixels meets the parts `among`, hidden or not."""
    o = position(camera)
    d = _ray(camera, column + 1.0, row + 1.0)
    near = False
    for k in range(among.shape[0]):
        near = near or meets(parts, among[k], o, d, spread, math.inf)
    if not near:
        return False
    for y in range(row, row + 2):
        for x in range(column, column + 2):
            d = _ray(camera, x + 0.5, y + 0.5)
            if nearest(parts, among, o, d)[1] >= 0:
                return True
            for s in range(samples * samples):
                d = _ray(camera, x + (s % samples + 0.5) / samples, y + (s // samples + 0.5) / samples)
                if nearest(parts, among, o, d)[1] >= 0:
                    return True
    return False


@serial
def _pixel_colour(
    camera: F64, scene: SceneArrays, among: IndexArray, x: int, y: int, samples: int, pixel_rad: float
) -> Vector:
    """Mean linear colour of samples x samples rays, gamma 2, as Y' in [0, 1], Cb, Cr in [-.5, .5]."""
    o, parts = position(camera), scene.parts
    r = g = b = 0.0
    for s in range(samples * samples):
        d = _ray(camera, x + (s % samples + 0.5) / samples, y + (s // samples + 0.5) / samples)
        t, part = nearest(parts, among, o, d)
        colour = _shade(scene, part, o, d, t, pixel_rad)
        r, g, b = r + colour[0], g + colour[1], b + colour[2]
    weight = 1.0 / (samples * samples)
    r = math.sqrt(min(max(r * weight, 0.0), 1.0))
    g = math.sqrt(min(max(g * weight, 0.0), 1.0))
    b = math.sqrt(min(max(b * weight, 0.0), 1.0))
    luma = 0.2126 * r + 0.7152 * g + 0.0722 * b
    return luma, (b - luma) / 1.8556, (r - luma) / 1.5748


@serial
def _trace_block(
    camera: F64, coding: Coding, scene: SceneArrays, among: IndexArray, samples: int, row: int, column: int,
    picture: TracedPicture,
) -> None:  # fmt: skip
    """Write a block of 2 x 2 pixels, as far as they lie in the picture."""
    luma, cb, cr, codes = picture
    height, width = luma.shape
    o, pixel_rad, parts = position(camera), _pixel_rad(camera), scene.parts
    blue = red = 0.0
    for k in range(4):
        y, x = min(row + k // 2, height - 1), min(column + k % 2, width - 1)
        bright, b, r = _pixel_colour(camera, scene, among, x, y, samples, pixel_rad)
        luma[y, x] = np.uint16(np.rint(64.0 + 876.0 * bright))
        blue, red = blue + b, red + r
        depth, _ = nearest(parts, among, o, _ray(camera, x + 0.5, y + 0.5))
        code = np.rint((1.0 / depth - coding.offset) / coding.step)
        codes[y, x] = np.uint16(min(max(code, coding.min_code), coding.max_code))
    cb[row // 2, column // 2] = np.uint16(np.rint(512.0 + 224.0 * blue))
    cr[row // 2, column // 2] = np.uint16(np.rint(512.0 + 224.0 * red))


@parallel
def trace_picture(
    camera: F64, coding: Coding, scene: SceneArrays, first: int, samples: int, picture: TracedPicture
) -> None:
    """Write a picture (10-bit limited-range BT.709, 4:2:0) and its depth codes in place.

    Blocks of 2 x 2 pixels without a ray that meets a group from `first` on keep their content: if the arrays hold the
    picture of the groups before `first`, the result is that of tracing everything. first = 0 traces every block. Colour
    takes samples x samples rays per pixel, depth the ray through its centre.
    """
    height, width = picture.luma.shape
    o, pixel_rad, solids = position(camera), _pixel_rad(camera), Solids(scene.parts, scene.groups)
    across = (width + TILE - 1) // TILE
    for tile in numba.prange(across * ((height + TILE - 1) // TILE)):
        top, left = TILE * (tile // across), TILE * (tile % across)
        d = _ray(camera, left + 0.5 * TILE, top + 0.5 * TILE)
        movers = candidates(solids, first, o, d, TILE * pixel_rad)
        if first > 0 and movers.shape[0] == 0:
            continue
        among = candidates(solids, 0, o, d, TILE * pixel_rad)
        for row in range(top, min(top + TILE, height), 2):
            for column in range(left, min(left + TILE, width), 2):
                if first == 0 or _block_meets(camera, scene.parts, movers, row, column, samples, 2.0 * pixel_rad):
                    _trace_block(camera, coding, scene, among, samples, row, column, picture)
