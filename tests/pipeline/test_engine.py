"""The engine on small scenes: pictures at the cameras, both eyes, refusals, threads, holes that the model fills."""

from __future__ import annotations

import dataclasses
import math
import threading

import numpy as np
import pytest
from farside.engine.evaluation.metrics import psnr
from farside.engine.geometry import mesh, prepared_view
from farside.engine.geometry.triangulator import Triangulator
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Perspective, Pose
from farside.engine.rig.frame import Frame
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, twin_frame
from support.rooms import BOX_X, WALL_X, WALL_Y, camera_row, frame

HEAD = StereoView.symmetric(Pose(), 48, 40, 1.2, 0.2)


def engine_with(cameras, *frames, viewers=None, **settings):
    engine = Engine(cameras, Settings(**settings))
    for one in frames:
        engine.update(one, viewers)
    return engine


@pytest.mark.parametrize(("name", "scale", "count"), [("museum", 0.06, 24), ("painter", 0.2, 6)])
def test_a_virtual_camera_at_a_reference_camera_gives_its_picture(name, scale, count):
    twin = make_twin(name, scale=scale, depth_noise=0.0)
    first = twin_frame(twin, 0, twin.source_names[:count])
    engine = engine_with(twin.sources[:count], first, n_init=2)
    for k in (0, count // 2):
        view = first.views[k]
        picture = engine.render_camera(view.camera)
        assert picture.report.views[0] == view.camera.name
        assert psnr(view.texture, picture.texture)[0] >= 45.0
        assert picture.report.holes_filled == 0.0


def test_eyes_are_offset_to_the_left_and_to_the_right():
    cameras = camera_row()
    engine = engine_with(cameras, frame(0, cameras, 0.0), background=False)
    pair = engine.render(HEAD)
    for picture, y in ((pair.left, 0.1), (pair.right, -0.1)):
        alone = engine.render_camera(dataclasses.replace(picture.camera, pose=Pose((0.0, y, 0.0))))
        assert picture.camera.pose.position == pytest.approx((0.0, y, 0.0))
        np.testing.assert_array_equal(picture.disparity, alone.disparity)
        np.testing.assert_array_equal(picture.texture.y, alone.texture.y)
    assert pair.frame_index == 0
    # The box is farther to the right in the left eye's picture, by f * ipd * disparity.
    shift = HEAD.left.fx * HEAD.ipd / BOX_X
    columns = [np.flatnonzero(p.disparity[20] > 1.1 / WALL_X).mean() for p in (pair.left, pair.right)]
    assert columns[0] - columns[1] == pytest.approx(shift, abs=1.0)


def moving(*views):
    """A function that returns the only viewer's view; each call returns the next of `views`."""
    coming = list(views)
    return lambda: {"me": coming.pop(0)}


@pytest.mark.parametrize("quality", ["fast", "balanced", "best"])
def test_a_picture_makes_nothing_that_the_update_could_have_made(quality, monkeypatch):
    """For where the head is when the update ends, not where it was when it began."""
    cameras = camera_row()
    engine = Engine(cameras, Settings.preset(quality, n_render=2))
    before, after = (HEAD.moved(Pose.from_euler((0.0, y, 0.0), 0.3 * y, 0.0, 0.0)) for y in (0.5, -0.5))
    made = []
    bound, anew, again = mesh.bound_blocks, prepared_view.triangulate, Triangulator.triangulate
    monkeypatch.setattr(mesh, "bound_blocks", lambda *given: made.append("spheres") or bound(*given))
    monkeypatch.setattr(prepared_view, "triangulate", lambda *given, **how: made.append("mesh") or anew(*given, **how))
    monkeypatch.setattr(Triangulator, "triangulate", lambda *given: made.append("surface") or again(*given))
    engine.update(frame(0, cameras, 0.0), {"me": before})
    assert set(made) >= {"spheres", "surface"}
    assert set(engine.render(before, "me").left.report.views) != set(engine.render(after, "me").left.report.views)
    engine.update(frame(1, cameras, 0.1), moving(before, after))
    made.clear()
    engine.render(after, "me")
    assert made == []


def test_eyes_turn_with_the_head():
    turned = HEAD.moved(Pose.from_euler((1.0, 2.0, 3.0), math.pi / 2, 0.0, 0.0))
    left, right = turned.eyes(camera_row()[0].depth)
    np.testing.assert_allclose(left.pose.position, (0.9, 2.0, 3.0), atol=1e-12)
    np.testing.assert_allclose(right.pose.position, (1.1, 2.0, 3.0), atol=1e-12)
    assert left.pose.orientation == right.pose.orientation == turned.pose.orientation


@pytest.mark.parametrize("ask", [lambda e: e.render(HEAD), lambda e: e.render_camera(camera_row()[0])])
def test_rendering_before_any_frame_is_refused(ask):
    engine = Engine(camera_row())
    assert engine.frame_index is None
    with pytest.raises(ValueError, match="frame: none"):
        ask(engine)
    with pytest.raises(ValueError, match="mesh: "):
        engine.mesh()


def test_an_engine_needs_cameras():
    with pytest.raises(ValueError, match="cameras: none"):
        Engine([])


def spoilt(first, how):
    """Frames that do not fit the rig."""
    views = list(first.views)
    if how == "missing":
        views.pop()
    elif how == "order":
        views.reverse()
    elif how == "projection":
        camera = dataclasses.replace(views[1].camera, projection=Perspective(96, 64, 1.0, 1.0, 0.0, 0.0))
        views[1] = dataclasses.replace(views[1], camera=camera)
    else:
        camera = dataclasses.replace(views[1].camera, depth=dataclasses.replace(views[1].camera.depth, near=0.1))
        views[1] = dataclasses.replace(views[1], camera=camera)
    return Frame(7, tuple(views))


@pytest.mark.parametrize("how", ["missing", "order", "projection", "depth"])
def test_views_that_do_not_fit_are_refused_and_change_nothing(how):
    cameras = camera_row()
    first = frame(0, cameras, 0.0)
    engine = engine_with(cameras, first, viewers={"me": HEAD})
    before, status = engine.render(HEAD, "me"), engine.status()
    with pytest.raises(ValueError, match="frame 7: view"):
        engine.update(spoilt(first, how), {"me": HEAD})
    assert engine.frame_index == 0
    assert engine.status() == status
    after = engine.render(HEAD, "me")
    np.testing.assert_array_equal(before.left.texture.y, after.left.texture.y)
    engine.update(frame(1, cameras, 0.5), {"me": HEAD})
    assert engine.frame_index == 1


def test_refused_before_the_first_frame_too():
    cameras = camera_row()
    engine = Engine(cameras)
    with pytest.raises(ValueError, match="frame 7"):
        engine.update(spoilt(frame(0, cameras), "missing"))
    assert engine.frame_index is None
    assert engine.update(frame(0, cameras)).frame_index == 0


def test_what_was_uncovered_earlier_fills_holes():
    """The box stands still, goes away, and stands there again: behind it is what was seen meanwhile."""
    cameras = camera_row(2, spacing=0.2)
    viewer = dataclasses.replace(cameras[0], name="viewer", pose=Pose((0.0, 0.9, 0.0)))
    frames = [frame(0, cameras, 0.0), frame(1, cameras, 1.2), frame(2, cameras, 1.2), frame(3, cameras, 0.0)]
    holes = {}
    for model in (False, True):
        settings = {"background": model, "fill": "none", "n_update": 2, "baseline_m": 1.0}
        engine = engine_with(cameras, *frames, viewers={"v": viewer}, **settings)
        picture = engine.render_camera(viewer, "v")
        holes[model] = picture.holes()[:, 16:].mean()  # the columns before are out of both cameras' sight
        if model:
            assert picture.report.holes_warped > picture.report.holes_backdrop
            assert picture.report.holes_filled == picture.report.holes_backdrop
            uncovered = picture.holes(warped=True) & ~picture.holes()
            assert uncovered.sum() > 20
            assert np.median(np.abs(picture.texture.y[uncovered].astype(int) - WALL_Y)) <= 1
            distance = 1 / picture.disparity[uncovered]
            assert np.median(distance) == pytest.approx(WALL_X, rel=0.08)  # pushed back a little
        else:
            assert picture.report.holes_warped == picture.report.holes_backdrop
    assert holes[False] > 0.02
    assert holes[True] < 0.1 * holes[False]


def test_settings_switch_filling_and_the_model_off():
    cameras = camera_row(1)
    viewer = dataclasses.replace(cameras[0], pose=Pose((0.0, 0.6, 0.0)))
    engine = engine_with(cameras, frame(0, cameras, 0.0), viewers={"v": viewer}, background=False, fill="none")
    report = engine.render_camera(viewer, "v").report
    assert report.holes_warped == report.holes_backdrop == report.holes_filled > 0.1
    assert engine.status()["background"] == {}
    with pytest.raises(ValueError, match="mesh: "):
        engine.mesh()
    engine = engine_with(cameras, frame(0, cameras, 0.0), background=False)
    assert engine.render_camera(viewer).report.holes_filled == 0.0


def test_a_viewer_that_sees_nothing_gets_a_grey_picture():
    cameras = camera_row()
    engine = engine_with(cameras, frame(0, cameras), background=False)
    away = dataclasses.replace(cameras[0], pose=Pose.from_euler((0.0, 0.0, 0.0), math.pi, 0.0, 0.0))
    picture = engine.render_camera(away)
    assert picture.holes().all()
    assert (picture.texture.y == 512).all()
    assert (picture.codes() == 0).all()
    assert picture.report.holes_filled == 1.0


def test_rendering_goes_on_while_frames_come():
    """Every picture is one of the frames' pictures, whole: the box stands where that frame has it."""
    cameras = camera_row()
    frames = [frame(k, cameras, y) for k, y in enumerate((-0.5, 0.0, 0.5))]
    expected = []
    for one in frames:
        engine = engine_with(cameras, one, background=False)
        expected.append(engine.render(HEAD).left.disparity)
    engine = engine_with(cameras, frames[0], background=False)
    stop, failures, pictures = threading.Event(), [], [0, 0]

    def look(number):
        while not stop.is_set():
            pair = engine.render(HEAD)
            if not np.array_equal(pair.left.disparity, expected[pair.frame_index % 3]):
                failures.append(pair.frame_index)
            pictures[number] += 1

    threads = [threading.Thread(target=look, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    index = 0
    try:
        while (index < 4 or min(pictures) < 4) and not failures and all(thread.is_alive() for thread in threads):
            index += 1
            engine.update(dataclasses.replace(frames[index % 3], index=index), {"me": HEAD})
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    assert not failures
    assert min(pictures) > 3


def test_the_models_mesh_can_be_taken_while_frames_come():
    cameras = camera_row()
    engine = engine_with(cameras, frame(0, cameras, 0.0))
    stop, meshes, failures = threading.Event(), [], []

    def take():
        try:
            while not stop.is_set():
                mesh = engine.mesh()
                assert mesh.triangles.max() < len(mesh.vertices) == len(mesh.colours)
                engine.render(HEAD, "me")
                meshes.append(len(mesh.triangles))
        except BaseException as error:
            failures.append(error)

    thread = threading.Thread(target=take)
    thread.start()
    try:
        for index in range(1, 25):
            engine.update(frame(index, cameras, 0.1 * (index % 9) - 0.4), {"me": HEAD})
    finally:
        stop.set()
        thread.join()
    assert not failures
    assert meshes
