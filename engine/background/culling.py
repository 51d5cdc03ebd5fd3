"""Foreground culling: what no camera's rays from outside the scene find is not background (section 3.3.2).

Each camera owns one bit of every triangle's marks. Casting a camera's rays sets its bit anew everywhere, and
leaves those of the others: with a group of cameras a frame, a triangle stays until every camera has had its turn
without finding it. A triangle of the S-PBS that was flagged stays flagged, as in the paper: rays no longer see it,
so that none can mark it again.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt

from .. import threads as _threads  # noqa: F401 (the threading layer, before the first parallel kernel)
from ..embree import MarkQuery
from ..kernels.culling import mark_grid, mark_through
from .pbs import ProbableBackgroundSurface, Surface

__all__ = ["clear_marks", "cull_unmarked", "mark_background", "mark_missed"]

FloatArray = npt.NDArray[np.float64]


def mark_background(
    pbs: ProbableBackgroundSurface, camera: int, packed: FloatArray, stride: int, delta_m: float
) -> int:
    """Casts a camera's culling rays and renews its marks; returns the number of rays.

    Two rays for every stride-th pixel both ways; each that hits is followed by a complementary one. `packed` is
    the camera as kernels take it.
    """
    word, bit = camera // 64, np.uint64(1 << (camera % 64))
    clear_marks(pbs, camera)
    query = MarkQuery(pbs.marks_table, word, int(bit))
    rays = mark_grid(
        pbs.intersect, pbs.scene, query.address, packed, pbs.bounds, stride, delta_m,
        pbs.marks_table, word, bit.astype(np.int64),
    )  # fmt: skip
    return int(rays)


def clear_marks(pbs: ProbableBackgroundSurface, camera: int) -> None:
    """Takes a camera's marks from all triangles."""
    word, bit = camera // 64, np.uint64(1 << (camera % 64))
    for surface in pbs.surfaces():
        surface.marks[:, word] &= ~bit


def mark_missed(
    pbs: ProbableBackgroundSurface, cameras: Iterable[int], packed: Sequence[FloatArray], delta_m: float
) -> int:
    """Looks again at triangles without a mark, one camera after the other until one finds them; returns the rays.

    A ray goes through the centroid of each: an error-bounded mesh has triangles smaller than any stride, which would
    else be culled wherever they stand. Each is left with one mark, so that it is looked at again in that camera's
    next turn, not in every one.
    """
    surfaces, rays = list(pbs.surfaces()), 0
    missed = [np.flatnonzero(_unmarked(surface)) for surface in surfaces]
    for camera in cameras:
        corners = [s.mesh.points[s.mesh.triangles[m]] for s, m in zip(surfaces, missed, strict=True)]
        points = np.concatenate([np.empty((0, 3), np.float32), *(c.mean(axis=1) for c in corners)])
        if not len(points):
            break
        word, bit = camera // 64, np.uint64(1 << (camera % 64))
        query = MarkQuery(pbs.marks_table, word, int(bit))
        rays += mark_through(
            pbs.intersect, pbs.scene, query.address, packed[camera], pbs.bounds, points, delta_m,
            pbs.marks_table, word, bit.astype(np.int64),
        )  # fmt: skip
        missed = [m[s.marks[m, word] & bit == 0] for s, m in zip(surfaces, missed, strict=True)]
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
    unmarked: npt.NDArray[np.bool_] = surface.invalid == 0
    for word in range(surface.marks.shape[1]):
        unmarked &= surface.marks[:, word] == 0
    return unmarked
