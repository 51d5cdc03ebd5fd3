"""What the model gains beyond the paper's limits, as `farside bench layers` measures it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from farside.clients.bench import layers as bench
from farside.engine.evaluation import layers
from farside.engine.evaluation.layers import VARIANTS, LayerCost, LayerSample, play_layers, within_reach
from farside.engine.evaluation.metrics import psnr
from farside.engine.rig.frame import Texture
from farside.engine.rig.viewer import RenderedPicture
from farside.engine.synth import FPS, make_twin, render_view, twin_frame


@pytest.fixture(scope="module")
def twin():
    return make_twin("lounge", 0.04)


def test_all_variants_are_judged_on_the_same_pixels(twin):
    cameras = [twin.camera("t0"), twin.camera("t3")]
    items = list(play_layers(twin, cameras, 4, 2, "fast", 1, reach_m=6.0))
    samples = [item for item in items if isinstance(item, LayerSample)]
    costs = [item for item in items if isinstance(item, LayerCost)]
    assert [(s.frame, s.camera, s.variant) for s in samples] == [
        (index, name, variant) for index in (0, 2, 3) for name in ("t0", "t3") for variant in VARIANTS
    ]
    for k in range(0, len(samples), len(VARIANTS)):
        group = samples[k : k + len(VARIANTS)]
        assert len({s.filled for s in group}) == 1
        assert 0 < group[0].filled < 0.9 * cameras[0].width * cameras[0].height
        assert len({s.come for s in group}) == 1
        assert all(0 <= s.missed <= min(s.come, s.wrong + s.unknown) and s.come <= s.filled for s in group)
        assert all(0 <= s.wrong + s.unknown <= s.filled and 5 < s.psnr_y < 60 for s in group)
    first = [cost.variant for cost in costs[:: len(VARIANTS)]]
    assert first == [list(VARIANTS)[k % len(VARIANTS)] for k in range(4)]
    assert all(cost.triangles > 100 and cost.memory > 1e4 and cost.update_ms > 0 for cost in costs)


def test_sensors_find_no_depth_beyond_their_reach(twin):
    whole, near = twin_frame(twin, 0), within_reach(twin_frame(twin, 0), 5.0)
    for view, cut in zip(whole.views, near.views, strict=True):
        depth, found = view.camera.depth.depth(view.codes), cut.camera.depth.depth(cut.codes)
        np.testing.assert_array_equal(np.isnan(found), depth > 5.0)
        np.testing.assert_array_equal(found[depth <= 5.0], depth[depth <= 5.0])
    assert 0.05 < np.mean([np.mean(view.codes == 0) for view in near.views]) < 0.95
    assert all((view.codes > 0).all() for view in within_reach(whole, math.inf).views)


def test_what_was_carried_has_come_and_who_walks_or_always_stood_has_not(twin):
    camera = twin.camera("t1")
    always = render_view(twin.scene, camera, 0.0, samples=1, background_only=True)
    first, before, now = (twin.truth(camera, index) for index in (0, 40, 70))
    come = layers._have_come(now, before, first, always)
    scene = dataclasses.replace(twin.scene, actors=twin.scene.actors[-1:])  # the armchair
    alone = render_view(scene, camera, 70 / FPS, samples=1)
    armchair = (alone.codes == now.codes) & (alone.codes != always.codes)
    assert 20 < come.sum() <= armchair.sum() < 0.2 * come.size
    assert (armchair | ~come).all()
    assert not layers._have_come(first, first, first, always).any()


def test_quality_is_that_of_the_filled_pixels_only(twin):
    camera, rng = twin.camera("t0"), np.random.default_rng(0)
    truth = twin.truth(camera, 0).texture
    filled = np.zeros(truth.y.shape, bool)
    filled[10:20, 4:40] = True
    y = truth.y + np.where(filled, 8, rng.integers(0, 500, truth.y.shape)).astype(np.uint16)
    disparity, winner = np.ones(y.shape, np.float32), np.zeros(y.shape, np.uint8)
    picture = RenderedPicture(camera, Texture(y, truth.cb, truth.cr), disparity, winner, None)
    psnr_y, iv_psnr = layers._quality(picture, truth, filled)
    assert psnr_y == pytest.approx(20 * math.log10(1023 / 8))
    assert iv_psnr >= psnr_y - 1e-6
    everywhere = layers._quality(picture, truth, np.ones_like(filled))
    assert everywhere[0] == pytest.approx(psnr(truth, picture.texture)[0])
    assert layers._quality(picture, truth, np.zeros_like(filled)) == (math.inf, math.inf)


def test_ratios_are_those_of_settled_frames():
    def costs(variant, times):
        return [LayerCost(variant, k, ms, 10 + k, 2_000_000) for k, ms in enumerate(times)]

    every = [*costs("neither", [99, 9, 9, 2.0, 4.0, 8.0]), *costs("stale", [99, 9, 9, 3.5, 5.0, 8.0])]
    assert bench._costs(every, "stale", "neither") == ["15", "5.50", "1.179", "2.0"]
    assert bench._costs(every, "neither", "neither") == ["15", "4.67", "1.000", "2.0"]


def test_shares_are_of_all_filled_pixels():
    sample = LayerSample("stale", "t0", 0, 100, 30.0, 40.0, 10, 5, 20, 4, 0.001)
    others = [sample, dataclasses.replace(sample, filled=300, wrong=0, unknown=3, psnr_y=math.inf, ghosts=0.003)]
    assert bench._qualities(others, 1000.0) == ["20.00", "30.00", "40.00", "2.50", "2.00", "20.00", "0.200"]
    none = [dataclasses.replace(sample, come=0, missed=0)]
    assert bench._qualities(none, 1000.0)[5] == "-"


def test_the_command_prints_a_row_for_each_variant(capsys):
    bench.command("lounge", scale=0.03, frames=2, every=1, quality="fast", reach=6.0)
    printed = capsys.readouterr().out
    assert "lounge at scale 0.03" in printed
    assert "depth up to 6 m" in printed
    assert all(variant in printed for variant in VARIANTS)
