"""The priority of updates of the background relative to pictures."""

from __future__ import annotations

__all__ = ["FIRM", "GENTLE", "Patience"]

# Niceness of the thread that updates. On Linux, a thread of niceness 0 on the same core gets nine times (GENTLE) or
# three times (FIRM) as much time. It must not be larger: while other processes keep the updating thread from running,
# it may hold the interpreter, and the threads that render would wait for it.
GENTLE, FIRM = 10, 5
_RESERVE = 10  # a firm update must be this many times faster than its limit before gentle ones are tried again
_RETRY = 16  # number of gentle updates before the next attempt with firm ones; it doubles with each vain attempt


class Patience:
    """Pictures come first: an update gets the time that they leave, unless it is then too late for the video.

    An update is too late if it takes longer than the frame interval, or longer than `longest_s` (it would never end if
    pictures left no time). Then later updates run at a higher priority. If they exceed the frame interval too, the low
    priority returns, and the next attempt waits twice as long. An update longer than `longest_s` always leads to the
    higher priority.
    """

    def __init__(self, longest_s: float = 5.0) -> None:
        self.longest_s = longest_s
        self.niceness = GENTLE  # of the next update
        self._limit_s = longest_s  # the limit whose excess led to firm updates
        self._wait, self._retry = 0, _RETRY

    def observe(self, seconds: float, interval_s: float) -> None:
        """Note that an update took `seconds` while pictures were rendered; `interval_s`: the video's frame interval."""
        if self.niceness == GENTLE:
            self._wait -= 1
            if seconds > min(self.longest_s, interval_s if self._wait <= 0 else self.longest_s):
                self.niceness = FIRM
                self._limit_s = self.longest_s if seconds > self.longest_s else interval_s
        elif seconds < self._limit_s / _RESERVE:
            self.niceness, self._retry = GENTLE, _RETRY
        elif self._limit_s < seconds <= self.longest_s:
            self.niceness, self._wait, self._retry = GENTLE, self._retry, 2 * self._retry
