"""The triangle filter (section 3.3.3, Fig. 6b): which updated pixels become part of the P-PBS.

The paper casts a ray through the middle of each new triangle. Here triangles are made only of pixels that have passed,
so the rays go through pixels.
"""

from __future__ import annotations

import numba

from ...support.array_types import F64, I64, U8, U16
from ...support.packed import Coding
from ..base.jit import inlined, parallel, serial
from ..base.tolerance import Delta, delta_at
from .flags import KEPT, UPDATED
from .rays import Tracer, farthest_hit

__all__ = ["ACCEPTED", "CANDIDATES", "CHANGED", "COUNTS_SIZE", "LONE", "RAYS", "filter_pixels"]


# More bits of a pixel's flags while candidates are tested. _SPARED: one ray for four pixels found it not farther;
# _ACCEPTED: it will be kept if it has enough neighbours; _CONFIRMED: it will be kept.
_SPARED, _ACCEPTED, _CONFIRMED = 16, 32, 64
_FLAT = 0.25  # share of delta: four pixels with depths that differ by less share a ray
# Columns of the counts of a block: candidates, accepted candidates, pixels that were kept before and have changed, lone
# candidates, rays.
CANDIDATES, ACCEPTED, CHANGED, LONE, RAYS = range(5)
COUNTS_SIZE = 5

_Box = tuple[int, int, int, int]  # first row and the one after the last, columns likewise


@inlined
def _count_around(flags: U8, y: int, x: int, bits: int) -> int:
    """The number of pixels with one of the bits, among the 3 x 3 pixels round (x, y)."""
    count = 0
    for row in range(max(y - 1, 0), min(y + 2, flags.shape[0])):
        for column in range(max(x - 1, 0), min(x + 2, flags.shape[1])):
            count += flags[row, column] & bits != 0
    return count


@inlined
def _depth(code: int, coding: Coding) -> float:
    return 1.0 / (coding.offset + coding.step * max(float(code), float(coding.min_code)))


@inlined
def _judge(tracer: Tracer, camera: F64, u: float, v: float, depth: float, delta: Delta) -> int:
    """The verdict on a surface seen at (u, v): _CONFIRMED if the PBS has a hole there, even of one pixel; _ACCEPTED if
    it is more than delta behind the farthest hit; else 0."""
    distance, _u, _v, _geometry, _primitive, length = farthest_hit(tracer, camera, u, v)
    if distance < 0.0:
        return _CONFIRMED
    return _ACCEPTED if depth * length > distance + delta_at(delta, distance) else 0


@inlined
def _judge_pixel(tracer: Tracer, camera: F64, coding: Coding, codes: U16, y: int, x: int, delta: Delta) -> int:
    """`_judge` for a pixel. Rays of the outermost pixels are moved inwards: meshes end at the centres of those pixels,
    and a ray there could just miss."""
    h, w = codes.shape
    u, v = min(max(x + 0.5, 0.51), w - 0.51), min(max(y + 0.5, 0.51), h - 0.51)
    return _judge(tracer, camera, u, v, _depth(codes[y, x], coding), delta)


@inlined
def _share_ray(
    tracer: Tracer, camera: F64, coding: Coding, codes: U16, flags: U8, y: int, x: int, delta: Delta
) -> bool:
    """Whether the 2x2 pixels from (x, y) on are all candidates, on one surface, which is not farther than the PBS."""
    near = far = codes[y, x]
    for row in range(y, y + 2):
        for column in range(x, x + 2):
            if flags[row, column] & (UPDATED | KEPT) != UPDATED:
                return False
            near, far = max(near, codes[row, column]), min(far, codes[row, column])
    depth = _depth(far, coding)
    if depth - _depth(near, coding) > _FLAT * delta_at(delta, depth):
        return False
    return _judge(tracer, camera, x + 1.0, y + 1.0, depth, delta) == 0


@serial
def _ask_by_four(
    tracer: Tracer, camera: F64, coding: Coding, codes: U16, flags: U8, delta: Delta, box: _Box
) -> int:
    """Spares four candidates of one surface if one ray finds it not farther; returns the number of these rays."""
    top, bottom, left, right = box
    h, w = codes.shape
    rays = 0
    for y in range(top, min(bottom, h - 1), 2):
        for x in range(left, min(right, w - 1), 2):
            if flags[y, x] & UPDATED != 0 and _share_ray(tracer, camera, coding, codes, flags, y, x, delta):
                for row in (y, y + 1):
                    flags[row, x] |= _SPARED
                    flags[row, x + 1] |= _SPARED
                rays += 1
    return rays


@serial
def _ask_one_by_one(
    tracer: Tracer, camera: F64, coding: Coding, codes: U16, flags: U8, delta: Delta, box: _Box
) -> tuple[int, int, int]:
    """Judges the candidates that were not spared; returns candidates, kept pixels that have changed, and rays."""
    top, bottom, left, right = box
    candidates, changed, rays = 0, 0, 0
    for y in range(top, bottom):
        for x in range(left, right):
            if flags[y, x] & UPDATED == 0:
                continue
            candidates += 1
            if flags[y, x] & KEPT != 0:
                flags[y, x] ^= UPDATED
                changed += 1
            elif flags[y, x] & _SPARED == 0:
                flags[y, x] ^= UPDATED | _judge_pixel(tracer, camera, coding, codes, y, x, delta)
                rays += 1
    return candidates, changed, rays


@inlined
def _box(blocks: I64, k: int, size: tuple[int, int], flags: U8) -> _Box:
    """The rows and columns of a block, clipped to the picture."""
    top, left = blocks[k, 0] * size[0], blocks[k, 1] * size[1]
    return top, min(top + size[0], flags.shape[0]), left, min(left + size[1], flags.shape[1])


# Each of these functions runs over all blocks before the next one begins, because it reads results of the one before
# also in neighbouring blocks. They are separate functions, as Numba might fuse several loops in one function.


@parallel
def _judge_candidates(
    tracer: Tracer, camera: F64, coding: Coding, codes: U16, flags: U8, delta: Delta, blocks: I64,
    size: tuple[int, int], counts: I64,
) -> None:  # fmt: skip
    for k in numba.prange(blocks.shape[0]):
        box = _box(blocks, k, size, flags)
        rays = _ask_by_four(tracer, camera, coding, codes, flags, delta, box)
        candidates, changed, more = _ask_one_by_one(tracer, camera, coding, codes, flags, delta, box)
        counts[k, CANDIDATES], counts[k, CHANGED], counts[k, RAYS] = candidates, changed, rays + more


@parallel
def _drop_spared(flags: U8, blocks: I64, size: tuple[int, int]) -> None:
    """Spared pixels without an accepted neighbour are no longer candidates."""
    for k in numba.prange(blocks.shape[0]):
        top, bottom, left, right = _box(blocks, k, size, flags)
        for y in range(top, bottom):
            for x in range(left, right):
                if flags[y, x] & _SPARED != 0 and _count_around(flags, y, x, _ACCEPTED | _CONFIRMED) == 0:
                    flags[y, x] ^= UPDATED | _SPARED


@parallel
def _judge_spared(
    tracer: Tracer, camera: F64, coding: Coding, codes: U16, flags: U8, delta: Delta, blocks: I64,
    size: tuple[int, int], counts: I64,
) -> None:  # fmt: skip
    """Judges the other spared pixels by rays of their own."""
    for k in numba.prange(blocks.shape[0]):
        top, bottom, left, right = _box(blocks, k, size, flags)
        for y in range(top, bottom):
            for x in range(left, right):
                if flags[y, x] & _SPARED != 0:
                    flags[y, x] ^= UPDATED | _SPARED
                    flags[y, x] |= _judge_pixel(tracer, camera, coding, codes, y, x, delta)
                    counts[k, RAYS] += 1


@parallel
def _confirm(flags: U8, neighbours: int, blocks: I64, size: tuple[int, int]) -> None:
    """Confirms accepted pixels with enough neighbours."""
    needed = neighbours + 1  # the pixel itself is among those around it
    for k in numba.prange(blocks.shape[0]):
        top, bottom, left, right = _box(blocks, k, size, flags)
        for y in range(top, bottom):
            for x in range(left, right):
                if (
                    flags[y, x] & _ACCEPTED != 0
                    and _count_around(flags, y, x, KEPT | _ACCEPTED | _CONFIRMED) >= needed
                ):
                    flags[y, x] ^= _ACCEPTED | _CONFIRMED


@parallel
def _keep(flags: U8, blocks: I64, size: tuple[int, int], counts: I64) -> None:
    """Keeps confirmed pixels; other accepted pixels are candidates again next time."""
    for k in numba.prange(blocks.shape[0]):
        top, bottom, left, right = _box(blocks, k, size, flags)
        kept, lone = 0, 0
        for y in range(top, bottom):
            for x in range(left, right):
                if flags[y, x] & _CONFIRMED != 0:
                    flags[y, x] ^= _CONFIRMED | KEPT
                    kept += 1
                elif flags[y, x] & _ACCEPTED != 0:
                    flags[y, x] ^= _ACCEPTED | UPDATED
                    lone += 1
        counts[k, ACCEPTED], counts[k, LONE] = kept, lone


@serial
def filter_pixels(
    tracer: Tracer, camera: F64, coding: Coding, codes: U16, flags: U8, delta: Delta,
    neighbours: int, blocks: I64, size: tuple[int, int], counts: I64,
) -> None:  # fmt: skip
    """The filter of Fig. 6b: an updated pixel is kept if its point is more than delta behind the farthest hit.

    At least `neighbours` of its eight neighbours must be in the P-PBS or accepted too: a surface that someone uncovers
    is a region, a wrong depth is mostly a lone pixel. With 3, a group of 2 x 2 pixels is enough.

    Only the blocks [n, 2] of `size` pixels (rows and columns, even) are filtered; they must contain all updated pixels.
    Four pixels on one surface first share one ray. Each gets its own ray only if the shared one finds them new, or if
    neighbouring pixels are new. Afterwards, in flags [h, w] (see `flags`), only lone pixels are still UPDATED: they are
    candidates again next time. counts [n, COUNTS_SIZE]: see the constants.
    """
    _judge_candidates(tracer, camera, coding, codes, flags, delta, blocks, size, counts)
    _drop_spared(flags, blocks, size)
    _judge_spared(tracer, camera, coding, codes, flags, delta, blocks, size, counts)
    _confirm(flags, neighbours, blocks, size)
    _keep(flags, blocks, size, counts)
