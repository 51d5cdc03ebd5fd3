"""Time measurements of a live service: stage timings, rates, event-loop stalls."""

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
    """Milliseconds per stage; the newest `keep` of each are kept, few enough to sort. For the event loop only."""

    def __init__(self, keep: int = 200) -> None:
        self._keep = keep
        self._stages: dict[str, deque[float]] = {}

    def add(self, stages: Mapping[str, float], prefix: str = "") -> None:
        """Record one duration, milliseconds, for each stage in `stages`; `prefix` is put before their names."""
        for name, milliseconds in stages.items():
            self._stages.setdefault(prefix + name, deque(maxlen=self._keep)).append(milliseconds)

    def summary(self) -> dict[str, dict[str, float]]:
        """Median and 95th percentile of every stage, milliseconds."""
        in_order = {name: sorted(values) for name, values in self._stages.items()}
        return {name: {"p50": _quantile(v, 0.5), "p95": _quantile(v, 0.95)} for name, v in in_order.items()}


def _quantile(ordered: Sequence[float], fraction: float) -> float:
    """A quantile, interpolated as NumPy does, in a tenth of NumPy's time for a few hundred numbers."""
    place = fraction * (len(ordered) - 1)
    below = math.floor(place)
    above = min(below + 1, len(ordered) - 1)
    return ordered[below] + (place - below) * (ordered[above] - ordered[below])


class Longest:
    """The longest of some durations, milliseconds, in the last hour or in a shorter time."""

    def __init__(self, keep_s: int = 3600) -> None:
        self._by_second: deque[tuple[int, float]] = deque(maxlen=keep_s)

    def add(self, milliseconds: float) -> None:
        """Record a duration that ended now."""
        second = int(time.monotonic())
        if self._by_second and self._by_second[-1][0] == second:
            milliseconds = max(milliseconds, self._by_second.pop()[1])
        self._by_second.append((second, milliseconds))

    def over(self, seconds: float = math.inf) -> float:
        """The longest duration that ended in the last `seconds` (rounded up to whole seconds of the clock); 0: none."""
        first = max(time.monotonic() - seconds, 0.0) // 1.0
        return max((longest for second, longest in self._by_second if second >= first), default=0.0)


class Rate:
    """Events per second over the last few seconds."""

    def __init__(self, window_s: float = 5.0) -> None:
        self._window_s = window_s
        self._times: deque[float] = deque()

    def count(self) -> None:
        """Count an event now."""
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
    """Whether something runs now, or ran a while ago."""

    def __init__(self) -> None:
        self._running = 0
        self._ended = -math.inf

    @contextmanager
    def running(self) -> Iterator[None]:
        """Marks the time of the `with` block as running."""
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

    A stall is reported three ways. stall: in total. own_stall: without the time that the loop's thread waited for a
    core (Linux schedstat), which is the load of the machine; the rest is caused by this service; it is None where the
    system does not tell. busy: the CPU time of the loop's thread, so without waiting for the interpreter and for locks.
    """

    KINDS = ("stall", "own_stall", "busy")

    def __init__(self, updates: Activity, interval_s: float = 0.005) -> None:
        self._updates, self._interval_s = updates, interval_s
        self._longest = {f"{kind}{when}": Longest() for kind in self.KINDS for when in ("", "_during_update")}
        self._busy_s = 0.0
        self._knows_waiting = True

    async def run(self) -> None:
        """Measure until cancelled."""
        with _WaitingForCore() as waiting:
            self._knows_waiting = waiting.is_known
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

    def summary(self, seconds: float = math.inf) -> dict[str, float | None]:
        """The longest of each kind in the last `seconds`, milliseconds; loop_busy_s: the loop thread's CPU time so far.
        """
        figures: dict[str, float | None] = {}
        for name, longest in self._longest.items():
            is_known = self._knows_waiting or not name.startswith("own_stall")
            figures[f"longest_{name}_ms"] = longest.over(seconds) if is_known else None
        return figures | {"loop_busy_s": self._busy_s}


class _WaitingForCore:
    """How long the calling thread has been runnable without running, as Linux counts it; 0 where it is not known."""

    def __init__(self) -> None:
        self._file: int | None = None

    def __enter__(self) -> _WaitingForCore:
        with suppress(OSError):  # another system, a container without /proc, a kernel that does not count
            self._file = os.open(f"/proc/self/task/{threading.get_native_id()}/schedstat", os.O_RDONLY)
        return self

    def __exit__(self, *error: object) -> None:
        if self._file is not None:
            os.close(self._file)

    @property
    def is_known(self) -> bool:
        """Whether the system tells."""
        return self._file is not None

    def milliseconds(self) -> float:
        """Since the thread began: the second of three numbers, in nanoseconds."""
        return 0.0 if self._file is None else 1e-6 * int(os.pread(self._file, 100, 0).split()[1])
