"""Views that are left out of frames: they leave no trace, the rest goes on, and their cameras come back."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from farside.engine.background.model import BackgroundModel
from farside.engine.evaluation.metrics import psnr
from farside.engine.geometry.scene_scale import Scene
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Fault, Frame, Texture
from farside.engine.rig.viewer import StereoView
from farside.engine.settings import Settings
from support.leaves import leaves
from support.rooms import BOX_X, CODING, WALL_X, camera_row, frame

MISSING = Fault("missing")
CODINGS = {"holes": CODING, "no holes": DepthCoding(0.5, 20.0), "sky": DepthCoding(0.5, math.inf, 12)}
HEAD = StereoView.symmetric(Pose((0.05, 0.1, 0.0)), 96, 64, 1.1)
EYE = dataclasses.replace(camera_row()[1], name="eye", pose=Pose((0.1, 0.13, 0.02)))
FRAMES, STILL = 12, 26  # someone walks, then nothing moves until all cameras had many turns
PATH = [*np.linspace(-0.6, 0.9, FRAMES), *[None] * (STILL - FRAMES)]


def rig(coding=CODING, count=4):
    return [dataclasses.replace(camera, depth=coding) for camera in camera_row(count)]


def walk(cameras):
    return [frame(index, cameras, box_y=y) for index, y in enumerate(PATH)]


def without(frame, *left_out, garbage=None):
    """The frame without some cameras' views, whose arrays hold `garbage` (a generator of random numbers) if given."""

    def gone(view):
        if garbage is None:
            return dataclasses.replace(view, fault=MISSING)
        planes = (garbage.integers(0, 65536, plane.shape, np.uint16) for plane in planes_of(view))
        *texture, codes = planes
        elsewhere = dataclasses.replace(view.camera, pose=Pose(tuple(garbage.normal(size=3))))
        return dataclasses.replace(view, camera=elsewhere, texture=Texture(*texture), codes=codes, fault=MISSING)

    views = (gone(view) if c in left_out else view for c, view in enumerate(frame.views))
    return dataclasses.replace(frame, views=tuple(views))


def planes_of(view):
    return view.texture.y, view.texture.cb, view.texture.cr, view.codes


def assert_same_state(model, other):
    found, expected = dict(leaves(model.state())), dict(leaves(other.state()))
    assert found.keys() == expected.keys()
    for name, value in expected.items():
        np.testing.assert_array_equal(found[name], value, err_msg=name)


def seen(engine):
    """Pictures for both kinds of viewers, as arrays."""
    pair, picture = engine.render(HEAD, "head"), engine.render_camera(EYE, "eye")
    return [plane for eye in (pair.left, pair.right, picture) for plane in (*planes_of_picture(eye), eye.disparity)]


def planes_of_picture(picture):
    return picture.texture.y, picture.texture.cb, picture.texture.cr


def viewers():
    return {"head": HEAD, "eye": EYE}


def drops(seed, count, frames):
    """Random cameras for random frames, also all but one, also all."""
    rng, chosen = np.random.default_rng(seed), {}
    for index in range(frames):
        many = rng.choice([0, 0, 1, 2, count - 1, count])
        chosen[index] = tuple(rng.permutation(count)[:many].tolist())
    return chosen


@pytest.mark.parametrize("quality", ["balanced", "fast"])
@pytest.mark.parametrize("coding", CODINGS)
def test_nothing_of_a_view_that_is_left_out_is_read(coding, quality):
    """Bit for bit: whatever its arrays and its pose hold, pictures, tones and the model are the same."""
    cameras = rig(CODINGS[coding])
    one, other = (Engine(cameras, Settings.preset(quality, n_render=3)) for _ in range(2))
    chosen, garbage = drops(1, len(cameras), FRAMES), np.random.default_rng(2)
    for index, whole in enumerate(walk(cameras)[:FRAMES]):
        gone = chosen[index] if index else (0, 2)
        reports = [
            engine.update(without(whole, *gone, garbage=source), viewers())
            for engine, source in ((one, None), (other, garbage))
        ]
        assert list(reports[0].left_out) == list(reports[1].left_out) == [f"v{c}" for c in sorted(gone)]
        for plane, same in zip(seen(one), seen(other), strict=True):
            np.testing.assert_array_equal(plane, same)
    assert_same_state(one.model, other.model)
    np.testing.assert_array_equal(one.tones, other.tones)


@pytest.mark.parametrize("settings", [Settings(n_init=2), Settings(n_init=2, n_update=2, culling_stride=2)])
def test_the_model_is_that_of_a_rig_whose_camera_never_got_its_turn_in_that_frame(settings, monkeypatch):
    cameras, gone, garbage = rig(), {3: {1}, 4: {1, 2}, 5: {0}, 6: {0, 1, 2}}, np.random.default_rng(3)
    frames = walk(cameras)
    one, other = (BackgroundModel(cameras, settings, Scene.of(cameras, settings, frames[0])) for _ in range(2))
    seen = {index: [c for c in range(len(cameras)) if c not in left] for index, left in gone.items()}
    monkeypatch.setattr(other._rig, "seen_in", lambda frame: seen.get(frame.index, list(range(len(cameras)))))
    for whole in frames[:FRAMES]:
        left = one.update(without(whole, *gone.get(whole.index, ()), garbage=garbage))
        full = other.update(whole)
        assert dataclasses.replace(left, stages={}) == dataclasses.replace(full, stages={})
    assert one.state().moved == ()
    assert_same_state(one, other)


def test_a_frame_of_which_all_views_are_left_out_changes_nothing():
    cameras = rig()
    engine, other = Engine(cameras), Engine(cameras)
    frames = walk(cameras)
    for whole in frames[:5]:
        engine.update(whole, viewers())
        other.update(whole, viewers())
        before = seen(engine), engine.front, engine.frame_index
        report = engine.update(without(frames[7], *range(len(cameras))), viewers())
        assert list(report.left_out.values()) == [MISSING] * len(cameras)
        assert (engine.front, engine.frame_index) == before[1:]
    assert_same_state(engine.model, other.model)
    engine.update(frames[5], viewers())
    other.update(frames[5], viewers())
    for plane, same in zip(seen(engine), seen(other), strict=True):
        np.testing.assert_array_equal(plane, same)


@pytest.mark.parametrize("coding", CODINGS)
@pytest.mark.parametrize("seed", range(4))
def test_pictures_stay_finite_and_become_those_of_the_undisturbed_run(seed, coding):
    """Random cameras are left out of random frames, also of the first; then all are back for some rounds."""
    cameras = rig(CODINGS[coding])
    undisturbed, engine = (Engine(cameras, Settings(n_render=3)) for _ in range(2))
    chosen = drops(seed, len(cameras), FRAMES) | {0: [(), (1,), (0, 1, 3), (0, 1, 2, 3)][seed]}
    assert any(chosen.values())
    for whole in walk(cameras):
        gone = chosen.get(whole.index, ())
        report = engine.update(without(whole, *gone), viewers())
        undisturbed.update(whole, viewers())
        assert sorted(report.left_out) == sorted(f"v{c}" for c in gone)
        pair = engine.render(HEAD, "head")
        for picture in (pair.left, pair.right, engine.render_camera(EYE, "eye")):
            assert np.isfinite(picture.disparity).all()
            assert (picture.disparity >= 0).all()
            assert max(int(plane.max()) for plane in planes_of_picture(picture)) <= 1023
            assert not {f"v{c}" for c in gone} & set(picture.report.views) or len(gone) == len(cameras)
        np.testing.assert_array_equal(np.isfinite(engine.tones if engine.tones is not None else 0.0), True)
    for picture, expected in zip(
        (engine.render(HEAD, "head").left, engine.render_camera(EYE, "eye")),
        (undisturbed.render(HEAD, "head").left, undisturbed.render_camera(EYE, "eye")), strict=True,
    ):  # fmt: skip
        assert psnr(expected.texture, picture.texture)[0] > 50.0
        np.testing.assert_allclose(picture.disparity, expected.disparity, atol=2e-3)
        assert picture.report.holes_backdrop <= expected.report.holes_backdrop + 1e-3


@pytest.mark.parametrize("coding", CODINGS)
def test_a_camera_that_was_not_there_at_first_adds_what_only_it_has_seen(coding):
    """A strip of the wall, and what the box hides from the others: holes in the background, until it comes."""
    cameras = rig(CODINGS[coding], 3)
    still = [frame(index, cameras, box_y=-0.4, half=0.35) for index in range(10)]
    whole, late = Engine(cameras, Settings(n_init=3)), Engine(cameras, Settings(n_init=3))
    for one in still:
        whole.update(one, viewers())
        late.update(without(one, 2) if one.index < 4 else one, viewers())
        assert len(late.model.captures) == 3
        if one.index == 3:
            before = background(late, cameras[2])
    expected, found = background(whole, cameras[2]), background(late, cameras[2])
    there = np.isfinite(expected) & (expected > (WALL_X + BOX_X) / 2)
    assert np.isfinite(found[there]).mean() > 0.995
    np.testing.assert_allclose(found[there & np.isfinite(found)], expected[there & np.isfinite(found)], atol=0.05)
    assert np.isfinite(before[there]).mean() < 0.95
    assert late.status()["background"]["p_pbs"] > 0
    assert len(late.export("glb")) > 1000


def background(engine, camera):
    """Depth, metres, of the farthest background seen from a camera, without the outermost pixels."""
    camera = dataclasses.replace(camera, depth=CODING)
    return CODING.depth(engine.model.render_pbi(camera).view.codes)[1:-1, 1:-1]


def test_a_rig_without_depth_so_far_shows_nothing_and_the_model_begins_with_the_first_depth():
    """From then on everything is, bit for bit, as if the frames before had never come."""
    cameras = rig()
    frames = walk(cameras)
    engine, other = Engine(cameras), Engine(cameras)
    for index in range(2):
        dark = dataclasses.replace(frames[0], index=index - 2, views=tuple(
            dataclasses.replace(view, codes=np.zeros_like(view.codes)) for view in frames[0].views
        ))  # fmt: skip
        report = engine.update(dark, viewers())
        assert {fault.reason for fault in report.left_out.values()} == {"no depth"}
        assert engine.model is None
        pair = engine.render(HEAD, "head")
        for picture in (pair.left, pair.right, engine.render_camera(EYE, "eye")):
            assert picture.report.views == ()
            assert picture.report.holes_backdrop == 1.0
            assert not picture.disparity.any()
            assert {len(np.unique(plane)) for plane in planes_of_picture(picture)} == {1}
        assert engine.render_encoded(HEAD).report.holes == 1.0
        with pytest.raises(ValueError, match="mesh: there is none before the first frame"):
            engine.export()
    for whole in frames[:4]:
        engine.update(whole, viewers())
        other.update(whole, viewers())
        for plane, same in zip(seen(engine), seen(other), strict=True):
            np.testing.assert_array_equal(plane, same)
    assert_same_state(engine.model, other.model)


@pytest.mark.parametrize("coding", CODINGS)
def test_what_a_camera_remembers_counts_while_it_is_away(coding):
    """Two cameras saw someone leave. Without their present views the place stays empty."""
    cameras = rig(CODINGS[coding], 3)
    engine = Engine(cameras, Settings(n_init=1, n_render=1))
    for whole in walk(cameras):
        engine.update(whole, viewers())
    shown = engine.render_camera(EYE, "eye")
    for index in range(3):
        engine.update(without(frame(STILL + index, cameras), 0, 2), viewers())
        alone = engine.render_camera(EYE, "eye")
        assert alone.report.views == ("v1",)
        assert not (alone.disparity > 1.1 / WALL_X).any()
        assert alone.report.holes_backdrop <= shown.report.holes_backdrop + 1e-3


def samples_with(engine, camera):
    """Numbers and colours of the surfaces that a camera and its neighbours, or the model, see."""
    overlap = engine._back_end._exposure._overlap
    concerned = (overlap.pairs == camera).any(axis=1)
    return overlap.counts[concerned].copy(), overlap.samples[concerned].copy()


def test_brightness_does_not_change_when_a_camera_is_away():
    """Cameras of different exposures: the picture has their mean, also while one is away."""
    cameras = rig()
    engine, undisturbed = (Engine(cameras, Settings(exposure_s=1.0)) for _ in range(2))

    def exposed(view, c):
        luma = 64 + (view.texture.y.astype(float) - 64) * (0.8 + 0.15 * c)
        y = np.minimum(luma, 1023).astype(np.uint16)
        return dataclasses.replace(view, texture=Texture(y, view.texture.cb, view.texture.cr))

    def lit(index):
        return Frame(index, tuple(exposed(view, c) for c, view in enumerate(frame(index, cameras, box_y=0.2).views)))

    for index in range(35):
        engine.update(without(lit(index), *[1] * (index >= 20)))
        undisturbed.update(lit(index))
        if index == 20:
            tones, samples = engine.tones, samples_with(engine, 1)
    assert np.ptp(tones[:, 0, 0]) > 0.2
    np.testing.assert_array_equal(engine.tones[1], tones[1])
    assert samples[0].min() > 0
    for now, then in zip(samples_with(engine, 1), samples, strict=True):  # the last ones that there were
        np.testing.assert_array_equal(now, then)
    np.testing.assert_allclose(engine.tones, undisturbed.tones, atol=0.1)
    lumas = [one.render_camera(EYE).texture.y.mean() for one in (engine, undisturbed)]
    assert abs(lumas[0] - lumas[1]) < 2.0



@pytest.mark.parametrize("coding", CODINGS)
def test_nothing_of_a_moving_camera_that_is_left_out_is_read(coding):
    """It goes on from where it is when it is back, and adds what it sees there."""
    cameras, garbage = rig(CODINGS[coding], 3), np.random.default_rng(2)
    one, other = (Engine(cameras, Settings(n_render=3)) for _ in range(2))
    for index in range(FRAMES):
        moved = dataclasses.replace(cameras[2], pose=Pose((0.0, 0.4 + 0.06 * index, 0.0)))
        whole = frame(index, [*cameras[:2], moved], box_y=PATH[index])
        gone = {0: (2,), 1: (2,), 5: (2,), 6: (1, 2), 7: (0, 1, 2)}.get(index, ())
        for engine, source in ((one, None), (other, garbage)):
            report = engine.update(without(whole, *gone, garbage=source), viewers())
            assert sorted(report.left_out) == [f"v{c}" for c in gone]
        for plane, same in zip(seen(one), seen(other), strict=True):
            np.testing.assert_array_equal(plane, same)
    assert_same_state(one.model, other.model)
    assert one.model.cameras[2].pose.position[1] > 0.9
    far = dataclasses.replace(cameras[2], pose=Pose((0.0, 1.0, 0.0)))
    assert np.isfinite(background(one, far)[:, :20]).mean() > 0.9  # what only the moving camera has seen
