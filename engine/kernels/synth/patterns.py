"""Procedural textures, band-limited: a pattern fades to its mean where a pixel covers more than its detail.

A material is a row of MATERIAL_SIZE numbers: [0] pattern, [1:4] and [4:7] two linear RGB colours, [7] scale
in metres, [8] seed, [9] roughness (contrast of the noise that every pattern carries).
"""

from __future__ import annotations

import math

from ...support.array_types import F64
from ..base.jit import serial

__all__ = [
    "BRICKS",
    "CHECKER",
    "MARBLE",
    "MATERIAL_SIZE",
    "NOISE",
    "PICTURE",
    "PLANKS",
    "STRIPES",
    "TILES",
    "fractal_noise",
    "hash_unit",
    "pattern_colour",
    "value_noise",
]

MATERIAL_SIZE = 10
NOISE, CHECKER, BRICKS, PLANKS, TILES, STRIPES, MARBLE, PICTURE = range(8)

Colour = tuple[float, float, float]


@serial
def _scramble(n: int) -> float:
    n &= 0xFFFFFFFF
    n ^= n >> 16
    n = (n * 0x7FEB352D) & 0xFFFFFFFF
    n ^= n >> 15
    n = (n * 0x846CA68B) & 0xFFFFFFFF
    n ^= n >> 16
    return n / 4294967296.0


@serial
def hash_unit(x: int, y: int, z: int, seed: int) -> float:
    """Lattice point and seed -> a number in [0, 1), the same on every machine."""
    return _scramble((x * 73856093) ^ (y * 19349663) ^ (z * 83492791) ^ (seed * 2654435761))


@serial
def value_noise(x: float, y: float, z: float, seed: int) -> float:
    """Smooth noise in [-1, 1] with one random value (`hash_unit`) per lattice point."""
    i, j, k = math.floor(x), math.floor(y), math.floor(z)
    fx, fy, fz = x - i, y - j, z - k
    fx, fy, fz = fx * fx * (3 - 2 * fx), fy * fy * (3 - 2 * fy), fz * fz * (3 - 2 * fz)
    x0, x1 = i * 73856093, (i + 1) * 73856093
    y0, y1 = j * 19349663, (j + 1) * 19349663
    z0, z1 = (k * 83492791) ^ (seed * 2654435761), ((k + 1) * 83492791) ^ (seed * 2654435761)
    a, b, c, d = (
        _scramble(x0 ^ y0 ^ z0),
        _scramble(x1 ^ y0 ^ z0),
        _scramble(x0 ^ y1 ^ z0),
        _scramble(x1 ^ y1 ^ z0),
    )
    e, f, g, h = (
        _scramble(x0 ^ y0 ^ z1),
        _scramble(x1 ^ y0 ^ z1),
        _scramble(x0 ^ y1 ^ z1),
        _scramble(x1 ^ y1 ^ z1),
    )
    a, c, e, g = a + fx * (b - a), c + fx * (d - c), e + fx * (f - e), g + fx * (h - g)
    a, e = a + fy * (c - a), e + fy * (g - e)
    return 2.0 * (a + fz * (e - a)) - 1.0


@serial
def fractal_noise(x: float, y: float, z: float, size: float, seed: int, footprint: float) -> float:
    """Seven octaves, from cells of `size` metres down; an octave fades out as its cells approach the footprint."""
    total, amplitude, cell = 0.0, 0.5, size
    for octave in range(7):
        fade = cell / footprint - 1.0
        if fade <= 0.0:
            break
        total += min(fade, 1.0) * amplitude * value_noise(x / cell, y / cell, z / cell, seed + octave)
        amplitude *= 0.62
        cell *= 0.5
    return total


@serial
def _covered(x: float, period: float, width: float, footprint: float) -> float:
    """Share of [x - footprint / 2, x + footprint / 2] inside stripes of `width` every `period`."""
    low, high = x - 0.5 * footprint, x + 0.5 * footprint
    low_turns, high_turns = math.floor(low / period), math.floor(high / period)
    inside = (high_turns - low_turns) * width
    inside += min(high - high_turns * period, width) - min(low - low_turns * period, width)
    return inside / footprint


@serial
def _cell_fade(cell: float, footprint: float) -> float:
    return min(max(0.5 * cell / footprint - 0.5, 0.0), 1.0)


@serial
def _laid(
    u: float, v: float, length: float, height: float, gap: float, seed: int, footprint: float
) -> Colour:
    """Courses of bricks, planks or tiles: (share of gap, tint of this piece in [-1, 1], its number)."""
    row = math.floor(v / height)
    shifted = u + length * hash_unit(row, 7, 0, seed) if length != height else u
    column = math.floor(shifted / length)
    # Gaps are centred on the borders, so that they hide the step of the tint.
    across = _covered(shifted + 0.5 * gap, length, gap, footprint)
    along = _covered(v + 0.5 * gap, height, gap, footprint)
    share = 1.0 - (1.0 - across) * (1.0 - along)
    tint = (2.0 * hash_unit(column, row, 3, seed) - 1.0) * _cell_fade(height, footprint)
    return share, tint, float(column + 57 * row)


@serial
def _checker(u: float, v: float, cell: float, footprint: float) -> float:
    f = footprint / cell
    total = 1.0
    for x in (u / cell, v / cell):
        low, high = 0.5 * (x - 0.5 * f), 0.5 * (x + 0.5 * f)
        low, high = low - math.floor(low), high - math.floor(high)
        total *= 2.0 * (abs(low - 0.5) - abs(high - 0.5)) / f
    return 0.5 - 0.5 * total


@serial
def _text(s: float, t: float, seed: int, footprint: float) -> float:
    """The share of ink in eight lines of made-up letters, of 3 x 5 dots each, over the unit square."""
    line, column = math.floor(t * 8.0), math.floor(s * 24.0)
    x, y = (s * 24.0 - column) * 4.0, (t * 8.0 - line) * 7.0
    if x >= 3.0 or y >= 5.0 or hash_unit(column, line, 11, seed) < 0.16:
        return 0.0
    ink = 1.0 if hash_unit(4 * column + int(x), 7 * line + int(y), 12, seed) < 0.58 else 0.0
    return 0.58 + (ink - 0.58) * _cell_fade(1.0 / 48.0, footprint)


@serial
def _picture(u: float, v: float, half_u: float, half_v: float, seed: int, footprint: float) -> Colour:
    """A painting over a face of the given half sizes: a graded ground, a dozen forms, some with a caption."""
    s, t = 0.5 + 0.5 * u / half_u, 0.5 - 0.5 * v / half_v
    grade = t + 0.3 * fractal_noise(u, v, 0.0, 0.5 * half_v, seed, footprint)
    r = 0.15 + 0.7 * (hash_unit(1, 0, 0, seed) * (1 - grade) + hash_unit(2, 0, 0, seed) * grade)
    g = 0.15 + 0.7 * (hash_unit(3, 0, 0, seed) * (1 - grade) + hash_unit(4, 0, 0, seed) * grade)
    b = 0.15 + 0.7 * (hash_unit(5, 0, 0, seed) * (1 - grade) + hash_unit(6, 0, 0, seed) * grade)
    for form in range(12):
        x = u - half_u * (1.8 * hash_unit(form, 1, 1, seed) - 0.9)
        y = v - half_v * (1.8 * hash_unit(form, 2, 1, seed) - 0.9)
        turn = 6.283 * hash_unit(form, 3, 1, seed)
        x, y = x * math.cos(turn) + y * math.sin(turn), y * math.cos(turn) - x * math.sin(turn)
        radius = min(half_u, half_v) * (0.08 + 0.4 * hash_unit(form, 4, 1, seed))
        if form % 2:
            distance = math.sqrt(x * x + y * y) - radius
        else:
            distance = max(abs(x) - radius, abs(y) - radius * (0.15 + 0.8 * hash_unit(form, 5, 1, seed)))
        cover = min(max(0.5 - distance / footprint, 0.0), 1.0)
        r += cover * (hash_unit(form, 6, 1, seed) - r)
        g += cover * (hash_unit(form, 7, 1, seed) - g)
        b += cover * (hash_unit(form, 8, 1, seed) - b)
    if hash_unit(9, 9, 9, seed) < 0.6 and 0.68 < t < 0.95 and 0.08 < s < 0.92:
        ink = _text((s - 0.08) / 0.84, (t - 0.68) / 0.27, seed, 0.5 * footprint / half_u)
        r, g, b = r + ink * (0.03 - r), g + ink * (0.03 - g), b + ink * (0.05 - b)
    return r, g, b


@serial
def pattern_colour(
    materials: F64,
    m: int,
    x: float,
    y: float,
    z: float,
    u: float,
    v: float,
    half_u: float,
    half_v: float,
    footprint: float,
) -> Colour:
    """Colour of material m, linear RGB, at point (x, y, z) of the body, (u, v) of its surface, metres."""
    kind, scale, seed = int(materials[m, 0]), materials[m, 7], int(materials[m, 8])
    rough = materials[m, 9]
    mix, gain = 0.0, 1.0
    if kind == PICTURE:
        r, g, b = _picture(u, v, half_u, half_v, seed, footprint)
        grain = 1.0 + rough * fractal_noise(x, y, z, 0.03, seed, footprint)
        return r * grain, g * grain, b * grain
    if kind == CHECKER:
        mix = _checker(u, v, scale, footprint)
    elif kind == BRICKS:
        mix, tint, _ = _laid(u, v, 2.6 * scale, scale, 0.14 * scale, seed, footprint)
        gain = 1.0 + 0.28 * tint
    elif kind == PLANKS:
        mix, tint, piece = _laid(u, v, 11.0 * scale, scale, 0.05 * scale, seed, footprint)
        grain = fractal_noise(0.12 * u, v, 3.7 * piece, 0.3 * scale, seed, footprint)
        gain = 1.0 + 0.25 * tint + 0.35 * grain
    elif kind == TILES:
        mix, tint, _ = _laid(u, v, scale, scale, 0.05 * scale, seed, footprint)
        gain = 1.0 + 0.15 * tint
    elif kind == STRIPES:
        mix = _covered(v, scale, 0.5 * scale, footprint)
    elif kind == MARBLE:
        bent = (x + 0.6 * y + 0.8 * z) / scale + 2.5 * fractal_noise(x, y, z, scale, seed, footprint)
        vein = 1.0 - abs(math.sin(math.pi * bent))
        mix = vein * vein * vein * _cell_fade(scale, 2.0 * footprint)
    else:
        mix = 0.5 + 0.8 * fractal_noise(x, y, z, scale, seed + 31, footprint)
    mix = min(max(mix, 0.0), 1.0)
    gain *= 1.0 + rough * fractal_noise(x, y, z, 0.5 * scale, seed, footprint)
    return (
        gain * (materials[m, 1] + mix * (materials[m, 4] - materials[m, 1])),
        gain * (materials[m, 2] + mix * (materials[m, 5] - materials[m, 2])),
        gain * (materials[m, 3] + mix * (materials[m, 6] - materials[m, 3])),
    )
