"""Tiles that contain holes, compared with counts of pixels."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from farside.engine.kernels.rendering.tiles import TILE
from farside.engine.rendering.filling import fill
from farside.engine.rendering.tiles import HoleMap

SHAPES = [(1, 1), (7, 10), (24, 40), (37, 51)]


def picture(shape, share, seed=0):
    rng = np.random.default_rng(seed)
    return np.where(rng.random(shape) < share, 0.0, rng.uniform(0.1, 1, shape)).astype(np.float32)


def by_tile(holes):
    h, w = holes.shape
    padded = np.pad(holes, ((0, -h % TILE), (0, -w % TILE)))
    return padded.reshape(-(-h // TILE), TILE, -(-w // TILE), TILE).sum(axis=(1, 3))


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("share", [0.0, 0.02, 1.0])
def test_holes_are_counted_and_listed(shape, share):
    disparity = picture(shape, share)
    holes = HoleMap.of(disparity)
    np.testing.assert_array_equal(holes.tiles, by_tile(disparity <= 0))
    assert holes.count == (disparity <= 0).sum()
    assert holes.fraction == pytest.approx((disparity <= 0).mean())
    places, index = holes.listed(disparity)
    np.testing.assert_array_equal(places, np.argwhere(disparity <= 0))
    np.testing.assert_array_equal(index[disparity <= 0], np.arange(len(places)))


@pytest.mark.parametrize("kind", ["alone", "all but one", "half", "none"])
@pytest.mark.parametrize("shape", [(90, 70), (40, 41), (7, 9)])
def test_holes_that_touch_what_was_drawn_are_rims(shape, kind):
    half = np.indices(shape)[1] < shape[1] // 2
    drawn = {"alone": picture(shape, 0.02) <= 0, "half": half}.get(kind, np.zeros(shape, bool))
    drawn[-1, -1] |= kind == "all but one"
    disparity = np.where(drawn, 0.5, 0.0).astype(np.float32)
    holes = HoleMap.of(disparity)
    places, index = holes.listed(disparity)
    grown = np.pad(drawn, 1)
    near = np.zeros(shape, bool)
    for y, x in itertools.product(range(3), range(3)):
        near |= grown[y : y + shape[0], x : x + shape[1]]
    assert sorted(map(tuple, places[holes.rims(disparity, index)])) == list(map(tuple, np.argwhere(near & ~drawn)))


@pytest.mark.parametrize("shape", SHAPES)
def test_what_is_left_of_holes(shape):
    disparity = picture(shape, 0.05)
    holes = HoleMap.of(disparity)
    disparity[(disparity <= 0) & (picture(shape, 0.5, 1) <= 0)] = 0.4
    holes.shrink(disparity)
    np.testing.assert_array_equal(holes.tiles, by_tile(disparity <= 0))


def test_blocks_with_holes_and_those_round_them():
    disparity = np.ones((100, 130), np.float32)
    disparity[99, 129] = disparity[3, 40] = 0.0
    found = HoleMap.of(disparity).neighbourhood(2)
    expected = np.zeros((7, 9), np.uint8)
    expected[5:, 7:] = expected[:2, 1:4] = 1
    np.testing.assert_array_equal(found, expected)


def test_far_from_holes_nothing_is_asked_for_and_nothing_changes():
    """A small hole gets the same colours from a picture that is mostly skipped as from the part around the hole."""
    y, x = np.mgrid[0:640, 0:640]
    luma = (400 + 100 * np.sin(x / 9) + 60 * np.cos(y / 7)).astype(np.float32)
    disparity = np.full(luma.shape, 0.5, np.float32)
    disparity[310:330, 300:340] = 0.0
    whole = [luma.copy() for _ in range(3)]
    part = [np.ascontiguousarray(luma[128:512, 128:512]) for _ in range(3)]
    fill(disparity.copy(), whole, 0.0)
    fill(np.ascontiguousarray(disparity[128:512, 128:512]), part, 0.0)
    for a, b in zip(whole, part, strict=True):
        np.testing.assert_allclose(a[128:512, 128:512], b, atol=1.0)
    assert (whole[0][disparity > 0] == luma[disparity > 0]).all()
