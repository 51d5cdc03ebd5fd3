"""What it costs to save a model while it is used: how much longer pictures and updates take meanwhile.

The engine is in a process of its own, as a server has it. One thread gives it frames at the video's rate, and gives way
to pictures; another one asks for one picture after the other from a moving head. Each picture and each update is
compared with the times at which the model was being copied, and at which it was being written.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..background.saved_model import SavedModel
from ..live.core import LocalCore
from ..live.core_process import ProcessCore
from ..live.saving import Saver
from ..live.update_priority import GENTLE
from ..pipeline.engine import Engine
from ..rig.camera import Camera
from ..rig.frame import Frame
from ..rig.viewer import StereoView, home_pose
from ..settings import Settings

__all__ = ["WHEN", "Delay", "SavingRun", "Span", "make_watched_core", "measure_saving"]

WHEN = ("untouched", "copied", "written")  # what happens to the model during a picture or an update
_SIZE = 640, 720  # an eye's picture
_SWAY_M = 0.1  # the head moves sideways, there and back in _PERIOD pictures
_PERIOD = 40
_WARM = 5  # updates and pictures before time counts


class Span(NamedTuple):
    """When something was going on: what, and its start and end, seconds of the system's monotonic clock."""

    what: str
    start: float
    end: float

    def meets(self, other: Span) -> bool:
        """Whether both were going on at the same time."""
        return self.start < other.end and other.start < self.end


class Delay(NamedTuple):
    """Pictures or updates (what) during which the model was untouched, copied or written (when): their number, and the
    median, the 95th percentile and the longest of their times, milliseconds."""

    what: str
    when: str
    number: int
    median_ms: float
    p95_ms: float
    longest_ms: float


@dataclass(frozen=True, slots=True)
class SavingRun:
    """Pictures and updates, and when the model was copied and written. size: bytes of the file."""

    asked: list[Span]
    saved: list[Span]
    size: int

    def delays(self) -> list[Delay]:
        """The times of pictures and of updates in each case; a copy goes before a writing in the same time."""
        rows = []
        for what in ("picture", "update"):
            groups: dict[str, list[float]] = {when: [] for when in WHEN}
            for span in (each for each in self.asked if each.what == what):
                met = {each.what for each in self.saved if each.meets(span)}
                when = next((when for when in WHEN[1:] if when in met), WHEN[0])
                groups[when].append(1e3 * (span.end - span.start))
            rows += [_delay(what, when, times) for when, times in groups.items()]
        return rows

    def took_ms(self, what: str) -> list[float]:
        """How long each copy ("copied") or each writing ("written") took, milliseconds."""
        return [1e3 * (each.end - each.start) for each in self.saved if each.what == what]


class WatchedCore(LocalCore):
    """A core that saves its model, and notes when; it has the frames that it is to take."""

    def __init__(self, engine: Engine, saver: Saver, spans: list[Span]) -> None:
        super().__init__(engine, saver)
        self.frames: Sequence[Frame] = ()
        self.spans, self.saver = spans, saver


class _Watched:
    """A copy of a model that notes when it is written."""

    def __init__(self, saved: SavedModel, spans: list[Span]) -> None:
        self._saved, self._spans = saved, spans

    def write(self, path: Path) -> int:
        start = time.monotonic()
        size = self._saved.write(path)
        self._spans.append(Span("written", start, time.monotonic()))
        return size


def make_watched_core(cameras: Sequence[Camera], settings: Settings, path: str, interval_s: float) -> WatchedCore:
    """A core with an engine for a rig, whose model is saved to a file every `interval_s` seconds."""
    engine, spans = Engine(cameras, settings), list[Span]()

    def copy() -> _Watched | None:
        start = time.monotonic()
        saved = engine.state()
        spans.append(Span("copied", start, time.monotonic()))
        return None if saved is None else _Watched(saved, spans)

    return WatchedCore(engine, Saver(Path(path), interval_s, copy), spans)


def measure_saving(
    frames: Sequence[Frame], settings: Settings, fps: float, path: Path, interval_s: float, seconds: float,
    progress: Callable[[float], None] = lambda share: None,
) -> SavingRun:  # fmt: skip
    """Play frames to and fro for some seconds, while a head looks and the model is saved every `interval_s` seconds.

    progress: called with the share of the time that is over. Raises ValueError for less than two frames, and OSError if
    the file cannot be written.
    """
    if len(frames) < 2:
        raise ValueError(f"frames: {len(frames)}: expected two or more")
    cameras, asked = tuple(view.camera for view in frames[0].views), list[Span]()
    head = StereoView.symmetric(home_pose(cameras), *_SIZE, math.radians(90))
    core = ProcessCore(make_watched_core, cameras, settings, str(path), interval_s)
    try:
        core.run(_take, list(frames))
        warm, stop = threading.Event(), threading.Event()
        feeder = threading.Thread(target=_feed, args=(core, len(frames), head, fps, asked, warm, stop))
        feeder.start()
        try:
            _look(core, head, asked, warm, feeder, seconds, progress)
        finally:
            stop.set()
            feeder.join()
        spans, status = core.run(_noted)
    finally:
        core.close()
    if status["failures"]:
        raise OSError(f"{path}: {status['error']}: expected to be written")
    begun = asked[0].start
    return SavingRun(asked, [each for each in spans if each.end > begun], status["bytes"])


def _feed(
    core: ProcessCore, count: int, head: StereoView, fps: float, asked: list[Span],
    warm: threading.Event, stop: threading.Event,
) -> None:  # fmt: skip
    """Give frames to the core at their rate, or as fast as it takes them; pictures go first."""
    core.give_way(GENTLE)
    number, due = 0, time.monotonic()
    while not stop.is_set():
        index = number % (2 * count - 2)
        start = time.monotonic()
        core.run(_update, index if index < count else 2 * count - 2 - index, head, fps)
        if warm.is_set():
            asked.append(Span("update", start, time.monotonic()))
        number += 1
        if number == _WARM:
            warm.set()
        due = max(due + 1.0 / fps, time.monotonic())
        stop.wait(due - time.monotonic())


def _look(
    core: ProcessCore, head: StereoView, asked: list[Span], warm: threading.Event, feeder: threading.Thread,
    seconds: float, progress: Callable[[float], None],
) -> None:  # fmt: skip
    """Ask for one picture after the other until the time is over."""
    while not warm.wait(0.1):
        if not feeder.is_alive():
            raise RuntimeError("update: failed: expected frames to be taken")
    number, begun = 0, time.monotonic()
    while (since := time.monotonic() - begun) < seconds:
        aside = _SWAY_M * math.sin(2 * math.pi * number / _PERIOD)
        start = time.monotonic()
        core.picture(head.moved(head.pose.translated((0.0, aside, 0.0))), "head", "jpeg")
        if number >= _WARM:
            asked.append(Span("picture", start, time.monotonic()))
        number += 1
        progress(since / seconds)


def _take(core: WatchedCore, frames: Sequence[Frame]) -> None:
    core.frames = frames


def _update(core: WatchedCore, index: int, head: StereoView, fps: float) -> None:
    core.update(core.frames[index], lambda: {"head": head}, {}, fps)


def _noted(core: WatchedCore) -> tuple[list[Span], dict[str, object]]:
    return core.spans, core.saver.status()


def _delay(what: str, when: str, times: Sequence[float]) -> Delay:
    if not times:
        return Delay(what, when, 0, math.nan, math.nan, math.nan)
    median, p95 = np.percentile(times, (50, 95)).tolist()
    return Delay(what, when, len(times), median, p95, max(times))
