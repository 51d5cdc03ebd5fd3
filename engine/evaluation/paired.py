"""Ratios of two versions' costs, measured in turns: what slows the machine down for a while slows both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

__all__ = ["FEWEST", "Ratio", "paired_ratio"]

FEWEST = 6  # turns: of fewer, no two ratios hold the median between them in 95 % of all cases


class Ratio(NamedTuple):
    """A median ratio, and the ends of its 95 % confidence interval."""

    median: float
    low: float
    high: float


def paired_ratio(now: Sequence[float], then: Sequence[float]) -> Ratio:
    """The median of the turns' ratios now / then, and its interval by the sign test: between the k-th smallest and the
    k-th largest ratio, for the largest k such that the median is outside in no more than 5 % of all cases.

    It asks nothing of the ratios' distribution but that they are independent. Raises ValueError for sequences of
    different lengths, for less than FEWEST turns, and for costs that are not positive.
    """
    if len(now) != len(then) or len(now) < FEWEST:
        raise ValueError(f"turns: {len(now)} and {len(then)}: expected as many, and at least {FEWEST}")
    if not (min(now) > 0 and min(then) > 0):
        raise ValueError(f"costs: {min(now)}, {min(then)}: expected positive numbers")
    ratios = np.sort(np.asarray(now, float) / np.asarray(then, float))
    count, rank, below = len(ratios), 0, 0.0
    while 2 * (below := below + math.comb(count, rank) / 2**count) <= 0.05:
        rank += 1
    return Ratio(float(np.median(ratios)), float(ratios[rank - 1]), float(ratios[count - rank]))
