"""`farside bench stages`: time, CPU time and work of each stage, on a sequence or a twin."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from farside.engine.evaluation.stages import PHASES, StageReport, StageRow, measure_stages
from farside.engine.evaluation.twin_recording import open_recording_or_twin
from farside.engine.settings import Settings
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Background, Frames, Quality, Report, Scale, Views

__all__ = ["command", "show_stages"]


def command(
    name: Annotated[str, typer.Argument(metavar="SEQ|NAME", help="A sequence's folder, or the name of a twin.")],
    scale: Scale = 0.25,
    frames: Frames = 8,
    quality: Quality = "best",
    views: Views = 5,
    background: Background = True,
    report: Report = None,
) -> None:
    """Measure time and work of every stage, on a sequence or a twin."""
    settings = Settings.preset(quality, n_render=views, background=background)
    show_stages(name, scale, frames, settings, report)


def show_stages(name: str, scale: float, frames: int, settings: Settings, folder: Path | None) -> None:
    """Print a table; with `folder`, write stages.json into it."""
    recording = open_recording_or_twin(name, scale)
    frames = min(frames, recording.frame_count)
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("playing (the first run compiles kernels)", total=frames + 1)
        report = measure_stages(recording, settings, frames, lambda: bar.advance(task))
    console = Console(width=140)
    width, height = report.size
    console.print(_table(report, f"{recording.name}: {frames} frames, a pair of {width}x{height} an eye"))
    console.print(f"compiling or loading kernels, in the first run alone: {report.compile_s:.1f} s")
    if folder:
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / "stages.json"
        path.write_text(json.dumps(report.as_dict(), indent=1) + "\n", "utf-8")
        console.print(f"figures: {path}")


def _table(report: StageReport, title: str) -> Table:
    table = Table(title=title)
    for column in ("", "stage", "times", "wall ms", "CPU ms", "share of CPU", "work"):
        table.add_column(column, justify="left" if column in ("", "stage") else "right")
    for phase in PHASES:
        for number, row in enumerate(row for row in report.rows if row.phase == phase):
            table.add_row(phase if number == 0 else "", *_cells(row), end_section=row.stage == "total")
    return table


def _cells(row: StageRow) -> tuple[str, ...]:
    work = ", ".join(f"{amount:,.0f} {unit}" for unit, amount in row.work.items())
    share = "" if row.stage == "ingest" else f"{100 * row.share:.1f} %"
    return row.stage, str(row.times), f"{row.wall_ms:.2f}", f"{row.cpu_ms:.2f}", share, work
