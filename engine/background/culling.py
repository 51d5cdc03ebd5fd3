"""Foreground culling: what no camera's rays from outside the scene find is not background (section 3.3.2).

Each camera owns one bit of every triangle's marks. Casting a camera's rays sets its bit anew everywhere, and
leaves those of the others: with a group of cameras a frame, a triangle stays until every camera has had its turn
without finding it. A triangle of the S-PBS that was flagged stays flagged, as in the paper: rays no longer see it,
so that none can mark it again.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .. import threads as _threads  # noqa: F401 (the threading layer, before the first parallel kernel)
from ..embree import MarkQuery
from ..kernels.culling import flag_unmarked, mark_centroids, mark_grid
from .pbs import ProbableBackgroundSurface

__all__ = ["cull_unmarked", "mark_background"]


def mark_background(
    pbs: ProbableBackgroundSurface,
    camera: int,
    packed: npt.NDArray[np.float64],
    stride: int,
    delta_m: float,
) -> int:
    """Casts a camera's culling rays and renews its marks; returns the number of rays.

    Two rays for every stride-th pixel both ways, and one through the centroid of each triangle of the camera's own
    that these have missed: an error-bounded mesh has triangles smaller than the stride. Each ray that hits is
    followed by a complementary one.
    """
    word, bits = camera // 64, np.uint64(1 << (camera % 64))
    for surface in pbs.surfaces():
        surface.marks[:, word] &= ~bits
    signed = int(bits.astype(np.int64))
    query = MarkQuery(pbs.marks_table, word, int(bits))
    rays = mark_grid(
        pbs.intersect, pbs.scene, query.address, packed, pbs.bounds, stride, delta_m, pbs.marks_table, word, signed
    )
    for surface in pbs.surfaces_of(camera):
        rays += mark_centroids(
            pbs.intersect, pbs.scene, query.address, packed, pbs.bounds,
            surface.mesh.uv, surface.mesh.triangles, surface.invalid,
            delta_m, pbs.marks_table, word, signed, surface.marks,
        )  # fmt: skip
    return int(rays)


def cull_unmarked(pbs: ProbableBackgroundSurface) -> int:
    """Flags as invalid what no camera has marked; returns how many triangles were valid before."""
    return sum(int(flag_unmarked(surface.marks, surface.invalid)) for surface in pbs.surfaces())
