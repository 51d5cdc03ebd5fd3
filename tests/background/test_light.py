"""Colours of maximum depth images follow the light where the camera sees a surface."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from farside.engine.background import light
from farside.engine.background.maximum_depth import MaximumDepthImage
from farside.engine.background.model import BackgroundModel
from farside.engine.background.state import CameraState
from farside.engine.background.state_check import check_model
from farside.engine.background.tolerances import Tolerances
from farside.engine.geometry.scene_scale import Scene
from farside.engine.kernels.background.flags import PROVISIONAL
from farside.engine.kernels.background.light import CELL, SUMS_SIZE, Cells, follow_light
from farside.engine.kernels.background.maximum_depth import PHASES
from farside.engine.kernels.background.picture import Picture
from farside.engine.kernels.base.tone import IDENTITY
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Frame, Texture, View
from farside.engine.settings import MODELLING, Settings
from oracle.light import follow, same_surface
from support.leaves import leaves

CODING = DepthCoding(0.5, 20.0, 16, True)
TOLERANCES = Tolerances(delta_m=0.1, margin_m=0.05)
FAR, NEAR = (int(CODING.codes(np.array(depth))) for depth in (4.0, 2.0))
SIZE = (256, 160)
SHARE = 0.25


def camera_of(size=SIZE):
    return Camera("c", Perspective.from_fov(*size, 1.0), Pose(), CODING)


def image_of(view, edge=0.05):
    return MaximumDepthImage(view, TOLERANCES, edge=edge)


def wall(seed=0, size=SIZE):
    """A wall of random colours."""
    rng = np.random.default_rng(seed)
    w, h = size
    y = rng.integers(250, 500, (h, w)).astype(np.uint16)
    cb, cr = (rng.integers(470, 555, ((h + 1) // 2, (w + 1) // 2)).astype(np.uint16) for _ in range(2))
    return View(camera_of(size), Texture(y, cb, cr), np.full((h, w), FAR, np.uint16))


def lit(view, gain=1.0, blue=0.0, red=0.0, grain=0.0, rng=None):
    """The view in another light: luma and chroma times `gain` ([h, w] or a number), chroma with shares of the luma.
    Chroma has half of the grain."""
    gain = np.broadcast_to(gain, view.codes.shape)
    y = (view.texture.y - 64.0) * gain
    luma = view.texture.y.astype(float) - 64.0
    means = luma.reshape(luma.shape[0] // 2, 2, -1, 2).mean(axis=(1, 3))
    chroma = []
    for plane, tint in ((view.texture.cb, blue), (view.texture.cr, red)):
        chroma.append(512 + (plane - 512.0) * gain[::2, ::2] + tint * means)
    planes = [64 + y, *chroma]
    if grain:
        planes = [p + rng.normal(0, part * grain, p.shape) for p, part in zip(planes, (1.0, 0.5, 0.5), strict=True)]
    return dataclasses.replace(view, texture=Texture(*(np.rint(p).clip(0, 1023).astype(np.uint16) for p in planes)))


def behind(view, x0, x1, y0=40, y1=120):
    """The view with someone in front of a part of it."""
    codes, y = view.codes.copy(), view.texture.y.copy()
    codes[y0:y1, x0:x1], y[y0:y1, x0:x1] = NEAR, 800
    return dataclasses.replace(view, codes=codes, texture=Texture(y, view.texture.cb, view.texture.cr))


def plays(image, views, share=SHARE):
    for view in views:
        image.update(view, whole=False)
        image.follow_light(view, IDENTITY, share)


def planes_of(image):
    """Planes of a maximum depth image, or of a view."""
    return [plane.astype(float) for plane in (image.texture.y, image.texture.cb, image.texture.cr)]


@pytest.mark.parametrize("size", [(150, 70), (33, 7), (64, 2), (4, 4)])
def test_colours_and_sums_are_those_of_the_slow_twin(size):
    w, h = size
    rng, camera = np.random.default_rng(w), camera_of(size)
    near = rng.random((h, w)) < 0.1
    codes = np.where(near, NEAR, FAR).astype(np.uint16)
    chroma = ((h + 1) // 2, (w + 1) // 2)

    def texture():
        y = rng.integers(20, 1000, (h, w))
        return Texture(*(p.astype(np.uint16) for p in (y, *(rng.integers(300, 700, chroma) for _ in range(2)))))

    image = image_of(View(camera, texture(), codes))
    moved = np.where(rng.random((h, w)) < 0.2, rng.integers(0, 65535, (h, w)), codes + rng.integers(-1, 2, (h, w)))
    new = View(camera, texture(), moved.astype(np.uint16))
    tone = np.array([1.1, -9.0, 0.9, 0.02, 40.0, 1.05, -0.01, -20.0])
    cells = -(-h // CELL), -(-w // CELL)
    known = [plane.copy() for plane in (image.texture.y, image.texture.cb, image.texture.cr)]
    margins = CODING, TOLERANCES.margin_m, TOLERANCES.margin_disparity(CODING)
    provisional = image.flags & PROVISIONAL != 0
    same = same_surface(new.codes, image.codes, provisional, margins, image.edge)
    assert 0 < same.mean() < 1
    seen = new.texture.y, new.texture.cb, new.texture.cr
    errors = []
    active = (rng.random(cells) < 0.6).astype(np.uint8)
    for number in range(PHASES):
        sums = np.zeros((*cells, SUMS_SIZE))
        before = [plane.copy() for plane in (image.texture.y, image.texture.cb, image.texture.cr)]
        follow_light(
            Picture(new.codes, *seen), Picture(image.codes, image.texture.y, image.texture.cb, image.texture.cr),
            image.flags, image._rules, tone, number, 3, SHARE,
            Cells(active, sums),
        )  # fmt: skip
        expected, wanted = follow(seen, before, same, tone, number, SHARE, active, number == 3)
        np.testing.assert_allclose(sums, wanted, rtol=1e-9, atol=1e-6)
        for found, value in zip((image.texture.y, image.texture.cb, image.texture.cr), expected, strict=True):
            assert np.abs(found - value).max() <= 1.001
            errors.append(found - value)
    off = np.concatenate([each.ravel() for each in errors])
    off = off[off != 0]
    assert len(off) < 50 or abs(off.mean()) < 4 * off.std() / math.sqrt(len(off)) + 0.01
    touched = [np.mean(now != then) for now, then in zip(planes_of(image), known, strict=True)]
    assert min(touched) > 0 or h < 2 * PHASES or not active.any()


def test_light_is_followed_where_it_is_seen_and_at_once_when_someone_leaves():
    view = wall()
    image = image_of(behind(view, 0, 0))
    across = np.linspace(0.5, 1.0, SIZE[0])[None, :].repeat(SIZE[1], 0)
    for index in range(30 * PHASES):
        done = min(index / (8 * PHASES), 1.0)
        now = lit(view, 1.0 + done * (across - 1.0), blue=-0.06 * done, red=0.04 * done)
        plays(image, [behind(now, 90, 170)])
    wanted, stale = planes_of(lit(view, across, -0.06, 0.04)), planes_of(view)
    for found, plane, old in zip(planes_of(image), wanted, stale, strict=True):
        step = SIZE[0] // plane.shape[1]
        hidden, wide = np.zeros(plane.shape, bool), np.zeros(plane.shape, bool)
        hidden[40 // step : 120 // step, 90 // step : 170 // step] = True
        wide[36 // step : 124 // step, 86 // step : 174 // step] = True
        assert np.abs(found - plane)[~wide].max() <= 3.0
        np.testing.assert_array_equal(found[hidden], old[hidden])
    plays(image, [now] * (20 * PHASES))
    for found, plane in zip(planes_of(image), wanted, strict=True):
        assert np.abs(found - plane).max() <= 4.0


def test_noise_changes_nothing():
    view, rng = wall(), np.random.default_rng(1)
    image = image_of(view)
    plays(image, (behind(lit(view, grain=6.0, rng=rng), 90, 170) for _ in range(40 * PHASES)))
    for found, plane in zip(planes_of(image), (view.texture.y, view.texture.cb, view.texture.cr), strict=True):
        np.testing.assert_array_equal(found, plane)


def test_noise_is_averaged_while_light_changes():
    view, rng = wall(), np.random.default_rng(1)
    image = image_of(view)
    for gain in (*np.linspace(1.0, 0.6, 80), *[0.6] * 40):
        now = lit(view, gain)
        plays(image, (behind(lit(now, grain=6.0, rng=rng), 90, 170) for _ in range(PHASES)))
    off = image.texture.y[:, :80].astype(float) - lit(view, 0.6).texture.y[:, :80]
    assert abs(off.mean()) < 0.5
    assert np.sqrt(np.mean(off**2)) == pytest.approx(6.0 * math.sqrt(SHARE / (2 - SHARE)), rel=0.15)


def test_a_steady_view_changes_nothing():
    view = wall()
    image = image_of(view)
    plays(image, [behind(view, 90, 170)] * (3 * PHASES))
    for found, plane in zip(planes_of(image), (view.texture.y, view.texture.cb, view.texture.cr), strict=True):
        np.testing.assert_array_equal(found, plane)


def test_a_shadow_that_has_passed_is_soon_forgotten():
    view = wall()
    image = image_of(view)
    shade = np.ones(view.codes.shape)
    shade[:, 96:192] = 0.7
    plays(image, [behind(lit(view, shade), 120, 150)] * (8 * PHASES))
    dark = image.texture.y[:, 100:110].mean()
    assert dark < view.texture.y[:, 100:110].mean() - 60  # it is there for a while
    plays(image, [behind(view, 120, 150)] * (16 * PHASES))
    off = image.texture.y.astype(float) - view.texture.y
    assert np.abs(off[:, 100:110]).max() <= 4  # 0.75 ** 16 of it is left, and the rounding
    np.testing.assert_array_equal(off[44:116, 122:148], 0)  # where someone stood in it


def frames_of(view, count):
    """Frames of cameras at the same place, in which someone walks by while the light fades."""
    for index in range(count):
        now = lit(view, 1.0 - 0.5 * min(index / 40, 1.0))
        yield Frame(index, (behind(now, 40 + index, 90 + index),))


def played(frames, settings):
    """A model that has taken the frames, and its cameras."""
    cameras = [view.camera for view in frames[0].views]
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, frames[0]))
    for one in frames:
        model.update(one, elapsed_s=1 / 30)
    return model, cameras


def test_a_model_put_back_half_way_follows_the_light_bit_for_bit():
    frames = list(frames_of(wall(), 90))
    model, _cameras = played(frames[:47], Settings(light_s=0.5))
    other = BackgroundModel.from_state(model.state())
    for one in frames[47:]:
        model.update(one, elapsed_s=1 / 30)
        other.update(one, elapsed_s=1 / 30)
    found, expected = (dict(leaves(each.state())) for each in (other, model))
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        np.testing.assert_array_equal(found[name], value, err_msg=name)
    (capture,) = model.state().captures
    assert isinstance(capture.light, light.LightState)
    assert capture.y.mean() < 0.85 * frames[0].views[0].texture.y.mean()


def test_colours_stay_as_they_are_without_a_time_constant():
    frames = list(frames_of(wall(), 30))
    model, _cameras = played(frames, Settings(light_s=0.0))
    (capture,) = model.state().captures
    assert capture.light is None
    np.testing.assert_array_equal(capture.y[:30], frames[0].views[0].texture.y[:30])


def test_a_state_of_other_cells_is_refused():
    model, cameras = played(list(frames_of(wall(), 20)), Settings(light_s=0.5))
    state, rig = model.state(), [CameraState.of(camera) for camera in cameras]
    check_model(state, rig)
    (capture,) = state.captures
    for field, value in (("sums", np.zeros((1, 1, SUMS_SIZE))), ("sums", capture.light.sums * np.nan)):
        damaged = dataclasses.replace(capture, light=dataclasses.replace(capture.light, **{field: value}))
        with pytest.raises(ValueError, match=rf"captures\[0\].light.{field}"):
            check_model(dataclasses.replace(state, captures=(damaged,)), rig)


def test_a_negative_time_constant_is_refused_and_the_paper_follows_no_light():
    with pytest.raises(ValueError, match=r"light_s: -1\.0: expected a number of at least 0"):
        Settings(light_s=-1.0)
    assert Settings.paper().light_s == 0.0
    assert "light_s" in MODELLING
