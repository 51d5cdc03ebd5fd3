"""`farside bench flicker`: how much pictures of a still head change where the scene does not."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from farside.engine.evaluation.flicker import watch_flicker
from farside.engine.io.recording import open_recording
from farside.engine.settings import Settings
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .fill import chosen_cameras
from .options import Background, Cameras, Frames, Quality, SequenceFolder, Views

__all__ = ["command", "show_flicker"]


def command(
    folder: SequenceFolder,
    cameras: Cameras = None,
    frames: Frames = 60,
    quality: Quality = "best",
    views: Views = 5,
    background: Background = True,
) -> None:
    """Measure how much pictures of a still head change from frame to frame where the truth does not."""
    show_flicker(folder, cameras, frames, quality, views, background)


def show_flicker(
    folder: Path, cameras: Sequence[str] | None, frames: int, quality: str, views: int, background: bool
) -> None:
    """Print a row for each camera: change between frames where the truth is still, in whole pictures and in holes."""
    sequence = open_recording(folder)
    settings = Settings.preset(quality, n_render=views, background=background)
    table = Table(title=f"{sequence.name}, quality {quality}, {views} views: change of what keeps still")
    columns = ("camera", "still, %", "rendered", "truth", "ratio", "holes, %", "rendered", "truth", "ratio")
    for column in columns:
        table.add_column(column, justify="right")
    names = chosen_cameras(sequence, cameras)
    with Progress(console=Console(stderr=True)) as bar:
        for name in bar.track(names, description="watching"):
            found = watch_flicker(sequence, name, frames, settings)
            cells = [name]
            for part in (found.whole, found.holes):
                cells += f"{100 * part.share:.2f}", f"{part.rendered:.3f}", f"{part.truth:.3f}", f"{part.ratio:.2f}"
            table.add_row(*cells)
    Console(width=120).print(table)
