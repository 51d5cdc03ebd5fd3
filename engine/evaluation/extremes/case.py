"""A case at an extreme: what is measured, by which oracle's error, within which bound, or how it is refused."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

__all__ = ["Case", "Measured", "Row", "run"]


@dataclass(frozen=True, slots=True)
class Measured:
    """An error against the oracle and the bound that is claimed for it, both in `unit`."""

    error: float
    bound: float
    unit: str

    @property
    def share(self) -> float:
        """How much of the bound is used; more than 1 is a failure, and so is what is no number."""
        if self.error == 0.0:
            return 0.0
        return self.error / self.bound if self.bound > 0.0 and not math.isnan(self.error) else math.inf


@dataclass(frozen=True, slots=True)
class Case:
    """One row: `measure` gives one or more measurements, of which the worst counts. A documented limit is `refused`
    with a ValueError that this expression finds."""

    group: str
    value: str
    measure: Callable[[], list[Measured]]
    refused: str = ""

    @property
    def name(self) -> str:
        """Group and value."""
        return f"{self.group}: {self.value}"


@dataclass(frozen=True, slots=True)
class Row:
    """What came of a case. verdict: holds, limit (refused as documented), or fails; `said`: what was raised."""

    case: Case
    measured: Measured | None
    verdict: str
    said: str = ""


def run(case: Case) -> Row:
    """Measure a case; only ValueErrors that it documents are no failure, and they must come."""
    try:
        worst = max(case.measure(), key=lambda measured: measured.share)
    except Exception as error:
        said = f"{type(error).__name__}: {error}"
        documented = case.refused and isinstance(error, ValueError) and re.search(case.refused, str(error))
        return Row(case, None, "limit" if documented else "fails", said)
    return Row(case, worst, "holds" if worst.share <= 1.0 and not case.refused else "fails")
