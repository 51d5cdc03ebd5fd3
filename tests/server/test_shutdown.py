"""The server ends when it is told to, whatever its engine is doing."""

from __future__ import annotations

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from farside.clients.connection import connect
from farside.server.pictures import encode_view
from farside.server.protocol import BufferFree, FrameDone, SourceHello, ViewerHello, Welcome
from support.doubles import CAMERAS, a_view
from support.processes import is_gone

HANG_S = 120.0
SOURCE = SourceHello("walls", 30.0, CAMERAS)


@contextmanager
def serving(**environment: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`farside serve` in a process of its own, and its address."""
    with subprocess.Popen(
        [sys.executable, "-m", "farside.clients.cli", "serve", "--port", "0", "--quality", "fast"],
        stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env={**os.environ, **environment},
    ) as process:  # fmt: skip
        assert process.stdout is not None
        try:
            yield process, process.stdout.readline().split()[2]
        finally:
            process.kill()


def children(pid: int) -> list[int]:
    """Processes that a process has started."""
    return [int(child) for path in Path(f"/proc/{pid}/task").glob("*/children") for child in path.read_text().split()]


async def play(url: str) -> None:
    async with connect(url, SOURCE) as (source, _):
        for camera in CAMERAS:
            await source.send(encode_view(a_view(camera), 0))
        while not isinstance(await source.receive(FrameDone, BufferFree), FrameDone):
            pass


async def wait_for_ever(url: str, asked: asyncio.Event) -> None:
    """A source whose frame is never taken."""
    async with connect(url, SOURCE) as (source, _):
        for camera in CAMERAS:
            await source.send(encode_view(a_view(camera), 1))
        asked.set()
        while True:
            await source.receive(FrameDone, BufferFree)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_a_server_without_work_ends_in_order(number: signal.Signals) -> None:
    with serving() as (process, url):

        async def scenario() -> None:
            async with connect(url, ViewerHello.symmetric(32, 24, 1.5)) as (_, welcome):
                assert isinstance(welcome, Welcome)
                process.send_signal(number)
                assert await asyncio.to_thread(process.wait, HANG_S) == 0

        asyncio.run(scenario())


@pytest.mark.parametrize("signals", ["once", "twice", "twice, others"])
def test_an_engine_that_does_not_answer_does_not_hold_the_server(signals: str) -> None:
    # Where a second signal comes, the first alone would wait for longer than this test does.
    patience = "1" if signals == "once" else "100000"
    with serving(FARSIDE_SHUTDOWN_TIMEOUT_S=patience) as (process, url):

        async def scenario() -> None:
            await play(url)
            (engine,) = children(process.pid)
            os.kill(engine, signal.SIGSTOP)
            asked = asyncio.Event()
            waiting = asyncio.create_task(wait_for_ever(url, asked))
            try:
                await asked.wait()
                process.send_signal(signal.SIGTERM)
                if signals != "once":
                    with pytest.raises(ConnectionError):  # the first one has come to the server
                        await waiting
                    process.send_signal(signal.SIGTERM if signals == "twice" else signal.SIGINT)
                code = await asyncio.to_thread(process.wait, HANG_S)
                assert (code == 0) == (signals == "once")  # in order, or not
            finally:
                waiting.cancel()
                await asyncio.gather(waiting, return_exceptions=True)
            while not is_gone(engine):
                await asyncio.sleep(0.01)

        asyncio.run(scenario())


def test_an_engine_that_is_still_being_made_does_not_hold_the_server() -> None:
    with serving(FARSIDE_SHUTDOWN_TIMEOUT_S="1") as (process, url):

        async def scenario() -> None:
            asked = asyncio.Event()
            waiting = asyncio.create_task(wait_for_ever(url, asked))
            while not (engines := children(process.pid)):
                await asyncio.sleep(0.001)
            os.kill(engines[0], signal.SIGSTOP)
            process.send_signal(signal.SIGTERM)
            await asyncio.to_thread(process.wait, HANG_S)
            await asyncio.gather(waiting, return_exceptions=True)
            while not is_gone(engines[0]):
                await asyncio.sleep(0.01)

        asyncio.run(scenario())
