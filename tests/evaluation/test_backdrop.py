from __future__ import annotations

import pytest
from farside.clients.bench import backdrop
from farside.engine.evaluation.backdrop import VIEWS, compare_backdrops, pbi_costs
from farside.engine.settings import BACKDROPS
from farside.engine.synth import make_twin, twin_frame


def test_the_benchmark_compares_both_on_the_same_pixels(capsys):
    twin = make_twin("doorway", 0.04)
    cameras = [twin.camera("t0")]
    samples = list(compare_backdrops(twin, cameras, 3, 2, "fast"))
    assert [(s.frame, s.views, s.mode) for s in samples] == [
        (index, views, mode) for index in (0, 2) for views in VIEWS for mode in BACKDROPS
    ]
    for farthest, standing in zip(samples[::2], samples[1::2], strict=True):
        assert farthest.pixels == standing.pixels > 0
        assert farthest.psnr_y == pytest.approx(standing.psnr_y, abs=3)
        assert farthest.too_far >= standing.too_far
    costs = list(pbi_costs([twin_frame(twin, 0)], cameras, "fast"))
    assert [cost.mode for cost in costs] == list(BACKDROPS)
    assert costs[0].rays < costs[1].rays < 2 * costs[0].rays
    assert all(cost.seconds > 0 for cost in costs)
    backdrop.command("hijack", scale=0.03, frames=1, quality="fast")
    printed = capsys.readouterr().out
    assert "hijack at scale 0.03" in printed
    assert "to the farthest" in printed
