"""Intervals of paired ratios hold the true ratio as often as they say."""

from __future__ import annotations

import numpy as np
import pytest
from farside.engine.evaluation.paired import FEWEST, paired_ratio


@pytest.mark.parametrize(("turns", "rank"), [(6, 1), (9, 2), (12, 3), (20, 6)])
def test_its_ends_are_ratios_of_a_rank(turns, rank):
    """The ranks are those of tables of the sign test."""
    rng = np.random.default_rng(turns)
    ratios = rng.permutation(np.arange(1.0, turns + 1))
    then = rng.uniform(1.0, 5.0, turns)
    found = paired_ratio(ratios * then, then)
    np.testing.assert_allclose(found, ((turns + 1) / 2, rank, turns + 1 - rank))


@pytest.mark.parametrize("turns", [FEWEST, 13, 20])
def test_the_true_ratio_is_outside_in_one_case_of_twenty(turns):
    rng, outside, cases = np.random.default_rng(0), 0, 2000
    for _ in range(cases):
        then = rng.uniform(1.0, 2.0, turns) * (1 + 3 * (rng.random(turns) < 0.2))  # the machine is slow now and then
        ratio = paired_ratio(0.8 * then * rng.lognormal(0.0, 0.1, turns), then)
        outside += not ratio.low <= 0.8 <= ratio.high
    assert 0.005 < outside / cases < 0.06


@pytest.mark.parametrize(
    ("now", "then", "told"),
    [([1.0] * 5, [1.0] * 5, "turns: 5"), ([1.0] * 7, [1.0] * 6, "turns: 7 and 6"), ([1.0] * 6, [0.0] * 6, "costs: ")],
)
def test_what_has_no_interval_is_refused(now, then, told):
    with pytest.raises(ValueError, match=told):
        paired_ratio(now, then)
