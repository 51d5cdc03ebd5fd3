"""The paper's culling: two rays per pixel, each followed by a complementary ray (section 3.3.2, Fig. 6a).

A ray from outside the scene marks the farthest triangle that it hits. The complementary ray marks those within half of
delta before and behind it: they are the same surface, seen by another view.
"""

from __future__ import annotations

import numba
import numpy as np

from ...support.array_types import F64, I64
from ...support.packed import HEIGHT, WIDTH
from ..base.jit import inlined, parallel
from ..base.memory import or_u64
from ..base.tolerance import Delta, delta_at
from .intersect import intersect1
from .ray_hit import INVALID_ID
from .rays import Tracer, outside_ray
from .surfaces import MARKS, WORDS

__all__ = ["OFFSETS", "mark_by_pixel"]

# Offsets from a pixel's centre into the two triangles that it owns in the quad to its north-east (Fig. 4). They are
# right for both diagonals: quads are divided by either in turn, and at a depth edge only one triangle may be left.
OFFSETS = ((0.72, -0.47), (0.27, -0.54))


@inlined
def _mark_along(
    tracer: Tracer, query: int, camera: F64, u: float, v: float, delta: Delta, marks: I64, word: int, bits: int
) -> int:
    """Marks the farthest triangle behind (u, v) and, by the complementary ray, all triangles from delta / 2 before it
    to delta / 2 behind it; returns the number of rays."""
    x, y, z, dx, dy, dz, far, _length = outside_ray(camera, tracer.bounds, u, v)
    if not far > 0.0:
        return 0
    ox, oy, oz = np.float32(x), np.float32(y), np.float32(z)
    fx, fy, fz = np.float32(dx), np.float32(dy), np.float32(dz)
    t, _hu, _hv, geometry, primitive = intersect1(
        tracer.intersect, tracer.scene, 0, ox, oy, oz, fx, fy, fz, np.float32(0.0), np.float32(far)
    )
    if geometry == INVALID_ID:
        return 1
    index = numba.int64(primitive) * marks[geometry, WORDS] + word
    or_u64(marks[geometry, MARKS], index, numba.uint64(bits))
    half = 0.5 * delta_at(delta, far - t)
    if half <= 0.0:
        return 1
    near = np.float32(max(t - half, 0.0))
    intersect1(tracer.intersect, tracer.scene, query, ox, oy, oz, fx, fy, fz, near, np.float32(t + half))
    return 2


@parallel
def mark_by_pixel(
    tracer: Tracer, query: int, camera: F64, stride: int, delta: Delta, marks: I64, word: int, bits: int
) -> int:
    """Casts two rays, each with its complementary ray, for every stride-th pixel in both directions; returns the number
    of rays.

    `query`: address of a MarkQuery with the same table of marks, word and bits. The bits are of one camera, so all
    threads set the same bits and cannot undo one another's.
    """
    w, h = int(camera[WIDTH]), int(camera[HEIGHT])
    rays = 0
    for row in numba.prange((h + stride - 1) // stride):
        v = min(row * stride + stride // 2, h - 1) + 0.5
        for column in range((w + stride - 1) // stride):
            u = min(column * stride + stride // 2, w - 1) + 0.5
            for k in range(2):
                rays += _mark_along(
                    tracer, query, camera, u + OFFSETS[k][0], v + OFFSETS[k][1], delta, marks, word, bits
                )
    return rays
