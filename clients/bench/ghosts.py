"""`farside bench ghosts`: ghosts and holes of the background model over a twin."""

from __future__ import annotations

from pathlib import Path

from farside.engine.evaluation.ghosts import inside_cameras, plot_ghosts, watch_ghosts
from farside.engine.settings import Settings
from farside.engine.synth import make_twin
from rich.console import Console
from rich.table import Table

from .options import Frames, Quality, Report, Scale, TwinName

__all__ = ["command", "show_ghosts"]


def command(
    name: TwinName, scale: Scale = 0.25, frames: Frames = 100, quality: Quality = "best", report: Report = None
) -> None:
    """Measure ghosts and holes of the background model over the frames of a twin."""
    show_ghosts(name, scale, frames, quality, report)


def show_ghosts(name: str, scale: float, frames: int, quality: str, report: Path | None) -> None:
    """Print a row for each sampled frame; with `report`, a plot."""
    console = Console()
    twin = make_twin(name, scale)
    cameras = inside_cameras(twin)
    table = Table(title=f"{name} at scale {scale}, quality {quality}: % of the pixels of {len(cameras)} inside cameras")
    columns = ("ghosts", "standing", "holes_model", "holes_warped", "holes_backdrop")
    for column in ("frame", *columns):
        table.add_column(column.replace("_", " "), justify="right")
    samples = []
    every = max(1, frames // 20)
    for sample in watch_ghosts(twin, cameras, range(frames), every, Settings.preset(quality)):
        samples.append(sample)
        if sample.camera == cameras[-1].name:
            moment = [s for s in samples if s.frame == sample.frame]
            means = [100 * sum(getattr(s, column) for s in moment) / len(moment) for column in columns]
            table.add_row(str(sample.frame), *(f"{mean:.3f}" for mean in means))
            console.log(f"frame {sample.frame} of {frames}")
    console.print(table)
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
        path = report / f"ghosts_{name}.png"
        try:
            plot_ghosts(samples, f"{name}, scale {scale}, quality {quality}", path)
            console.print(f"plot: {path}")
        except ImportError as error:
            console.print(f"no plot: {error} (pip install farside[plots])")
