"""Which updated pixels become part of the P-PBS (Fig. 6b)."""

from __future__ import annotations

import numpy as np
import pytest
from farside.engine.background.pbs import ProbableBackgroundSurface
from farside.engine.geometry.mesh import Mesh
from farside.engine.kernels.background.flags import KEPT, PROVISIONAL, UPDATED
from farside.engine.kernels.background.triangle_filter import (
    ACCEPTED,
    CANDIDATES,
    CHANGED,
    COUNTS_SIZE,
    LONE,
    RAYS,
    filter_pixels,
)
from farside.engine.rig.camera import Camera, Perspective, Pose
from oracle.rays import farthest
from support.rooms import CODING

DELTA = 0.2


def wall_with_a_gap():
    """A wall at a distance of 4 m, made of squares of 0.25 m, nine of which are missing."""
    y, z = np.meshgrid(np.arange(-4, 4.01, 0.25) + 0.07, np.arange(-4, 4.01, 0.25) + 0.04, indexing="ij")
    points = np.stack([np.full(y.shape, 4.0), y, z], axis=-1).reshape(-1, 3).astype(np.float32)
    k = np.arange(y.size).reshape(y.shape)
    gap = np.zeros((len(k) - 1, len(k) - 1), bool)
    gap[14:17, 12:15] = True
    a, b, c, d = (q[~gap] for q in (k[:-1, :-1], k[:-1, 1:], k[1:, :-1], k[1:, 1:]))
    triangles = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).astype(np.int32)
    return Mesh(points, np.zeros((len(points), 2), np.float32), triangles)


def slow_filter(camera, mesh, depth, updated, kept, neighbours):
    """(kept, updated) afterwards: pixel by pixel, each by its own ray."""
    accepted, confirmed = np.zeros(kept.shape, bool), np.zeros(kept.shape, bool)
    for y, x in np.argwhere(updated & ~kept):
        found, _triangle = farthest(camera, x + 0.5, y + 0.5, mesh.points, mesh.triangles)
        length = np.linalg.norm(camera.unproject([x + 0.5, y + 0.5], 1.0))
        confirmed[y, x] = np.isnan(found)
        accepted[y, x] = np.isnan(found) or depth[y, x] * length > found + DELTA
    there = np.pad(kept | accepted, 1).astype(int)
    h, w = kept.shape
    around = sum(there[y : y + h, x : x + w] for y in range(3) for x in range(3)) - there[1:-1, 1:-1]
    confirmed |= accepted & (around >= neighbours)
    return kept | confirmed, accepted & ~confirmed


@pytest.mark.parametrize("size", [(40, 32), (33, 25)])
@pytest.mark.parametrize(("share", "neighbours"), [(1.0, 3), (0.8, 3), (1.0, 0)])
def test_candidates_are_accepted_as_by_the_slow_twin_with_fewer_rays(size, share, neighbours):
    camera, mesh = Camera("c", Perspective.from_fov(*size, 1.0), Pose(), CODING), wall_with_a_gap()
    pbs = ProbableBackgroundSurface(1)
    pbs.set_static(0, 0, mesh)
    pbs.commit()
    rng = np.random.default_rng(2)
    depth = np.full(size[::-1], 4.0)
    depth[3:9, 5:16] = 5.0  # a region behind the wall, and pixels too few for one
    depth[14, 28] = depth[20, 9:11] = 5.0
    codes = CODING.codes(depth)
    updated = rng.random(codes.shape) < share
    kept = rng.random(codes.shape) < 0.02
    others = rng.integers(0, 1 << 8, codes.shape, np.uint8) & PROVISIONAL
    flags = np.where(updated, UPDATED, 0).astype(np.uint8) | np.where(kept, KEPT, 0).astype(np.uint8) | others
    expected, lone = slow_filter(camera, mesh, CODING.depth(codes), updated, kept, neighbours)
    candidates, changed, before = np.count_nonzero(updated), np.count_nonzero(updated & kept), np.count_nonzero(kept)
    blocks = np.argwhere(np.ones((-(-size[1] // 8), -(-size[0] // 16))))
    counts = np.empty((len(blocks), COUNTS_SIZE), np.int64)
    filter_pixels(
        pbs.tracer.packed, camera.packed(), camera.depth.packed(), codes, flags, (DELTA, 0.0), neighbours, blocks,
        (8, 16), counts,
    )  # fmt: skip
    np.testing.assert_array_equal(flags, np.where(expected, KEPT, 0) | np.where(lone, UPDATED, 0) | others)
    totals = counts.sum(axis=0)
    accepted = np.count_nonzero(expected) - before
    expected = {CANDIDATES: candidates, ACCEPTED: accepted, CHANGED: changed, LONE: np.count_nonzero(lone)}
    assert {column: totals[column] for column in expected} == expected
    assert lone.any() == (neighbours > 0)
    assert accepted > 66 * share
    assert totals[RAYS] < (0.6 if share == 1 else 0.9) * candidates
