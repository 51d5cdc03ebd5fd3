"""The slope of a series, with its interval."""

from __future__ import annotations

import numpy as np
import pytest
from farside.engine.evaluation.trend import trend


def test_a_line_has_its_slope_whatever_a_few_outliers_say():
    values = 3.0 + 0.25 * np.arange(40.0)
    assert trend(values.tolist()) == pytest.approx((0.25, 0.25, 0.25))
    values[[5, 20, 33]] += 400.0
    found = trend(values.tolist())
    assert found.slope == pytest.approx(0.25)
    assert found.low <= 0.25 <= found.high < 1.0


def test_the_interval_holds_the_slope_of_noise_in_about_95_of_100_series():
    rng, steps = np.random.default_rng(1), np.arange(50)
    held, narrow = 0, 0
    for _ in range(400):
        found = trend((0.02 * steps + rng.normal(size=50)).tolist())
        held += found.low <= 0.02 <= found.high
        narrow += found.high - found.low < 0.08
    assert 0.92 <= held / 400 <= 0.99
    assert narrow > 380  # else an interval of everything would pass


def test_two_values_are_too_few():
    with pytest.raises(ValueError, match="values: 2: expected three or more"):
        trend([1.0, 2.0])
