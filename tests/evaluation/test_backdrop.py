from __future__ import annotations

import pytest
from farside.clients.bench import backdrop
from farside.engine.background.model import BackgroundModel
from farside.engine.evaluation import backdrop as evaluation
from farside.engine.evaluation.backdrop import VIEWS, compare_backdrops, pbi_costs
from farside.engine.settings import BACKDROPS
from farside.engine.synth import make_twin, twin_frame
from support.clocks import Clock

PEAK = 1023


def test_the_benchmark_compares_both_on_the_same_pixels():
    twin = make_twin("doorway", 0.04)
    cameras = [twin.camera("t0")]
    samples = list(compare_backdrops(twin, cameras, 3, 2, "fast"))
    assert [(s.frame, s.views, s.mode) for s in samples] == [
        (index, views, mode) for index in (0, 2) for views in VIEWS for mode in BACKDROPS
    ]
    for farthest, standing in zip(samples[::2], samples[1::2], strict=True):
        assert farthest.pixels == standing.pixels > 0
        # What was drawn of the views is the same in both: so is what is left of the pictures' squared errors.
        pixels = cameras[0].width * cameras[0].height
        elsewhere = [pixels * PEAK**2 / 10 ** (s.psnr_y / 10) - s.squares for s in (farthest, standing)]
        assert elsewhere[0] == pytest.approx(elsewhere[1], rel=1e-9)
        assert min(elsewhere) > 0
        assert farthest.too_far >= standing.too_far


def test_a_pbi_costs_the_rays_cast_and_the_least_time(monkeypatch):
    """By a clock that each PBI moves on: in turn, the modes take 5, 7, 2, 3, 4 and 9 seconds."""
    twin = make_twin("doorway", 0.04)
    clock, took, made = Clock(), iter((5.0, 7.0, 2.0, 3.0, 4.0, 9.0)), []
    render = BackgroundModel.render_pbi

    def timed(model, camera, present=None):
        clock.advance(next(took))
        image = render(model, camera, present)
        made.append((present is not None, image.rays))
        return image

    clock.instead_of(monkeypatch, evaluation)
    monkeypatch.setattr(BackgroundModel, "render_pbi", timed)
    costs = list(pbi_costs([twin_frame(twin, 0)], [twin.camera("t0")], "fast"))
    assert [cost.mode for cost in costs] == list(BACKDROPS) == ["farthest", "standing"]
    assert made == [(False, costs[0].rays), (True, costs[1].rays)] * 3
    assert costs[0].rays < costs[1].rays < 2 * costs[0].rays
    assert [cost.seconds for cost in costs] == [2.0, 3.0]


def test_the_command_prints_both(capsys):
    backdrop.command("hijack", scale=0.03, frames=1, quality="fast")
    printed = capsys.readouterr().out
    assert "hijack at scale 0.03" in printed
    assert "to the farthest" in printed
