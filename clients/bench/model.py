"""`farside bench model`: the gain by the background model on a sequence."""

from __future__ import annotations

from pathlib import Path

from farside.engine.evaluation.background import compare_model, hole_picture, inside_rig, summarise
from farside.engine.io.recording import open_recording
from PIL import Image
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Cameras, Every, Frames, Quality, Report, SequenceFolder, Views

__all__ = ["command", "show_model"]


def command(
    folder: SequenceFolder,
    cameras: Cameras = None,
    frames: Frames = 100,
    every: Every = 12,
    quality: Quality = "best",
    views: Views = 5,
    report: Report = None,
) -> None:
    """Compare few views with the model, few views without it and all views without it, by ground truth."""
    show_model(folder, cameras, frames, every, quality, views, report)


def show_model(
    folder: Path, chosen: list[str] | None, frames: int, every: int, quality: str, views: int, report: Path | None
) -> None:
    """Print a row for each camera; with `report`, write a picture of the holes without and with the model."""
    sequence = open_recording(folder)
    cameras, count = chosen or inside_rig(sequence), min(frames, sequence.frame_count)
    if not cameras:
        raise ValueError(f"{folder}: no virtual camera with ground truth stands inside the rig")
    samples = []
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("comparing", total=len(cameras) * 3 * -(-count // every))
        for sample in compare_model(sequence, cameras, count, every, quality, views):
            samples.append(sample)
            bar.advance(task)
    # Medians count from the third second on, or over the later half of a shorter run.
    settled = min(int(2 * sequence.fps), count // 2)
    table = Table(title=f"{sequence.name}, quality {quality}: {views} views with the model, {views} and all without")
    columns = ("camera", "with, IV-PSNR", "without", "all views", "worst loss", "holes without", "holes with", "all")
    for column in columns:
        table.add_column(column, justify="right")
    for row in summarise(samples, settled):
        figures = (f"{row[mode]:.2f}" for mode in ("model", "few", "all"))
        holes = (f"{100 * float(row[key]):.3f} %" for key in ("holes_warped", "holes_backdrop", "holes_all"))
        table.add_row(str(row["camera"]), *figures, f"{row['worst_loss']:.2f}", *holes)
    Console(width=120).print(table)
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
        worst = max(samples, key=lambda sample: sample.holes_warped * (sample.mode == "model"))
        picture = hole_picture(sequence, worst.camera, worst.frame, quality, views)
        Image.fromarray(picture).save(report / "holes.png")
