"""Disocclusion filling: nothing is left, nothing drawn is touched, far surfaces go on behind near ones."""

from __future__ import annotations

import numpy as np
import pytest
from farside.engine.filling import fill, hole_fraction
from hypothesis import given, settings
from hypothesis import strategies as st

UNSEEN = -1e6  # a colour that must not get into anything


def picture(disparity, luma):
    """Planes with the given luma where something was drawn; chroma follows luma so that mixing shows."""
    disparity = np.asarray(disparity, np.float32)
    luma = np.where(disparity > 0, np.broadcast_to(np.asarray(luma, np.float32), disparity.shape), UNSEEN)
    return disparity, tuple(np.ascontiguousarray(plane, np.float32) for plane in (luma, luma / 2, luma / 4))


def filled(disparity, luma):
    disparity, planes = picture(disparity, luma)
    fill(disparity, planes)
    return planes


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(1, 37), st.integers(1, 37), st.integers(0, 2**32 - 1), st.sampled_from([0.02, 0.4, 0.95]))
def test_every_hole_gets_a_colour_of_the_picture_and_nothing_drawn_changes(h, w, seed, share):
    rng = np.random.default_rng(seed)
    disparity = np.where(rng.random((h, w)) < share, rng.uniform(0.1, 2.0, (h, w)), 0.0)
    disparity[rng.integers(h), rng.integers(w)] = 1.0
    disparity, planes = picture(disparity, rng.uniform(64, 940, (h, w)))
    before, drawn = [plane.copy() for plane in planes], disparity > 0
    unchanged = disparity.copy()
    fill(disparity, planes)
    np.testing.assert_array_equal(disparity, unchanged)  # holes stay known
    for plane, old in zip(planes, before, strict=True):
        np.testing.assert_array_equal(plane[drawn], old[drawn])
        assert plane.min() >= old[drawn].min() * (1 - 1e-5)
        assert plane.max() <= old[drawn].max() * (1 + 1e-5)


@pytest.mark.parametrize("shape", [(1, 1), (1, 17), (17, 1), (2, 3), (64, 64), (33, 5)])
def test_a_single_pixel_colours_everything(shape):
    disparity = np.zeros(shape)
    disparity[shape[0] // 2, shape[1] // 3] = 0.7
    for plane, value in zip(filled(disparity, 600), (600, 300, 150), strict=True):
        np.testing.assert_allclose(plane, value, rtol=1e-5)


@pytest.mark.parametrize("width", [1, 4, 15])
@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("flip", [False, True])
def test_a_hole_between_near_and_far_takes_the_far_colour(width, axis, flip):
    column = np.arange(60)
    near, hole = column < 12, (column >= 12) & (column < 12 + width)
    disparity = np.broadcast_to(np.where(hole, 0.0, np.where(near, 2.0, 0.25)), (21, 60))
    luma = np.broadcast_to(np.where(near, 900, 200), (21, 60))
    if flip:
        disparity, luma, hole = disparity[:, ::-1], luma[:, ::-1], hole[::-1]
    if axis == 0:
        found = filled(disparity.T, luma.T)[0].T
    else:
        found = filled(disparity, luma)[0]
    np.testing.assert_allclose(found[:, hole], 200, atol=8)


def test_structure_goes_on_into_a_narrow_hole():
    """Stripes that run into a hole from both sides are there inside it too."""
    luma = np.broadcast_to(np.where(np.arange(32) % 8 < 4, 200, 800)[:, None], (32, 32))
    disparity = np.full((32, 32), 0.5)
    disparity[:, 14:18] = 0.0
    found = filled(disparity, luma)[0]
    inner = np.arange(32) % 4 % 3 != 0  # not beside a stripe's rim
    assert np.abs(found[inner] - luma[inner])[:, 14:18].max() < 120


def test_hole_fraction():
    disparity = np.zeros((7, 10), np.float32)
    assert hole_fraction(disparity) == 1.0
    disparity[:, :3] = 0.5
    assert hole_fraction(disparity) == pytest.approx(0.7)
    disparity[:] = 1e-6
    assert hole_fraction(disparity) == 0.0
