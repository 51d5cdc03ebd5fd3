"""`farside bench --fill` and `--flicker`: holes against their truth, and pictures that should keep still."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from farside.engine.evaluation.background import inside_rig
from farside.engine.evaluation.filling import KINDS, compare_fills
from farside.engine.evaluation.flicker import watch_flicker
from farside.engine.io.recording import Recording, open_recording
from farside.engine.settings import Settings
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

__all__ = ["show_fills", "show_flicker"]


def show_fills(
    folder: Path, cameras: Sequence[str] | None, frames: int, every: int, quality: str, views: int, background: bool
) -> None:
    """Print a row a camera: how near to the truth each kind of filling comes inside holes."""
    sequence = open_recording(folder)
    table = Table(title=f"{sequence.name}, quality {quality}, the {views} nearest views, inside holes only")
    for column in ("camera", "holes, %", *(f"{kind}, PSNR-Y / SSIM" for kind in KINDS)):
        table.add_column(column, justify="right")
    settings = Settings.preset(quality, background=background)
    for name in _chosen(sequence, cameras):
        sampled = range(0, min(frames, sequence.frame_count), every)
        samples = list(compare_fills(sequence, [name], sampled, views, settings))
        if samples:
            groups = [[s for s in samples if s.kind == kind] for kind in KINDS]
            figures = [f"{np.mean([s.psnr_y for s in g]):.2f} / {np.mean([s.ssim for s in g]):.4f}" for g in groups]
            table.add_row(name, f"{100 * np.mean([s.share for s in samples]):.2f}", *figures)
    Console(width=120).print(table)


def show_flicker(
    folder: Path, cameras: Sequence[str] | None, frames: int, quality: str, views: int, background: bool
) -> None:
    """Print a row a camera: change from frame to frame of what keeps still in truth, of pictures and of holes."""
    sequence = open_recording(folder)
    settings = Settings.preset(quality, n_render=views, background=background)
    table = Table(title=f"{sequence.name}, quality {quality}, {views} views: change of what keeps still")
    columns = ("camera", "still, %", "rendered", "truth", "ratio", "holes, %", "rendered", "truth", "ratio")
    for column in columns:
        table.add_column(column, justify="right")
    names = _chosen(sequence, cameras)
    with Progress(console=Console(stderr=True)) as bar:
        for name in bar.track(names, description="watching"):
            found = watch_flicker(sequence, name, frames, settings)
            cells = [name]
            for part in (found.whole, found.holes):
                cells += f"{100 * part.share:.2f}", f"{part.rendered:.3f}", f"{part.truth:.3f}", f"{part.ratio:.2f}"
            table.add_row(*cells)
    Console(width=120).print(table)


def _chosen(sequence: Recording, cameras: Sequence[str] | None) -> Sequence[str]:
    """The cameras asked for, or those inside the rig; ValueError where there is none."""
    names = cameras or inside_rig(sequence)
    if not names:
        raise ValueError(f"{sequence.name}: no virtual camera with ground truth stands inside the rig")
    return names
