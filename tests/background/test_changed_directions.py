"""The directions in which geometry has changed, and the cameras whose culling marks are affected."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.changed_directions import ChangedDirections
from farside.engine.background.model import BackgroundModel
from farside.engine.background.surface import Surface
from farside.engine.geometry.mesh import Mesh
from farside.engine.geometry.scene_scale import Scene
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.settings import Settings
from support.rooms import CODING, camera_row, frame

DELTA = 0.1
EYES = ((0.0, 0.0, 0.0), (0.4, -0.2, 0.1))


def triangles_around(rng, count, size):
    """Meshes of single triangles at random places around the eyes, some of them at the poles."""
    middle = rng.normal(size=(count, 3))
    middle[: count // 8, :2] *= 0.02
    middle *= rng.uniform(2.0, 6.0, (count, 1)) / np.linalg.norm(middle, axis=1, keepdims=True)
    corners = middle[:, None] + size * rng.uniform(-1, 1, (count, 3, 3))
    numbers = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    return Mesh(corners.reshape(-1, 3).astype(np.float32), np.zeros((3 * count, 2), np.float32), numbers)


def packed_eyes():
    return np.array([Camera("c", Perspective.from_fov(8, 8, 1.0), Pose(eye), CODING).packed() for eye in EYES])


def lies_behind(eye, one, other):
    """Whether `other` [3, 3] lies more than delta / 2 behind one of some points of the triangle `one`, as seen from an
    eye."""
    weights = np.array([(i, j, 6 - i - j) for i in range(7) for j in range(7 - i)]) / 6
    rays = weights @ (one - eye)
    parts = rays @ np.linalg.inv(other - eye)  # of the corners' directions; all positive: inside
    times = 1.0 / parts.sum(axis=1)  # of the rays' lengths: how far the other one is
    farther = (times - 1.0) * np.linalg.norm(rays, axis=1) > 0.5 * DELTA
    return bool(np.any(np.all(parts > 1e-6, axis=1) & farther))


@pytest.mark.parametrize(("size", "most"), [(0.2, 0.25), (0.6, 0.7), (3.0, 1.0)])
def test_all_marks_before_new_triangles_are_taken_and_few_others(size, most):
    rng = np.random.default_rng(0)
    mesh, new = triangles_around(rng, 600, size), triangles_around(rng, 40, size)
    marks = np.full((600, 2), 3, np.uint64)
    surface = Surface(mesh, marks, np.zeros(600, np.uint8), 0, 0)
    changed = ChangedDirections(packed_eyes())
    changed.add(Surface.new(new, 1, 1, 1), np.arange(40))
    changed.forget(1, [surface], (DELTA, 0.0))
    corners, others = mesh.points.astype(float).reshape(-1, 3, 3), new.points.astype(float).reshape(-1, 3, 3)
    met = np.array([any(lies_behind(EYES[1], one, other) for other in others) for one in corners])
    taken = marks[:, 0] == 1
    assert met.any()
    assert np.all(taken[met])
    assert taken.mean() <= most
    np.testing.assert_array_equal(marks[:, 1], 3)
    before = marks.copy()
    changed.forget(1, [surface], (DELTA, 0.0))  # camera 1 has handled these changes
    np.testing.assert_array_equal(marks, before)
    changed.forget(0, [surface], (DELTA, 0.0))  # but not by the other camera
    assert np.count_nonzero(marks[:, 0] == 0) > 0


def test_when_all_may_have_moved_all_marks_are_taken():
    marks = np.ones((50, 1), np.uint64)
    mesh = triangles_around(np.random.default_rng(1), 50, 0.2)
    changed = ChangedDirections(packed_eyes())
    changed.add_all()
    changed.forget(0, [Surface(mesh, marks, np.zeros(50, np.uint8), 0, 0)], (DELTA, 0.0))
    assert not marks.any()


def test_a_model_that_looks_only_where_something_changed_culls_the_same(monkeypatch):
    cameras = camera_row()
    settings = Settings(n_init=3, n_update=1)

    def walk():
        first = frame(0, cameras, box_y=-0.8)
        model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, first))
        model.update(first)
        reports = [model.update(frame(i, cameras, box_y=-0.8 + 0.07 * i)) for i in range(1, 20)]
        return [dataclasses.replace(report, rays=0, stages={}) for report in reports], sum(r.rays for r in reports)

    found, rays = walk()
    forget = ChangedDirections.forget

    def forget_all(self, camera, surfaces, delta_m):
        self.add_all()
        forget(self, camera, surfaces, delta_m)

    monkeypatch.setattr(ChangedDirections, "forget", forget_all)
    expected, all_rays = walk()
    assert found == expected
    assert sum(report.culled for report in found) > 0
    assert rays < all_rays
