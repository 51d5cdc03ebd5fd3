"""Surfaces keep the colours of their own capture, even when their camera has moved and sees something else."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.model import BackgroundModel
from farside.engine.background.pbs import ProbableBackgroundSurface
from farside.engine.geometry.scene_scale import Scene
from farside.engine.io.coloured_meshes import srgb_from_ycbcr
from farside.engine.kernels.base.tone import IDENTITY
from farside.engine.rig.camera import Pose
from farside.engine.rig.frame import Frame, View
from farside.engine.settings import Settings
from support.models import sheets
from support.rooms import WALL_X, WALL_Y, camera_row, see, texture_of
from support.slow_tracer import SlowTracer

LATER_Y = 700
GAP = np.s_[24:40, 36:60]  # where the first capture has no depth; the second sees it at about the same place
INSIDE = np.s_[28:36, 42:54]


def wall(camera, luma, *, gap):
    """A view of the wall in one colour, with or without a gap in its depth."""
    codes = see(camera).codes.copy()
    if gap:
        codes[GAP] = 0
    return View(camera, texture_of(np.full(codes.shape, luma)), codes)


def recaptured():
    """A model of one camera that has moved and begun a second capture, and the camera before and after."""
    first = camera_row(1)[0]
    begin = Frame(0, (wall(first, WALL_Y, gap=True),))
    settings = Settings(n_init=1)
    model = BackgroundModel([first], settings, Scene.of([first], settings, begin))
    model.update(begin)
    second = dataclasses.replace(first, pose=Pose((0.0, 0.02, 0.0)))
    model.update(Frame(1, (wall(first, WALL_Y, gap=True),)))
    model.recapture(0, wall(second, LATER_Y, gap=True), np.array(IDENTITY))
    return model, first, second


def luma_of(model, camera):
    view = model.render_pbi(camera).view
    return view.texture.y, view.camera.depth.depth(view.codes)


def test_a_camera_has_a_newer_capture_and_the_older_one_stays():
    model, first, second = recaptured()
    assert [(capture.number, capture.camera, capture.pose) for capture in model.captures] == [
        (0, 0, first.pose), (1, 0, second.pose),
    ]  # fmt: skip
    assert model.cameras == (second,)
    np.testing.assert_array_equal(np.unique(model.captures[0].image.texture.y), WALL_Y)
    np.testing.assert_array_equal(np.unique(model.captures[1].image.texture.y), LATER_Y)


def test_triangles_of_the_first_capture_keep_its_colours():
    model, first, second = recaptured()
    luma, depth = luma_of(model, first)
    there = ~np.isnan(depth)
    assert there.mean() > 0.8
    np.testing.assert_array_equal(luma[there], WALL_Y)
    expected = srgb_from_ycbcr(np.array([[WALL_Y, WALL_Y // 2, WALL_Y // 2 + 1]], np.float32))
    np.testing.assert_array_equal(model.mesh().colours, np.broadcast_to(expected, model.mesh().colours.shape))
    for index in range(2, 6):  # turns at its new place do not change that
        report = model.update(Frame(index, (wall(second, LATER_Y, gap=True),)))
        assert report.group == ("v0",)
    np.testing.assert_array_equal(luma_of(model, first)[0][there], WALL_Y)
    assert len(model.mesh().triangles) > 0


def test_what_the_second_capture_uncovers_has_its_own_colours():
    model, first, second = recaptured()
    assert np.isnan(luma_of(model, first)[1][INSIDE]).all()
    report = model.update(Frame(2, (wall(second, LATER_Y, gap=False),)))
    assert report.accepted > 0
    luma, depth = luma_of(model, first)
    np.testing.assert_allclose(depth[INSIDE], WALL_X, atol=0.02)
    np.testing.assert_array_equal(luma[INSIDE], LATER_Y)
    outside = np.ones(luma.shape, bool)
    outside[20:44, 32:64] = False
    np.testing.assert_array_equal(luma[outside & ~np.isnan(depth)], WALL_Y)
    colours = np.unique(model.mesh().colours, axis=0)
    expected = [[[y, y // 2, y // 2 + 1]] for y in (WALL_Y, LATER_Y)]
    expected = srgb_from_ycbcr(np.array(expected, np.float32).reshape(-1, 3))
    np.testing.assert_array_equal(colours, np.sort(expected, axis=0))


def test_what_a_camera_that_has_moved_sees_anew_has_its_colours():
    cameras = camera_row(2)
    settings = Settings(n_init=2)
    begin = Frame(0, tuple(wall(camera, WALL_Y, gap=True) for camera in cameras))
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, begin))
    model.update(begin)
    moved = dataclasses.replace(cameras[0], pose=Pose((0.0, -0.3, 0.0)))
    for index in range(1, 5):
        report = model.update(Frame(index, (wall(moved, LATER_Y, gap=False), wall(cameras[1], WALL_Y, gap=True))))
        assert report.group == (cameras[(index + 1) % 2].name,)
    assert model.cameras[0].pose == moved.pose
    luma, depth = luma_of(model, cameras[1])
    there = ~np.isnan(depth)
    assert set(np.unique(luma[there])) == {WALL_Y, LATER_Y}
    assert (luma[there] == WALL_Y).mean() > 0.8  # what was there before keeps its colours


def test_a_capture_needs_a_first_frame_and_a_view_of_its_camera():
    cameras = camera_row(2)
    begin = Frame(0, tuple(wall(camera, WALL_Y, gap=False) for camera in cameras))
    settings, tone = Settings(n_init=2), np.array(IDENTITY)
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, begin))
    with pytest.raises(ValueError, match="camera 0: no capture to follow: expected a first frame"):
        model.recapture(0, begin.views[0], tone)
    model.update(begin)
    with pytest.raises(ValueError, match="camera 2: expected 0 to 1"):
        model.recapture(2, begin.views[0], tone)
    with pytest.raises(ValueError, match=r"view v1: .*: expected .*'v0'"):
        model.recapture(0, begin.views[1], tone)
    assert len(model.captures) == 2
    assert model.cameras == tuple(cameras)


class Numbers(SlowTracer):
    """A tracer that notes under which numbers surfaces are put."""

    def __init__(self):
        super().__init__()
        self.taken = []

    def set(self, geometry, surface, *, lasting):
        self.taken.append(geometry)
        super().set(geometry, surface, lasting=lasting)


@pytest.mark.parametrize("cameras", [1, 3])
def test_each_surface_of_a_capture_is_a_geometry_of_its_own(cameras):
    tracer, (mesh, *_) = Numbers(), sheets(0)
    pbs = ProbableBackgroundSurface(cameras, tracer)
    surfaces = [(capture, static) for static in (True, False) for capture in range(4 * cameras)]
    for _ in range(2):  # what is put again takes its own place
        for capture, static in surfaces:
            (pbs.set_static if static else pbs.set_progressive)(capture, capture % cameras, mesh)
        pbs.commit()
    first, second = np.split(np.array(tracer.taken), 2)
    np.testing.assert_array_equal(first, second)
    assert sorted(first) == list(range(len(surfaces)))  # and no number is left out
