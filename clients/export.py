"""`farside export`: write the background model of a live server, or of a sequence, as a mesh."""

from __future__ import annotations

import json
import urllib.error
import urllib.request
from pathlib import Path
from typing import Annotated
from urllib.parse import quote

import typer
from farside.engine.io.recording import open_recording
from farside.engine.settings import Settings
from rich.console import Console
from rich.progress import Progress

from .connection import base_url
from .replay import parse_sources

__all__ = ["command"]

FORMATS = ("glb", "ply")


def command(
    where: Annotated[
        str, typer.Argument(metavar="URL|SEQ", help="A server's address or a sequence's folder.")
    ],
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="The file to write, .glb or .ply.")],
    frames: Annotated[int | None, typer.Option(min=1, help="Sequences only: number of frames (default: all).")] = None,
    sources: Annotated[
        str | None, typer.Option(help="Sequences only: source views, like v0,v3 (default: all).")
    ] = None,
    quality: Annotated[str, typer.Option(help="Sequences only: fast, balanced, best or paper.")] = "balanced",
    token: Annotated[str, typer.Option(envvar="FARSIDE_TOKEN", help="The server's token.")] = "",
) -> None:
    """Write the background model of a live server, or of a sequence, as a mesh."""
    if mesh.suffix[1:] not in FORMATS:
        raise ValueError(f"mesh: {mesh.name}: expected a name that ends in .glb or .ply")
    if "://" in where:
        data = _of_server(where, mesh.suffix[1:], token)
    else:
        data = _of_sequence(Path(where), mesh.suffix[1:], frames, sources, Settings.preset(quality))
    mesh.write_bytes(data)
    print(f"{mesh}: {len(data)} bytes")


def _of_server(url: str, suffix: str, token: str) -> bytes:
    address = f"{base_url(url, 'http')}/mesh.{suffix}?token={quote(token)}"
    try:
        with urllib.request.urlopen(address, timeout=120) as answer:
            data: bytes = answer.read()
            return data
    except urllib.error.HTTPError as error:
        with error:
            raise ValueError(
                f"refused by the server: {_detail(error.read())} (status {error.code})"
            ) from error
    except urllib.error.URLError as error:
        raise ConnectionError(f"no server at {url}: {error.reason}") from error


def _detail(body: bytes) -> str:
    try:
        return str(json.loads(body)["detail"])
    except (ValueError, KeyError, TypeError):
        return body[:200].decode(errors="replace")


def _of_sequence(
    path: Path, suffix: str, frames: int | None, sources: str | None, settings: Settings
) -> bytes:
    sequence = open_recording(path)
    names = parse_sources(sequence, sources)
    count = min(frames or sequence.frame_count, sequence.frame_count)
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("loading the engine", total=count)
        from farside.engine.io.mesh_files import to_glb, to_ply
        from farside.engine.pipeline.engine import Engine  # imported late: compiled kernels take a moment to load

        engine = Engine([sequence.camera(name) for name in names], settings, f_vin=sequence.fps)
        for index, frame in enumerate(sequence.frames(0, count, names)):
            engine.update(frame)
            bar.update(task, completed=index + 1, description="building the model")
        return {"glb": to_glb, "ply": to_ply}[suffix](engine.mesh())
