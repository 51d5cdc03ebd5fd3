"""Benchmarks of speed on a tiny twin: their pictures and sizes are right, however long they take."""

from __future__ import annotations

import numpy as np
import pytest
from farside.clients.bench.targets import show_targets
from farside.engine.evaluation import scaling, targets
from farside.engine.evaluation.scaling import DOUBLINGS, Growth, exponent, measure_growth
from farside.engine.evaluation.targets import Target, loss_targets, pair_targets, warp_all
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.frame import Frame
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, twin_frame
from support.clocks import Clock


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


def test_five_views_with_the_model_leave_no_more_holes_than_all(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that a pair moves on by a millisecond for each view that it may draw."""
    twin, clock = make_twin("museum", 0.06), Clock()
    engines = {"fast": Engine(twin.sources, Settings.preset("fast"))}
    for index in range(0, 60, 6):
        engines["fast"].update(twin_frame(twin, index))
    render = Engine.render

    def timed(engine: Engine, *given: object) -> object:
        pair = render(engine, *given)  # type: ignore[arg-type]
        clock.advance(1e-3 * engine.settings.n_render)
        return pair

    clock.instead_of(monkeypatch, targets)
    monkeypatch.setattr(Engine, "render", timed)
    rows = {row.what: row for row in pair_targets(twin_frame(twin, 54), engines, (80, 90), 4, lambda: None)}
    holes = rows["holes before filling, fast"]
    assert holes.met, holes
    eyes = "stereo pair 2 x 80x90 from five of 24 views, fast"
    assert rows[eyes].value == pytest.approx(5.0)
    assert rows["the same, all 24 views warped, fast"].value == pytest.approx(24.0)
    faster = rows["times faster than warping all 24, fast"]
    assert faster.value == pytest.approx(24 / 5)
    assert faster.met is False  # five times is wanted


def test_warping_all_draws_every_view_that_shows_something_and_keeps_no_model() -> None:
    twin = make_twin("museum", 0.06)
    frame, camera = twin_frame(twin, 0), twin.camera("t0")
    engine = Engine(twin.sources, warp_all(24, "fast"))
    engine.update(frame)
    drawn = engine.render_camera(camera).report.views
    assert engine.model is None
    assert len(drawn) > 5
    left_out = [view for view in frame.views if view.camera.name not in drawn]
    assert len(left_out) == 24 - len(drawn)
    for view in left_out:
        alone = Engine([view.camera], Settings.preset("fast", background=False, fill="none"))
        alone.update(Frame(0, (view,)))
        assert alone.render_camera(camera).holes().all()


def test_all_rows_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    show_targets("museum", 0.05, frames=4, every=2, repeats=1)
    printed = capsys.readouterr().out
    for what in ("one eye", "S-PBS init", "median", "p99", "stereo pair 2 x 64x72", "times faster", "loss of"):
        assert what in printed


def test_growth_is_measured_over_doublings(monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that pairs move on by their pixels, and updates by those of the views."""
    clock, render, update = Clock(), Engine.render, Engine.update

    def timed_render(engine: Engine, view: StereoView, *given: object) -> object:
        clock.advance(1e-6 * 2 * view.left.width * view.left.height)
        return render(engine, view, *given)  # type: ignore[arg-type]

    def timed_update(engine: Engine, frame: Frame, *given: object) -> object:
        clock.advance(1e-6 * sum(view.codes.size for view in frame.views))
        return update(engine, frame, *given)  # type: ignore[arg-type]

    clock.instead_of(monkeypatch, scaling)
    monkeypatch.setattr(Engine, "render", timed_render)
    monkeypatch.setattr(Engine, "update", timed_update)
    rows = list(measure_growth("museum", 0.05, "fast", 1))
    for grows in ("output", "input"):
        pixels = [row.pixels for row in rows if row.grows == grows]
        assert len(pixels) == DOUBLINGS + 1
        # Sides are even numbers of pixels: of the smallest views, 50 wide, off by a fiftieth.
        assert np.allclose(np.diff(np.log2(pixels)), 1.0, atol=0.1)
    for row in rows:
        if row.grows == "output":
            assert row.pair == pytest.approx(1e-3 * row.pixels)
        else:
            assert row.update == pytest.approx(1e-3 * 24 * row.pixels)
    slopes = {("output", "pair"): 1, ("output", "update"): 0, ("input", "pair"): 0, ("input", "update"): 1}
    for (grows, cost), slope in slopes.items():
        assert exponent(rows, grows, cost) == pytest.approx(slope, abs=1e-6)


def test_the_exponent_is_the_slope() -> None:
    rows = [Growth("input", n, 3.0 * n**0.5, 2.0 * n) for n in (100, 200, 400, 800)]
    assert exponent(rows, "input", "pair") == pytest.approx(0.5)
    assert exponent(rows, "input", "update") == pytest.approx(1.0)
