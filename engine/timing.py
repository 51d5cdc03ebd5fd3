"""What a live service knows about its own time: stage timings, rates, event-loop stalls."""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np

__all__ = ["Rate", "StallMonitor", "Timings"]


class Timings:
    """Milliseconds by stage; the newest few hundred are kept. Used from the event loop only."""

    def __init__(self, keep: int = 500) -> None:
        self._keep = keep
        self._stages: dict[str, deque[float]] = {}

    def add(self, stages: Mapping[str, float], prefix: str = "") -> None:
        """Record one duration for each of some stages."""
        for name, milliseconds in stages.items():
            self._stages.setdefault(prefix + name, deque(maxlen=self._keep)).append(milliseconds)

    def summary(self) -> dict[str, dict[str, float]]:
        """Median and 95th percentile of every stage, milliseconds."""
        percentiles = {name: np.percentile(list(values), (50, 95)) for name, values in self._stages.items()}
        return {name: {"p50": float(p50), "p95": float(p95)} for name, (p50, p95) in percentiles.items()}


class Rate:
    """Events a second over the last few seconds."""

    def __init__(self, window_s: float = 5.0) -> None:
        self._window_s = window_s
        self._times: deque[float] = deque()

    def count(self) -> None:
        """Something happened now."""
        self._times.append(time.monotonic())

    def per_second(self) -> float:
        """The present rate; 0 until two events have been seen within the window."""
        now = time.monotonic()
        while self._times and self._times[0] < now - self._window_s:
            self._times.popleft()
        if len(self._times) < 2:
            return 0.0
        return (len(self._times) - 1) / max(self._times[-1] - self._times[0], 1e-6)


class StallMonitor:
    """Measures how late the event loop wakes a sleeper up: overall, and while a background update runs."""

    def __init__(self, interval_s: float = 0.005) -> None:
        self._interval_s = interval_s
        self._updates = 0
        self._updated = False  # whether an update ran at any time since the last wake-up
        self.longest_ms = 0.0
        self.longest_during_update_ms = 0.0

    @contextmanager
    def updating(self) -> Iterator[None]:
        """Marks the time that a background update takes."""
        self._updates += 1
        self._updated = True
        try:
            yield
        finally:
            self._updates -= 1

    async def run(self) -> None:
        """Measure until cancelled."""
        loop = asyncio.get_running_loop()
        while True:
            due = loop.time() + self._interval_s
            await asyncio.sleep(self._interval_s)
            self._observe(1e3 * (loop.time() - due))

    def _observe(self, late_ms: float) -> None:
        self.longest_ms = max(self.longest_ms, late_ms)
        if self._updated:
            self.longest_during_update_ms = max(self.longest_during_update_ms, late_ms)
        self._updated = self._updates > 0

    def summary(self) -> dict[str, float]:
        """The longest stalls, milliseconds."""
        return {
            "longest_stall_ms": self.longest_ms,
            "longest_stall_during_update_ms": self.longest_during_update_ms,
        }
