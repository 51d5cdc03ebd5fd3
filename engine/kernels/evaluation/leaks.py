"""Many rays, cast by `background.rays.farthest_hit`, to compare with the known geometry of a scene."""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, F64, I32
from ..background.rays import Tracer, farthest_hit
from ..base.jit import inlined, parallel
from ..base.project import project_point

__all__ = ["count_leaks", "farthest_distances"]


_SHARE = 1.0 / (1 << 32)


@inlined
def _random(state: np.uint64) -> np.uint64:
    """The next number of a sequence (splitmix64, Steele et al. 2014)."""
    z = state + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@parallel
def count_leaks(
    tracer: Tracer, points: F32, triangles: I32, cameras: F64, seed: int, rays: int
) -> tuple[int, int, int]:
    """The number of rays, of `rays` each, that hit nothing: from random cameras [n, 20] towards the insides of random
    triangles, towards their sides, and towards their corners."""
    missed = np.zeros((rays, 3), np.uint8)
    for i in numba.prange(rays):
        a = _random(np.uint64(seed) + np.uint64(i) * np.uint64(3))
        b = _random(a)
        c = _random(b)
        camera = cameras[np.int64(a % np.uint64(len(cameras)))]
        triangle = triangles[np.int64(b % np.uint64(len(triangles)))]
        p, q = _SHARE * np.float64(c & np.uint64(0xFFFFFFFF)), _SHARE * np.float64(c >> np.uint64(32))
        p, q = (1.0 - p, 1.0 - q) if p + q > 1.0 else (p, q)
        for kind in range(3):
            second, third = p if kind < 2 else 0.0, q if kind < 1 else 0.0
            x, y, z = 0.0, 0.0, 0.0
            for corner in range(3):
                share = 1.0 - second - third if corner == 0 else (second if corner == 1 else third)
                x += share * points[triangle[corner], 0]
                y += share * points[triangle[corner], 1]
                z += share * points[triangle[corner], 2]
            u, v, _depth = project_point(camera, x, y, z)
            missed[i, kind] = farthest_hit(tracer, camera, u, v)[0] < 0.0
    return int(missed[:, 0].sum()), int(missed[:, 1].sum()), int(missed[:, 2].sum())


@parallel
def farthest_distances(tracer: Tracer, camera: F64, distances: F64) -> None:
    """distances [h, w]: of the farthest hits behind the pixels of a camera; nan where there is no hit."""
    for row in numba.prange(distances.shape[0]):
        for x in range(distances.shape[1]):
            found = farthest_hit(tracer, camera, x + 0.5, row + 0.5)[0]
            distances[row, x] = found if found > 0.0 else math.nan
