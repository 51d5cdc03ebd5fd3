"""The measure of following the light: which part a frame is in, what counts, and that following helps."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from farside.engine.evaluation.light import PARTS, Colours, part_of, watch_light, with_grain
from farside.engine.rig.frame import Texture
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, twin_frame
from farside.engine.synth.lamps import Dimming, Fade


def test_parts_are_those_of_the_lamps():
    twin = make_twin("gymnasium-lamps", 0.02)
    dimming = twin.scene.dimming
    assert dimming is not None
    assert [part_of(twin, round(30 * time)) for time in (0.0, dimming.start, 3.3, dimming.end)] == [
        "before", "before", "while", "after"
    ]  # fmt: skip
    assert part_of(make_twin("museum", 0.02), 290) == "before"


def test_grain_is_the_same_for_the_same_frame():
    frame = twin_frame(make_twin("gymnasium-a", 0.03), 0)
    first, again = with_grain(frame, 5.0), with_grain(frame, 5.0)
    for a, b, clean in zip(first.views, again.views, frame.views, strict=True):
        np.testing.assert_array_equal(a.texture.y, b.texture.y)
        np.testing.assert_array_equal(a.codes, clean.codes)
        assert np.std(a.texture.y.astype(float) - clean.texture.y) == pytest.approx(5.0, rel=0.1)
        assert np.std(a.texture.cb.astype(float) - clean.texture.cb) == pytest.approx(2.5, rel=0.1)
    assert with_grain(frame, 0.0) is frame


def test_colours_are_compared_where_the_mask_says():
    def texture(code):
        return Texture(*(np.full(shape, code, np.uint16) for shape in ((4, 6), (2, 3), (2, 3))))

    where = np.zeros((4, 6), bool)
    where[1, :3] = True
    colours = Colours()
    for kind, code in ((0, 510), (1, 501)):
        colours.add(kind, texture(code), texture(500), where)
    assert colours.count == 3
    assert colours.psnr(0) == pytest.approx(2 * (20 * math.log10(1023 / 10),))
    assert colours.psnr(1) == pytest.approx(2 * (20 * math.log10(1023),))
    assert math.isnan(Colours().psnr(0)[0])


def test_following_improves_the_model_and_leaves_it_alone_in_steady_light():
    twin = make_twin("gymnasium-lamps", 0.06)
    dark, warm = (0.1, 0.1, 0.1), (1.0, 0.5, 0.0)
    fades = [*(Fade(k, 0.2, 0.4, dark) for k in (0, 1)), *(Fade(k, 0.3, 0.3, warm) for k in (2, 3))]
    twin = dataclasses.replace(twin, scene=dataclasses.replace(twin.scene, dimming=Dimming(4, fades)))
    settings = Settings.preset("balanced", n_render=2, light_s=0.4, exposure_s=0.0)
    *_, meter = watch_light(twin, [twin.camera("t3")], 61, 6, settings)
    before, _while, after = (meter.parts[part] for part in PARTS)
    for colours in (before.whole, before.model, before.filled):
        np.testing.assert_array_equal(colours.errors[0], colours.errors[1])
    luma, chroma = (after.model.psnr(1)[k] - after.model.psnr(0)[k] for k in (0, 1))
    assert luma > 1.0
    assert chroma > 1.0
    assert after.whole.psnr(1)[0] >= after.whole.psnr(0)[0] - 0.02
    assert after.judged == 7
    assert after.cost > 0
