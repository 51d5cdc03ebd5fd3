"""The live engine: asyncio around a core.

There are two rates that do not wait for each other: video frames go to one back-end thread (f_vin), poses to a few
front-end threads (f_ren). Neither is ever queued: the newest complete frame and each viewer's newest pose win, older
ones are dropped and counted. Everything except the work itself happens on the event loop.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractAsyncContextManager, contextmanager
from types import TracebackType
from typing import Any, Self

from ..rig.frame import Frame
from ..rig.viewer import EncodedPair, StereoView
from .core import Core, CoreLostError, Source, Updated
from .core_uses import CoreUses
from .governor import Governor
from .left_out import LeftOutLog, Settled
from .model_reads import ModelReads
from .scene_effects import SceneEffects
from .timing import Activity, Longest, Rate, StallMonitor, Timings
from .update_priority import FIRM, GENTLE, Patience
from .viewer import LiveViewer

__all__ = ["Live"]

_log = logging.getLogger(__name__)


class Live(AbstractAsyncContextManager["Live"]):
    """Owns the core, its threads and its tasks; used as an async context manager.

    make_core: makes a core for a source, in a worker thread. render_workers: pictures rendered at the same time.
    governor: holds a frame rate; None: settings stay. patience: chooses the priority of updates.
    """

    def __init__(
        self,
        make_core: Callable[[Source], Core],
        *,
        render_workers: int = 2,
        governor: Governor | None = None,
        patience: Patience | None = None,
    ) -> None:
        self._make_core, self.governor = make_core, governor
        self._patience = patience or Patience()
        # One thread per niceness, as a thread cannot raise its priority again. Only one of them works at a time.
        self._back_ends = {niceness: ThreadPoolExecutor(1, "farside-back-end") for niceness in (GENTLE, FIRM)}
        self._front_end = ThreadPoolExecutor(render_workers, "farside-front-end")
        self._tasks: list[asyncio.Task[None]] = []
        self._viewers: dict[str, LiveViewer[Any]] = {}
        self._core: Core | None = None
        self._uses = CoreUses()
        self.effects = SceneEffects(lambda: self._core, self._uses)
        self.model = ModelReads(lambda: self.shown, self._uses)
        self._core_status: dict[str, Any] = {}
        self._pending: tuple[Frame, asyncio.Future[Settled]] | None = None
        self._arrived = asyncio.Event()
        self._opening = asyncio.Lock()
        self.source: Source | None = None
        self.shown: Core | None = None  # the core, once it has a frame to show
        self._updates = Activity()
        self.stalls = StallMonitor(self._updates)
        self.timings = Timings()
        self._longest_picture, self._longest_in_update = Longest(), Longest()
        self.frames = {"updated": 0, "dropped": 0, "failed": 0}
        self.left_out = LeftOutLog()
        self.frame_rate, self.picture_rate = Rate(), Rate()

    async def __aenter__(self) -> Self:
        self._tasks = [asyncio.create_task(self._run_back_end()), asyncio.create_task(self.stalls.run())]
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Stop taking frames, end the tasks, then wait until the threads have finished their work."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._drop_pending()
        await self.effects.close()
        await self.model.close()
        for pool in (*self._back_ends.values(), self._front_end):
            await asyncio.to_thread(pool.shutdown, wait=True, cancel_futures=True)
        await self._uses.closed()
        for core in filter(None, (self._core, None if self.shown is self._core else self.shown)):
            await asyncio.to_thread(core.close)

    async def open(self, source: Source) -> None:
        """Begin with a source. If its cameras are those of the last source, or if the model is kept and only cameras
        that have moved are elsewhere, the background model is continued.

        Calls run one after the other: a source may come while a core is still being made for one that has left.
        """
        async with self._opening:
            self._drop_pending()
            if not await self._goes_on(source):
                core = await self._make(source)
                former = {id(old): old for old in (self._core, self.shown) if old is not None}
                self._drop_pending()  # a frame offered meanwhile was for the core before
                self._core, self.left_out = core, LeftOutLog()
                self.shown, self._core_status = None, {}
                for old in former.values():
                    self._uses.retire(old)
                self._retune()
                await self.effects.put_all()
            self.source = source
            self._wake_viewers()

    async def _goes_on(self, source: Source) -> bool:
        """Whether the present core takes a source; raises ValueError if neither it nor another one may."""
        core, last = self._core, self.source
        if core is None or last is None:
            return False
        if last.cameras == source.cameras:
            return True
        try:
            with self._uses.using(core):
                return await asyncio.to_thread(core.continues, source.cameras)
        except CoreLostError as error:
            self._give_up(core, error)
            return False

    async def _make(self, source: Source) -> Core:
        core = await asyncio.to_thread(self._make_core, source)
        loop = asyncio.get_running_loop()
        for niceness, thread in self._back_ends.items():
            await loop.run_in_executor(thread, core.give_way, niceness)  # a late picture is noticed more than a frame
        return core

    def offer(self, frame: Frame) -> asyncio.Future[Settled]:
        """Offer a complete frame. The future is true if the frame was shown, false if a newer one overtook it or all of
        its views were left out.

        Raises RuntimeError before a source was opened.
        """
        if self._core is None:
            raise RuntimeError("no source was opened")
        self.left_out.note(frame.index, frame.faults)
        self._drop_pending()
        settled: asyncio.Future[Settled] = asyncio.get_running_loop().create_future()
        self._pending = frame, settled
        self._arrived.set()
        return settled

    def _drop_pending(self) -> None:
        if self._pending is not None:
            (frame, settled), self._pending = self._pending, None
            self._settle(settled, Settled(False, frame.faults))

    def _settle(self, settled: asyncio.Future[Settled], outcome: Settled) -> None:
        self.frames["updated" if outcome else "dropped"] += 1
        if not settled.done():
            settled.set_result(outcome)

    async def _run_back_end(self) -> None:
        while True:
            await self._arrived.wait()
            self._arrived.clear()
            core, source = self._core, self.source
            if self._pending is None or core is None or source is None:
                continue
            (frame, settled), self._pending = self._pending, None
            try:
                await self._update(core, source, frame, settled)
            finally:
                settled.cancel()  # has an effect only if a shutdown interrupted the update
                del frame, settled  # the next one may be long in coming

    async def _update(self, core: Core, source: Source, frame: Frame, settled: asyncio.Future[Settled]) -> None:
        speeds = {name: viewer.speed for name, viewer in self._viewers.items()}
        # The PBI has to last until the next one is ready, so the attained rate counts, not the nominal one.
        f_vin = min(source.fps, self.frame_rate.per_second() or source.fps)
        loop, start, first = asyncio.get_running_loop(), time.monotonic(), self.shown is not core
        try:
            with self._updates.running(), self._uses.using(core):
                updated = await loop.run_in_executor(
                    self._back_ends[self._patience.niceness], core.update, frame, self._look, speeds, f_vin
                )
        except Exception as error:  # a boundary: the future gets the error, the service goes on
            self._fail(frame, settled, error)
            self._give_up(core, error)
            return
        found = {name: fault for name, fault in updated.left_out.items() if name not in frame.faults}
        if core is self._core:
            self.left_out.note(frame.index, found, waiting=first and not updated.shown)
        if updated.shown:
            self._show(core, source, updated, None if first else start)
        self._settle(settled, Settled(updated.shown, updated.left_out))

    def _show(self, core: Core, source: Source, updated: Updated, start: float | None) -> None:
        """Account for an update that began at `start` (monotonic clock, s; None: the first one), and show its frame."""
        if start is not None:
            self._patience.observe(time.monotonic() - start, 1.0 / source.fps)
        self.timings.add(updated.stages, "update.")
        self.frame_rate.count()
        self._core_status = dict(updated.status)
        if core is self._core and self.shown is not core:
            self.shown = core
            self._wake_viewers()

    def _look(self) -> dict[str, StereoView]:
        """The present views of all viewers; called in any thread."""
        return {name: viewer.view for name, viewer in list(self._viewers.items())}

    def _fail(self, frame: Frame, settled: asyncio.Future[Settled], error: Exception) -> None:
        trace = None if isinstance(error, CoreLostError) else error  # a lost engine says all in a line
        _log.error("frame %d could not be taken: %s", frame.index, error, exc_info=trace)
        self.frames["failed"] += 1
        if not settled.done():
            settled.set_exception(error)

    def _wake_viewers(self) -> None:
        for viewer in self._viewers.values():
            viewer.wake.set()

    @contextmanager
    def viewer(self, name: str, view: StereoView) -> Iterator[LiveViewer[Any]]:
        """Add a viewer while the `with` block runs; every update renders its PBI."""
        viewer: LiveViewer[Any] = LiveViewer(self, name, view)
        self._viewers[name] = viewer
        viewer.wake.set()
        try:
            yield viewer
        finally:
            del self._viewers[name]

    async def picture(self, core: Core, view: StereoView, viewer: str, encoding: str) -> EncodedPair:
        """A viewer's pair, rendered and encoded in a render thread."""
        loop, start = asyncio.get_running_loop(), time.monotonic()
        try:
            with self._uses.using(core):
                pair = await loop.run_in_executor(self._front_end, core.picture, view, viewer, encoding)
        except CoreLostError as error:
            self._give_up(core, error)
            raise
        report = pair.report
        self._account(viewer, report.stages | {"encode": report.encode_ms, "total": report.total_ms}, start)
        return pair

    def _give_up(self, core: Core, error: Exception) -> None:
        """Forget a core whose process has ended; the next source gets another one."""
        if not isinstance(error, CoreLostError) or core is not self._core:
            return
        self._core_status = {"lost": str(error)}
        self._core = self.source = self.shown = None
        if self._pending is not None:  # perhaps from a source that came before the loss was noticed
            (frame, settled), self._pending = self._pending, None
            self._fail(frame, settled, error)

    def _account(self, viewer: str, stages: Mapping[str, float], start: float) -> None:
        """Account for a viewer's stereo picture that was requested at `start` (monotonic clock, s)."""
        self.timings.add(stages, "render.")
        self.picture_rate.count()
        now, updating = time.monotonic(), self._updates.since(start)
        took = 1e3 * (now - start)
        if self.governor is not None and self.governor.observe(viewer, now - start, now):
            self._retune()
        self.timings.add({"picture_during_update" if updating else "picture": took})
        (self._longest_in_update if updating else self._longest_picture).add(took)

    def _retune(self) -> None:
        """Set the governor's rung in the core that is shown, and in the one that is going to be shown."""
        if self.governor is not None:
            for core in filter(None, (self.shown, self._core)):
                core.retune(self.governor.rung.settings)

    @property
    def viewer_count(self) -> int:
        """The number of viewers."""
        return len(self._viewers)

    def status(self, seconds: float = math.inf) -> dict[str, Any]:
        """Figures for people and monitors: milliseconds, the longest of the last `seconds`, and rates in 1/s."""
        source = self.source
        return {
            "source": source and {"name": source.name, "fps": source.fps, "cameras": [c.name for c in source.cameras]},
            "frames": dict(self.frames),
            "left_out": self.left_out.counts(),
            "updating": self._updates.since(math.inf),
            "update_niceness": self._patience.niceness,
            "rates": {"f_vin": self.frame_rate.per_second(), "f_ren": self.picture_rate.per_second()},
            "viewers": {name: viewer.status() for name, viewer in self._viewers.items()},
            "stages_ms": self.timings.summary(),
            "event_loop": self.stalls.summary(seconds),
            "pictures": {
                "longest_picture_ms": self._longest_picture.over(seconds),
                "longest_picture_during_update_ms": self._longest_in_update.over(seconds),
            },
            "engine": self._core_status,
            "governor": self.governor and self.governor.status(time.monotonic()),
        }
