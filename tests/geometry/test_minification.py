"""Views at reduced sizes: patterns that are too fine become grey, and nothing crosses a depth edge."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from farside.engine.geometry.minification import MOST_LEVELS, Level, halved, level_for
from farside.engine.geometry.prepared_view import PreparedView, ViewTable, pixels_per_radian
from farside.engine.geometry.triangulation import TriangulationOptions, depth_cuts
from farside.engine.kernels.geometry import minify
from farside.engine.rendering.target import Target
from farside.engine.rendering.warping import Canvas
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Texture, View
from farside.engine.support.packed import HEIGHT, WIDTH
from oracle.minify import halve

ORIGIN = np.zeros(3)
CODING = DepthCoding(0.5, 20.0, 16, has_invalid=True)
FLAT = Perspective.from_fov(128, 96, 1.2)
SPHERE = Equirectangular(256, 128, (-math.pi, math.pi), (-math.pi / 2, math.pi / 2))
OPTIONS = TriangulationOptions(0.0, 0.1)
NEAR, FAR = 1.5, 5.0


def camera_at(y=0.0, projection=FLAT, yaw=0.0, pitch=0.0):
    return Camera("v", projection, Pose.from_euler((0.0, y, 0.0), yaw, pitch, 0.0), CODING)


def prepared(camera, depth, luma):
    """A view whose Cb is an eighth of its luma, and whose Cr is that plus 9."""
    luma = np.broadcast_to(np.rint(luma), (camera.height, camera.width)).astype(np.uint16)
    chroma = np.ascontiguousarray(luma[::2, ::2] // 8)
    codes = camera.depth.codes(np.broadcast_to(np.asarray(depth, float), luma.shape))
    return PreparedView(View(camera, Texture(luma.copy(), chroma, chroma + np.uint16(9)), codes), OPTIONS, ORIGIN)


def shaded(camera, view, *, prefilter=True, cubic=False):
    canvas, target = Canvas(camera.width, camera.height), Target(camera, ORIGIN)
    canvas.clear()
    canvas.grey()
    canvas.draw(view.mesh(), target, 0, 0.01, 1e-3)
    canvas.shade(target, ViewTable([view], drawn=1), 1, 3, cubic=cubic, prefilter=prefilter)
    return canvas


def size_for(projection, view):
    """Width and height of the view that a picture of this projection takes colours from."""
    rows, _ = ViewTable([view], drawn=1).at(pixels_per_radian(camera_at(projection=projection)))
    return rows[0, WIDTH], rows[0, HEIGHT]


@pytest.mark.parametrize("cubic", [False, True])
@pytest.mark.parametrize("projection", [FLAT, Equirectangular(128, 96, (-0.6, 0.6), (-0.45, 0.45))])
@pytest.mark.parametrize("times", [2, 4])
def test_a_pattern_that_is_too_fine_becomes_grey(projection, times, cubic):
    camera = camera_at(projection=projection)
    v, u = np.mgrid[0:96, 0:128]
    view = prepared(camera, 4.0, np.where((u + v) % 2, 900, 100))
    # The target's pixel centres project to centres of texels, not to corners where four of them meet.
    half = 0.5 / (projection.fx if isinstance(projection, Perspective) else 128 / 1.2)
    target = camera_at(projection=projection.scaled(1.0 / times), yaw=half, pitch=half)
    inner = np.s_[2:-2, 2:-2]
    aliased = shaded(target, view, prefilter=False, cubic=cubic).planes[0][inner]
    grey = shaded(target, view, cubic=cubic).planes[0][inner]
    assert np.abs(aliased - 500).mean() > 100
    np.testing.assert_allclose(grey, 500, atol=1.0)


@pytest.mark.parametrize("times", [2, 4])
@pytest.mark.parametrize("y", [0.0, 0.05, 0.11])
def test_no_colour_crosses_a_depth_edge(times, y):
    column = np.arange(FLAT.width)
    near = (column > 40) & (column < 83)
    view = prepared(camera_at(), np.where(near, NEAR, FAR), np.where(near, 900, 100))
    canvas = shaded(camera_at(y, FLAT.scaled(1.0 / times)), view)
    drawn = canvas.disparity > 0
    expected = np.where(canvas.disparity > 1 / 3, 900, 100)
    assert len(np.unique(expected[drawn])) == 2
    np.testing.assert_allclose(canvas.planes[0][drawn], expected[drawn], atol=0.1)


def test_chroma_crosses_no_depth_edge_either():
    near = (np.arange(FLAT.width) >= 42) & (np.arange(FLAT.width) < 82)  # its own 2x2 texels are of one surface
    view = prepared(camera_at(), np.where(near, NEAR, FAR), np.where(near, 900, 104))
    canvas = shaded(camera_at(0.05, FLAT.scaled(0.25)), view)
    drawn = canvas.disparity > 0
    expected = np.where(canvas.disparity > 1 / 3, 900 // 8, 104 // 8)
    assert drawn.all()
    blocks = expected.reshape(drawn.shape[0] // 2, 2, -1, 2).mean(axis=(1, 3))  # chroma is that of 2x2 pixels
    np.testing.assert_allclose(canvas.planes[1][::2, ::2], blocks, atol=0.1)
    np.testing.assert_allclose(canvas.planes[2][::2, ::2], blocks + 9, atol=0.1)


def test_what_only_the_full_size_shows_is_taken_from_there():
    """A wall seen through slits narrower than a reduced texel: in the reduced view the fence wins there."""
    slit = np.isin(np.arange(FLAT.width) % 8, (3, 4))
    view = prepared(camera_at(), np.where(slit, FAR, NEAR), np.where(slit, 100, 900))
    canvas = shaded(camera_at(projection=FLAT.scaled(0.5), yaw=1.0 / FLAT.fx), view)
    wall = (canvas.disparity > 0) & (canvas.disparity < 1 / 3)
    assert wall.sum() > 500
    whole = view.view
    planes = (whole.texture.y, whole.texture.cb, whole.texture.cr)
    half = halved(Level(whole.camera, whole.codes, *planes, view.cuts), OPTIONS)
    assert (half.codes > CODING.codes(np.array(3.0))).all()
    np.testing.assert_allclose(canvas.planes[0][wall], 100, atol=0.1)


@pytest.mark.parametrize("times", [1.0, 1.3, 1.7])
def test_a_picture_that_is_hardly_coarser_is_left_alone(times):
    luma = np.random.default_rng(1).integers(64, 940, (96, 128))
    projection = dataclasses.replace(FLAT, fx=FLAT.fx / times, fy=FLAT.fy / times)
    pictures = []
    for prefilter in (False, True):
        view = prepared(camera_at(), 4.0, luma)
        pictures.append(shaded(camera_at(0.03, projection), view, cubic=True, prefilter=prefilter).planes)
        assert size_for(projection, view) == (128, 96)
    for plain, same in zip(*pictures, strict=True):
        np.testing.assert_array_equal(plain, same)


@pytest.mark.parametrize("times", [2.0, 4.0])
def test_a_wrapping_picture_is_reduced_across_its_seam(times):
    azimuth = math.pi - (np.arange(256) + 0.5) / 256 * 2 * math.pi
    view = prepared(camera_at(projection=SPHERE), 3.0, 500 + 300 * np.cos(azimuth)[None, :])
    size = 2 * round(0.5 * 256 / (2 * math.pi) / times)
    camera = camera_at(projection=Perspective.from_fov(size, size, 2 * math.atan(0.5)), yaw=math.pi)
    canvas = shaded(camera, view)
    assert (canvas.disparity > 0).all()
    assert size_for(camera.projection, view) == (256 / times, 128 / times)
    v, u = np.mgrid[0:size, 0:size] + 0.5
    along = camera.unproject(np.stack([u, v], -1), np.ones_like(u))
    expected = 500 + 300 * np.cos(np.arctan2(along[..., 1], along[..., 0]))
    # The error of a bilinear fetch of a cosine that was averaged over each texel.
    assert np.abs(canvas.planes[0] - expected).max() < 300 * 0.25 * (2 * math.pi * times / 256) ** 2 + 1


def level_of(codes, planes, wraps=False):
    h, w = codes.shape
    projection = dataclasses.replace(SPHERE, width=w, height=h) if wraps else Perspective(w, h, 40.0, 50.0, 7.0, 6.0)
    camera = Camera("v", projection, Pose(), CODING)
    return Level(camera, codes, *planes, depth_cuts(camera, codes, OPTIONS))


@pytest.mark.parametrize("wraps", [False, True])
def test_levels_are_those_of_the_oracle(wraps):
    rng = np.random.default_rng(5)
    depth = rng.choice([1.5, 1.6, 5.0, np.nan], (16, 24), p=[0.3, 0.3, 0.3, 0.1])
    depth[:4] = 2.0 + 0.01 * np.arange(24)
    planes = [rng.integers(0, 1024, depth.shape).astype(np.uint16) for _ in range(3)]
    level = level_of(CODING.codes(depth), planes, wraps)
    smaller = halved(level, OPTIONS)
    expected = halve(level.codes, level.cuts, planes)
    for got, wanted in zip((smaller.codes, smaller.y, smaller.cb, smaller.cr), expected, strict=True):
        np.testing.assert_array_equal(got, wanted)
    np.testing.assert_array_equal(smaller.cuts, depth_cuts(smaller.camera, smaller.codes, OPTIONS))
    masks = np.empty(smaller.codes.shape, np.uint8)
    minify.halve_codes(level.codes, level.cuts, np.empty_like(smaller.codes), masks)
    assert len(np.unique(masks)) > 10
    assert (masks[:2] == minify.ALL).all()


def test_the_camera_of_a_level_sees_the_same_points_in_half_the_pixels():
    codes = np.full((12, 14), 9000, np.uint16)
    for wraps in (False, True):
        level = level_of(codes, [codes] * 3, wraps)
        smaller = halved(level, OPTIONS).camera
        for point in ((3.0, 0.4, -0.2), (2.0, -0.7, 0.3)):
            np.testing.assert_allclose(2 * smaller.project(point)[0], level.camera.project(point)[0], atol=1e-9)


def test_chroma_of_a_420_view_is_that_of_its_first_level():
    rng = np.random.default_rng(6)
    view = prepared(camera_at(), 4.0, rng.integers(64, 940, (96, 128))).view
    planes = (view.texture.y, view.texture.cb, view.texture.cr)
    first = halved(Level(view.camera, view.codes, *planes, depth_cuts(view.camera, view.codes, OPTIONS)), OPTIONS)
    assert first.cb is view.texture.cb
    assert not first.subsampled
    assert halved(first, OPTIONS).cb.shape == (24, 32)


def test_odd_sizes_are_not_halved():
    codes = np.full((10, 14), 9000, np.uint16)
    first = halved(level_of(codes, [codes] * 3), OPTIONS)
    assert first.y.shape == (5, 7)
    assert halved(first, OPTIONS) is None
    view = prepared(camera_at(projection=Perspective.from_fov(66, 50, 1.2)), 4.0, 700)
    canvas = shaded(camera_at(projection=Perspective.from_fov(8, 6, 1.2)), view)
    assert size_for(Perspective.from_fov(8, 6, 1.2), view) == (33, 25)  # once halved: odd
    np.testing.assert_allclose(canvas.planes[0][canvas.disparity > 0], 700, atol=0.1)


def test_the_level_follows_from_the_ratio():
    ratios = (0.3, 1.0, 1.4, 1.73, 1.75, 2.0, 3.4, 3.5, 4.0, 6.9, 7.0, 100.0)
    assert [level_for(ratio) for ratio in ratios] == [0, 0, 0, 0, 1, 1, 1, 2, 2, 2, 3, MOST_LEVELS]
