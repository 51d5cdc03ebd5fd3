"""The same pipeline with another renderer, slow and readable, whose pictures agree with those of the kernels."""

from __future__ import annotations

import math
import threading

import numpy as np
import pytest
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Pose
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from oracle.renderer import OracleRenderer
from support.rooms import camera_row, frame

HEAD = StereoView.symmetric(Pose((0.0, 0.9, 0.0)), 40, 32, 1.2, 0.2)
PLAIN = {
    "fill": "none", "settles": False, "rims": False, "overdraw": False, "blend": 1, "antialias": "none",
    "prefilter": False, "n_update": 2, "exposure_s": 0.0, "baseline_m": 1.0,
}  # fmt: skip


def pictures(renderer):
    """A pair and a single picture after a box has come, gone and come again; and what the engine is."""
    cameras = camera_row(2, spacing=0.2)
    engine = Engine(cameras, Settings(**PLAIN), renderer=renderer)
    for index, box in enumerate((0.0, 1.2, 0.0)):
        engine.update(frame(index, cameras, box), {"me": HEAD})
    pair = engine.render(HEAD, "me")
    single = engine.render_camera(cameras[1])
    engine.close()
    return pair, single


def test_a_renderer_of_another_kind_draws_what_the_pipeline_asks_for():
    slow = OracleRenderer()
    before = set(threading.enumerate())
    pair, single = pictures(slow)
    assert set(threading.enumerate()) <= before  # threads belong to the renderer
    frames = [("prepare", ("me",)), ("warm", "head", (0, 1))]
    selected = slow.asked[1][2]
    assert [asked[:2] for asked in slow.asked[:6]] == [asked[:2] for asked in 3 * frames]
    assert slow.asked[6] == ("render", ("left", "right"), "me", selected)
    assert slow.asked[7][:3] == ("render", ("v1",), None)
    assert slow.asked[8:] == [("close",)]
    assert pair.frame_index == 2
    assert "select" in pair.stages
    for drawn, expected in zip((pair.left, pair.right, single), _by_kernels(), strict=True):
        assert drawn.camera == expected.camera
        assert drawn.report.views == expected.report.views
        both = ~drawn.holes() & ~expected.holes()
        assert np.mean(drawn.holes() != expected.holes()) < 0.03
        apart = np.abs(drawn.disparity - expected.disparity)[both]
        assert np.mean(apart > 0.02) < 0.03  # outlines
        assert np.median(apart) < 1e-3
        luma = np.abs(drawn.texture.y.astype(int) - expected.texture.y)[both]
        assert np.mean(luma > 8) < 0.05


def _by_kernels():
    pair, single = pictures(None)
    # There is a hole for the backdrop to show in.
    assert pair.left.report.holes_warped > pair.left.report.holes_backdrop
    return pair.left, pair.right, single


def test_what_a_renderer_raises_reaches_who_asked():
    class Broken(OracleRenderer):
        def prepare(self, content):
            raise RuntimeError("out of memory")

    cameras = camera_row()
    engine = Engine(cameras, Settings(**PLAIN), renderer=Broken())
    with pytest.raises(RuntimeError, match="out of memory"):
        engine.update(frame(0, cameras, 0.0), {"me": HEAD})
    assert engine.frame_index is None


def test_a_viewer_who_looks_away_is_drawn_nothing():
    cameras = camera_row()
    engine = Engine(cameras, Settings(**PLAIN), renderer=OracleRenderer())
    away = HEAD.moved(Pose.from_euler((0.0, 0.0, 0.0), math.pi, 0.0, 0.0))
    engine.update(frame(0, cameras), {"me": away})
    assert engine.render(away, "me").left.holes().all()
