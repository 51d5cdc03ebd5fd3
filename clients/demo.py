"""`farside demo`: a twin sequence, the server, a replay and the viewer's address, in one command."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import shlex
import socket
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Annotated

import typer
from farside.engine.compiling.pool import Compiling
from farside.engine.io.recording import Recording, open_recording
from farside.engine.live import left_out
from farside.engine.support.kernel_folders import user_cache
from farside.server.app import make_server
from farside.server.settings import ServerSettings
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.text import Text

from .demo_twin import FIRST_VIEWS, DemoTwin
from .listening import addresses_of, listen
from .replay import Playback, Replay
from .serve import server_settings, stop_within, tell_variables
from .trust import trust_certificate

__all__ = ["command"]

_TARGET_FPS = 12.0  # a rate at which a head feels free, and that two cores hold
_PATIENCE_S = 15.0  # for which the rest of the twin waits at most for an engine that takes no frame


def command(
    scale: Annotated[float, typer.Option(help="Size of the twin's pictures; 1: the paper's size.")] = 0.25,
    frames: Annotated[int, typer.Option(min=1, help="Frames of the twin, played forwards and backwards.")] = 60,
    rate: Annotated[float, typer.Option(help="Frames a second.")] = 10.0,
    port: Annotated[int, typer.Option(help="Port (0: any free one).")] = 8765,
    seconds: Annotated[float | None, typer.Option(help="Stop after this time (default: run until Ctrl-C).")] = None,
    quality: Annotated[str, typer.Option(help="fast, balanced, best, or paper (as published).")] = "balanced",
    target_fps: Annotated[
        float | None,
        typer.Option(
            help="Stereo pairs a second to hold (default 12; none with `paper`): quality follows the load, --quality "
            "is the upper limit."
        ),
    ] = None,
    model: Annotated[
        str | None, typer.Option(metavar="FILE", help="Save the background model to this file, and continue it.")
    ] = None,
    seed_model: Annotated[
        str | None, typer.Option(metavar="FILE", help="An earlier model that a new one begins with: GLB, or saved.")
    ] = None,
    cache: Annotated[
        Path | None, typer.Option(help="Folder in which twins are kept (default: the user's cache).")
    ] = None,
) -> None:
    """Show everything at once: a twin sequence, the server, a replay and the viewer's address."""
    console = Console()
    if target_fps is None and quality != "paper":
        target_fps = _TARGET_FPS
    tell_variables()
    settings = server_settings(
        port=port, quality=quality, target_fps=target_fps, model=model, seed_model=seed_model
    )
    stop_within(settings)
    with listen(settings) as listening:
        address = " and ".join(addresses_of(listening, settings, settings.token))
        text = ("watch at ", (address, "bold"), " (Ctrl-C stops); move with the mouse and W A S D Q E")
        console.print(Text.assemble(*text), soft_wrap=True, highlight=False)  # an address stays in one piece
        twin = _twin(cache or _own_cache(), scale, frames)
        show = _Show(settings, listening, twin, rate)
        with contextlib.suppress(KeyboardInterrupt), _unwarned() if isinstance(twin, DemoTwin) else nullcontext():
            asyncio.run(show.run(seconds, console))
        console.print("stopped")


def _own_cache() -> Path:
    try:
        return user_cache()
    except RuntimeError:
        raise ValueError("--cache: this user has no home folder: expected a folder for the twin") from None


def _twin(cache: Path, scale: float, frames: int) -> Recording | DemoTwin:
    """The museum twin: the one that is kept, or one that is still to be made."""
    folder = cache / f"museum-{scale:g}-{frames}"
    if folder.is_dir():
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        _tell_place(f"the twin is in {folder}, {size / 1e9:.2g} GB", folder)
        return open_recording(folder)
    _tell_place(f"the twin will take {_twin_bytes(scale, frames) / 1e9:.3g} GB in {folder}", folder)
    return DemoTwin(folder, scale, frames)


@contextmanager
def _unwarned() -> Iterator[None]:
    """While the block runs, nobody is warned of views that the first frame lacks: they are being made."""

    def is_of_later_frame(record: logging.LogRecord) -> bool:
        return not (isinstance(record.args, tuple) and record.args[1:2] == (0,))

    log = logging.getLogger(left_out.__name__)
    log.addFilter(is_of_later_frame)
    try:
        yield
    finally:
        log.removeFilter(is_of_later_frame)


def _twin_bytes(scale: float, frames: int) -> int:
    """Bytes of a museum twin: texture and depth, both 4:2:0 with two bytes a sample."""
    from farside.engine.synth import make_twin

    rig = make_twin("museum", scale).rig
    cameras = map(rig.camera, rig.source_names)
    return frames * sum(6 * camera.width * camera.height for camera in cameras)


def _tell_place(what: str, folder: Path) -> None:
    print(f"{what}; to remove it: rm -r -- {shlex.quote(str(folder))}", flush=True)


class _Show:
    """The server, and a replay to it as soon as there is a frame."""

    def __init__(
        self, settings: ServerSettings, listening: list[socket.socket], twin: Recording | DemoTwin, rate: float
    ) -> None:
        self._twin = twin if isinstance(twin, DemoTwin) else None  # one that is made meanwhile
        self._compiling = Compiling(("synth", *settings.needed) if self._twin else settings.needed)
        self._server = make_server(settings, compiling=self._compiling, preparing=self._preparing)
        self._settings, self._listening = settings, listening
        self._recording, self._rate = twin, rate
        self._waiting: asyncio.Task[None] | None = None  # a twin waits for the first picture
        self._shown = asyncio.Event()  # the engine has had a frame

    async def run(self, seconds: float | None, console: Console) -> None:
        """Serve and replay for `seconds`, or until either ends; then stop the replay before the server."""
        serving = asyncio.create_task(self._server.serve(sockets=self._listening))
        playing, showing = asyncio.create_task(self._replay()), asyncio.create_task(self._show_progress(console))
        try:
            tasks = serving, showing, playing
            await asyncio.wait(tasks, timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
            for task in (showing, playing):  # if the twin cannot be made, that is why it cannot be played
                if task.done() and not self._server.should_exit:  # a server that was asked to end closes connections
                    task.result()
        finally:
            for task in (playing, showing):
                task.cancel()
            await asyncio.gather(playing, showing, return_exceptions=True)
            self._server.should_exit = True
            await serving
            if self._twin:
                self._twin.stop()

    def _preparing(self) -> str:
        if self._twin is None or self._shown.is_set():
            return ""
        made = self._twin.first_views
        return f"making the sequence: {made} of {FIRST_VIEWS} views" if made < FIRST_VIEWS else ""

    async def _replay(self) -> None:
        if self._twin:
            await asyncio.to_thread(self._compiling.wait, ("synth",))
            self._twin.start()
            await self._twin.wait_for_cameras()  # the engine starts while the first views are made
            self._waiting = asyncio.create_task(self._make_way(self._twin))
        while not self._server.started:
            await asyncio.sleep(0.02)
        settings, recording = self._settings, self._recording
        playback = Playback(recording, recording.source_names, self._rate, loop=True, token=settings.token)
        tls = trust_certificate(settings.ssl_certfile) if settings.secure else None
        replay = Replay(playback, lambda replay: self._shown.set(), tls)
        await replay.run(addresses_of(self._listening, settings)[0])

    async def _make_way(self, twin: DemoTwin) -> None:
        """From its first views on, let the twin wait until the kernels for the first picture are there and the engine
        has had its first frame."""
        await twin.wait_for_first_views()
        twin.pause()
        try:
            await asyncio.to_thread(self._compiling.wait, self._settings.needed[:1])
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._shown.wait(), _PATIENCE_S)
        finally:
            twin.go_on()

    async def _show_progress(self, console: Console) -> None:
        """Kernels that are compiled and frames that are made. It does not end; raises OSError if there is no twin."""
        columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
        with Progress(*columns, console=console, transient=True) as bar:
            kernels = bar.add_task("compiling kernels", total=self._compiling.progress.total)
            made = bar.add_task("making a twin of Museum", total=self._twin.total) if self._twin else None
            while not bar.finished:
                bar.update(kernels, completed=self._compiling.progress.done)
                if self._twin and made is not None:
                    self._twin.check()
                    bar.update(made, completed=self._twin.done)
                await asyncio.sleep(0.5)  # looking for frames takes time that kernels need
        await asyncio.Event().wait()
