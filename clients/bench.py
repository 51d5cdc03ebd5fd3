"""`farside bench`: measurements that the README's figures come from, each in its own module of `benchmarks`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["command"]


def command(
    peers: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Sequences whose README has the figures of other renderers."),
    ] = None,
    ghosts: Annotated[
        str | None, typer.Option(metavar="NAME", help="Ghosts and holes of the background model over a twin.")
    ] = None,
    model: Annotated[
        Path | None,
        typer.Option(metavar="SEQ", help="Few views with the model against few and all without it, by truth."),
    ] = None,
    views: Annotated[int, typer.Option(help="What --model calls few views.", min=1)] = 5,
    camera: Annotated[
        list[str] | None, typer.Option(help="Virtual cameras of --model; without it those inside the rig.")
    ] = None,
    every: Annotated[int, typer.Option(help="Look at every so many frames (--model).", min=1)] = 12,
    pairs: Annotated[
        str | None, typer.Option(metavar="NAME", help="Stereo pairs a second of a twin while the model is updated.")
    ] = None,
    scale: Annotated[float, typer.Option(help="Size of the twin's pictures (--ghosts, --pairs).")] = 0.25,
    frames: Annotated[int, typer.Option(help="Frames to play, at most.", min=1)] = 100,
    report: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for plots.")] = None,
    quality: Annotated[str, typer.Option(help="fast, balanced or best.")] = "best",
    background: Annotated[bool, typer.Option("--background/--no-background", help="The model.")] = True,
) -> None:
    """Measure speed and quality."""
    if peers is None and ghosts is None and model is None and pairs is None:
        raise ValueError("bench: nothing to measure: expected --peers FOLDER, --model SEQ, --ghosts or --pairs NAME")
    if pairs is not None:
        from .benchmarks.pairs import show_pairs

        show_pairs(pairs, scale, quality)
    if peers is not None:
        from .benchmarks.peers import show_peers

        show_peers(peers, quality, background)
    if model is not None:
        from .benchmarks.model import show_model

        show_model(model, camera, frames, every, quality, views, report)
    if ghosts is not None:
        from .benchmarks.ghosts import show_ghosts

        show_ghosts(ghosts, scale, frames, quality, report)
