"""Benchmarks of speed on a tiny twin: their pictures and sizes are right, however long they take."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.clients.bench.targets import show_targets
from farside.engine.evaluation.scaling import DOUBLINGS, Growth, exponent, measure_growth
from farside.engine.evaluation.targets import Target, loss_targets, pair_targets, warp_all
from farside.engine.pipeline.engine import Engine
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, twin_frame


def test_a_target_knows_which_way_is_better() -> None:
    assert Target("time", 30.0, "ms", 30.0).met
    assert not Target("time", 31.0, "ms", 30.0).met
    assert not Target("ratio", 4.9, "x", 5.0, at_least=True).met
    assert Target("size", 3.0, "MB").met is None


def test_presets_lose_no_more_than_is_wanted() -> None:
    # Pictures of a few dozen pixels would be all silhouettes.
    rows = list(loss_targets(make_twin("museum", 0.15), 0, lambda: None))
    assert len(rows) == 6
    assert [row.met for row in rows if row.wanted is not None] == [True, True]


def test_five_views_with_the_model_leave_no_more_holes_than_all() -> None:
    twin = make_twin("museum", 0.06)
    engines = {"fast": Engine(twin.sources, Settings.preset("fast"))}
    for index in range(0, 60, 6):
        engines["fast"].update(twin_frame(twin, index))
    rows = {row.what: row for row in pair_targets(twin_frame(twin, 54), engines, (80, 90), 4, lambda: None)}
    holes = rows["holes before filling, fast"]
    assert holes.met, holes
    assert rows["times faster than warping all 24, fast"].value > 0
    assert warp_all(24, "fast") == dataclasses.replace(Settings.preset("fast"), n_render=24, background=False)


def test_all_rows_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    show_targets("museum", 0.05, frames=4, every=2, repeats=1)
    printed = capsys.readouterr().out
    for what in ("one eye", "S-PBS init", "median", "p99", "stereo pair 2 x 64x72", "times faster", "loss of"):
        assert what in printed


def test_growth_is_measured_over_doublings() -> None:
    rows = list(measure_growth("museum", 0.05, "fast", 1))
    for grows in ("output", "input"):
        pixels = [row.pixels for row in rows if row.grows == grows]
        assert len(pixels) == DOUBLINGS + 1
        assert np.allclose(np.diff(np.log2(pixels)), 1.0, atol=0.1)
    assert all(row.pair > 0 and row.update > 0 for row in rows)


def test_the_exponent_is_the_slope() -> None:
    rows = [Growth("input", n, 3.0 * n**0.5, 2.0 * n) for n in (100, 200, 400, 800)]
    assert exponent(rows, "input", "pair") == pytest.approx(0.5)
    assert exponent(rows, "input", "update") == pytest.approx(1.0)
