"""The engine starts when the kernels for a picture are there, and its model when all are."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Iterator, Sequence
from typing import Any

import pytest
from farside.clients.connection import connect
from farside.clients.fetching import fetch
from farside.engine.compiling.pool import Progress
from farside.engine.live.core import Source
from farside.server import app
from farside.server.pictures import encode_view
from farside.server.protocol import FrameDone, SourceHello
from farside.server.settings import ServerSettings
from support.doubles import CAMERAS, FakeCore, a_frame
from support.serving import running

HANG_S = 60.0


class Kernels:
    """Kernels for a picture, and for all, that are there when a test says so."""

    def __init__(self) -> None:
        self.progress, self.first = Progress(0, 2), Progress(0, 1)
        self._there = {"picture": threading.Event(), "balanced": threading.Event()}
        self.waited = threading.Event()
        self.rests: list[float] = []

    def start(self) -> None:
        pass

    def stop(self) -> None:
        for event in self._there.values():
            event.set()

    def rest(self, seconds: float) -> None:
        self.rests.append(seconds)

    def make(self, use: str) -> None:
        self._there[use].set()

    def wait(self, uses: Sequence[str], timeout: float | None = None) -> bool:
        if timeout is None:
            self.waited.set()
        return all(self._there[use].wait(HANG_S if timeout is None else timeout) for use in uses)


class Told(FakeCore):
    """A core that notes whether it was made with a model, and when it begins one."""

    made: list[Told] = []  # noqa: RUF012 # emptied by the fixture

    def __init__(self, make: Any, cameras: Any, settings: Any, modelling: bool = True, files: Any = None) -> None:
        super().__init__(Source("", 30.0, CAMERAS))
        self.modelling, self.begun = modelling, threading.Event()
        self.made.append(self)

    def begin_model(self) -> None:
        self.begun.set()


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Told]]:
    monkeypatch.setattr(app, "ProcessCore", Told)
    yield Told.made
    Told.made.clear()


async def _send_one(url: str) -> None:
    async with connect(url, SourceHello("walls", 30.0, CAMERAS, "")) as (peer, _):
        for view in a_frame(1).views:
            await peer.send(encode_view(view, 1))
        await peer.receive(FrameDone)


def test_pictures_come_before_the_model(made: list[Told]) -> None:
    kernels = Kernels()
    with running(compiling=kernels) as url:
        assert json.loads(fetch(url, "status", timeout_s=HANG_S))["kernels"] == {
            "ready": 0, "of": 2, "failed": 0, "first_ready": 0, "first_of": 1
        }  # fmt: skip
        sending = threading.Thread(target=lambda: asyncio.run(_send_one(url)))
        sending.start()
        assert kernels.waited.wait(HANG_S)
        assert not made
        kernels.make("picture")
        sending.join(HANG_S)
        (core,) = made
        assert not core.modelling
        assert kernels.rests == [pytest.approx(4.0)]  # the engine has the cores alone while it starts
        assert not core.begun.is_set()
        kernels.make("balanced")
        assert core.begun.wait(HANG_S)


def test_with_all_kernels_the_model_begins_at_once(made: list[Told]) -> None:
    kernels = Kernels()
    kernels.make("picture")
    kernels.make("balanced")
    with running(compiling=kernels) as url:
        asyncio.run(_send_one(url))
    (core,) = made
    assert core.modelling


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, ("picture", "balanced", "effects")),
        ({"quality": "fast", "target_fps": 10}, ("picture", "fast", "effects")),
        ({"quality": "best", "target_fps": 10}, ("picture", "best", "balanced", "fast", "effects")),
        ({"quality": "paper"}, ("picture", "paper", "effects")),
        ({"seed_model": "room.glb"}, ("picture", "balanced", "seed", "effects")),
        ({"light": 2.0}, ("picture", "balanced", "beyond", "effects")),
        ({"middle_layers": 9, "quality": "fast"}, ("picture", "fast", "beyond", "effects")),
        ({"light": 2.0, "background": False}, ("picture", "balanced", "effects")),
    ],
)
def test_settings_tell_what_is_needed(given: dict[str, Any], expected: tuple[str, ...]) -> None:
    assert ServerSettings(**given).needed == expected
