"""The benchmark of the model under noise: its figures on known cases, and the command's output."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.clients.bench import noise
from farside.engine.background.model import BackgroundModel
from farside.engine.evaluation.ghosts import inside_cameras
from farside.engine.evaluation.noise import model_error, uncovered_psnr, watch_noise
from farside.engine.geometry.scene_scale import Scene
from farside.engine.settings import Settings
from farside.engine.synth import make_twin
from support.rooms import WALL_X, WALL_Y, camera_row, frame, see, texture_of


def test_psnr_of_some_pixels_forgives_a_shift():
    truth = np.full((24, 32), 300)
    truth[8:16, 10:20] = 800
    where = np.zeros(truth.shape, bool)
    where[8:16, 10:20] = True
    far_off, off = truth.copy(), truth.copy()
    far_off[~where] = 0  # is not asked for
    off[where] += 60
    assert uncovered_psnr(texture_of(truth), texture_of(far_off), where) > 80
    assert uncovered_psnr(texture_of(truth), texture_of(np.roll(truth, 2, axis=1)), where) > 80
    expected = 10 * np.log10(1023**2 / ((4 * 60**2 + 2 * 30**2) / 6))
    assert uncovered_psnr(texture_of(truth), texture_of(off), where) == pytest.approx(expected, abs=1e-6)
    assert np.isnan(uncovered_psnr(texture_of(truth), texture_of(off), np.zeros_like(where)))


def test_the_models_error_is_that_of_its_surface_and_colour():
    cameras, settings = camera_row(), Settings(n_init=3)
    first = frame(0, cameras)
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, first))
    model.update(first)
    empty = see(cameras[1])
    hidden = np.zeros(empty.codes.shape, bool)
    hidden[20:40, 30:60] = True
    error = model_error(model, empty, hidden)
    assert error.surface_m < 0.002
    assert error.colour == error.colour_once_hidden == error.other == 0.0
    depth = cameras[1].depth.depth(empty.codes)
    luma = np.full(empty.codes.shape, WALL_Y)
    luma[hidden] += 50
    moved = dataclasses.replace(empty, codes=cameras[1].depth.codes(depth - 0.03), texture=texture_of(luma))
    error = model_error(model, moved, hidden)
    assert error.surface_m == pytest.approx(0.03, abs=0.002)
    assert error.surface_delta == pytest.approx(error.surface_m / (0.02 * WALL_X), rel=0.01)
    assert error.colour_once_hidden == 50.0
    assert error.colour == pytest.approx(50 * np.sqrt(hidden.sum() / (1 - error.holes) / hidden.size), rel=0.01)
    away = dataclasses.replace(empty, codes=cameras[1].depth.codes(depth - 0.3))
    assert model_error(model, away, hidden).other > 0.95


def test_no_frame_of_a_noisy_twin_loses_by_its_model():
    twin = make_twin("painter", 0.06)
    cameras = inside_cameras(twin)[:1]
    samples = list(watch_noise(twin, cameras, 24, 8, Settings.preset("balanced", n_render=2)))
    assert [s.frame for s in samples] == list(range(24))
    assert [s.frame for s in samples if s.error is not None] == [0, 8, 16, 23]
    assert min(s.model - s.without for s in samples) > 0.0
    surface = [s.error.surface_m for s in samples if s.error is not None]
    assert surface[-1] < 0.95 * surface[0]


def test_the_command_prints_both_tables(capsys):
    noise.command("frog", scale=0.03, frames=2, quality="fast", views=2)
    printed = capsys.readouterr().out
    assert "frog at scale 0.03, depth noise 1, quality fast, 2 views" in printed
    assert "the model against the true background" in printed
    assert "with the model less dB without" in printed
