"""A case at an extreme: its measurement, the error against an oracle and its bound, or the error that refuses it."""

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
        """The error as a share of the bound. More than 1 is a failure; an error that is nan gives infinity."""
        if self.error == 0.0:
            return 0.0
        return self.error / self.bound if self.bound > 0.0 and not math.isnan(self.error) else math.inf


@dataclass(frozen=True, slots=True)
class Case:
    """One row of the table.

    group, value: what is extreme, and how far. measure: returns one or more measurements, of which the worst counts.
    refused: for a documented limit, a regular expression that matches the message of the expected ValueError.
    """

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
    """The result of a case. verdict: holds, limit (refused as documented), or fails. said: the error, if any."""

    case: Case
    measured: Measured | None
    verdict: str
    said: str = ""


def run(case: Case) -> Row:
    """Measure a case. It fails on any error except the ValueError that it documents, and also if that is not raised."""
    try:
        worst = max(case.measure(), key=lambda measured: measured.share)
    except Exception as error:
        said = f"{type(error).__name__}: {error}"
        documented = case.refused and isinstance(error, ValueError) and re.search(case.refused, str(error))
        return Row(case, None, "limit" if documented else "fails", said)
    return Row(case, worst, "holds" if worst.share <= 1.0 and not case.refused else "fails")
