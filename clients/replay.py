"""`farside replay`: send a sequence to a live server, as a camera rig would."""

from __future__ import annotations

import asyncio
import ssl
from collections import Counter
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, NoReturn, TypeVar

import numpy as np
import typer
from farside.engine.io.recording import Playhead, Recording, ToAndFro, open_recording
from farside.engine.live.frame_memory import Planes, open_buffer
from farside.engine.rig.camera import Camera
from farside.engine.rig.frame import Fault, View
from farside.engine.rig.left_out import LeftOut
from farside.server.pictures import encode_view
from farside.server.protocol import (
    MISSING_VIEWS,
    BufferFree,
    Features,
    FrameDone,
    SharedMemory,
    SourceHello,
    ViewData,
    encode,
)
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from .address import token_of
from .connection import Peer, connect, persist
from .moving import Moving, pose_files
from .trust import trust_file

__all__ = ["Playback", "Replay", "command", "parse_sources"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Playback:
    """The recording to send, its source views, and the manner of sending."""

    recording: Recording
    sources: tuple[str, ...]
    rate: float  # frames a second
    frames: int | None = None  # number of frames; None: all once, or without end with `loop`
    loop: bool = False
    every_frame: bool = False  # wait until each frame has been taken instead of keeping the rate
    texture: Literal["raw", "jpeg"] = "raw"
    depth: Literal["raw", "zlib"] = "raw"
    token: str = ""

    @property
    def total(self) -> int | None:
        """Frames to send; None: no end."""
        if self.loop:
            return self.frames
        return min(self.frames or self.recording.frame_count, self.recording.frame_count)


@dataclass
class Replay:
    """One source: the frames that it has sent, and their outcomes. After a lost connection it continues there."""

    playback: Playback
    progress: Callable[[Replay], None] = lambda replay: None
    tls: ssl.SSLContext | None = None  # whom to trust; None: as the machine
    number: int = 0  # of the next frame
    skipped: int = 0  # frames not sent, to keep the rate
    outcomes: Counter[str] = field(default_factory=Counter)
    left_out: LeftOut = field(default_factory=LeftOut)  # views that the server left out of frames
    _order: ToAndFro = field(default_factory=ToAndFro)
    shared: bool = False  # whether frames go through the server's memory

    async def run(self, url: str) -> None:
        """Connect and send all frames; raises RefusedError or ConnectionError."""
        p = self.playback
        cameras = tuple(p.recording.camera(name) for name in p.sources)
        raw = p.texture == p.depth == "raw"  # only raw frames can go through the memory of a server on this machine
        features = Features(optional=(MISSING_VIEWS,))
        hello = SourceHello(p.recording.name, p.rate, cameras, p.token, shares=raw, features=features)
        async with connect(url, hello, tls=self.tls) as (peer, welcome):
            credits = 1 if p.every_frame else welcome.credits
            playhead = Playhead(p.recording, p.sources)
            says_missing = MISSING_VIEWS in welcome.features
            session = _Session(peer, credits, _open_buffers(welcome.memory, cameras), playhead, says_missing)
            self.shared = session.buffers is not None
            settling = asyncio.create_task(self._settle(session))
            try:
                await self._send_frames(session, settling)
            finally:
                settling.cancel()
                await asyncio.gather(settling, return_exceptions=True)

    async def _send_frames(self, session: _Session, settling: asyncio.Task[NoReturn]) -> None:
        p, loop = self.playback, asyncio.get_running_loop()
        start = loop.time() - self.number / p.rate
        while p.total is None or self.number < p.total:
            await _unless_failed(session.window.acquire(), settling)
            buffer = await _unless_failed(session.free.get(), settling) if session.buffers else None
            await asyncio.sleep(start + self.number / p.rate - loop.time())
            late = 0 if p.every_frame else int((loop.time() - start) * p.rate) - self.number
            if late > 0 and (p.total is None or self.number + late < p.total):
                self.skipped += late
                self.number += late
            await self._send_frame(session, self.number, buffer)
            self.number += 1
        for _ in range(session.credits):  # wait for the frames that are still under way
            await _unless_failed(session.window.acquire(), settling)

    async def _send_frame(self, session: _Session, number: int, buffer: int | None) -> None:
        index = self._order.index(number, self.playback.recording.frame_count)
        frame = await asyncio.to_thread(session.playhead.frame, index)
        if not frame.there and not session.says_missing:  # a server that would never hear of this frame
            session.give_back(buffer)
            return
        for view in frame.views:
            if not view.there:
                if session.says_missing:
                    await session.peer.send(ViewData.without(number, view.camera.name, buffer, missing=True))
            elif session.buffers and buffer is not None:
                planes = session.buffers[buffer][view.camera.name]
                await session.peer.send(await asyncio.to_thread(self._write, view, number, buffer, planes))
            else:
                await session.peer.send_bytes(await asyncio.to_thread(self._message, view, number))

    def _message(self, view: View, number: int) -> bytes:
        p = self.playback
        return encode(encode_view(view, number, texture=p.texture, depth=p.depth))

    @staticmethod
    def _write(view: View, number: int, buffer: int, planes: Planes) -> ViewData:
        """Write a view into the server's memory; returns the message that announces it."""
        for plane in ("y", "cb", "cr"):
            np.copyto(getattr(planes.texture, plane), getattr(view.texture, plane))
        np.copyto(planes.codes, view.codes)
        camera = view.camera
        return ViewData(number, camera.name, camera.width, camera.height, None, None, camera.pose, buffer)

    async def _settle(self, session: _Session) -> NoReturn:
        while True:
            message = await session.peer.receive(FrameDone, BufferFree)
            if isinstance(message, BufferFree):
                session.free.put_nowait(message.number)
            elif isinstance(message, FrameDone):
                self.outcomes[message.outcome] += 1
                self.left_out.add({camera: Fault(*why.split(": ", 1)) for camera, why in message.left_out.items()})
                session.window.release()
                self.progress(self)


class _Session:
    """One connection: the frames that may be under way, the server's memory if it is shared, and the playhead.

    Only one thread at a time may use a playhead. Each connection has its own, because a thread may still be reading for
    a connection that was lost.
    """

    def __init__(
        self, peer: Peer, credits: int, buffers: list[dict[str, Planes]] | None, playhead: Playhead, says_missing: bool
    ) -> None:
        self.peer, self.credits, self.buffers, self.playhead = peer, credits, buffers, playhead
        self.says_missing = says_missing  # whether the server wants to know which views a frame lacks
        self.window = asyncio.Semaphore(credits)
        self.free: asyncio.Queue[int] = asyncio.Queue()

    def give_back(self, buffer: int | None) -> None:
        """A frame was not sent, so that its credit and its buffer can be used for the next one."""
        self.window.release()
        if buffer is not None:
            self.free.put_nowait(buffer)


def _open_buffers(memory: SharedMemory | None, cameras: tuple[Camera, ...]) -> list[dict[str, Planes]] | None:
    """The server's buffers; None if it does not offer them, or if this process cannot open them (another container)."""
    if memory is None:
        return None
    try:
        return [open_buffer(memory.process, file, memory.name, cameras) for file in memory.files]
    except OSError:
        return None


async def _unless_failed(waiting: Coroutine[Any, Any, T], task: asyncio.Task[NoReturn]) -> T:
    """Await `waiting`; raises the exception of `task`, which runs at the same time, if that fails first."""
    other = asyncio.ensure_future(waiting)
    try:
        await asyncio.wait((other, task), return_when=asyncio.FIRST_COMPLETED)
        if task.done():
            task.result()
        return other.result()
    finally:
        other.cancel()


def parse_sources(sequence: Recording, sources: str | None) -> tuple[str, ...]:
    """The views to send: those named in `sources`, comma-separated, or all; raises ValueError for an unknown name."""
    names = tuple(sources.split(",")) if sources else sequence.source_names
    for name in names:
        if name not in sequence.source_names:
            raise ValueError(f"--sources: {name!r}: expected names among {', '.join(sequence.source_names)}")
    return names


def command(
    sequence: Annotated[Path, typer.Argument(metavar="SEQ", help="The sequence's folder, or its JSON.")],
    url: Annotated[str, typer.Argument(help="The server, like http://127.0.0.1:8765.")],
    rate: Annotated[float | None, typer.Option(help="Frames a second (default: the sequence's).")] = None,
    loop: Annotated[bool, typer.Option("--loop", help="Play forwards and backwards until stopped.")] = False,
    frames: Annotated[
        int | None, typer.Option(min=1, help="Number of frames (default: all; without end with --loop).")
    ] = None,
    sources: Annotated[str | None, typer.Option(help="Source views, like v0,v3 (default: all).")] = None,
    moving: Moving = None,
    every_frame: Annotated[
        bool, typer.Option("--every-frame", help="Wait for the server instead of skipping frames.")
    ] = False,
    jpeg: Annotated[bool, typer.Option("--jpeg", help="Send textures as JPEG.")] = False,
    deflate: Annotated[bool, typer.Option("--deflate", help="Compress depth (without loss).")] = False,
    token: Annotated[str, typer.Option(envvar="FARSIDE_TOKEN", help="The server's token.")] = "",
    ca_file: Annotated[
        str,
        typer.Option(metavar="FILE", envvar="FARSIDE_CA_FILE", help="PEM file of another authority to trust (TLS)."),
    ] = "",
    patience: Annotated[float, typer.Option(help="Seconds to keep trying to connect.")] = 10.0,
) -> None:
    """Send a sequence to a live server, as a camera rig would."""
    opened = open_recording(sequence, pose_files(moving))
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
        token_of(url, token),
    )
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("frames"))
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(escape(opened.name), total=playback.total)
        replay = Replay(playback, lambda r: bar.update(task, completed=r.number), trust_file(ca_file))
        try:
            asyncio.run(persist(lambda: replay.run(url), patience, partial(console.print, markup=False)))
        except KeyboardInterrupt:
            console.print("stopped")
    print(_summary(replay))


def _summary(replay: Replay) -> str:
    outcomes, left_out = replay.outcomes, str(replay.left_out)
    return (
        f"{replay.number - replay.skipped} frames sent, {replay.skipped} skipped to keep the rate; "
        f"the server took {outcomes['updated']} and dropped {outcomes['dropped']}"
        + (f"; it left out views: {left_out}" if left_out else "")
    )
