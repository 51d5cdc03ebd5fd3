"""`farside bench saving`: pictures and updates while the model is being saved, on a twin."""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path
from typing import Annotated

import typer
from farside.engine.evaluation.saving import SavingRun, measure_saving
from farside.engine.settings import Settings
from farside.engine.synth import FPS, make_twin, twin_frame
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Frames, Quality, Scale, TwinName

__all__ = ["command"]


def command(
    name: TwinName,
    scale: Scale = 0.25,
    frames: Frames = 12,
    quality: Quality = "balanced",
    seconds: Annotated[float, typer.Option(min=1.0, help="Time for which pictures are rendered.")] = 60.0,
    save_interval_s: Annotated[float, typer.Option(min=0.1, help="Time between two savings of the model, s.")] = 3.0,
) -> None:
    """Measure how much longer pictures and updates of a twin take while the model is copied and written to a file."""
    twin = make_twin(name, scale)
    with Progress(console=Console(stderr=True)) as bar, tempfile.TemporaryDirectory() as folder:
        video = [twin_frame(twin, k) for k in bar.track(range(max(frames, 2)), description="making frames")]
        task = bar.add_task("measuring", total=1.0)
        run = measure_saving(
            video, Settings.preset(quality), FPS, Path(folder) / "room.farside", save_interval_s, seconds,
            lambda share: bar.update(task, completed=share),
        )  # fmt: skip
    console = Console(width=120)
    console.print(_table(run, f"{name} at scale {scale:g}, quality {quality}, a pair of 640x720 an eye"))
    console.print(_told(run))


def _table(run: SavingRun, title: str) -> Table:
    table = Table(title=title)
    for column in ("", "the model is", "number", "median, ms", "p95", "longest"):
        table.add_column(column, justify="left" if column in ("", "the model is") else "right")
    for row in run.delays():
        times = (f"{value:.1f}" for value in (row.median_ms, row.p95_ms, row.longest_ms))
        table.add_row(row.what, row.when, str(row.number), *times)
    return table


def _told(run: SavingRun) -> str:
    """How long a saving takes, and the longest delay of a picture next to a usual picture."""
    parts = []
    for what, name in (("copied", "copies"), ("written", "writings")):
        took = run.took_ms(what)
        times = f"median {statistics.median(took):.0f} ms, longest {max(took):.0f} ms" if took else ""
        parts.append(f"{len(took)} {name}: {times}")
    usual, *others = (row for row in run.delays() if row.what == "picture")
    late = max((row.longest_ms for row in others if row.number), default=usual.median_ms) - usual.median_ms
    return (
        f"{run.size / 1e6:.1f} MB; {'; '.join(parts)}; the longest wait for a picture meanwhile: {late:.0f} ms "
        f"more than a usual picture of {usual.median_ms:.0f} ms"
    )


