"""A moving camera's views may serve updates of the model only (section 4.2)."""

from __future__ import annotations

import dataclasses

import pytest
from farside.engine.pipeline.engine import Engine
from farside.engine.pipeline.moving_views import MovingViews
from farside.engine.rig.camera import Pose
from farside.engine.settings import Settings
from support.rooms import camera_row, frame


def poses_of(index, cameras, moving):
    """The cameras in a frame: some of them move along y."""
    return [
        dataclasses.replace(c, pose=c.pose.translated((0.0, 0.05 * index, 0.0))) if k in moving else c
        for k, c in enumerate(cameras)
    ]


def drawn(moving, count=4, **changes):
    """The views from which a picture at the last camera's place is drawn after each frame."""
    cameras = camera_row(3)
    engine = Engine(cameras, Settings(n_render=3, **changes))
    target = dataclasses.replace(cameras[2], name="t", pose=Pose((0.0, 0.35, 0.0)))
    views = []
    for index in range(count):
        engine.update(frame(index, poses_of(index, cameras, moving), 0.1), {"t": target})
        views.append(set(engine.render_camera(target, "t").report.views))
    engine.close()
    return views


def test_a_moving_camera_serves_updates_only():
    assert drawn({2}, draw_moving=False) == [{"v0", "v1", "v2"}] + [{"v0", "v1"}] * 3


def test_by_default_it_is_drawn_like_others():
    assert drawn({2}) == [{"v0", "v1", "v2"}] * 4


def test_without_fixed_cameras_all_are_drawn():
    assert drawn({0, 1, 2}, draw_moving=False) == [{"v0", "v1", "v2"}] * 4


@pytest.mark.parametrize("name", ["balanced", "paper"])
def test_the_paper_draws_fixed_cameras_only(name):
    assert Settings.preset(name).draw_moving == (name != "paper")


def test_whether_some_cameras_stand_is_known():
    cameras, moving = camera_row(2), MovingViews()
    assert not moving.some_stand  # none was seen
    moving.note(frame(0, cameras))
    assert moving.some_stand
    for index, stands in ((1, True), (2, False)):
        places = poses_of(index, cameras, range(index))
        moving.note(frame(index, places))
        assert moving.some_stand is stands
