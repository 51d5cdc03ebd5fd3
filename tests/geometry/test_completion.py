"""Completion of depth: against the readable twin, on planes and steps, and its effect on pictures."""

from __future__ import annotations

import numpy as np
import pytest
from farside.engine.evaluation.sparse import compare_sparse, punched
from farside.engine.geometry.completion import complete, completed_codes
from farside.engine.io.tmiv import open_sequence
from farside.engine.kernels.geometry.complete import drop_mixed
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Frame, Texture, View
from farside.engine.settings import Settings
from farside.engine.synth import write_twin
from oracle import completion as oracle

CODING = DepthCoding(0.5, 10.0, 16, has_invalid=True)
EDGE_CODES = 2000.0


def view_of(codes, y=None, *, coding=CODING, name="v0", position=(0.0, 0.0, 0.0)):
    """A view with the given codes and luma; grey."""
    h, w = codes.shape
    camera = Camera(name, Perspective.from_fov(w, h, 1.0), Pose(position), coding)
    luma = np.full((h, w), 500, np.uint16) if y is None else y.astype(np.uint16)
    chroma = np.full(((h + 1) // 2, (w + 1) // 2), 512, np.uint16)
    return View(camera, Texture(luma, chroma, chroma.copy()), codes.astype(np.uint16))


def completed(view):
    return completed_codes(view, EDGE_CODES * view.camera.depth.step)


@pytest.mark.parametrize("shape", [(23, 17), (16, 32), (1, 9), (2, 2), (7, 1)])
def test_as_the_readable_twin(shape):
    rng = np.random.default_rng(shape[0])
    y, x = np.mgrid[: shape[0], : shape[1]]
    codes = (20000 + 300 * x + 15000 * (y > 10) + rng.integers(0, 500, shape)).astype(np.uint16)
    codes[(rng.random(shape) < 0.5) | ((x > 3) & (x < 12) & (y > 3))] = 0
    codes[0, 0] = 21000
    view = view_of(codes, rng.integers(64, 940, shape))
    for plane in (view.texture.cb, view.texture.cr):
        plane[:] = rng.integers(400, 600, plane.shape)
    out, confidence = completed(view)
    expected, trust = oracle.complete(codes, view.texture.y, view.texture.cb, view.texture.cr, EDGE_CODES)
    np.testing.assert_allclose(out, expected, atol=1.0)
    np.testing.assert_allclose(confidence, trust, atol=1.0)


def test_measured_depth_stays_and_is_certain_and_the_rest_is_less_so_with_distance():
    rng = np.random.default_rng(0)
    codes = rng.integers(20000, 21000, (64, 64)).astype(np.uint16)
    codes[:, 20:] = 0
    out, confidence = completed(view_of(codes))
    np.testing.assert_array_equal(out[:, :20], codes[:, :20])
    assert (confidence[:, :20] == 255).all()
    assert (confidence[:, 20:] < 255).all()
    rows = confidence[32, [20, 24, 32, 60]].astype(int)
    assert (np.diff(rows) < 0).all()
    assert out.min() > 0


def test_a_plane_with_dropouts_is_restored_in_its_slope():
    y, x = np.mgrid[:96, :128]
    plane = 20000 + 90.0 * x + 60.0 * y
    lost = np.random.default_rng(1).random(plane.shape) < 0.3
    lost |= (x % 16 == 5) | (y % 16 == 9)  # cracks
    out, confidence = completed(view_of(np.where(lost, 0, np.rint(plane))))
    error = np.abs(out - plane)
    assert error.max() <= 150.0  # one pixel down the slope
    assert error[lost].mean() <= 15.0
    assert (confidence[lost] >= 180).mean() > 0.98  # except in clusters of dropouts


def test_a_hole_in_a_plane_is_crossed():
    y, x = np.mgrid[:96, :128]
    plane = 20000 + 90.0 * x + 60.0 * y
    lost = np.hypot(y - 48, x - 64) < 12
    out, _ = completed(view_of(np.where(lost, 0, np.rint(plane))))
    # Much closer than a single depth could be, whose error would be the slope times the radius.
    assert np.abs(out - plane)[lost].max() < 0.4 * 12 * np.hypot(90, 60)


def test_a_step_under_a_colour_edge_is_not_smeared():
    x = np.broadcast_to(np.arange(64), (48, 64))
    near = x < 30
    codes = np.where(near, 40000, 15000)
    codes[:, 26:38] = 0
    out, _ = completed(view_of(codes, np.where(near, 200, 800)))
    assert np.abs(out[near].astype(int) - 40000).max() < 2500
    assert np.abs(out[~near].astype(int) - 15000).max() < 2500


def mixed_by_loops(codes, edge):
    """Pixels half way between two surfaces, directly from the definition."""
    mixed = np.zeros(codes.shape, bool)
    for lines, marks in ((codes, mixed), (codes.T, mixed.T)):
        for j, i in np.ndindex(lines.shape):
            if 2 <= i < lines.shape[1] - 2:
                p, a, c, b, q = (int(lines[j, i + k]) for k in range(-2, 3))
                slopes = abs(a - p) * (p > 0), abs(b - q) * (q > 0)
                between = a > 0 and b > 0 and min(a, b) < c < max(a, b) and abs(a - b) > edge
                marks[j, i] |= between and 4 * min(abs(c - a), abs(c - b)) > abs(a - b) > 4 * max(slopes)
    return mixed


@pytest.mark.parametrize("shape", [(19, 33), (3, 60), (60, 4)])
def test_mixed_pixels_as_by_definition(shape):
    rng = np.random.default_rng(shape[1])
    runs = np.repeat(np.repeat(rng.choice([20000, 34000], shape), 3, 0), 3, 1)[: shape[0], : shape[1]]
    codes = np.where(rng.random(shape) < 0.2, rng.integers(20000, 34000, shape), runs).astype(np.uint16)
    codes[rng.random(shape) < 0.05] = 0
    out = np.empty_like(codes)
    drop_mixed(codes, EDGE_CODES, out)
    expected = mixed_by_loops(codes, EDGE_CODES)
    assert expected.any()
    np.testing.assert_array_equal(out, np.where(expected, 0, codes))


def test_a_mixed_pixel_goes_and_a_slope_stays():
    x = np.broadcast_to(np.arange(40), (30, 40))
    codes = np.where(x < 20, 40000, 15000)
    codes[:, 20] = 28000
    codes[0, 0] = 0
    view = view_of(codes)
    mixed = complete(view, EDGE_CODES * CODING.step).doubtful
    assert (mixed[:, 20] == 1).all()
    assert mixed[2:, :20].sum() == mixed[:, 21:].sum() == 0
    steep = 10000 + 1500 * x  # two pixels are an edge apart
    steep = np.where((x == 0) & (np.arange(30)[:, None] == 0), 0, steep)
    assert complete(view_of(steep), EDGE_CODES * CODING.step).doubtful[2:].sum() == 0


def test_clean_views_are_left_alone():
    codes = np.full((8, 8), 30000, np.uint16)
    whole = view_of(codes)
    assert complete(whole, 0.1).codes is whole.codes
    assert complete(whole, 0.1).doubtful is None
    codes = codes.copy()
    codes[2, 2] = 0
    far = view_of(codes, coding=DepthCoding(0.5, 10.0))  # code 0 is the far plane
    assert complete(far, 0.1).codes is far.codes
    nothing = view_of(np.zeros((8, 8)))
    assert complete(nothing, 0.1).codes is nothing.codes


def rendered(views, **settings):
    cameras = [view.camera for view in views]
    engine = Engine(cameras, Settings(background=False, fill="none", **settings))
    engine.update(Frame(0, tuple(views)))
    return engine.render_camera(cameras[0])


def test_what_is_not_measured_hides_no_measured_surface():
    near, far = (int(code) for code in CODING.codes(np.array([1.0, 3.0])))
    x = np.broadcast_to(np.arange(64), (48, 64))
    half = view_of(np.where(x < 24, near, 0))  # completion would continue it at 1 m
    wall = view_of(np.full((48, 64), far), name="v1", position=(0.0, 0.02, 0.0))
    picture = rendered([half, wall])
    np.testing.assert_allclose(picture.disparity[:, 2:22], 1.0, atol=0.01)
    np.testing.assert_allclose(picture.disparity[:, 32:60], 1.0 / 3.0, atol=0.01)
    alone = rendered([half])
    np.testing.assert_allclose(alone.disparity[:, 2:60], 1.0, atol=0.01)
    assert (rendered([half], completion=False).disparity[:, 26:] == 0.0).all()


def test_sparse_depth_of_a_twin_gives_better_pictures_completed(tmp_path):
    write_twin("painter", tmp_path, 0.12, 1)
    sequence = open_sequence(tmp_path)
    view = sequence.frame(0).views[0]
    holes = punched(view, 1)
    share = (holes.codes == 0).mean()
    assert 0.2 < share < 0.7
    assert (holes.codes == view.codes)[holes.codes > 0].all()
    samples = {s.mode: s.iv_psnr for s in compare_sparse(sequence, ["t0"], [0], "balanced")}
    assert samples["completed"] > samples["holes"] + 2.0
    assert samples["whole"] > samples["completed"]
