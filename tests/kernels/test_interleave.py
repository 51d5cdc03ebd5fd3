"""Rows are dealt out once each, and neighbouring places have rows of all regions."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from farside.engine.kernels.base.interleave import interleaved


@numba.njit
def order(count, stride):
    return np.array([interleaved(index, count, stride) for index in range(count)])


@pytest.mark.parametrize("stride", [1, 2, 8])
def test_each_row_has_one_place(stride):
    for count in range(1, 60):
        found = order(count, stride)
        np.testing.assert_array_equal(found, np.concatenate([np.arange(k, count, stride) for k in range(stride)]))
