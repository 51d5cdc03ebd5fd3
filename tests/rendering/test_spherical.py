"""Bounds of triangles on an equirectangular picture: no triangle exceeds them, and they are no wider than necessary."""

from __future__ import annotations

import math

import numpy as np
import pytest
from farside.engine.kernels.rendering.spherical import azimuths, elevations
from hypothesis import given, settings
from hypothesis import strategies as st

_SHARES = np.random.default_rng(5).dirichlet((0.4, 0.4, 0.4), 400)  # many near sides and corners


def corners(size, elevation, seed):
    """Directions [3, 3] of a triangle of `size` radians around a direction at `elevation`."""
    rng = np.random.default_rng(seed)
    azimuth = rng.uniform(-math.pi, math.pi)
    planar = math.cos(elevation)
    up = np.array([planar * math.cos(azimuth), planar * math.sin(azimuth), math.sin(elevation)])
    return (up + size * rng.uniform(-1, 1, (3, 3))) * rng.uniform(0.3, 5.0, (3, 1))


def bounds(a, b, c):
    left, right = azimuths(tuple(a), tuple(b), tuple(c))
    return left, right, *elevations(tuple(a), tuple(b), tuple(c), right - left)


def inside(triangle):
    """Azimuths and elevations of many points of a triangle."""
    points = _SHARES @ triangle
    return np.arctan2(points[:, 1], points[:, 0]), np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1]))


@settings(deadline=None, max_examples=300, derandomize=True)
@given(
    st.sampled_from([1e-3, 1e-2, 0.1, 0.5, 0.9]),
    st.one_of(st.floats(-math.pi / 2, math.pi / 2), st.sampled_from([-math.pi / 2, 0.0, 1.5, math.pi / 2])),
    st.integers(0, 1 << 32),
)
def test_no_point_of_a_triangle_lies_outside(size, elevation, seed):
    triangle = corners(size, elevation, seed)
    left, right, low, high = bounds(*triangle)
    azimuth, found = inside(triangle)
    assert low - 1e-9 <= found.min() <= found.max() <= high + 1e-9
    if right - left <= 3.0:
        middle = 0.5 * (left + right)
        off = (azimuth - middle + math.pi) % (2 * math.pi) - math.pi
        assert np.abs(off).max() <= 0.5 * (right - left) + 1e-9


@settings(deadline=None, max_examples=300, derandomize=True)
@given(st.sampled_from([1e-4, 1e-3, 1e-2]), st.floats(-1.45, 1.45), st.integers(0, 1 << 32))
def test_bounds_of_small_triangles_are_those_of_their_corners_but_for_a_bulge(size, elevation, seed):
    triangle = corners(size, elevation, seed)
    left, right, low, high = bounds(*triangle)
    at = np.arctan2(triangle[:, 2], np.hypot(triangle[:, 0], triangle[:, 1]))
    turns = np.arctan2(triangle[:, 1], triangle[:, 0])
    off = (turns - turns[0] + math.pi) % (2 * math.pi) - math.pi
    width = np.ptp(off)
    assert right - left == pytest.approx(width, abs=1e-9)
    # sin(elevation) cos(elevation) (1 / cos(width / 2) - 1), and cosines of less than a quarter turn
    bulge = 0.5 * (1.0 / math.cos(0.5 * width) - 1.0)
    assert high <= at.max() + bulge + 1e-12
    assert low >= at.min() - bulge - 1e-12


def test_a_triangle_round_a_pole_reaches_it():
    low, high = bounds((1.0, 0.0, 3.0), (-1.0, 1.0, 3.0), (-1.0, -1.0, 3.0))[2:]
    assert high == pytest.approx(math.pi / 2)
    assert low == pytest.approx(math.atan2(3.0, math.sqrt(2.0)))
    low, high = bounds((1.0, 0.0, -3.0), (-1.0, -1.0, -3.0), (-1.0, 1.0, -3.0))[2:]
    assert low == pytest.approx(-math.pi / 2)
    assert high == pytest.approx(-math.atan2(3.0, math.sqrt(2.0)))
