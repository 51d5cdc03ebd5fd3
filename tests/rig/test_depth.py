"""Depth codes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from farside.engine.rig.depth import DepthCoding
from hypothesis import given, settings
from hypothesis import strategies as st


@settings(max_examples=80, deadline=None, derandomize=True)
@given(
    st.floats(0.01, 100),
    st.one_of(st.floats(1.01, 1e4), st.just(math.inf)),
    st.integers(8, 16),
    st.booleans(),
    st.integers(0, 65535),
)
def test_codes_round_trip(near: float, ratio: float, bits: int, has_invalid: bool, code: int) -> None:
    coding = DepthCoding(near, near * ratio, bits, has_invalid)
    codes = np.array([max(coding.min_code, code % (coding.max_code + 1))], np.uint16)
    depth = coding.depth(codes)
    assert near * (1 - 1e-9) <= depth[0] <= near * ratio * (1 + 1e-9)
    np.testing.assert_array_equal(coding.codes(depth), codes)


def test_ends_of_the_range() -> None:
    coding = DepthCoding(0.5, 25.0, 10)
    np.testing.assert_allclose(coding.depth(np.array([0, 1023], np.uint16)), [25.0, 0.5])
    expected = 1 / (1 / 25 + 511 / 1023 * (1 / 0.5 - 1 / 25))
    np.testing.assert_allclose(coding.depth(np.array([511], np.uint16)), [expected])


def test_code_zero() -> None:
    zero_and_one = np.array([0, 1], np.uint16)
    infinite = DepthCoding(1.0, math.inf).depth(zero_and_one)
    assert infinite[0] == infinite[1] == pytest.approx(65535.0)
    holes = DepthCoding(1.0, 10.0, has_invalid=True).depth(zero_and_one)
    assert math.isnan(holes[0])
    assert holes[1] < 10.0


def test_codes_of_depths_outside_the_range() -> None:
    depth = np.array([0.1, 1e9, math.inf, math.nan])
    np.testing.assert_array_equal(DepthCoding(1.0, 10.0, 8).codes(depth), [255, 0, 0, 0])
    np.testing.assert_array_equal(DepthCoding(1.0, 10.0, 8, has_invalid=True).codes(depth), [255, 1, 1, 0])


@pytest.mark.parametrize(
    ("near", "far"), [(0, 1), (-1, 1), (2, 2), (3, 2), (math.nan, 1), (1, math.nan), (math.inf, math.inf)]
)
def test_bad_range(near: float, far: float) -> None:
    with pytest.raises(ValueError, match="depth range"):
        DepthCoding(near, far)


@pytest.mark.parametrize("bits", [0, 17])
def test_bad_bits(bits: int) -> None:
    with pytest.raises(ValueError, match="depth bits"):
        DepthCoding(1, 2, bits)
