"""Anti-aliased silhouettes: a slanted edge gets its coverage, and no other pixel changes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from farside.engine.kernels.rendering import antialias
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Frame, Texture, View
from farside.engine.settings import Settings

CODING = DepthCoding(0.5, 20.0, 16, has_invalid=True)
FLAT = Perspective.from_fov(64, 48, 1.2)
SPHERE = Equirectangular(64, 48, (-0.6, 0.6), (-0.45, 0.45))
NEAR, FAR = 1.5, 5.0


def slanted(camera):
    """A view of a near bright surface to the left of a slanted line, in front of a dark wall."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    near = u / camera.width < 0.4 + 0.17 * v / camera.height
    luma = np.where(near, 900, 100).astype(np.uint16)
    chroma = np.full((camera.height // 2, camera.width // 2), 512, np.uint16)
    return View(camera, Texture(luma, chroma, chroma), camera.depth.codes(np.where(near, NEAR, FAR)))


def rendered(projection, **settings):
    """A picture from one view of four times its size, and the truth: the mean colour that each of its pixels covers."""
    source = Camera("source", projection.scaled(4.0), Pose((0.0, 0.0, 0.0)), CODING)
    view = slanted(source)
    engine = Engine([source], Settings(background=False, baseline_m=0.5, **settings))
    engine.update(Frame(0, (view,)))
    picture = engine.render_camera(dataclasses.replace(source, name="eye", projection=projection))
    luma = view.texture.y.astype(float)
    h, w = picture.texture.y.shape
    return picture, luma.reshape(h, 4, w, 4).mean(axis=(1, 3))


@pytest.mark.parametrize("antialias", ["morphological", "samples"])
@pytest.mark.parametrize("projection", [FLAT, SPHERE], ids=["perspective", "sphere"])
def test_a_slanted_silhouette_covers_its_pixels_in_part(projection, antialias):
    aliased, truth = rendered(projection)
    smooth, _ = rendered(projection, antialias=antialias)
    at_edge = (truth > 100) & (truth < 900)
    assert at_edge.sum() > 40
    before, after = (
        np.sqrt(np.mean((picture.texture.y - truth)[at_edge] ** 2)) for picture in (aliased, smooth)
    )
    assert after < 0.6 * before
    around = np.pad(at_edge, 1)
    elsewhere = ~np.any([np.roll(around, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1)], axis=0)[1:-1, 1:-1]
    np.testing.assert_array_equal(smooth.texture.y[elsewhere], aliased.texture.y[elsewhere])
    np.testing.assert_array_equal(smooth.disparity, aliased.disparity)


def test_silhouettes_are_bends_of_disparity_and_slopes_are_none():
    disparity = np.tile(np.linspace(0.1, 0.9, 17, dtype=np.float32), (6, 1))
    disparity[:, 9:] += 0.5
    disparity[0] = 0.0  # a hole has no silhouette
    marks = np.full(disparity.shape, 7, np.uint8)
    antialias.mark_silhouettes(disparity, 0.2, marks)
    expected = np.zeros(disparity.shape, np.uint8)
    expected[1:, 8:10] = 1
    np.testing.assert_array_equal(marks, expected)


@pytest.mark.parametrize("seed", range(3))
def test_marked_pixels_take_the_mean_of_what_was_drawn(seed):
    rng = np.random.default_rng(seed)
    h, w = 5, 7
    marks = (rng.random((h, w)) < 0.5).astype(np.uint8)
    drawn = (rng.random((2 * h, 2 * w)) < 0.6).astype(np.float32)
    fine = [rng.random((2 * h, 2 * w), np.float32) for _ in range(3)]
    planes = [rng.random((h, w), np.float32) for _ in range(3)]
    expected = [plane.copy() for plane in planes]
    for y, x in np.argwhere(marks):
        samples = np.s_[2 * y : 2 * y + 2, 2 * x : 2 * x + 2]
        if drawn[samples].any():
            for plane, source in zip(expected, fine, strict=True):
                plane[y, x] = source[samples][drawn[samples] > 0].mean()
    antialias.average_marked(marks, drawn, *fine, *planes)
    for plane, wanted in zip(planes, expected, strict=True):
        np.testing.assert_allclose(plane, wanted, rtol=1e-6)


def test_tiles_hold_their_marked_pixels():
    marks = np.zeros((9, 13), np.uint8)
    marks[3, 12] = marks[8, 4] = 1
    tiles = np.full((3, 4), 9, np.uint8)
    antialias.mark_tiles(marks, 4, tiles)
    expected = np.zeros((3, 4), np.uint8)
    expected[0, 3] = expected[2, 1] = 1
    np.testing.assert_array_equal(tiles, expected)
