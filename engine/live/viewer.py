"""One viewer of the live engine: its newest pose wins, older ones are dropped and counted."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from ..rig.camera import Pose
from ..rig.viewer import EncodedPair, StereoView
from .core import Core, Source
from .timing import Rate

__all__ = ["IN_FLIGHT", "Deliver", "HeadPose", "LiveViewer", "Show"]

Tag = TypeVar("Tag")
IN_FLIGHT = 2  # pictures that may be on their way to a viewer, if it tells how many it has received


@dataclass(frozen=True, slots=True)
class HeadPose(Generic[Tag]):
    """A pose at a time on the viewer's clock (s), with its velocity in m/s if known; `tag` is returned unchanged.

    `seen`: the number of pictures that the viewer has received, None if it does not tell. With it, no pictures queue up
    in a slow network.
    """

    pose: Pose
    time: float
    tag: Tag
    velocity: tuple[float, float, float] | None = None
    seen: int | None = None


# Called with a pose when its pair is requested; returns the function that delivers the pair, which so can hold the
# state at the time of the request.
Deliver = Callable[[HeadPose[Tag]], Callable[[EncodedPair], Awaitable[None]]]


class Show(Protocol):
    """The live engine as viewers use it."""

    @property
    def source(self) -> Source | None:
        """The source that is playing; None if there is none."""

    @property
    def shown(self) -> Core | None:
        """The core, once it has a frame to show."""

    async def picture(self, core: Core, view: StereoView, viewer: str, encoding: str) -> EncodedPair:
        """A viewer's pair, rendered and encoded in a worker thread."""


class LiveViewer(Generic[Tag]):
    """One viewer: its newest pose, the number of pictures for it, and the speed of its head."""

    def __init__(self, show: Show, name: str, view: StereoView) -> None:
        self._show, self.name, self.view = show, name, view
        self._wanted: HeadPose[Tag] | None = None
        self._last: HeadPose[Tag] | None = None
        self.wake = asyncio.Event()
        self.speed = 0.0  # m/s
        self.rendered = 0
        self.dropped = 0
        self.rate = Rate()

    def look(self, wanted: HeadPose[Tag]) -> None:
        """Take a new pose; a pose that was not rendered yet is dropped."""
        self.dropped += self._wanted is not None
        self._measure_speed(wanted)
        self._wanted = self._last = wanted
        self.view = self.view.moved(wanted.pose)
        self.wake.set()

    def _measure_speed(self, new: HeadPose[Tag], smoothing_s: float = 0.1, fastest: float = 10.0) -> None:
        if new.velocity is not None:
            self.speed = min(math.hypot(*new.velocity), fastest)
        elif self._last is not None and new.time > self._last.time:
            elapsed = new.time - self._last.time
            speed = min(math.dist(new.pose.position, self._last.pose.position) / elapsed, fastest)
            self.speed += (1.0 - math.exp(-elapsed / smoothing_s)) * (speed - self.speed)

    async def run(
        self, encoding: str, deliver: Deliver[Tag], announce: Callable[[Source], Awaitable[None]]
    ) -> None:
        """Request pairs (`encoding`: see `io.images.encode_picture`) and deliver them, until cancelled; `announce` each
        new source first."""
        announced = None
        while True:
            await self.wake.wait()
            self.wake.clear()
            source = self._show.source
            if source is not None and source is not announced:
                announced = source
                await announce(source)
            core = self._show.shown
            if self._wanted is None or core is None or self._congested():
                continue  # until the next pose, frame or source wakes it
            wanted, self._wanted = self._wanted, None
            send = deliver(wanted)
            pair = await self._show.picture(core, self.view, self.name, encoding)
            self.rendered += 1
            self.rate.count()
            await send(pair)

    def _congested(self) -> bool:
        seen = self._wanted.seen if self._wanted is not None else None
        return seen is not None and self.rendered - seen >= IN_FLIGHT

    def status(self) -> dict[str, Any]:
        """Figures for people and monitors."""
        return {
            "rendered": self.rendered,
            "dropped": self.dropped,
            "rate": self.rate.per_second(),
            "speed": self.speed,
        }
