"""`farside bench accuracy`: every quality figure, over sequences and twins."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer
from farside.engine.evaluation.accuracy import Plan, Sample, judge_pictures, picture_count
from farside.engine.evaluation.twin_recording import TwinRecording, default_targets, find_recordings
from farside.engine.io.recording import Recording
from farside.engine.synth import make_twin
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .accuracy_report import AccuracyReport, summary_table
from .options import Cameras, Folders, Report, Scale, Twins

__all__ = ["command", "make_plan", "show_accuracy"]


def command(
    folders: Folders = None,
    twins: Twins = None,
    scale: Scale = 0.25,
    cameras: Cameras = None,
    views: Annotated[
        str | None, typer.Option(metavar="N,...|all", help="Numbers of nearest views to render from, like 2,3,5,all.")
    ] = None,
    background: Annotated[
        bool | None,
        typer.Option("--background/--no-background", help="With or without the background model (default: both)."),
    ] = None,
    quality: Annotated[str, typer.Option(help="fast, balanced, best or paper; several separated by commas.")] = "best",
    frames: Annotated[int | None, typer.Option(min=1, help="Most frames played (default 16).")] = None,
    every: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Every N-th frame is judged (default 15).")
    ] = None,
    report: Report = None,
) -> None:
    """All quality figures over sequences and twins, with a report."""
    plan = make_plan(views, background, quality, frames, every)
    show_accuracy(folders or [], twins, scale, cameras or [], plan, report)


def show_accuracy(
    folders: Sequence[Path], twins: str | None, scale: float, chosen: Sequence[str], plan: Plan, report: Path | None
) -> None:
    """Print a row for each sequence, quality, number of views and model on or off; with `report`, write a page."""
    recordings: list[Recording] = list(find_recordings(folders))
    recordings += [TwinRecording(make_twin(name, scale)) for name in (twins.split(",") if twins else ())]
    if not recordings:
        raise ValueError("bench --accuracy: nothing to render: expected folders of sequences or --twins NAME,...")
    work = [(recording, list(chosen) or default_targets(recording)) for recording in recordings]
    pages, samples = AccuracyReport(report) if report else None, list[Sample]()
    # After Ctrl-C the figures measured so far are still printed.
    with suppress(KeyboardInterrupt), Progress(console=Console(stderr=True)) as bar:
        for recording, targets in work:
            task = bar.add_task(recording.name, total=picture_count(recording, targets, plan))
            for judged in judge_pictures(recording, targets, plan):
                samples.append(judged.sample)
                if pages:
                    pages.add(judged)
                bar.advance(task)
    console = Console(width=180)
    console.print(_table(samples))
    if pages:
        console.print(f"report: {pages.finish('Accuracy: ' + ', '.join(recording.name for recording in recordings))}")


def make_plan(views: str | None, background: bool | None, quality: str, frames: int | None, every: int | None) -> Plan:
    """The plan for options of the command line; None leaves the plan's default. ValueError for unreadable `views`."""
    parts = views.split(",") if views else []
    if not all(part == "all" or (part.isdecimal() and int(part)) for part in parts):
        raise ValueError(f"--views: {views!r}: expected numbers of at least 1, or all, as in 2,5,all")
    given = {
        "views": tuple(0 if part == "all" else int(part) for part in parts) or None,
        "model": None if background is None else (background,),
        "frames": frames,
        "every": every,
    }
    changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    return Plan(qualities=tuple(quality.split(",")), **changes)


def _table(samples: Sequence[Sample]) -> Table:
    titles, rows = summary_table(samples)
    table = Table(title="Means over cameras and frames; PSNR in dB")
    for title in titles:
        table.add_column(title, justify="right")
    for row in rows:
        table.add_row(*row)
    return table
