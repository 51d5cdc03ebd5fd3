"""Exposure: oracles of the kernels, recovered tones, robustness, steadiness, and pictures without seams."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.background.exposure import Exposure, packed, to_common, to_picture
from farside.engine.evaluation.exposure import misexposed, random_tones, tone_errors, without_gain
from farside.engine.evaluation.metrics import psnr
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.geometry.scene_scale import Scene
from farside.engine.kernels.background.exposure import gather_samples, weigh_samples
from farside.engine.kernels.background.tone_solver import solve_tones
from farside.engine.kernels.base.view_table import EDGE, TOLERANCE
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Pose
from farside.engine.rig.frame import Frame, Texture
from farside.engine.rig.selection import view_shares
from farside.engine.rig.texture import toned_texture
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, twin_frame
from oracle.exposure import common_samples, normal_equations, solve
from support.rooms import WALL_Y, camera_row, frame

FOLLOW_S, FRAME_S = 0.5, 1 / 30
GREY = np.array([438.0, 0.0, 0.0, 1.0])  # luma relative to black, chroma to grey
WHITE = np.array([876.0, 0.0, 0.0, 1.0])


@pytest.fixture(scope="module", params=["museum", "painter"])
def rig(request):
    """A twin, its first frame, and its scene."""
    twin = make_twin(request.param, 0.125)
    first = twin_frame(twin, 0)
    return twin, first, Scene.of(twin.sources, Settings(), first)


def table(one, scene):
    return ViewTable([PreparedView(v, scene.triangulation(v.camera, Settings()), scene.origin) for v in one.views])


def followed(*frames, scene):
    """The tones [n, 4, 4] after each frame."""
    exposure = Exposure(len(frames[0].views), FOLLOW_S, scene.depths[:2])
    for one in frames:
        exposure.update(table(one, scene), FRAME_S)
        yield exposure.tones


def with_luma(view, luma):
    texture = Texture(np.clip(luma, 0, 1023).astype(np.uint16), view.texture.cb, view.texture.cr)
    return dataclasses.replace(view, texture=texture)


def test_samples_are_those_of_the_readable_twin(rig):
    _, first, scene = rig
    views = table(first, scene)
    # Cameras at different heights: otherwise images lie on the border of two pixels, and rounding decides.
    pairs, columns, rows = np.array([[0, 5], [5, 0], [2, 5]]), 20, 15
    samples = np.zeros((3, columns * rows, 2, 3), np.float32)
    counts = np.zeros(3, np.int64)
    gather_samples(views.rows, views.addresses, pairs, np.arange(3), columns, rows, samples, counts)
    for (a, b), found, count in zip(pairs, samples, counts, strict=True):
        limits = (views.rows[[a, b], k] for k in (EDGE, TOLERANCE))
        expected = common_samples(first.views[a], first.views[b], columns, rows, *limits)
        assert len(expected) == count > 20
        np.testing.assert_allclose(found[:count], expected, atol=2e-3)


def test_pairs_that_are_not_due_keep_their_samples(rig):
    _, first, scene = rig
    views, samples, counts = table(first, scene), np.full((2, 12, 2, 3), np.nan, np.float32), np.array([5, 5])
    gather_samples(views.rows, views.addresses, np.array([[0, 1], [1, 0]]), np.array([1]), 4, 3, samples, counts)
    assert np.isnan(samples[0]).all()
    assert counts[0] == 5
    assert np.isfinite(samples[1, : counts[1]]).all()
    assert np.isnan(samples[1, counts[1] :]).all()


def test_normal_equations_are_those_of_the_readable_twin():
    rng = np.random.default_rng(1)
    samples = rng.normal((300, 10, -20), (150, 30, 30), (2, 50, 2, 3)).astype(np.float32)
    samples[1, :, 1] = 0.9 * samples[1, :, 0] + rng.normal(0, 2, (50, 3))
    tones = np.tile([1.0, 0.0, 0.0], (3, 3, 1)) + 0.05 * rng.normal(size=(3, 3, 3))
    tones[:, 0, 2] = 0
    nodes, counts = np.array([[0, 2], [1, 0]]), np.array([50, 40])
    information, evidence = np.empty((2, 3, 3, 3)), np.empty((2, 3, 3))
    weigh_samples(samples, counts, nodes, tones, information, evidence)
    for p, (a, b) in enumerate(nodes):
        expected = normal_equations(samples[p, : counts[p]].astype(float), tones[a], tones[b])
        np.testing.assert_allclose(information[p], expected[0], rtol=1e-6)
        np.testing.assert_allclose(evidence[p], expected[1], rtol=1e-6)


@pytest.mark.parametrize("count", [4, 80])
def test_tones_are_those_of_the_dense_system(count):
    rng = np.random.default_rng(5)
    ring = [(k, (k + 1) % count) for k in range(count)]
    nodes = np.array([*ring, (3, 1), (0, count), (3, count)])  # the last node is the model, no unknown
    roots = rng.normal(size=(len(nodes), 3, 3, 3))
    information, evidence = roots @ roots.transpose(0, 1, 3, 2), rng.normal(size=(len(nodes), 3, 3))
    weights, expected = rng.uniform(0.1, 1.0, len(nodes)), rng.normal(size=(count, 3, 3))
    precision = np.array([25.0, 0.1, 9.0])
    off = expected.copy()
    solve_tones(information, evidence, nodes, weights, precision, off)
    dense = solve(information, evidence, nodes, weights, precision, expected)
    np.testing.assert_allclose(off, dense, rtol=0.0, atol=1e-9 * np.abs(dense).max())


def test_tones_that_agree_stay():
    """Without evidence, and without any pair, the solution is the expected tones."""
    for nodes in (np.empty((0, 2), np.int64), np.array([[0, 1]])):
        off, nothing = np.zeros((2, 3, 3)), np.zeros((len(nodes), 3, 3, 3))
        solve_tones(nothing, nothing[..., 0], nodes, np.ones(len(nodes)), np.array([25.0, 0.1, 9.0]), off)
        np.testing.assert_array_equal(off, np.zeros((2, 3, 3)))


@pytest.mark.parametrize("size", [(6, 8), (5, 7), (1, 1)])
def test_a_texture_in_another_tone(size):
    rng = np.random.default_rng(0)
    (h, w), half = size, ((size[0] + 1) // 2, (size[1] + 1) // 2)
    texture = Texture(*(rng.integers(0, 1024, s).astype(np.uint16) for s in (size, half, half)))
    tone = np.array([1.2, -30.0, 0.8, 0.1, 90.0, 1.1, -0.05, 3.0])
    out = toned_texture(texture, tone)
    full = np.pad(texture.y.astype(float), ((0, h % 2), (0, w % 2)), "edge")
    luma = full.reshape(half[0], 2, half[1], 2).mean(axis=(1, 3))
    expected = (
        tone[0] * texture.y + tone[1],
        tone[2] * texture.cb + tone[3] * luma + tone[4],
        tone[5] * texture.cr + tone[6] * luma + tone[7],
    )
    for plane, wanted in zip((out.y, out.cb, out.cr), expected, strict=True):
        np.testing.assert_allclose(plane, np.clip(wanted, 0, 1023), atol=0.501)
    same = toned_texture(texture, packed(np.eye(4)[None])[0])
    np.testing.assert_array_equal(same.y, texture.y)
    np.testing.assert_array_equal(same.cr, texture.cr)


def test_pictures_have_the_views_mean_tone():
    tones = random_tones(3, 0)
    shares = np.array([0.5, 0.3, 0.2])
    colour = np.array([0.3, 0.2, -0.1, 1]) * [876, 448, 448, 1]
    seen = (tones @ colour)[:, :3] + [64, 512, 512]
    mean = shares @ seen
    rows = to_picture(tones, shares)

    def apply(t, c):
        return [t[0] * c[0] + t[1], t[2] * c[1] + t[3] * c[0] + t[4], t[5] * c[2] + t[6] * c[0] + t[7]]

    common = np.add(colour[:3], [64, 512, 512])
    for k in range(3):
        np.testing.assert_allclose(apply(rows[k], seen[k]), mean, atol=1e-9)
        np.testing.assert_allclose(apply(to_common(tones)[k], seen[k]), common, atol=1e-9)
    np.testing.assert_allclose(apply(rows[3], common), mean, atol=1e-9)


def test_shares_change_smoothly_and_go_to_the_nearest(rig):
    twin, _, scene = rig
    cameras = list(twin.sources)
    at_one = view_shares(dataclasses.replace(cameras[3], name="t"), cameras, scene.depths[:2])
    assert at_one.sum() == pytest.approx(1.0)
    assert at_one.argmax() == 3
    assert at_one[3] > 0.7
    shares = []
    for y in np.linspace(-0.05, 0.05, 41):
        pose = cameras[3].pose.translated((0.0, y, 0.0))
        shares.append(view_shares(dataclasses.replace(cameras[3], pose=pose), cameras, scene.depths[:2]))
    assert np.abs(np.diff(shares, axis=0)).max() < 0.1  # in steps of 2.5 mm
    away = [dataclasses.replace(c, pose=Pose.from_euler((0, 0, 0), np.pi, 0, 0)) for c in camera_row()]
    np.testing.assert_allclose(view_shares(camera_row()[0], away, (2.0,)), 1 / 3)


def test_views_that_agree_are_left_alone(rig):
    _, first, scene = rig
    (tones,) = followed(first, scene=scene)
    assert np.abs(tones @ GREY - GREY).max() < 1.0


@pytest.mark.parametrize("seed", [0, 1])
def test_tones_are_found_again(rig, seed):
    _, first, scene = rig
    truth = random_tones(len(first.views), seed)
    (tones,) = followed(misexposed(first, truth), scene=scene)
    assert np.abs(tone_errors(np.tile(np.eye(4), (len(truth), 1, 1)), truth)).max() > 40
    assert np.abs(tone_errors(tones, truth)).max() < 1.0  # code at mid grey
    assert np.abs((np.linalg.inv(tones) @ truth @ WHITE).std(axis=0)).max() < 1.0


def test_a_fifth_of_outliers_does_little(rig):
    """Bright squares cover a fifth of every view, in each view at other places, so that no two views agree there."""
    _, first, scene = rig
    truth = random_tones(len(first.views), 0)
    rng = np.random.default_rng(5)
    spoilt = []
    for view in misexposed(first, truth).views:
        tiles = rng.random((6, 8)) < 0.2
        mask = np.kron(tiles, np.ones((-(-view.camera.height // 6), -(-view.camera.width // 8)), bool))
        spoilt.append(with_luma(view, np.where(mask[: view.camera.height, : view.camera.width], 800, view.texture.y)))
    (tones,) = followed(Frame(0, tuple(spoilt)), scene=scene)
    assert np.abs(tone_errors(tones, truth))[:, 0].max() < 4.0


def test_noise_does_not_make_tones_flicker(rig):
    """Sixty frames of a still scene with noise: no view's white moves by a code from one frame to the next."""
    _, first, scene = rig
    rng = np.random.default_rng(2)
    altered = misexposed(first, random_tones(len(first.views), 0))

    def noisy(view):
        return with_luma(view, view.texture.y + rng.normal(0, 12, view.texture.y.shape))

    frames = [dataclasses.replace(altered, views=tuple(map(noisy, altered.views))) for _ in range(60)]
    whites = np.array([tones @ WHITE for tones in followed(*frames, scene=scene)])
    assert np.abs(np.diff(whites, axis=0)).max() < 1.0


def test_a_step_is_followed_smoothly(rig):
    _, first, scene = rig
    count = len(first.views)
    step = np.tile(np.eye(4), (count, 1, 1))
    step[1, [0, 1, 2], [0, 1, 2]] = 1.2
    frames = [first] * 2 + [misexposed(first, step)] * 75  # five time constants
    all_whites = np.array([(tones @ WHITE)[:, 0] for tones in followed(*frames, scene=scene)])
    gain = all_whites[:, 1] / np.median(all_whites, axis=1) - 1.0
    assert abs(gain[1]) < 0.002
    assert gain[-1] == pytest.approx(0.2, rel=0.03)
    assert np.diff(gain)[1:].min() > -0.0005
    assert np.diff(gain).max() < 0.1 * 0.2  # 1 - exp(-1 / 15) of it


def test_views_without_a_common_surface_stay_as_they_are():
    cameras = camera_row(2)
    turned = dataclasses.replace(cameras[1], pose=Pose.from_euler((0.0, 0.4, 0.0), np.pi, 0.0, 0.0))
    first = frame(0, [cameras[0], cameras[0]], 0.0)
    views = (first.views[0], dataclasses.replace(first.views[1], camera=turned))
    scene = Scene.of([cameras[0], turned], Settings(), Frame(0, views))
    (tones,) = followed(misexposed(Frame(0, views), random_tones(2, 0)), scene=scene)
    np.testing.assert_array_equal(tones, np.tile(np.eye(4), (2, 1, 1)))


@pytest.mark.parametrize("quality", ["fast", "balanced", "best"])
def test_pictures_from_differing_views_are_as_good_as_from_equal_ones(quality):
    twin = make_twin("museum", 0.125)
    first, target = twin_frame(twin, 0), twin.camera("t0")
    altered = misexposed(first, random_tones(len(first.views), 0))
    truth = twin.truth(target, 0).texture
    figures = []
    for one, follow_s in ((first, 0.0), (first, 0.5), (altered, 0.0), (altered, 0.5)):
        engine = Engine(twin.sources, Settings.preset(quality, exposure_s=follow_s))
        engine.update(one, {"me": target})
        figures.append(psnr(truth, without_gain(truth, engine.render_camera(target, "me").texture))[0])
    equal, equal_followed, left, removed = figures
    assert equal_followed == pytest.approx(equal, abs=0.02)
    assert left < equal - 0.5
    assert removed == pytest.approx(equal, abs=0.15)


def test_the_background_follows_the_light():
    """Background that was uncovered while the light was on fills a hole when all cameras see less light."""
    cameras = camera_row(2, spacing=0.2)
    viewer = dataclasses.replace(cameras[0], name="viewer", pose=Pose((0.0, 0.9, 0.0)))
    dark = np.tile(np.diag([0.6, 0.6, 0.6, 1.0]), (2, 1, 1))
    frames = [frame(0, cameras, 0.0), frame(1, cameras, 1.2), frame(2, cameras, 1.2)]
    frames += [misexposed(frame(k, cameras, 0.0), dark) for k in range(3, 63)]
    engine = Engine(cameras, Settings(fill="none", n_update=2, baseline_m=1.0))
    for one in frames:
        engine.update(one, {"v": viewer})
    picture = engine.render_camera(viewer, "v")
    uncovered = picture.holes(warped=True) & ~picture.holes()
    assert uncovered.sum() > 20
    assert np.median(picture.texture.y[uncovered]) == pytest.approx(64 + 0.6 * (WALL_Y - 64), abs=5)


def test_a_time_constant_below_zero_is_refused():
    with pytest.raises(ValueError, match="exposure_s: -1"):
        Settings(exposure_s=-1.0)
