"""What a live service knows about its own time: stage timings, rates, event-loop stalls."""

from __future__ import annotations

import asyncio
import math
import os
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress

__all__ = ["Activity", "Longest", "Rate", "StallMonitor", "Timings"]


class Timings:
    """Milliseconds by stage; the newest hundreds are kept, few enough to sort. Used from the event loop only."""

    def __init__(self, keep: int = 200) -> None:
        self._keep = keep
        self._stages: dict[str, deque[float]] = {}

    def add(self, stages: Mapping[str, float], prefix: str = "") -> None:
        """Record one duration for each of some stages."""
        for name, milliseconds in stages.items():
            self._stages.setdefault(prefix + name, deque(maxlen=self._keep)).append(milliseconds)

    def summary(self) -> dict[str, dict[str, float]]:
        """Median and 95th percentile of every stage, milliseconds."""
        in_order = {name: sorted(values) for name, values in self._stages.items()}
        return {name: {"p50": _quantile(v, 0.5), "p95": _quantile(v, 0.95)} for name, v in in_order.items()}


def _quantile(ordered: Sequence[float], fraction: float) -> float:
    """Between its neighbours, as NumPy does, which takes ten times as long for a few hundred numbers."""
    place = fraction * (len(ordered) - 1)
    below = math.floor(place)
    above = min(below + 1, len(ordered) - 1)
    return ordered[below] + (place - below) * (ordered[above] - ordered[below])


class Longest:
    """The longest of some durations, milliseconds: of all in the last hour, or of the newest."""

    def __init__(self, keep_s: int = 3600) -> None:
        self._by_second: deque[tuple[int, float]] = deque(maxlen=keep_s)

    def add(self, milliseconds: float) -> None:
        """Something took so long, and ended now."""
        second = int(time.monotonic())
        if self._by_second and self._by_second[-1][0] == second:
            milliseconds = max(milliseconds, self._by_second.pop()[1])
        self._by_second.append((second, milliseconds))

    def over(self, seconds: float = math.inf) -> float:
        """The longest that ended in so many seconds before now, or less than one before these; 0 where nothing did."""
        first = max(time.monotonic() - seconds, 0.0) // 1.0
        return max((longest for second, longest in self._by_second if second >= first), default=0.0)


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


class Activity:
    """Whether something runs, or did a while ago."""

    def __init__(self) -> None:
        self._running = 0
        self._ended = -math.inf

    @contextmanager
    def running(self) -> Iterator[None]:
        """Marks the time that it takes."""
        self._running += 1
        try:
            yield
        finally:
            self._running -= 1
            self._ended = time.monotonic()

    def since(self, moment: float) -> bool:
        """Whether it ran at any time after a moment of the monotonic clock."""
        return self._running > 0 or self._ended >= moment


class StallMonitor:
    """Measures how late the event loop wakes a sleeper up: overall, and while a background update runs.

    Of a stall it tells what is the service's own: all but the time that the loop's thread waited for a core (Linux
    knows), which is the load of the machine; and of that what the loop's thread was busy with itself, which is all but
    waiting for the interpreter and for locks.
    """

    KINDS = ("stall", "own_stall", "busy")

    def __init__(self, updates: Activity, interval_s: float = 0.005) -> None:
        self._updates, self._interval_s = updates, interval_s
        self._longest = {f"{kind}{when}": Longest() for kind in self.KINDS for when in ("", "_during_update")}
        self._busy_s = 0.0

    async def run(self) -> None:
        """Measure until cancelled."""
        with _WaitingForCore() as waiting:
            first = busy = time.thread_time()
            start, waited = time.monotonic(), waiting.milliseconds()
            while True:
                await asyncio.sleep(self._interval_s)
                before = start, waited, busy
                start, waited, busy = time.monotonic(), waiting.milliseconds(), time.thread_time()
                late = 1e3 * (start - before[0] - self._interval_s)
                self._observe(before[0], late, max(late - (waited - before[1]), 0.0), 1e3 * (busy - before[2]))
                self._busy_s = busy - first

    def _observe(self, since: float, *milliseconds: float) -> None:
        for kind, duration in zip(self.KINDS, milliseconds, strict=True):
            self._longest[kind].add(duration)
            if self._updates.since(since):
                self._longest[f"{kind}_during_update"].add(duration)

    def summary(self, seconds: float = math.inf) -> dict[str, float]:
        """The longest of the last so many seconds, milliseconds; and how many seconds the loop's thread was busy."""
        figures = {f"longest_{name}_ms": longest.over(seconds) for name, longest in self._longest.items()}
        return figures | {"loop_busy_s": self._busy_s}


class _WaitingForCore:
    """How long the calling thread has been runnable without running, as Linux counts it; nothing elsewhere."""

    def __init__(self) -> None:
        self._file: int | None = None

    def __enter__(self) -> _WaitingForCore:
        with suppress(OSError):
            self._file = os.open(f"/proc/self/task/{threading.get_native_id()}/schedstat", os.O_RDONLY)
        return self

    def __exit__(self, *error: object) -> None:
        if self._file is not None:
            os.close(self._file)

    def milliseconds(self) -> float:
        """Since the thread began: the second of three numbers, in nanoseconds."""
        return 0.0 if self._file is None else 1e-6 * int(os.pread(self._file, 100, 0).split()[1])
