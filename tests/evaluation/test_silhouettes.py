"""Displacement, roughness and thin structures, on shapes whose coverage is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from farside.engine.evaluation.silhouettes import fine_camera, judge_silhouettes
from farside.engine.kernels.evaluation.silhouettes import FINE, thin_structures
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Texture, View

W, H = 96, 80
NEAR, FAR = 1.0, 4.0
CAMERA = Camera("t", Perspective.from_fov(W, H, 1.2), Pose(), DepthCoding(0.5, 10.0))


def texture(luma):
    half = np.full((math.ceil(luma.shape[0] / 2), math.ceil(luma.shape[1] / 2)), 512, np.uint16)
    return Texture(np.rint(luma).astype(np.uint16), half, half)


def coverage(inside, fine=16):
    """Share of each pixel inside a shape given by a function of (x, y), pixels."""
    y, x = (np.mgrid[0 : H * fine, 0 : W * fine] + 0.5) / fine
    return inside(x, y).reshape(H, fine, W, fine).mean(axis=(1, 3))


def truth(inside, near=800.0, far=200.0):
    camera = fine_camera(CAMERA)
    y, x = (np.mgrid[0 : H * FINE, 0 : W * FINE] + 0.5) / FINE
    mask = inside(x, y)
    return View(camera, texture(np.where(mask, near, far)), camera.depth.codes(np.where(mask, NEAR, FAR)))


def rendered(cover, near=800.0, far=200.0, disparity=None):
    light = [((code - 64) / 876) ** 2 for code in (near, far)]
    luma = 64 + 876 * np.sqrt(light[1] + cover * (light[0] - light[1]))
    if disparity is None:
        disparity = np.where(cover > 0.5, 1 / NEAR, 1 / FAR)
    return texture(luma), disparity.astype(np.float32)


def disc(radius):
    return lambda x, y: np.hypot(x - 47.3, y - 40.6) < radius


@pytest.mark.parametrize("colours", [(800.0, 200.0), (250.0, 700.0)])
@pytest.mark.parametrize("grown", [-1.0, -0.3, 0.0, 0.25, 1.0])
def test_bias_is_the_growth_of_a_disc(grown, colours):
    figures = judge_silhouettes(truth(disc(30.0), *colours), *rendered(coverage(disc(30.0 + grown)), *colours))
    assert figures.bias_px == pytest.approx(grown, abs=0.03)
    assert figures.roughness_px < 0.1
    assert figures.silhouettes > 0.95 * 4 * math.sqrt(2) * 30  # one a row or column


def test_blur_is_no_bias():
    cover = coverage(disc(20.0))
    blurred = sum(np.roll(cover, (j, i), (0, 1)) for j in (-1, 0, 1) for i in (-1, 0, 1)) / 9
    figures = judge_silhouettes(truth(disc(20.0)), *rendered(blurred))
    assert figures.bias_px == pytest.approx(0.0, abs=0.03)


def test_an_edge_without_mixed_pixels_is_rough():
    def slope(x, y):
        return (x - 48) + 0.3 * (y - 40) < 0

    smooth = judge_silhouettes(truth(slope), *rendered(coverage(slope)))
    stepped = judge_silhouettes(truth(slope), *rendered((coverage(slope) > 0.5).astype(float)))
    # Rounding to whole pixels is uniform within half a pixel along x; the normal leans by atan 0.3.
    assert stepped.roughness_px == pytest.approx(math.sqrt(1 / 12) / math.hypot(1, 0.3), abs=0.02)
    assert smooth.roughness_px < 0.06
    assert stepped.bias_px == pytest.approx(0.0, abs=0.03)


def test_teeth_are_rough_and_no_bias():
    cover = coverage(lambda x, y: x < 48)
    cover[::2, 48], cover[1::2, 47] = 1.0, 0.0
    figures = judge_silhouettes(truth(lambda x, y: x < 48), *rendered(cover))
    assert figures.bias_px == pytest.approx(0.0, abs=0.02)
    # Teeth of one pixel out and in: the mean of nine neighbours is off by a ninth itself.
    assert figures.roughness_px == pytest.approx(math.sqrt(9 / 8) * 8 / 9, abs=0.02)


def test_nothing_is_said_where_lumas_are_alike_or_depth_is_smooth():
    assert judge_silhouettes(truth(disc(20.0), 500, 520), *rendered(coverage(disc(20.0)), 500, 520)).silhouettes == 0
    flat = judge_silhouettes(truth(lambda x, y: x > 1000), *rendered(np.zeros((H, W))))
    assert (flat.silhouettes, flat.thin_pixels) == (0, 0)
    assert math.isnan(flat.bias_px)
    assert math.isnan(flat.thin)


def bar(width):
    return lambda x, y: np.abs(x - 30.5) < width / 2


def test_thin_bars_survive_as_far_as_their_depth_is_there():
    cover = coverage(bar(1.5))
    kept = np.where(cover > 0.5, 1 / NEAR, 1 / FAR)
    kept[: H // 4] = 1 / FAR
    kept[H // 4 : H // 2] = 0.0  # holes
    figures = judge_silhouettes(truth(bar(1.5)), *rendered(cover, disparity=kept))
    assert figures.thin_pixels == H
    assert figures.thin == pytest.approx(0.5)
    assert judge_silhouettes(truth(bar(3.0)), *rendered(coverage(bar(3.0)))).thin_pixels == 0


def test_thin_structures_agree_with_a_plain_search():
    rng = np.random.default_rng(3)
    disparity = rng.choice([0.2, 0.5, 0.51, 1.0], (40, 50), p=[0.5, 0.2, 0.2, 0.1])

    def plain(line, at, step, width):
        limit = line[at] / (1 + step)
        left = next((k for k in range(at - 1, -1, -1) if line[k] < limit), None)
        right = next((k for k in range(at + 1, len(line)) if line[k] < limit), None)
        if left is None or right is None or right - left - 1 > width:
            return 0.0
        return max(line[left], line[right])

    for width in (1, 2, 5):
        expected = [
            [max(plain(disparity[y], x, 0.05, width), plain(disparity[:, x], y, 0.05, width)) for x in range(50)]
            for y in range(40)
        ]
        np.testing.assert_array_equal(thin_structures(disparity, 0.05, width), expected)


def test_the_size_of_the_truth_is_checked():
    view = View(CAMERA, texture(np.zeros((H, W))), np.zeros((H, W), np.uint16))
    with pytest.raises(ValueError, match=r"fine: \(96, 80\): expected 4 times the picture's \(96, 80\)"):
        judge_silhouettes(view, *rendered(np.zeros((H, W))))
