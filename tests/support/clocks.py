"""A clock that goes on only when it is told to, or a little with each look at it."""

from __future__ import annotations

import threading
import types

__all__ = ["Clock"]


class Clock:
    """Stands in for the module `time`: all of its clocks show `now`, and each look moves it on by `tick`, seconds."""

    def __init__(self, now: float = 100.0, tick: float = 0.0) -> None:
        self.now, self.tick = now, tick
        self._lock = threading.Lock()

    def read(self) -> float:
        with self._lock:
            now = self.now
            self.now += self.tick
        return now

    def advance(self, seconds: float) -> None:
        with self._lock:
            self.now += seconds

    def instead_of(self, monkeypatch, *modules: types.ModuleType) -> Clock:
        """What these modules know as `time` is this clock."""
        for module in modules:
            monkeypatch.setattr(module, "time", self)
        return self

    perf_counter = process_time = thread_time = monotonic = read
