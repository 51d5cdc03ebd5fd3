"""`farside replay`: send a sequence to a live server, as a camera rig would."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal, NoReturn

import typer
from farside.engine.tmiv import Sequence, open_sequence, playback_index
from farside.server.pictures import encode_view
from farside.server.protocol import FrameDone, SourceHello, encode
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from .connection import Peer, connect, persist

__all__ = ["Playback", "Replay", "command", "parse_sources"]


@dataclass(frozen=True, slots=True)
class Playback:
    """What to send, and how."""

    sequence: Sequence
    sources: tuple[str, ...]
    rate: float  # frames a second
    frames: int | None = None  # how many; None: all once, or for ever with `loop`
    loop: bool = False
    every_frame: bool = False  # wait until each frame was taken instead of keeping the rate
    texture: Literal["raw", "jpeg"] = "raw"
    depth: Literal["raw", "zlib"] = "raw"
    token: str = ""

    @property
    def total(self) -> int | None:
        """Frames to send; None: no end."""
        if self.loop:
            return self.frames
        return min(self.frames or self.sequence.frame_count, self.sequence.frame_count)


@dataclass
class Replay:
    """One source: what it has sent and what became of it. Goes on where it was after a lost connection."""

    playback: Playback
    progress: Callable[[Replay], None] = lambda replay: None
    number: int = 0  # of the next frame
    skipped: int = 0  # frames not sent, to keep the rate
    outcomes: Counter[str] = field(default_factory=Counter)

    async def run(self, url: str) -> None:
        """Connect and send to the end; raises RefusedError or ConnectionError."""
        p = self.playback
        cameras = tuple(p.sequence.camera(name) for name in p.sources)
        hello = SourceHello(p.sequence.name, p.rate, cameras, p.token)
        async with connect(url, hello) as (peer, welcome):
            window = asyncio.Semaphore(1 if p.every_frame else welcome.credits)
            settling = asyncio.create_task(self._settle(peer, window))
            try:
                await self._send_frames(peer, window, settling)
            finally:
                settling.cancel()
                await asyncio.gather(settling, return_exceptions=True)

    async def _send_frames(
        self, peer: Peer, window: asyncio.Semaphore, settling: asyncio.Task[NoReturn]
    ) -> None:
        p, loop = self.playback, asyncio.get_running_loop()
        start = loop.time() - self.number / p.rate
        while p.total is None or self.number < p.total:
            await _unless_failed(window.acquire(), settling)
            await asyncio.sleep(start + self.number / p.rate - loop.time())
            late = 0 if p.every_frame else int((loop.time() - start) * p.rate) - self.number
            if late > 0 and (p.total is None or self.number + late < p.total):
                self.skipped += late
                self.number += late
            await self._send_frame(peer, self.number)
            self.number += 1
        for _ in range(1 if p.every_frame else 3):  # what is still under way
            await _unless_failed(window.acquire(), settling)

    async def _send_frame(self, peer: Peer, number: int) -> None:
        for name in self.playback.sources:
            await peer.send_bytes(await asyncio.to_thread(self._message, name, number))

    def _message(self, name: str, number: int) -> bytes:
        p = self.playback
        view = p.sequence.view(name, playback_index(number, p.sequence.frame_count))
        return encode(encode_view(view, number, texture=p.texture, depth=p.depth))

    async def _settle(self, peer: Peer, window: asyncio.Semaphore) -> NoReturn:
        while True:
            done = await peer.receive(FrameDone)
            self.outcomes[done.outcome] += 1
            window.release()
            self.progress(self)


async def _unless_failed(waiting: Awaitable[object], task: asyncio.Task[NoReturn]) -> None:
    """Await something, or the failure of a task that runs beside it."""
    other = asyncio.ensure_future(waiting)
    try:
        await asyncio.wait((other, task), return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            task.result()
    finally:
        other.cancel()


def parse_sources(sequence: Sequence, sources: str | None) -> tuple[str, ...]:
    """The views to send: those named, comma-separated, or all; raises ValueError for another's name."""
    names = tuple(sources.split(",")) if sources else sequence.source_names
    for name in names:
        if name not in sequence.source_names:
            raise ValueError(f"--sources: {name!r}: expected some of {', '.join(sequence.source_names)}")
    return names


def command(
    sequence: Annotated[Path, typer.Argument(metavar="SEQ", help="The sequence's folder, or its JSON.")],
    url: Annotated[str, typer.Argument(help="The server, like http://127.0.0.1:8765.")],
    rate: Annotated[float | None, typer.Option(help="Frames a second (default: the sequence's).")] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Play to and fro until stopped.")] = False,
    frames: Annotated[int | None, typer.Option(min=1, help="How many frames.")] = None,
    sources: Annotated[str | None, typer.Option(help="Source views, like v0,v3 (default: all).")] = None,
    every_frame: Annotated[
        bool, typer.Option("--every-frame", help="Wait for the server instead of skipping frames.")
    ] = False,
    jpeg: Annotated[bool, typer.Option("--jpeg", help="Send textures as JPEG.")] = False,
    deflate: Annotated[bool, typer.Option("--deflate", help="Compress depth (without loss).")] = False,
    token: Annotated[str, typer.Option(envvar="FARSIDE_TOKEN", help="The server's token.")] = "",
    patience: Annotated[float, typer.Option(help="Seconds to keep trying without a connection.")] = 10.0,
) -> None:
    """Send a sequence to a live server, as a camera rig would."""
    opened = open_sequence(sequence)
    if rate is not None and not 0.01 <= rate <= 1000:
        raise ValueError(f"--rate: {rate!r}: expected 0.01 to 1000 frames a second")
    playback = Playback(
        opened,
        parse_sources(opened, sources),
        rate or opened.fps,
        frames,
        loop,
        every_frame,
        "jpeg" if jpeg else "raw",
        "zlib" if deflate else "raw",
        token,
    )
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("frames"))
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(opened.name, total=playback.total)
        replay = Replay(playback, lambda r: bar.update(task, completed=r.number))
        try:
            asyncio.run(persist(lambda: replay.run(url), patience, console.print))
        except KeyboardInterrupt:
            console.print("stopped")
    print(_summary(replay))


def _summary(replay: Replay) -> str:
    outcomes = replay.outcomes
    return (
        f"{replay.number - replay.skipped} frames sent, {replay.skipped} skipped to keep the rate; "
        f"the server took {outcomes['updated']} and dropped {outcomes['dropped']}"
    )
