"""Whether a cost grows: the slope of a series, with an interval that outliers do not widen."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

__all__ = ["Trend", "trend"]

_QUANTILE = 1.96  # of the normal distribution, for 95 %


class Trend(NamedTuple):
    """A slope a step, and the ends of its 95 % confidence interval."""

    slope: float
    low: float
    high: float


def trend(values: Sequence[float]) -> Trend:
    """The median of the slopes between all pairs of values (Theil-Sen), and its interval by Kendall's statistic.

    Values follow one another at equal steps, and have independent errors. Raises ValueError for less than three.
    """
    count = len(values)
    if count < 3:
        raise ValueError(f"values: {count}: expected three or more")
    first, second = np.triu_indices(count, 1)
    found = np.sort((np.asarray(values)[second] - np.asarray(values)[first]) / (second - first))
    spread = _QUANTILE * math.sqrt(count * (count - 1) * (2 * count + 5) / 18.0)
    low = max(math.floor((len(found) - spread) / 2.0), 0)
    high = min(math.ceil((len(found) + spread) / 2.0), len(found) - 1)
    return Trend(float(np.median(found)), float(found[low]), float(found[high]))
