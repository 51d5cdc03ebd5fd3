from __future__ import annotations

import numpy as np
import pytest
from farside.clients.bench import ghosts
from farside.engine.background.model import BackgroundModel
from farside.engine.evaluation.ghosts import GhostSample, ghost_pixels, inside_cameras, plot_ghosts, watch_ghosts
from farside.engine.geometry.scene_scale import Scene
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, render_view, twin_frame
from support.rooms import BOX_X, camera_row, frame, see

FRAMES = (*range(0, 120, 10), 111, 112, 113)  # the last ones: a round after the last long stride
SETTINGS = Settings.preset("balanced", n_update=5)  # of ten cameras: a round is two frames


@pytest.fixture(scope="module")
def twin():
    return make_twin("hijack", 0.06)


@pytest.fixture(scope="module")
def samples(twin):
    return list(watch_ghosts(twin, inside_cameras(twin), FRAMES, 1, SETTINGS))


def mean(samples, name, index):
    return np.mean([getattr(s, name) for s in samples if s.frame == index])


def test_who_walked_away_leaves_no_ghost_and_holes_close(samples):
    last = FRAMES[-1]
    assert mean(samples, "ghosts", last) < 1e-3
    assert max(mean(samples, "ghosts", index) for index in FRAMES) < 3e-3  # at most a round late
    assert mean(samples, "standing", last) < 0.6 * mean(samples, "standing", 0)
    assert mean(samples, "holes_model", last) < 0.9 * mean(samples, "holes_model", 0)


def test_without_updates_there_would_be_ghosts(twin, samples):
    camera, last = inside_cameras(twin)[0], FRAMES[-1]
    first = twin_frame(twin, 0)
    model = BackgroundModel(twin.sources, SETTINGS, Scene.of(twin.sources, SETTINGS, first))
    model.update(first)
    still = render_view(twin.scene, camera, 0.0, samples=1, background_only=True)
    _holes, nearer, nearer_than_now = ghost_pixels(model, still, twin.truth(camera, last))
    ghosts = np.mean(nearer & nearer_than_now)
    updated = next(s.ghosts for s in samples if (s.camera, s.frame) == (camera.name, last))
    assert ghosts > max(5e-3, 10 * updated)


def test_ghosts_are_what_neither_the_background_nor_the_present_explains():
    cameras = camera_row()
    first = frame(0, cameras, box_y=0.0)
    settings = Settings(n_init=3)
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, first))
    model.update(first)
    empty, there, elsewhere = see(cameras[1]), see(cameras[1], box_y=0.0), see(cameras[1], box_y=0.9)
    _holes, nearer, nearer_than_now = ghost_pixels(model, empty, there)
    box = there.camera.depth.depth(there.codes) < BOX_X + 0.1
    assert np.count_nonzero(nearer) > 0
    assert not np.any(nearer & ~box)
    assert not np.any(nearer & nearer_than_now)
    np.testing.assert_array_equal(ghost_pixels(model, empty, elsewhere)[2] & nearer, nearer)


def test_the_command_prints_a_table_and_draws(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    ghosts.command("hijack", scale=0.03, frames=2, report=tmp_path / "new", quality="fast")
    printed = capsys.readouterr().out
    assert "hijack at scale 0.03" in printed
    assert "ghosts" in printed
    assert [path.name for path in (tmp_path / "new").iterdir()] == ["ghosts_hijack.png"]


def test_the_plot_is_a_picture(tmp_path):
    pytest.importorskip("matplotlib")
    samples = [GhostSample("t0", k, 0.1 / (k + 1), 0.2, 0.1, 0.05, 0.01) for k in range(5)]
    plot_ghosts(samples, "title", tmp_path / "plot.png")
    assert (tmp_path / "plot.png").read_bytes().startswith(b"\x89PNG")
