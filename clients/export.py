"""`farside export`: write the background model of a live server, of a sequence, or of a file, as a mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated
from urllib.parse import quote

import typer
from farside.engine.io.mesh_files import FORMATS, colours_of, to_file
from farside.engine.io.recording import open_recording
from farside.engine.io.saved_file import means_saved
from farside.engine.io.seed_file import check_seed
from farside.engine.rig.left_out import LeftOut
from farside.engine.settings import Settings
from rich.console import Console
from rich.progress import Progress

from .address import token_of
from .fetching import fetch
from .kernels import compile_shown
from .moving import Moving, pose_files
from .replay import parse_sources
from .trust import trust_file

__all__ = ["command"]


def command(
    where: Annotated[
        str,
        typer.Argument(metavar="URL|SEQ|MODEL", help="A server's address, a sequence's folder, or a saved model."),
    ],
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="The file to write, .glb or .ply.")],
    colours: Annotated[
        str | None,
        typer.Option(help="texture (only .glb, its default) or vertex: a smaller file with blurred colours."),
    ] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Sequences only: number of frames (default: all).")] = None,
    sources: Annotated[
        str | None, typer.Option(help="Sequences only: source views, like v0,v3 (default: all).")
    ] = None,
    moving: Moving = None,
    quality: Annotated[str, typer.Option(help="Sequences only: fast, balanced, best or paper.")] = "balanced",
    seed_model: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Sequences only: an earlier model to begin with (GLB, or saved)."),
    ] = None,
    token: Annotated[str, typer.Option(envvar="FARSIDE_TOKEN", help="The server's token.")] = "",
    ca_file: Annotated[
        str,
        typer.Option(metavar="FILE", envvar="FARSIDE_CA_FILE", help="PEM file of another authority to trust (TLS)."),
    ] = "",
) -> None:
    """Write the background model of a live server, of a sequence, or of a file of `serve --model`, as a mesh.

    Units are metres. GLB: y up, -z forward, colours not lit; PLY: x forward, y left, z up, colours of vertices in sRGB.
    """
    suffix = mesh.suffix[1:]
    if suffix not in FORMATS:
        raise ValueError(f"mesh: {mesh.name}: expected a name that ends in .glb or .ply")
    if not mesh.parent.is_dir():
        raise ValueError(f"mesh: {mesh}: expected a file in a folder that exists")
    colours = colours_of(suffix, colours)
    if "://" in where:
        data = _of_server(where, suffix, colours, token_of(where, token), ca_file)
    elif means_saved(Path(where)):
        data = _of_saved(Path(where), suffix, colours)
    else:
        data = _of_sequence(
            Path(where), suffix, colours, frames, sources, pose_files(moving), quality, seed_model
        )  # fmt: skip
    mesh.write_bytes(data)
    print(f"{mesh}: {len(data)} bytes")


def _of_server(url: str, suffix: str, colours: str, token: str, ca_file: str) -> bytes:
    path = f"mesh.{suffix}?colours={colours}&token={quote(token, safe='')}"
    with _progress() as bar:
        task = bar.add_task("waiting for the server to make the file", total=None)

        def show(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total, description="receiving")

        return fetch(url, path, timeout_s=120, tls=trust_file(ca_file), progress=show)


def _of_saved(path: Path, suffix: str, colours: str) -> bytes:
    from farside.engine.background.model import BackgroundModel  # imported late: they load the compiler
    from farside.engine.background.saved_model import SavedModel

    model = BackgroundModel.from_state(SavedModel.read(path).model)
    return to_file(model.textured_mesh() if colours == "texture" else model.mesh(), suffix)


def _of_sequence(
    path: Path, suffix: str, colours: str, frames: int | None, sources: str | None, moving: dict[str, Path],
    quality: str, seed_model: Path | None,
) -> bytes:  # fmt: skip
    settings = Settings.preset(quality)
    sequence = open_recording(path, moving)
    names = parse_sources(sequence, sources)
    if seed_model is not None:
        check_seed(seed_model)
    compile_shown([quality, *(["seed"] if seed_model else [])])
    count = min(frames or sequence.frame_count, sequence.frame_count)
    with _progress() as bar:
        task = bar.add_task("loading the engine", total=count)
        from farside.engine.background.seed_files import read_seed  # imported late: it takes a moment to load kernels
        from farside.engine.pipeline.engine import Engine

        seed, left_out = None if seed_model is None else read_seed(seed_model), LeftOut()
        engine = Engine([sequence.camera(name) for name in names], settings, f_vin=sequence.fps, seed=seed)
        for index, frame in enumerate(sequence.frames(0, count, names)):
            left_out.add(engine.update(frame).left_out)
            bar.update(task, completed=index + 1, description="building the model")
        if told := str(left_out):
            bar.console.print(f"views left out of frames: {told}", markup=False)
        bar.add_task("making the file", total=None)
        return engine.export(suffix, colours)


def _progress() -> Progress:
    return Progress(console=Console(stderr=True))
