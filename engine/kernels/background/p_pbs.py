"""A camera's part of the P-PBS when it is derived anew (section 3.3.3): removal of the pixels of culled triangles, and
inheritance of marks."""

from __future__ import annotations

import math

import numba

from ...support.array_types import B1, F32, I32, U8, U64
from ..base.jit import inlined, parallel, serial
from .flags import ALL, KEPT
from .surfaces import Triangles

__all__ = ["clear_culled", "inherit_marks", "paint_triangles"]


@inlined
def _extent(a: float, b: float, c: float) -> tuple[int, int]:
    """The range of pixels, the last one excluded, with centres between the least and the greatest of three values."""
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
def paint_triangles(mesh: Triangles, invalid: U8, wraps: bool, erase: bool, numbers: I32) -> None:
    """Writes each valid triangle's number, or -1 to erase it, to all pixels whose centre it covers or touches.

    Where several triangles touch a centre, the last one counts. Therefore a single thread does this: with more threads
    the result would depend on their timing.
    """
    h, w = numbers.shape
    uv, triangles = mesh.uv, mesh.triangles
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
def clear_culled(mesh: Triangles, invalid: U8, wraps: bool, numbers: I32, flags: U8) -> None:
    """Clears KEPT in flags [h, w] (see `flags`) of pixels of invalid triangles that no valid triangle touches.

    numbers: see `paint_triangles`.
    """
    h, w = numbers.shape
    uv, triangles = mesh.uv, mesh.triangles
    for i in numba.prange(triangles.shape[0]):
        if invalid[i] == 0:
            continue
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        x0, x1 = _extent(uv[a, 0], uv[b, 0], uv[c, 0])
        y0, y1 = _extent(uv[a, 1], uv[b, 1], uv[c, 1])
        for y in range(max(y0, 0), min(y1, h)):
            for x in range(x0, x1):
                if (wraps or (x >= 0 and x < w)) and numbers[y, x % w] < 0 and _covers(uv, a, b, c, x, y):
                    flags[y, x % w] &= ALL ^ KEPT


@inlined
def _meets(blocks: B1, x0: int, x1: int, y0: int, y1: int) -> bool:
    """Whether one of the blocks from (x0, y0) to (x1, y1) is set; columns wrap round."""
    for y in range(max(y0, 0), min(y1, blocks.shape[0] - 1) + 1):
        for x in range(x0, x1 + 1):
            if blocks[y, x % blocks.shape[1]]:
                return True
    return False


@parallel
def inherit_marks(
    mesh: Triangles, numbers: I32, old: U64, new: U64, changed: B1, size: tuple[int, int], news: B1
) -> None:
    """Gives each new triangle the marks of the old triangle at its centroid, or none.

    news [m] is set for triangles without an old one there, and for those that meet a changed block of `size` pixels
    (rows, columns).
    """
    h, w = numbers.shape
    uv, triangles = mesh.uv, mesh.triangles
    height, width = size
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
