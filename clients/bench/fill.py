"""`farside bench fill`: filled holes against ground truth."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from farside.engine.evaluation.background import inside_rig
from farside.engine.evaluation.filling import KINDS, compare_fills
from farside.engine.io.recording import Recording, open_recording
from farside.engine.settings import Settings
from rich.console import Console
from rich.table import Table

from .options import Background, Cameras, Every, Frames, Quality, SequenceFolder, Views

__all__ = ["chosen_cameras", "command", "show_fills"]


def command(
    folder: SequenceFolder,
    cameras: Cameras = None,
    frames: Frames = 16,
    every: Every = 5,
    quality: Quality = "best",
    views: Views = 2,
    background: Background = True,
) -> None:
    """Compare the kinds of filling with the truth, inside holes only."""
    show_fills(folder, cameras, frames, every, quality, views, background)


def show_fills(
    folder: Path, cameras: Sequence[str] | None, frames: int, every: int, quality: str, views: int, background: bool
) -> None:
    """Print a row for each camera: the quality of each kind of filling inside holes."""
    sequence = open_recording(folder)
    table = Table(title=f"{sequence.name}, quality {quality}, the {views} nearest views, inside holes only")
    for column in ("camera", "holes, %", *(f"{kind}, PSNR-Y / SSIM" for kind in KINDS)):
        table.add_column(column, justify="right")
    settings = Settings.preset(quality, background=background)
    for name in chosen_cameras(sequence, cameras):
        sampled = range(0, min(frames, sequence.frame_count), every)
        samples = list(compare_fills(sequence, [name], sampled, views, settings))
        if samples:
            groups = [[s for s in samples if s.kind == kind] for kind in KINDS]
            figures = [f"{np.mean([s.psnr_y for s in g]):.2f} / {np.mean([s.ssim for s in g]):.4f}" for g in groups]
            table.add_row(name, f"{100 * np.mean([s.share for s in samples]):.2f}", *figures)
    Console(width=120).print(table)


def chosen_cameras(sequence: Recording, cameras: Sequence[str] | None) -> Sequence[str]:
    """`cameras`, or all virtual cameras inside the rig if it is empty; raises ValueError if there is none."""
    names = cameras or inside_rig(sequence)
    if not names:
        raise ValueError(f"{sequence.name}: no virtual camera with ground truth stands inside the rig")
    return names
