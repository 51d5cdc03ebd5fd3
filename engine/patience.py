"""How far updates of the background give way to pictures."""

from __future__ import annotations

__all__ = ["FIRM", "GENTLE", "Patience"]

# Niceness: of two threads on a core, one in front gets 68 times, three times as much as one behind (Linux).
GENTLE, FIRM = 19, 5
_RESERVE = 10  # so much faster than it must be a firm update is before gentle ones are tried again


class Patience:
    """Pictures come first as long as updates do not take longer than `longest_s`; then these take their part.

    An update that gets only what pictures leave holds none of them up, but where they leave nothing it would not end.
    """

    def __init__(self, longest_s: float = 5.0) -> None:
        self.longest_s = longest_s
        self.niceness = GENTLE  # of the next update

    def observe(self, seconds: float) -> None:
        """An update beside pictures has taken so long."""
        if self.niceness == GENTLE and seconds > self.longest_s:
            self.niceness = FIRM
        elif self.niceness == FIRM and seconds < self.longest_s / _RESERVE:
            self.niceness = GENTLE
