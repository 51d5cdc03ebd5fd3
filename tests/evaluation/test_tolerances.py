"""Depth edges that follow from a scene, and the benchmark of tolerances: its figures, findings and output."""

from __future__ import annotations

import csv
import dataclasses

import numpy as np
import pytest
from farside.clients.bench import tolerances
from farside.engine.evaluation.tolerances import FACTORS, automatic_choices, summarise, sweep
from farside.engine.geometry.prepared_view import pixels_per_radian
from farside.engine.geometry.scene_scale import Scene
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, twin_frame
from support.rooms import WALL_X, camera_row, frame

SETTINGS = Settings.preset("fast")


@pytest.fixture(scope="module")
def rows():
    return sweep(make_twin("street", 0.06), Settings.preset("balanced"), (0, 1, 8, 16, 24))


@pytest.mark.parametrize(("width", "pixels"), [(24, 2.0), (128, None), (768, 4.0)])
def test_a_depth_edge_is_a_quarter_of_the_median_disparity_of_two_to_four_pixels(width, pixels):
    cameras = camera_row(3, (width, 2 * width // 3))
    scene = Scene.of(cameras, Settings(), frame(0, cameras))
    pixel = 1 / (scene.baseline * pixels_per_radian(cameras[0]))
    edge = scene.triangulation(cameras[0], Settings()).edge
    assert edge == pytest.approx(0.25 / WALL_X if pixels is None else pixels * pixel, rel=0.01)
    assert 2.0 * pixel <= edge <= 4.0 * pixel
    assert scene.triangulation(cameras[0], Settings(edge_px=7.0)).edge == pytest.approx(7 * pixel)


def test_every_value_is_played_and_the_automatic_one_among_them(rows):
    choices = {row.choice.name: row.choice for row in rows}
    assert list(choices) == ["delta", "margin", "backdrop offset", "depth edge", "triangulation"]
    for name, choice in choices.items():
        own = {row.label: row for row in rows if row.choice.name == name}
        assert set(own) == {f"{factor:g}" for factor in FACTORS} | ({"paper"} if name == "delta" else set())
        for factor in FACTORS:
            expected = {setting: factor * value for setting, value in choice.values.items()}
            assert own[f"{factor:g}"].values == pytest.approx(expected)
    assert len({row.outcome for row in rows if row.label == "1"}) == 1  # one engine plays them all


def test_what_is_set_by_hand_to_the_automatic_values_is_the_same():
    twin = make_twin("frog", 0.03)
    first = [twin_frame(twin, index) for index in (0, 1)]
    values = {name: value for choice in automatic_choices(first, SETTINGS) for name, value in choice.values.items()}
    by_hand = dataclasses.replace(SETTINGS, **values)
    again = {name: value for choice in automatic_choices(first, by_hand) for name, value in choice.values.items()}
    assert again == pytest.approx(values)


def test_a_delta_for_the_hills_everywhere_would_keep_ghosts_of_people(rows):
    delta = {row.label: row for row in rows if row.choice.name == "delta"}
    assert delta["8"].outcome.ghosts > delta["1"].outcome.ghosts
    assert delta["1"].values["delta_m"] < 0.5
    hills = 300.0
    assert delta["1"].values["delta_disparity"] * hills**2 > 1.0


def test_automatic_tolerances_are_not_far_off_the_best(rows):
    for automatic, best, off in summarise(rows):
        assert off == best.figure - automatic.figure >= 0
        assert automatic.label == "1"
        assert off < 0.2, automatic.choice.name  # dB, which nobody sees
    edges = {row.label: row.outcome for row in rows if row.choice.name == "depth edge"}
    torn = edges["0.125"]  # what is slanted is, though rims cover much of it
    assert torn.holes > 1.05 * edges["1"].holes
    assert torn.iv_psnr < edges["1"].iv_psnr - 0.2
    assert edges["8"].ghosts > 3 * edges["1"].ghosts  # people are tied to what is behind them


def test_the_command_prints_tables_and_writes_figures(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("farside.engine.evaluation.tolerances.FACTORS", (1.0, 8.0))
    tolerances.command(twins="frog", scale=0.03, quality="fast", report=tmp_path / "new")
    printed = capsys.readouterr().out
    assert "frog at scale 0.03, quality fast" in printed
    assert "automatic values next to the best" in printed
    with (tmp_path / "new" / "tolerances.csv").open() as file:
        found = list(csv.DictReader(file))
    assert len(found) == 5 * 2 + 1
    assert {row["scene"] for row in found} == {"frog"}
    assert np.isfinite([float(row["iv_psnr"]) for row in found]).all()
