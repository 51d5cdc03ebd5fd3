"""`farside bench sparse`: pictures from depth with a sensor's holes, completed and not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from farside.engine.evaluation.background import inside_rig
from farside.engine.evaluation.sparse import MODES, SparseSample, compare_sparse, completion_cost, punched
from farside.engine.io.recording import open_recording
from rich.console import Console
from rich.table import Table

from .options import Cameras, Every, Frames, Quality, SequenceFolder, Views

__all__ = ["command", "show_sparse"]


def command(
    folder: SequenceFolder,
    cameras: Cameras = None,
    frames: Frames = 1,
    every: Every = 12,
    quality: Quality = "best",
    views: Views = 5,
) -> None:
    """Judge pictures from whole depth, from depth with a time-of-flight sensor's holes, and from that completed."""
    show_sparse(folder, cameras, frames, every, quality, views)


def show_sparse(folder: Path, cameras: list[str] | None, frames: int, every: int, quality: str, views: int) -> None:
    """Print a row for each virtual camera of a sequence: means over the judged frames."""
    sequence = open_recording(folder)
    names = cameras or inside_rig(sequence)
    indices = range(0, min(frames, sequence.frame_count), every)
    samples = list(compare_sparse(sequence, names, indices, quality, views))
    table = Table(title=f"{sequence.name}: PSNR-Y / IV-PSNR in dB at quality {quality}, depth punched")
    for column in ("camera", "whole depth", "with holes", "completed", "gained, IV-PSNR"):
        table.add_column(column, justify="right")
    for name in names:
        means = [_mean(samples, name, mode) for mode in MODES]
        gained = means[2][1] - means[1][1]
        table.add_row(name, *(f"{p:.2f} / {iv:.2f}" for p, iv in means), f"{gained:+.2f}")
    view = punched(sequence.frame(0, sequence.source_names[:1]).views[0], 1)
    lost = 100 * float(np.mean(view.codes == 0))
    cost = completion_cost(view)
    table.caption = f"{lost:.0f} % of the first view lost; completing it: {cost:.0f} ms CPU a megapixel"
    Console(width=110).print(table)


def _mean(samples: list[SparseSample], camera: str, mode: str) -> tuple[float, float]:
    own = [(s.psnr_y, s.iv_psnr) for s in samples if (s.camera, s.mode) == (camera, mode)]
    mean = np.mean(own, axis=0)
    return float(mean[0]), float(mean[1])
