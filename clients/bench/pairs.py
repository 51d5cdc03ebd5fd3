"""`farside bench pairs`: stereo pairs a second while the model is updated, on a twin."""

from __future__ import annotations

from farside.engine.evaluation.pairs import measure_pairs
from farside.engine.synth import make_twin, twin_frame
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Quality, Scale, TwinName

__all__ = ["command", "show_pairs"]


def command(name: TwinName, scale: Scale = 0.25, quality: Quality = "best") -> None:
    """Measure stereo pairs a second of a twin while the model is updated at different rates."""
    show_pairs(name, scale, quality)


def show_pairs(name: str, scale: float, quality: str) -> None:
    """Print a row for each rate of updates."""
    twin = make_twin(name, scale)
    with Progress(console=Console(stderr=True)) as bar:
        frames = [twin_frame(twin, index) for index in bar.track(range(6), description="making frames")]
        table = Table(title=f"{name} at scale {scale:g}, quality {quality}, a pair of 640x720 an eye")
        for column in ("updates asked for a second", "updates", "pairs a second", "medians of a pair, ms, eyes' sum"):
            table.add_column(column, justify="right")
        for f_vin in bar.track((0.0, 0.5, 1.0, 2.0, 4.0), description="measuring"):
            rate = measure_pairs(frames, quality, f_vin, 10.0)
            stages = ", ".join(f"{stage} {value:.1f}" for stage, value in rate.stages.items())
            table.add_row(f"{f_vin:g}", f"{rate.updates:.1f}", f"{rate.pairs:.1f}", stages)
    Console(width=140).print(table)
