"""Foreground culling: what no camera's rays from outside the scene find is not background (section 3.3.2).

Each camera owns one bit of every triangle's marks. Casting a camera's rays sets its bit anew everywhere, and
leaves those of the others: with a group of cameras a frame, a triangle stays until every camera has had its turn
without finding it. A triangle of the S-PBS that was flagged stays flagged, as in the paper: rays no longer see it,
so that none can mark it again.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .. import threads as _threads  # noqa: F401 (the threading layer, before the first parallel kernel)
from ..embree import MarkQuery
from ..kernels.culling import mark_grid, mark_through
from .pbs import ProbableBackgroundSurface, Surface

__all__ = ["cull_unmarked", "mark_background", "mark_unseen"]

FloatArray = npt.NDArray[np.float64]


def mark_background(
    pbs: ProbableBackgroundSurface, camera: int, packed: FloatArray, stride: int, delta_m: float
) -> int:
    """Casts a camera's culling rays and renews its marks; returns the number of rays.

    Two rays for every stride-th pixel both ways, and one through the centroid of each triangle that had the
    camera's mark and was missed by these: an error-bounded mesh has triangles smaller than any stride. Each ray that
    hits is followed by a complementary one. `packed` is the camera as kernels take it.
    """
    word, bit = camera // 64, np.uint64(1 << (camera % 64))
    before = []
    for surface in pbs.surfaces():
        before.append(surface.marks[:, word] & bit)
        surface.marks[:, word] &= ~bit
    query = MarkQuery(pbs.marks_table, word, int(bit))
    arguments = (delta_m, pbs.marks_table, word, bit.astype(np.int64))
    rays = mark_grid(pbs.intersect, pbs.scene, query.address, packed, pbs.bounds, stride, *arguments)
    missed = [
        (had & ~surface.marks[:, word] != 0) & (surface.invalid == 0)
        for surface, had in zip(pbs.surfaces(), before, strict=True)
    ]
    points = _centroids(pbs, missed)
    rays += mark_through(pbs.intersect, pbs.scene, query.address, packed, pbs.bounds, points, *arguments)
    return int(rays)


def mark_unseen(pbs: ProbableBackgroundSurface, packed: Sequence[FloatArray], delta_m: float) -> int:
    """Gives every triangle without a mark one ray from each camera through its centroid; returns the rays.

    These are new triangles that the grid of rays has missed, and those that were about to be culled: a last look.
    """
    points = _centroids(pbs, [_unmarked(surface) for surface in pbs.surfaces()])
    rays = 0
    for camera, own in enumerate(packed if len(points) else ()):
        word, bit = camera // 64, np.uint64(1 << (camera % 64))
        query = MarkQuery(pbs.marks_table, word, int(bit))
        rays += mark_through(
            pbs.intersect, pbs.scene, query.address, own, pbs.bounds, points, delta_m,
            pbs.marks_table, word, bit.astype(np.int64),
        )  # fmt: skip
    return int(rays)


def cull_unmarked(pbs: ProbableBackgroundSurface) -> int:
    """Flags as invalid what no camera has marked; returns how many triangles were valid before."""
    count = 0
    for surface in pbs.surfaces():
        unmarked = _unmarked(surface)
        surface.invalid[unmarked] = 1
        count += int(np.count_nonzero(unmarked))
    return count


def _unmarked(surface: Surface) -> npt.NDArray[np.bool_]:  # [m]
    """Which valid triangles have no mark."""
    unmarked: npt.NDArray[np.bool_] = (surface.invalid == 0) & ~surface.marks.any(axis=1)
    return unmarked


def _centroids(pbs: ProbableBackgroundSurface, chosen: Sequence[npt.NDArray[np.bool_]]) -> npt.NDArray[np.float32]:
    """Centroids [n, 3] of chosen triangles, one array of flags for each surface."""
    parts = [s.mesh.points[s.mesh.triangles[c]].mean(axis=1) for s, c in zip(pbs.surfaces(), chosen, strict=True)]
    return np.concatenate([np.empty((0, 3), np.float32), *parts])
