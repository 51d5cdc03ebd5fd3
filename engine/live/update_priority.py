"""How far updates of the background give way to pictures."""

from __future__ import annotations

__all__ = ["FIRM", "GENTLE", "Patience"]

# Niceness: of two threads on a core, one in front gets nine times, three times as much as one behind (Linux). Far
# behind, a thread that other processes keep from running would keep the interpreter from those that render.
GENTLE, FIRM = 10, 5
_RESERVE = 10  # so much faster than it must be a firm update is before gentle ones are tried again
_RETRY = 16  # gentle updates after firm ones did not keep up either; each time twice as many


class Patience:
    """Pictures come first: an update gets what they leave, unless it is too late for the video then.

    That is: later than the next frame, if updates that take their part are not (this is tried, ever more rarely where
    it was in vain), and later than `longest_s` in any case: where pictures leave nothing, it would never end.
    """

    def __init__(self, longest_s: float = 5.0) -> None:
        self.longest_s = longest_s
        self.niceness = GENTLE  # of the next update
        self._limit_s = longest_s  # that firm updates were begun for
        self._wait, self._retry = 0, _RETRY

    def observe(self, seconds: float, interval_s: float) -> None:
        """An update beside pictures has taken so long; the video's frames are so far apart."""
        if self.niceness == GENTLE:
            self._wait -= 1
            if seconds > min(self.longest_s, interval_s if self._wait <= 0 else self.longest_s):
                self.niceness = FIRM
                self._limit_s = self.longest_s if seconds > self.longest_s else interval_s
        elif seconds < self._limit_s / _RESERVE:
            self.niceness, self._retry = GENTLE, _RETRY
        elif self._limit_s < seconds <= self.longest_s:
            self.niceness, self._wait, self._retry = GENTLE, self._retry, 2 * self._retry
