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

TwinName = Annotated[str, typer.Argument(metavar="NAME", help="A twin, made in memory.")]
SequenceFolder = Annotated[Path, typer.Argument(metavar="SEQ", help="A sequence's folder.")]
Folders = Annotated[
    list[Path] | None, typer.Argument(metavar="FOLDER", help="Sequences, or folders of them, with ground truth.")
]
Twins = Annotated[str | None, typer.Option(metavar="NAME,...", help="Twins to make, at --scale.")]
Scale = Annotated[float, typer.Option(help="Size of a twin's pictures; 1: as the paper's sequences.", min=0.001)]
Frames = Annotated[int, typer.Option(min=1, help="Frames played, at most.")]
Every = Annotated[int, typer.Option(min=1, help="Frames from one that is judged to the next.")]
Quality = Annotated[str, typer.Option(help="fast, balanced, best, or paper (as published).")]
Views = Annotated[int, typer.Option(min=1, help="Views given, or warped a picture.")]
Cameras = Annotated[list[str] | None, typer.Option("--camera", help="A virtual camera (default: those in the rig).")]
Background = Annotated[bool, typer.Option("--background/--no-background", help="The background model.")]
Report = Annotated[Path | None, typer.Option(metavar="DIR", help="Folder for figures, plots and pictures.")]
