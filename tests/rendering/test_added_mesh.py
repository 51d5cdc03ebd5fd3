"""Added meshes in a picture: coverage and depth as by rays, colours, and what hides what."""

from __future__ import annotations

import math

import numpy as np
import pytest
from farside.engine.kernels.rendering.added_mesh import ADDED, ColouredTriangles, draw
from farside.engine.kernels.rendering.records import DepthBuffer, Planes
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from oracle.effects import nearest_of_both_sides

CODING = DepthCoding(0.3, 20.0, 16, has_invalid=True)
EYES = {
    "perspective": Perspective.from_fov(60, 44, 1.4),
    "off centre": Perspective(52, 40, 30.0, -32.0, 70.0, 8.0),
    "sphere": Equirectangular(80, 40, (-math.pi, math.pi), (-0.5 * math.pi, 0.5 * math.pi)),
    "part of a sphere": Equirectangular(50, 40, (-1.0, 1.2), (-0.9, 0.8)),
}


def coloured(points, triangles, seed=0):
    """A mesh with a random picture."""
    rng = np.random.default_rng(seed)
    y, cb, cr = (rng.integers(64, 940, size).astype(np.uint16) for size in ((9, 11), (5, 6), (5, 6)))
    uv = rng.uniform((0, 0), (11, 9), (len(points), 2)).astype(np.float32)
    return ColouredTriangles(
        np.ascontiguousarray(points, np.float64), np.ascontiguousarray(triangles, np.int32), uv, y, cb, cr
    )


def drawn(mesh, camera, near=0.05, disparity=None):
    shape = (camera.height, camera.width)
    disparity = np.zeros(shape, np.float32) if disparity is None else disparity
    buffer = DepthBuffer(disparity, np.zeros(shape, np.uint8))
    planes = Planes(*(np.full(shape, -1.0, np.float32) for _ in range(3)))
    draw(mesh, camera.packed(), near, buffer, planes)
    return buffer, planes


@pytest.mark.parametrize("eye", EYES)
@pytest.mark.parametrize("seed", range(4))
def test_coverage_and_depth_are_those_of_rays(eye, seed):
    rng = np.random.default_rng(seed)
    camera = Camera("t", EYES[eye], Pose.from_euler(rng.uniform(-0.3, 0.3, 3), *rng.uniform(-0.6, 0.6, 3)), CODING)
    # All around the eye: some triangles are behind it, some cross its plane, some are near the poles of a sphere.
    middles = rng.normal(size=(40, 1, 3)) * 2.5
    points = (middles + rng.normal(size=(40, 3, 3)) * rng.choice([0.3, 2.0], (40, 1, 1))).reshape(-1, 3)
    triangles = np.arange(120).reshape(-1, 3)
    buffer, planes = drawn(coloured(points, triangles, seed), camera)
    truth = nearest_of_both_sides(camera, points, triangles, 0.05)
    covered = buffer.disparity > 0
    sure = truth.sure_of_coverage
    assert sure.mean() > 0.8
    assert covered.any()
    np.testing.assert_array_equal(covered[sure], truth.triangle[sure] >= 0)
    same = truth.sure_of_triangle & covered
    np.testing.assert_allclose(buffer.disparity[same], truth.disparity[same], rtol=1e-4)
    assert (buffer.winner[covered] == ADDED).all()
    assert (planes.luma[covered] >= 64).all()
    assert (planes.luma[~covered] == -1).all()


def test_neighbouring_triangles_leave_no_gap_and_colours_go_on_evenly():
    """A slanted grid whose picture is a ramp along each axis: perspective-correct everywhere."""
    n = 12
    v, u = np.mgrid[0 : n + 1, 0 : n + 1] / n
    jitter = np.random.default_rng(3).uniform(-0.03, 0.03, (2, n + 1, n + 1))
    jitter[:, [0, -1]] = jitter[:, :, [0, -1]] = 0.0
    u, v = u + jitter[0], v + jitter[1]
    points = np.stack([2.0 + 3.0 * u, 2.0 - 4.0 * u, 2.0 - 4.0 * v], -1).reshape(-1, 3)
    i = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    triangles = np.concatenate([np.stack([i, i + 1, i + n + 2], -1), np.stack([i, i + n + 2, i + n + 1], -1)])
    ramp = np.arange(101)
    y = np.tile(ramp, (101, 1)).astype(np.uint16)
    cb, cr = np.zeros((51, 51), np.uint16), np.tile(2 * ramp[:51, None], (1, 51)).astype(np.uint16)
    uv = (np.stack([u, v], -1).reshape(-1, 2) * 100 + 0.5).astype(np.float32)
    camera = Camera("t", Perspective.from_fov(160, 120, 1.3), Pose(), CODING)
    buffer, planes = drawn(ColouredTriangles(points, triangles.astype(np.int32), uv, y, cb, cr), camera)
    ys, xs = np.mgrid[0:120, 0:160] + 0.5
    rays = camera.unproject(np.stack([xs, ys], -1), np.ones(xs.shape))
    # The plane: x = 2 + 3 u and y = 2 - 4 u, so 4 x + 3 y = 14.
    t = 14.0 / (4.0 * rays[..., 0] + 3.0 * rays[..., 1])
    place = t[..., None] * rays
    pu, pv = (place[..., 0] - 2.0) / 3.0, (2.0 - place[..., 2]) / 4.0
    inside = (np.minimum(pu, pv) > 0.01) & (np.maximum(pu, pv) < 0.99)
    assert inside.sum() > 3000
    assert (buffer.disparity[inside] > 0).all()
    np.testing.assert_allclose(buffer.disparity[inside], 1 / t[inside], rtol=1e-5)
    np.testing.assert_allclose(planes.luma[inside], 100 * pu[inside], atol=0.01)
    middle = inside & (pv > 0.02) & (pv < 0.97)
    # A sample of chroma lies between two of luma.
    np.testing.assert_allclose(planes.chroma_r[middle], 100 * pv[middle] - 0.5, atol=0.01)


def test_nearer_surfaces_hide_it_and_nothing_before_the_near_plane_is_drawn():
    square = np.array([(2.0, 1.0, 1.0), (2.0, -1.0, 1.0), (2.0, -1.0, -1.0), (2.0, 1.0, -1.0)])
    mesh = coloured(square, [(0, 1, 2), (0, 2, 3)])
    camera = Camera("t", Perspective.from_fov(40, 30, 1.2), Pose(), CODING)
    behind = np.full((30, 40), 1 / 3.0, np.float32)
    behind[:, :20] = 1 / 1.5
    buffer, _ = drawn(mesh, camera, disparity=behind)
    shown = buffer.winner == ADDED
    assert not shown[:, :20].any()
    assert shown[10:20, 20:25].all()
    np.testing.assert_allclose(buffer.disparity[shown], 0.5, rtol=1e-6)
    assert not (drawn(mesh, camera, near=2.1)[0].disparity > 0).any()


def test_a_mesh_of_nowhere_draws_nothing():
    bad = np.array([(np.nan, 0.0, 1.0), (1e300, -1e300, 0.0), (np.inf, 1.0, 1.0), (0.0, 0.0, 0.0)])
    for projection in EYES.values():
        camera = Camera("t", projection, Pose(), CODING)
        triangles = [(0, 1, 2), (3, 3, 3), (1, 3, 2), (0, 0, 3)]
        assert not (drawn(coloured(bad, triangles), camera)[0].disparity > 0).any()
