"""Arguments and options that several measures share, as typer reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = [
    "Background",
    "Cameras",
    "Every",
    "Folders",
    "Frames",
    "Quality",
    "Report",
    "Scale",
    "SequenceFolder",
    "TwinName",
    "Twins",
    "Views",
]

TwinName = Annotated[str, typer.Argument(metavar="NAME", help="Name of a twin, which is made in memory.")]
SequenceFolder = Annotated[Path, typer.Argument(metavar="SEQ", help="A sequence's folder.")]
Folders = Annotated[
    list[Path] | None,
    typer.Argument(metavar="FOLDER", help="Sequences with ground truth, or folders of such sequences."),
]
Twins = Annotated[str | None, typer.Option(metavar="NAME,...", help="Twins to make in memory, at --scale.")]
Scale = Annotated[float, typer.Option(help="Size of a twin's pictures; 1: the paper's size.", min=0.001)]
Frames = Annotated[int, typer.Option(min=1, help="Most frames played.")]
Every = Annotated[int, typer.Option(metavar="N", min=1, help="Every N-th frame is judged.")]
Quality = Annotated[str, typer.Option(help="fast, balanced, best, or paper (as published).")]
Views = Annotated[int, typer.Option(min=1, help="Number of views from which a picture is rendered.")]
Cameras = Annotated[list[str] | None, typer.Option("--camera", help="A virtual camera (default: all inside the rig).")]
Background = Annotated[
    bool, typer.Option("--background/--no-background", help="Build and render the background model.")
]
Report = Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for figures, plots and pictures.")]
