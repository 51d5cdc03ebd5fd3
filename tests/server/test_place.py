"""The place of the only source is free as soon as its connection has ended, even while work for it goes on."""

from __future__ import annotations

import asyncio
import dataclasses
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

import pytest
from farside.clients.connection import Peer, RefusedError, base_url, connect
from farside.engine.live.core import CoreLostError, Source
from farside.engine.live.core_process import ProcessCore
from farside.engine.live.engine import Live
from farside.engine.live.frame_memory import FrameBuffers
from farside.engine.rig.camera import Camera
from farside.server import inbox, left_out
from farside.server.inbox import Inbox
from farside.server.pictures import encode_view
from farside.server.protocol import BufferFree, FrameDone, SourceHello, encode
from starlette.websockets import WebSocket
from support.doubles import CAMERAS, HANG_S, FakeCore, Gate, a_view
from support.serving import run_within, running
from websockets.asyncio.client import connect as raw_connect

SOURCE = SourceHello("walls", 30.0, CAMERAS)
OTHER = SourceHello("wall", 30.0, CAMERAS[:1])
BUSY = "expected no other source at a time"


class Cores:
    """Makes cores and remembers them; making one waits at a gate."""

    def __init__(self) -> None:
        self.made: list[FakeCore] = []
        self.making = Gate()

    def __call__(self, source: Source) -> FakeCore:
        self.making.pass_through()
        self.made.append(FakeCore(source))
        return self.made[-1]


@pytest.fixture
def cores() -> Cores:
    return Cores()


run = partial(run_within, 2 * HANG_S)


async def send_views(peer: Peer, frame: int, cameras: tuple[Camera, ...] = CAMERAS) -> None:
    for camera in cameras:
        await peer.send(encode_view(a_view(camera), frame))


async def send_frame(peer: Peer, frame: int, cameras: tuple[Camera, ...] = CAMERAS) -> FrameDone:
    await send_views(peer, frame, cameras)
    return await peer.receive(FrameDone)


async def come_and_play(url: str, hello: SourceHello, frame: int) -> FrameDone:
    async with connect(url, hello) as (source, _):
        return await send_frame(source, frame, hello.cameras)


async def until(condition: Callable[[], bool]) -> None:
    while not condition():
        await asyncio.sleep(0.001)


async def entered(gate: Gate) -> None:
    assert await asyncio.to_thread(gate.entered.wait, HANG_S)


class Held:
    """Calls of one function: it counts how many have begun and how many have ended; held calls wait at a gate."""

    def __init__(self, function: Callable[..., Any], hold: Callable[[int], bool]) -> None:
        self._function, self._hold = function, hold
        self.gate = Gate()
        self.gate.close()
        self.begun = self.over = 0

    def call(self, *given: Any, **named: Any) -> Any:
        number, self.begun = self.begun, self.begun + 1
        try:
            if self._hold(number):
                self.gate.pass_through()
            return self._function(*given, **named)
        finally:
            self.over += 1


@pytest.fixture
def hold(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Held]]:
    """A function that makes calls of an owner's function wait; all of them continue when the test ends."""
    with ExitStack() as stack:

        def holding(owner: Any, name: str, which: Callable[[int], bool] = lambda number: number == 0) -> Held:
            held = Held(getattr(owner, name), which)
            monkeypatch.setattr(owner, name, lambda *given, **named: held.call(*given, **named))
            stack.callback(held.gate.open)
            return held

        yield holding


async def leave(source: Peer, how: str) -> None:
    """End a connection with a close frame, or in the way of a killed process."""
    if how == "closes":
        await source._socket.close()
    else:
        source._socket.transport.abort()


LEAVES = pytest.mark.parametrize("how", ["closes", "vanishes"])
NEXT = pytest.mark.parametrize("following", [SOURCE, OTHER], ids=["same cameras", "other cameras"])


# Work that is still done for a source that has ended


@LEAVES
@NEXT
def test_a_source_comes_while_the_memory_of_the_last_one_is_being_freed(
    url: str, hold: Callable[..., Held], how: str, following: SourceHello
) -> None:
    freeing = hold(FrameBuffers, "close", lambda number: True)

    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, _):
            await send_frame(source, 0)
            await leave(source, how)
            assert await come_and_play(url, following, 0) == FrameDone(0, "updated")
        await until(lambda: freeing.begun == 2)
        assert freeing.over == 0

    run(scenario)


@LEAVES
@NEXT
def test_a_view_that_is_still_being_decoded_does_not_get_into_the_next_rig(
    url: str, cores: Cores, hold: Callable[..., Held], how: str, following: SourceHello
) -> None:
    decoding = hold(left_out, "decode_view", lambda number: number == 3)
    freeing = hold(FrameBuffers, "close", lambda number: False)

    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, _):
            await send_frame(source, 0)
            await send_views(source, 7)
            await entered(decoding.gate)
            await leave(source, how)
            assert await come_and_play(url, following, 1) == FrameDone(1, "updated")
            decoding.gate.open()
            await until(lambda: freeing.over == 2)

    run(scenario)
    assert [core.updates for core in cores.made] == ([[0, 1]] if following is SOURCE else [[0], [1]])


@pytest.mark.parametrize("held", [True, False])
def test_the_last_frame_of_a_source_that_has_left_is_taken_where_no_other_comes(
    url: str, cores: Cores, hold: Callable[..., Held], held: bool
) -> None:
    decoding = hold(left_out, "decode_view", lambda number: held)

    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, _):
            await send_views(source, 0)
        decoding.gate.open()
        await until(lambda: cores.made[0].updates == [0])

    run(scenario)


@NEXT
def test_a_source_comes_while_an_engine_is_being_made_for_one_that_has_left(
    url: str, cores: Cores, monkeypatch: pytest.MonkeyPatch, following: SourceHello
) -> None:
    opened: list[str] = []
    original = Live.open

    async def open_(live: Live, source: Source) -> None:
        opened.append(source.name)
        await original(live, source)

    async def scenario() -> None:
        async with raw_connect(base_url(url, "ws") + "/source") as socket:
            await socket.send(encode(SOURCE))
            await entered(cores.making)
        coming = asyncio.create_task(come_and_play(url, following, 0))
        await until(lambda: len(opened) == 2 or coming.done())
        cores.making.open()
        assert await coming == FrameDone(0, "updated")

    monkeypatch.setattr(Live, "open", open_)
    cores.making.close()
    try:
        run(scenario)
    finally:
        cores.making.open()
    assert [core.updates for core in cores.made] == ([[0]] if following is SOURCE else [[], [0]])


def lose(*asked: object) -> None:
    raise CoreLostError("the engine's process ended by SIGKILL")


@pytest.mark.parametrize(
    ("fault", "says"), [("bad view", r"camera: v7.*code 4404"), ("lost engine", r"CoreLostError.*code 4500")]
)
def test_a_source_comes_before_the_last_one_is_told_what_was_wrong(
    url: str, cores: Cores, hold: Callable[..., Held], fault: str, says: str
) -> None:
    freeing = hold(FrameBuffers, "close")

    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, _):
            await send_frame(source, 0)
            if fault == "bad view":
                await source.send(dataclasses.replace(encode_view(a_view(CAMERAS[0]), 1), camera="v7"))
            else:
                cores.made[0].update = lose
                await send_views(source, 1)
            await entered(freeing.gate)
            assert await come_and_play(url, SOURCE, 0) == FrameDone(0, "updated")
            freeing.gate.open()
            with pytest.raises((RefusedError, ConnectionError), match=says):
                await source.receive(FrameDone)

    run(scenario)
    assert [core.updates for core in cores.made] == ([[0, 0]] if fault == "bad view" else [[0], [0]])


# A source that is there


@pytest.mark.parametrize("step", ["making", "decoding"])
def test_another_source_is_refused_at_once_whatever_is_being_done_for_the_first(
    url: str, cores: Cores, hold: Callable[..., Held], step: str
) -> None:
    decoding = hold(left_out, "decode_view", lambda number: step == "decoding")
    held = decoding.gate if step == "decoding" else cores.making
    held.close()

    async def first() -> None:
        async with connect(url, SOURCE) as (source, _):
            assert await send_frame(source, 0) == FrameDone(0, "updated")

    async def scenario() -> None:
        playing = asyncio.create_task(first())
        await entered(held)
        with pytest.raises(RefusedError, match=BUSY):
            await come_and_play(url, OTHER, 0)
        held.open()
        await playing

    try:
        run(scenario)
    finally:
        held.open()


class Behind:
    """A source that has sent more than the server has read, and other sources that connect then."""

    def __init__(self, url: str, cores: Cores, monkeypatch: pytest.MonkeyPatch) -> None:
        self.url, self.cores = url, cores
        self.read = self.asked = 0
        receive, is_there = inbox.receive, Inbox.is_there

        async def count_read(socket: WebSocket) -> bytes:
            data = await receive(socket)
            self.read += 1
            return data

        async def count_asked(source: Inbox) -> bool:
            self.asked += 1
            return await is_there(source)

        monkeypatch.setattr(inbox, "receive", count_read)
        monkeypatch.setattr(Inbox, "is_there", count_asked)

    async def send(self, source: Peer) -> None:
        """Send frames 0 to 8; of the last eight, the core holds the first, and the third waits to be offered."""
        await send_frame(source, 0)
        self.cores.made[0].updating.close()
        for frame in range(1, 9):
            await send_views(source, frame)
        await until(lambda: self.read == 2 + 3 * 2 + 2)

    async def come(self, count: int) -> list[asyncio.Task[FrameDone]]:
        """Connect `count` other sources; return when all have asked for the place or have been refused."""
        coming = [asyncio.create_task(come_and_play(self.url, OTHER, 0)) for _ in range(count)]
        await until(lambda: self.asked == count or any(task.done() for task in coming))
        return coming


@pytest.fixture
def behind(url: str, cores: Cores, monkeypatch: pytest.MonkeyPatch) -> Iterator[Behind]:
    yield Behind(url, cores, monkeypatch)
    cores.made[0].updating.open()


def test_where_a_source_is_so_far_behind_that_its_end_is_not_read_the_next_ones_wait_for_it(
    behind: Behind, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(inbox, "READ_S", HANG_S)

    async def scenario() -> None:
        async with connect(behind.url, SOURCE) as (source, _):
            await behind.send(source)
            await leave(source, "vanishes")
            coming = await behind.come(2)
            assert not any(task.done() for task in coming)
            behind.cores.made[0].updating.open()
            one, other = sorted(await asyncio.gather(*coming, return_exceptions=True), key=repr)
            assert one == FrameDone(0, "updated")
            assert BUSY in str(other)

    run(scenario)
    assert [core.updates for core in behind.cores.made][1:] == [[0]]


def test_a_source_that_is_far_behind_but_there_keeps_its_place(behind: Behind, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inbox, "READ_S", HANG_S)

    async def scenario() -> None:
        async with connect(behind.url, SOURCE) as (source, _):
            await behind.send(source)
            (coming,) = await behind.come(1)
            assert not coming.done()
            behind.cores.made[0].updating.open()
            with pytest.raises(RefusedError, match=BUSY):
                await coming
            assert [await source.receive(FrameDone) for _ in range(8)] == [FrameDone(k, "updated") for k in range(1, 9)]

    run(scenario)


def test_nobody_waits_long_for_a_source_that_is_far_behind(behind: Behind, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inbox, "READ_S", 0.01)

    async def scenario() -> None:
        async with connect(behind.url, SOURCE) as (source, _):
            await behind.send(source)
            (coming,) = await behind.come(1)
            with pytest.raises(RefusedError, match=BUSY):
                await coming
            behind.cores.made[0].updating.open()

    run(scenario)


# Many times


@LEAVES
def test_two_sources_come_and_go_in_turn_many_times(url: str, cores: Cores, how: str) -> None:
    names = dataclasses.replace(SOURCE, name="a"), dataclasses.replace(SOURCE, name="b", shares=True)

    async def scenario() -> None:
        for turn in range(50):
            async with connect(url, names[turn % 2]) as (source, _):
                await send_views(source, turn)
                while not isinstance(done := await source.receive(FrameDone, BufferFree), FrameDone):
                    pass
                assert done == FrameDone(turn, "updated")
                await leave(source, how)

    run(scenario)
    assert [core.updates for core in cores.made] == [list(range(50))]


@contextmanager
def busy_cores(count: int) -> Iterator[None]:
    """Processes that keep `count` cores busy."""
    with ExitStack() as stack:
        for _ in range(count):
            process = stack.enter_context(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            stack.callback(process.kill)
        yield


def test_engines_in_processes_of_their_own_are_lost_and_replaced_while_all_cores_are_busy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    made: list[ProcessCore] = []

    def make(source: Source) -> ProcessCore:
        made.append(ProcessCore(FakeCore, source))
        return made[-1]

    async def scenario(url: str) -> None:
        for turn in range(2):
            async with connect(url, SOURCE) as (source, _):
                assert await send_frame(source, 0) == FrameDone(0, "updated")
                os.kill(made[-1].pid, signal.SIGKILL)
                with pytest.raises(ConnectionError, match=r"CoreLostError: the engine's process ended by S.*code 4500"):
                    await send_frame(source, 1)
            assert len(made) == turn + 1

    with busy_cores(2), running(make) as url:
        run(lambda: scenario(url))
