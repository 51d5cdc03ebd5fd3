"""A camera's part of the P-PBS: which pixels belong to it, and what its triangles inherit (section 3.3.3)."""

from __future__ import annotations

import math

import numba

from ...support.array_types import B1, F32, F64, I32, I64, U8, U16, U64
from ..base.jit import inlined, parallel, serial
from ..base.tolerance import Delta, delta_at
from .maximum_depth import KEPT, UPDATED
from .rays import farthest_hit

__all__ = ["accept_candidates", "clear_culled", "inherit_marks", "paint_triangles"]


# A candidate needs this many of its eight neighbours to be in the P-PBS, or accepted, as well: what someone uncovers
# is a region, a wrong depth mostly a lone pixel. A corner of two by two pixels has three.
_NEIGHBOURS = 3
# More bits of a pixel's flags, while candidates are looked at: spared by one ray for four pixels; those that will be
# kept, some only if they have enough neighbours.
_SPARED, _ACCEPTED, _CONFIRMED = 16, 32, 64
_FLAT = 0.25  # of delta: four pixels whose depths differ by less share a ray


@inlined
def _around(flags: U8, y: int, x: int, bits: int) -> int:
    """How many of the three by three pixels round one have one of the bits."""
    count = 0
    for row in range(max(y - 1, 0), min(y + 2, flags.shape[0])):
        for column in range(max(x - 1, 0), min(x + 2, flags.shape[1])):
            count += flags[row, column] & bits != 0
    return count


@inlined
def _judge(
    function: int, scene: int, camera: F64, bounds: F64, u: float, v: float, depth: float, delta: Delta
) -> int:
    """What becomes of a surface seen at (u, v): _CONFIRMED where the PBS has a hole, be it a pixel's; _ACCEPTED, or 0
    where it is not more than delta behind the farthest hit."""
    distance, _u, _v, _geometry, _primitive, length = farthest_hit(function, scene, camera, bounds, u, v)
    if distance < 0.0:
        return _CONFIRMED
    return _ACCEPTED if depth * length > distance + delta_at(delta, distance) else 0


@inlined
def _share_ray(
    function: int, scene: int, camera: F64, bounds: F64, coding: F64, codes: U16, flags: U8, y: int, x: int,
    delta: Delta,
) -> bool:  # fmt: skip
    """Whether 2x2 pixels from (x, y) on are all candidates on one surface that is not farther than the PBS."""
    near = far = codes[y, x]
    for row in range(y, y + 2):
        for column in range(x, x + 2):
            if flags[row, column] & (UPDATED | KEPT) != UPDATED:
                return False
            near, far = max(near, codes[row, column]), min(far, codes[row, column])
    depth = 1.0 / (coding[0] + coding[1] * max(float(far), coding[3]))
    if depth - 1.0 / (coding[0] + coding[1] * max(float(near), coding[3])) > _FLAT * delta_at(delta, depth):
        return False
    return _judge(function, scene, camera, bounds, x + 1.0, y + 1.0, depth, delta) == 0


@parallel
def accept_candidates(
    function: int, scene: int, camera: F64, bounds: F64, coding: F64, codes: U16, flags: U8, delta: Delta, blocks: I64,
    height: int, width: int, counts: I64,
) -> None:  # fmt: skip
    """The filter of Fig. 6b: an updated pixel is kept if its point is more than delta behind the farthest hit.

    Looks at blocks [n, 2] of height x width pixels (even) only, which must hold all updated ones. Four pixels on one
    surface are first asked by one ray; only if it finds them new, or pixels beside them are, each gets its own. In
    flags [h, w] (see `maximum_depth`) none is UPDATED afterwards but lone pixels: these are candidates again next time.
    counts [n, 5]: candidates, accepted ones, pixels that were kept before and have changed, lone ones, rays. coding as
    in `coverage.keep_farther`.
    """
    h, w = codes.shape
    for k in numba.prange(blocks.shape[0]):
        counts[k] = 0
        top, left = blocks[k, 0] * height, blocks[k, 1] * width
        for y in range(top, min(top + height, h - 1), 2):
            for x in range(left, min(left + width, w - 1), 2):
                if flags[y, x] & UPDATED != 0 and _share_ray(
                    function, scene, camera, bounds, coding, codes, flags, y, x, delta
                ):
                    for row in (y, y + 1):
                        flags[row, x] |= _SPARED
                        flags[row, x + 1] |= _SPARED
                    counts[k, 4] += 1
        for y in range(top, min(top + height, h)):
            for x in range(left, min(left + width, w)):
                if flags[y, x] & UPDATED == 0:
                    continue
                counts[k, 0] += 1
                if flags[y, x] & KEPT != 0:
                    flags[y, x] ^= UPDATED
                    counts[k, 2] += 1
                elif flags[y, x] & _SPARED == 0:
                    flags[y, x] ^= UPDATED | _judge_pixel(function, scene, camera, bounds, coding, codes, y, x, delta)
                    counts[k, 4] += 1
    for k in numba.prange(blocks.shape[0]):
        top, left = blocks[k, 0] * height, blocks[k, 1] * width
        for y in range(top, min(top + height, h)):
            for x in range(left, min(left + width, w)):
                if flags[y, x] & _SPARED != 0 and _around(flags, y, x, _ACCEPTED | _CONFIRMED) == 0:
                    flags[y, x] ^= UPDATED | _SPARED
    for k in numba.prange(blocks.shape[0]):
        top, left = blocks[k, 0] * height, blocks[k, 1] * width
        for y in range(top, min(top + height, h)):
            for x in range(left, min(left + width, w)):
                if flags[y, x] & _SPARED != 0:
                    flags[y, x] ^= UPDATED | _SPARED
                    flags[y, x] |= _judge_pixel(function, scene, camera, bounds, coding, codes, y, x, delta)
                    counts[k, 4] += 1
    for k in numba.prange(blocks.shape[0]):
        top, left = blocks[k, 0] * height, blocks[k, 1] * width
        for y in range(top, min(top + height, h)):
            for x in range(left, min(left + width, w)):
                if flags[y, x] & _ACCEPTED != 0 and _around(flags, y, x, KEPT | _ACCEPTED | _CONFIRMED) > _NEIGHBOURS:
                    flags[y, x] ^= _ACCEPTED | _CONFIRMED
    for k in numba.prange(blocks.shape[0]):
        top, left = blocks[k, 0] * height, blocks[k, 1] * width
        for y in range(top, min(top + height, h)):
            for x in range(left, min(left + width, w)):
                if flags[y, x] & _CONFIRMED != 0:
                    flags[y, x] ^= _CONFIRMED | KEPT
                    counts[k, 1] += 1
                elif flags[y, x] & _ACCEPTED != 0:
                    flags[y, x] ^= _ACCEPTED | UPDATED
                    counts[k, 3] += 1


@inlined
def _judge_pixel(
    function: int, scene: int, camera: F64, bounds: F64, coding: F64, codes: U16, y: int, x: int, delta: Delta
) -> int:
    """`_judge` of a pixel: off the outermost ones' centres, where the mesh ends; rays there may just miss it."""
    h, w = codes.shape
    u, v = min(max(x + 0.5, 0.51), w - 0.51), min(max(y + 0.5, 0.51), h - 0.51)
    depth = 1.0 / (coding[0] + coding[1] * max(float(codes[y, x]), coding[3]))
    return _judge(function, scene, camera, bounds, u, v, depth, delta)


@inlined
def _extent(a: float, b: float, c: float) -> tuple[int, int]:
    """The pixels, from the first to before the last, whose centres lie between the least and the greatest of three."""
    return math.ceil(min(a, b, c) - 0.5), math.floor(max(a, b, c) - 0.5) + 1


@inlined
def _covers(uv: F32, a: int, b: int, c: int, x: int, y: int) -> bool:
    """Whether a triangle covers or touches a pixel's centre."""
    px, py = x + 0.5, y + 0.5
    ax, ay, bx, by = uv[a, 0] - px, uv[a, 1] - py, uv[b, 0] - px, uv[b, 1] - py
    cx, cy = uv[c, 0] - px, uv[c, 1] - py
    ab, bc, ca = ax * by - ay * bx, bx * cy - by * cx, cx * ay - cy * ax
    return (ab >= 0.0 and bc >= 0.0 and ca >= 0.0) or (ab <= 0.0 and bc <= 0.0 and ca <= 0.0)


@serial
def paint_triangles(uv: F32, triangles: I32, invalid: U8, wraps: bool, erase: bool, numbers: I32) -> None:
    """Writes each valid triangle's number, or -1 to erase them, to all pixels whose centre it covers or touches.

    Of several the last one's, and so by one thread: with more, it would be now this one's, now that one's.
    """
    h, w = numbers.shape
    for i in range(triangles.shape[0]):
        if invalid[i] != 0:
            continue
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        x0, x1 = _extent(uv[a, 0], uv[b, 0], uv[c, 0])
        y0, y1 = _extent(uv[a, 1], uv[b, 1], uv[c, 1])
        for y in range(max(y0, 0), min(y1, h)):
            for x in range(x0, x1):
                if (wraps or (x >= 0 and x < w)) and _covers(uv, a, b, c, x, y):
                    numbers[y, x % w] = -1 if erase else i


@parallel
def clear_culled(uv: F32, triangles: I32, invalid: U8, wraps: bool, numbers: I32, flags: U8) -> None:
    """A pixel of an invalid triangle that no valid one touches (numbers: see `paint_triangles`) is kept no longer.

    flags [h, w]: see `maximum_depth`.
    """
    h, w = numbers.shape
    for i in numba.prange(triangles.shape[0]):
        if invalid[i] == 0:
            continue
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        x0, x1 = _extent(uv[a, 0], uv[b, 0], uv[c, 0])
        y0, y1 = _extent(uv[a, 1], uv[b, 1], uv[c, 1])
        for y in range(max(y0, 0), min(y1, h)):
            for x in range(x0, x1):
                if (wraps or (x >= 0 and x < w)) and numbers[y, x % w] < 0 and _covers(uv, a, b, c, x, y):
                    flags[y, x % w] &= ~KEPT


@inlined
def _meets(blocks: B1, x0: int, x1: int, y0: int, y1: int) -> bool:
    """Whether one of the blocks from (x0, y0) to (x1, y1) is set; their columns begin again on the left."""
    for y in range(max(y0, 0), min(y1, blocks.shape[0] - 1) + 1):
        for x in range(x0, x1 + 1):
            if blocks[y, x % blocks.shape[1]]:
                return True
    return False


@parallel
def inherit_marks(
    uv: F32, triangles: I32, numbers: I32, old: U64, new: U64, changed: B1, height: int, width: int, news: B1
) -> None:
    """A new triangle gets the marks of the old one at its centroid, or none.

    It is news [m] where there was none, or where it meets one of the changed blocks of height x width pixels.
    """
    h, w = numbers.shape
    for i in numba.prange(triangles.shape[0]):
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        x = int((uv[a, 0] + uv[b, 0] + uv[c, 0]) / 3.0) % w
        y = min(int((uv[a, 1] + uv[b, 1] + uv[c, 1]) / 3.0), h - 1)
        before = numbers[y, x]
        for word in range(new.shape[1]):
            new[i, word] = old[before, word] if before >= 0 else numba.uint64(0)
        x0, x1 = min(uv[a, 0], uv[b, 0], uv[c, 0]) / width, max(uv[a, 0], uv[b, 0], uv[c, 0]) / width
        y0, y1 = min(uv[a, 1], uv[b, 1], uv[c, 1]) / height, max(uv[a, 1], uv[b, 1], uv[c, 1]) / height
        news[i] = before < 0 or _meets(changed, math.floor(x0), math.floor(x1), math.floor(y0), math.floor(y1))
