"""`farside bench moving`: what a moving camera adds, on a small twin and a small walk."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.clients.bench.moving import command
from farside.engine.evaluation.metrics import psnr
from farside.engine.evaluation.moving import is_walk, moving_names, play_rig, play_walk, side_by_side
from farside.engine.evaluation.twin_recording import TwinRecording
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Pose
from farside.engine.settings import Settings
from farside.engine.synth import make_twin
from support.recordings import MemoryRecording
from support.rooms import camera_row, frame
from support.shared import SHARED, needs_shared

SETTINGS = Settings.preset("balanced", n_render=2, n_init=4)


class Walk(MemoryRecording):
    """One camera that walks along a wall with a box before it."""

    name = "walk"

    def __init__(self, count=16):
        camera = camera_row(1)[0]
        self._all = [Pose((0.0, 0.25 * k, 0.0)) for k in range(count)]
        super().__init__([frame(k, [dataclasses.replace(camera, pose=p)], 0.4) for k, p in enumerate(self._all)])

    def poses(self, name):
        return self._all

    def texture(self, name, index):
        return self._frames[index].views[0].texture


@pytest.fixture(scope="module")
def twin():
    return TwinRecording(make_twin("gymnasium-a", 0.06))


@pytest.fixture(scope="module")
def moments(twin):
    cameras = [twin.camera(name) for name in ("t3", "t4")]
    return list(play_rig(twin, cameras, 42, 21, SETTINGS))


def test_a_twins_moving_camera_closes_holes(twin, moments):
    assert moving_names(twin) == ["v4"]
    assert [moment.frame for moment in moments if moment.holes] == [20, 41]
    without, with_it = np.sum(list(moments[-1].holes.values()), axis=0)
    assert with_it < without / 3
    for pictures in moments[-1].pictures.values():
        assert all("v4" not in picture.report.views for picture in pictures)


def test_pictures_are_not_worse_where_the_view_of_a_camera_far_above_is_drawn_too(twin):
    """Its surfaces across depth edges would be curtains from people's heads down to the floor."""
    rig = [twin.camera(name) for name in twin.source_names]
    engines = [Engine(rig, Settings.preset("balanced", draw_moving=moving)) for moving in (False, True)]
    targets = {name: twin.camera(name) for name in ("t0", "t1", "t4")}
    for one in twin.frames(0, 3):
        for engine in engines:
            engine.update(one, targets)
    for name, camera in targets.items():
        pictures = [engine.render_camera(camera, name) for engine in engines]
        assert ["v4" in picture.report.views for picture in pictures] == [False, True]
        without, with_it = (psnr(twin.texture(name, 2), picture.texture)[0] for picture in pictures)
        assert with_it > without - 0.3


def test_its_triangles_are_counted(moments):
    assert sum(moment.added for moment in moments) > 0
    assert all(moment.added == 0 for moment in moments if moment.frame % 5)  # each of five cameras has a turn
    assert moments[-1].p_pbs[1] > 0
    assert all(min(moment.update_ms) > 0 for moment in moments)


def test_a_rig_needs_fixed_and_moving_cameras(twin):
    still = MemoryRecording([frame(0, camera_row(2))])
    for recording in (still, Walk()):
        with pytest.raises(ValueError, match=r"moving views .*: expected some of .*, not all"):
            list(play_rig(recording, [], 1, 1, SETTINGS))


def test_a_viewer_who_stays_behind_sees_the_walk():
    walk = Walk()
    assert is_walk(walk)
    samples = list(play_walk(walk, 5, Settings.preset("balanced")))
    assert [sample.frame for sample in samples] == [4, 9, 14]
    assert samples[0].unseen > 0.3
    for sample in samples[:2]:
        assert sample.holes < 0.1 * sample.unseen
        assert sample.psnr_modelled > sample.psnr_filled
    # Where nothing is unseen, there is no error.
    assert samples[0].pictures[0] is walk.texture("v0", 4)


def test_a_walk_needs_frames():
    with pytest.raises(ValueError, match="frames: 2, 1 of them held out: expected two or more"):
        list(play_walk(Walk(2), 2, SETTINGS))


@needs_shared
def test_the_model_of_a_real_walk_is_better_than_filling():
    from farside.engine.io.recording import open_recording

    samples = list(play_walk(open_recording(SHARED / "real" / "hololens_office"), 5, Settings.preset("balanced")))
    unseen, holes, filled, modelled = (
        np.mean([getattr(sample, name) for sample in samples])
        for name in ("unseen", "holes", "psnr_filled", "psnr_modelled")
    )
    assert holes < 0.5 * unseen
    assert modelled > filled + 3.0


def test_the_table_and_pictures(tmp_path, capsys):
    command("gymnasium-a", scale=0.03, frames=6, every=3, report=tmp_path)
    said = capsys.readouterr().out
    assert "gymnasium-a, quality balanced" in said
    names = {path.name for path in tmp_path.iterdir()}
    assert {"moving_gymnasium-a_t0_2.png", "moving_gymnasium-a_t4_5.png"} <= names


def test_pictures_lie_side_by_side_with_blue_holes(moments):
    pictures = moments[-1].pictures["t4"]
    shown = side_by_side(pictures)
    width = pictures[0].camera.width
    assert shown.shape == (pictures[0].camera.height, 2 * width, 3)
    blue = (shown == (150, 215, 255)).all(axis=-1)
    assert (blue[:, :width] >= pictures[0].holes()).all()
