"""Settings that change while the engine runs, and settings of the update interval and picture sizes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.pbi import imaginary_camera
from farside.engine.geometry.prepared_view import pixels_per_radian
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Pose
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import PER_PICTURE, Settings
from support.rooms import camera_row, frame

HEAD = StereoView.symmetric(Pose(), 48, 40, 1.2, 0.2)


def same(a, b):
    return all(
        np.array_equal(getattr(one.texture, plane), getattr(two.texture, plane))
        for one, two in ((a.left, b.left), (a.right, b.right))
        for plane in ("y", "cb", "cr")
    )


@pytest.fixture
def engine():
    cameras = camera_row()
    engine = Engine(cameras, Settings.preset("balanced", settles=False))
    engine.update(frame(0, cameras, 0.0), {"me": HEAD})
    return engine


@pytest.mark.parametrize(
    "change",
    [{"n_render": 1}, {"overdraw": False, "rims": False}, {"antialias": "samples"}, {"fill": "none"}, {"blend": 1}],
)
def test_what_only_rendering_reads_changes_with_the_next_picture(engine, change):
    """The pictures are those of an engine that had these settings from the start; the model is not touched."""
    assert set(change) <= set(PER_PICTURE)
    before, model, counts = engine.render(HEAD, "me"), engine.model, engine.model.counts()
    first = engine.settings
    engine.retune(dataclasses.replace(first, **change))
    after = engine.render(HEAD, "me")
    assert engine.model is model
    assert engine.model.counts() == counts
    cameras = camera_row()
    other = Engine(cameras, dataclasses.replace(first, **change))
    other.update(frame(0, cameras, 0.0), {"me": HEAD})
    assert same(after, other.render(HEAD, "me"))
    engine.retune(first)
    assert same(engine.render(HEAD, "me"), before)


@pytest.mark.parametrize("change", [{"tolerance_px": 1.0}, {"n_init": 2}, {"update_interval": 2}, {"delta_m": 0.1}])
def test_what_the_model_and_the_meshes_are_made_by_is_refused(engine, change):
    before = engine.settings
    with pytest.raises(ValueError, match=rf"{next(iter(change))}: .*which stays while the engine runs"):
        engine.retune(dataclasses.replace(before, **change))
    assert engine.settings is before


def test_a_scaled_picture_has_the_field_of_view_and_the_cameras_say_its_size(engine):
    engine.retune(dataclasses.replace(engine.settings, output_scale=0.5))
    pair = engine.render(HEAD, "me")
    for eye, asked in ((pair.left, HEAD.left), (pair.right, HEAD.right)):
        p = eye.camera.projection
        assert (p.width, p.height) == (asked.width // 2, asked.height // 2) == eye.texture.y.shape[::-1]
        assert p.width / p.fx == pytest.approx(asked.width / asked.fx)
        assert p.height / p.fy == pytest.approx(asked.height / asked.fy)
    one = engine.render_camera(camera_row()[0])
    assert one.camera.width == camera_row()[0].width // 2


def test_scaled_pictures_are_those_of_a_viewer_who_asked_for_that_size():
    cameras, pairs = camera_row(), []
    for scale, head in ((0.5, HEAD), (1.0, HEAD.scaled(0.5))):
        engine = Engine(cameras, Settings.preset("balanced", output_scale=scale))
        for k, y in enumerate((0.0, 0.4)):
            engine.update(frame(k, cameras, y), {"me": head})
        pairs.append(engine.render(head, "me"))
    assert same(*pairs)


def test_the_model_takes_every_so_many_frames_and_pictures_show_each():
    cameras = camera_row()
    engine = Engine(cameras, Settings.preset("balanced", update_interval=3, background=True))
    groups = []
    for k in range(8):
        report = engine.update(frame(k, cameras, 0.1 * k), {"me": HEAD}).background
        groups.append(len(report.group))
        assert engine.render(HEAD, "me").frame_index == k
    assert groups == [len(cameras), 0, 0, 1, 0, 0, 1, 0]


def test_a_camera_that_moves_waits_for_its_turn_and_is_no_evidence_until_then():
    cameras = camera_row(3)
    engine = Engine(cameras, Settings.preset("balanced", update_interval=3))
    engine.update(frame(0, cameras, 0.0))
    moved = [cameras[0], dataclasses.replace(cameras[1], pose=Pose((0.0, 0.05, 0.0))), cameras[2]]
    for index in range(1, 6):
        one = frame(index, moved, 0.0)
        assert bool(engine.update(one).background.group) == (index % 3 == 0)
        assert engine.model.images(one)[0] == [0, 2]  # its maximum depth image is that of another place
    assert engine.update(frame(6, moved, 0.0)).background.group == ("v1",)
    assert engine.model.images(one)[0] == [0, 1, 2]


def test_the_margin_is_what_the_pbi_sees_beyond_the_eyes():
    coding = camera_row()[0].depth
    narrow, wide = (imaginary_camera(HEAD, 0.0, 30.0, coding, 1.0, margin) for margin in (0.0, 0.2))
    assert pixels_per_radian(narrow) == pytest.approx(pixels_per_radian(wide), rel=0.05)
    half = [np.arctan(0.5 * c.width / c.projection.fx) for c in (narrow, wide)]
    assert half[1] - half[0] == pytest.approx(0.2, abs=0.03)
    cameras, rays = camera_row(), []
    for margin in (0.0, 0.2):
        engine = Engine(cameras, Settings.preset("balanced", pbi_margin_rad=margin))
        engine.update(frame(0, cameras, 0.0), {"me": HEAD})
        rays.append(engine.front.content.pbis["me"].view.camera.width)
    assert rays[0] < rays[1]


@pytest.mark.parametrize(
    ("name", "value"), [("output_scale", 0.0), ("output_scale", 9.0), ("pbi_margin_rad", -0.1), ("update_interval", 0)]
)
def test_knobs_out_of_range_are_named(name, value):
    with pytest.raises(ValueError, match=rf"{name}: {value}: expected"):
        Settings(**{name: value})
