"""The background model as a whole, over some frames of a room."""

from __future__ import annotations

import dataclasses
import threading

import numpy as np
import pytest
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.frame import Frame, View
from support.models import SETTINGS, model_of, near_points, pbi_of
from support.rooms import BOX_X, BOX_Y, CODING, WALL_X, WALL_Y, camera_row, frame, see


def test_the_first_frame_is_the_wall_and_the_box_before_it():
    cameras = camera_row()
    model, report = model_of(cameras, frame(0, cameras, box_y=0.0))
    assert 0 < report.s_pbs_valid <= report.s_pbs
    assert report.p_pbs == 0
    depth, luma = pbi_of(model, cameras[1])
    behind = np.isclose(depth, WALL_X, atol=0.02)
    assert np.count_nonzero(~behind & ~np.isclose(depth, BOX_X, atol=0.02)) < 5  # corners of the box are culled
    assert behind.mean() > 0.9
    # Where another camera sees the wall behind the box, the wall is the farthest surface.
    seen = see(cameras[1], box_y=0.0).texture.y[1:-1, 1:-1] == BOX_Y
    assert np.count_nonzero(~behind) < 0.8 * np.count_nonzero(seen)
    assert np.all(luma[behind & ~seen] == WALL_Y)


def test_a_static_scene_adds_nothing_and_costs_no_rays():
    cameras = camera_row()
    model, first = model_of(cameras, frame(0, cameras, box_y=0.0))
    for index in range(1, 5):
        report = model.update(frame(index, cameras, box_y=0.0))
        assert (report.updated, report.candidates, report.accepted) == (0, 0, 0)
        assert (report.culled, report.p_pbs, report.rays) == (0, 0, 0)
        assert report.s_pbs_valid == first.s_pbs_valid


@pytest.mark.parametrize("n_update", [1, 2])
def test_groups_take_turns(n_update):
    cameras = camera_row()
    model, _first = model_of(cameras, frame(0, cameras), dataclasses.replace(SETTINGS, n_update=n_update))
    groups = [model.update(frame(i, cameras)).group for i in range(1, 4)]
    expected = {1: [("v0",), ("v1",), ("v2",)], 2: [("v0", "v1"), ("v2", "v0"), ("v1", "v2")]}
    assert groups == expected[n_update]


@pytest.mark.parametrize(
    ("tolerance_px", "n_update", "stride"), [(0.0, 1, 0), (0.25, 1, 0), (0.25, 3, 0), (0.25, 1, 4)]
)
def test_someone_who_left_leaves_no_ghost_after_one_round(tolerance_px, n_update, stride):
    cameras = camera_row()
    settings = dataclasses.replace(
        SETTINGS, tolerance_px=tolerance_px, n_update=n_update, culling_stride=stride
    )
    model, _first = model_of(cameras, frame(0, cameras, box_y=0.0), settings)
    assert len(near_points(model)) > 0
    reports = [model.update(frame(index, cameras)) for index in range(1, 4)]
    assert sum(r.accepted for r in reports) > 0
    assert sum(r.culled for r in reports) > 0
    assert len(near_points(model)) == 0
    for camera in (*cameras, dataclasses.replace(cameras[1], pose=Pose((-0.3, 0.1, 0.1)))):
        depth, luma = pbi_of(model, camera)
        outside = np.isnan(depth)
        assert outside.mean() < (0.25 if camera.pose.position[0] else 1e-3)
        assert np.all(outside | np.isclose(depth, WALL_X + camera.pose.position[0] * -1, atol=0.02))
        assert np.all(outside | (luma == WALL_Y))
    later = [model.update(frame(index, cameras)) for index in range(4, 10)]
    assert sum(r.accepted for r in later) == 0
    assert later[-1].rays == 0


def test_someone_who_comes_stays_out_of_the_model():
    cameras = camera_row()
    model, first = model_of(cameras, frame(0, cameras))
    for index in range(1, 7):
        report = model.update(frame(index, cameras, box_y=0.1 * index))
    assert (report.p_pbs, report.s_pbs_valid) == (0, first.s_pbs_valid)
    assert len(near_points(model)) == 0


def test_a_walker_is_forgotten_all_along():
    cameras = camera_row()
    model, _first = model_of(cameras, frame(0, cameras, box_y=-0.8))
    for index in range(1, 20):
        report = model.update(frame(index, cameras, box_y=min(-0.8 + 0.1 * index, 0.7)))
    assert len(near_points(model)) == 0
    size = report.p_pbs
    for index in range(20, 30):
        report = model.update(frame(index, cameras, box_y=0.7))
    assert report.p_pbs <= size


def test_a_camera_that_moves_has_its_turn_and_leaves_no_ghost():
    cameras = camera_row()
    model, _first = model_of(cameras, frame(0, cameras, box_y=0.0))
    edge = model.mesh().vertices[:, 1].min()
    groups = []
    for index in range(1, 9):
        moving = dataclasses.replace(cameras[0], pose=Pose((0.0, -0.4 - 0.05 * index, 0.0)))
        groups.append(model.update(frame(index, [moving, *cameras[1:]])).group)
    assert groups[:4] == [("v0",), ("v1",), ("v2",), ("v0",)]
    assert len(near_points(model)) == 0
    np.testing.assert_allclose(pbi_of(model, cameras[1])[0], WALL_X, atol=0.02)
    y = model.mesh().vertices[:, 1]
    pixel = 2 * WALL_X * np.tan(0.6) / 96
    assert y.min() == pytest.approx(edge - 0.35, abs=1.5 * pixel)  # what it saw in its last turn, in frame 7


def test_without_a_fixed_camera_the_background_stays():
    cameras = camera_row(2)
    model, first = model_of(cameras, frame(0, cameras, box_y=0.0))
    for index in range(1, 5):
        moved = [dataclasses.replace(c, pose=c.pose.translated((-0.1 * index, 0.0, 0.0))) for c in cameras]
        report = model.update(frame(index, moved, box_y=0.0))
        assert report.group == (cameras[(index + 1) % 2].name,)
    assert report.s_pbs_valid == first.s_pbs_valid
    assert report.p_pbs > 0  # from behind they see more of the wall
    assert not np.isnan(pbi_of(model, cameras[1])[0]).any()


def test_far_from_the_worlds_origin():
    shift = np.array([1e6, -2e6, 5e5])
    cameras = camera_row()
    moved = [
        dataclasses.replace(c, pose=Pose(tuple(float(p) for p in np.add(c.pose.position, shift)))) for c in cameras
    ]

    def there(index, box_y):
        views = frame(index, cameras, box_y).views
        return Frame(index, tuple(dataclasses.replace(v, camera=c) for v, c in zip(views, moved, strict=True)))

    model, _first = model_of(moved, there(0, 0.0))
    for index in range(1, 4):
        model.update(there(index, None))
    depth, _luma = pbi_of(model, moved[1])
    np.testing.assert_allclose(depth, WALL_X, atol=0.02)
    np.testing.assert_allclose(model.mesh().vertices[:, 0] - shift[0], WALL_X, atol=0.02)


@pytest.mark.parametrize("change", ["recoded", "renamed"])
def test_frames_that_do_not_fit_are_refused_and_change_nothing(change):
    cameras = camera_row()
    model, _first = model_of(cameras, frame(0, cameras, box_y=0.0))
    counts = model.counts()
    other = {"recoded": {"depth": dataclasses.replace(CODING, far=30.0)}, "renamed": {"name": "v9"}}[change]
    views = list(frame(1, cameras).views)
    views[1] = dataclasses.replace(views[1], camera=dataclasses.replace(cameras[1], **other))
    with pytest.raises(ValueError, match="frame 1: view"):
        model.update(Frame(1, tuple(views)))
    assert model.counts() == counts
    assert model.update(frame(1, cameras)).group == ("v0",)


def test_a_mesh_may_be_taken_while_the_model_is_updated():
    cameras = camera_row()
    model, _first = model_of(cameras, frame(0, cameras, box_y=0.0))
    meshes, errors = [], []

    def take():
        try:
            meshes.extend(model.mesh() for _ in range(30))
        except Exception as error:  # reported by the test's own thread
            errors.append(error)

    thread = threading.Thread(target=take)
    thread.start()
    for index in range(1, 30):
        model.update(frame(index, cameras, box_y=0.1 * (index % 7)))
    thread.join()
    assert not errors
    assert len(meshes) == 30
    for mesh in meshes:
        assert mesh.triangles.min() == 0
        assert mesh.triangles.max() == len(mesh.vertices) - 1
        assert len(mesh.colours) == len(mesh.vertices)


def test_a_sphere_camera_sees_the_seam_closed():
    projection = Equirectangular(96, 48, (-np.pi, np.pi), (-np.pi / 2, np.pi / 2))
    camera = Camera("all", projection, Pose(), CODING)
    codes = np.full((48, 96), CODING.codes(np.array(3.0)), np.uint16)
    view = View(camera, see(camera_row(1, (96, 48))[0]).texture, codes)
    model, _report = model_of([camera], Frame(0, (view,)))
    behind = Camera("behind", Perspective.from_fov(80, 60, 1.0), Pose.from_euler((0, 0, 0), np.pi, 0, 0), CODING)
    assert not np.isnan(pbi_of(model, behind)[0]).any()
