"""`--moving NAME=TRACE.csv`: where a camera of a recording is in each frame."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

__all__ = ["Moving", "pose_files"]

Moving = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME=TRACE.csv", help="A camera that moves: its poses in the world, a row for each frame."
    ),
]


def pose_files(given: Sequence[str] | None) -> dict[str, Path]:
    """The pose files that `--moving` names, by camera; raises ValueError for anything else than NAME=TRACE.csv."""
    files: dict[str, Path] = {}
    for text in given or ():
        name, equals, file = text.partition("=")
        if not (name and equals and file):
            raise ValueError(f"--moving: {text!r}: expected NAME=TRACE.csv")
        if name in files:
            raise ValueError(f"--moving: {text!r}: expected one file for camera {name}, there is {files[name]}")
        files[name] = Path(file)
    return files
