"""`farside demo`: a twin sequence, the server, a replay and the viewer's address, in one command."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shlex
import socket
from pathlib import Path
from typing import Annotated

import typer
import uvicorn
from farside.engine.io.recording import open_recording
from farside.server.app import make_server
from rich.console import Console
from rich.progress import Progress
from rich.text import Text

from .ending import unfinished
from .listening import addresses_of, listen
from .replay import Playback, Replay
from .serve import server_settings, stop_within, tell_variables
from .trust import trust_certificate

__all__ = ["command"]

_TARGET_FPS = 12.0  # a rate at which a head feels free, and that two cores hold


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
    cache: Annotated[
        Path | None, typer.Option(help="Folder in which twins are kept (default: the user's cache).")
    ] = None,
) -> None:
    """Show everything at once: a twin sequence, the server, a replay and the viewer's address."""
    console = Console()
    if target_fps is None and quality != "paper":
        target_fps = _TARGET_FPS
    tell_variables()
    settings = server_settings(port=port, quality=quality, target_fps=target_fps)
    stop_within(settings)
    with listen(settings) as listening:
        folder = _twin(cache or _cache(), scale, frames, console)
        sequence = open_recording(folder)
        playback = Playback(sequence, sequence.source_names, rate, loop=True, token=settings.token)
        replay = Replay(playback, tls=trust_certificate(settings.ssl_certfile) if settings.secure else None)
        own_address = addresses_of(listening, settings)[0]
        address = " and ".join(addresses_of(listening, settings, settings.token))
        text = ("watch at ", (address, "bold"), " (Ctrl-C stops); move with the mouse and W A S D Q E")
        console.print(Text.assemble(*text), soft_wrap=True, highlight=False)  # an address stays in one piece
        with contextlib.suppress(KeyboardInterrupt):
            asyncio.run(_play(make_server(settings), listening, own_address, replay, seconds))
        console.print("stopped")


def _cache() -> Path:
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "farside"


def _twin(cache: Path, scale: float, frames: int, console: Console) -> Path:
    """The folder of the museum twin, which is made on the first run; an interrupted run leaves no partial folder."""
    folder = cache / f"museum-{scale:g}-{frames}"
    if folder.is_dir():
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        _tell_place(f"the twin is in {folder}, {size / 1e9:.2g} GB", folder)
        return folder
    partial = folder.with_name(f"{folder.name}.{os.getpid()}")
    _tell_place(f"the twin will take {_twin_bytes(scale, frames) / 1e9:.3g} GB in {folder}", folder)
    with Progress(console=console) as bar:
        task = bar.add_task("making a twin of Museum (the first time compiles the ray tracer)", total=None)
        from farside.engine.synth import write_twin

        with unfinished(partial):
            write_twin(
                "museum", partial, scale, frames, progress=lambda n, m: bar.update(task, completed=n, total=m)
            )
            partial.rename(folder)
    return folder


def _twin_bytes(scale: float, frames: int) -> int:
    """Bytes of a museum twin, virtual cameras included: texture and depth, both 4:2:0 with two bytes a sample."""
    from farside.engine.synth import make_twin

    rig = make_twin("museum", scale).rig
    cameras = map(rig.camera, (*rig.source_names, *rig.target_names))
    return frames * sum(6 * camera.width * camera.height for camera in cameras)


def _tell_place(what: str, folder: Path) -> None:
    print(f"{what}; to remove it: rm -r -- {shlex.quote(str(folder))}", flush=True)


async def _play(
    server: uvicorn.Server, listening: list[socket.socket], url: str, replay: Replay, seconds: float | None
) -> None:
    """Serve and replay for `seconds`, or until either ends; then stop the replay before the server."""
    serving = asyncio.create_task(server.serve(sockets=listening))
    playing = asyncio.create_task(_replay(server, replay, url))
    try:
        await asyncio.wait((serving, playing), timeout=seconds, return_when=asyncio.FIRST_COMPLETED)
        if playing.done():
            playing.result()
    finally:
        playing.cancel()
        await asyncio.gather(playing, return_exceptions=True)
        server.should_exit = True
        await serving


async def _replay(server: uvicorn.Server, replay: Replay, url: str) -> None:
    while not server.started:
        await asyncio.sleep(0.02)
    await replay.run(url)
