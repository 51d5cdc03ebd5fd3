"""`farside bench trade`: cost and benefit of each setting, and the choices that no other choice beats."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from farside.engine.evaluation.trade import Plan, Row, step_count, sweep
from farside.engine.evaluation.trade_points import Point, summarise
from farside.engine.evaluation.trade_variants import variants
from farside.engine.evaluation.twin_recording import TwinRecording, find_recordings
from farside.engine.io.recording import Recording
from farside.engine.synth import make_twin
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Every, Folders, Frames, Report, Scale, Twins
from .trade_report import TITLES, fronts, point_table, write_report

__all__ = ["command", "show_trade"]

_TWINS = "museum,painter"  # clean depth and noisy depth


def command(
    folders: Folders = None,
    twins: Twins = None,
    scale: Scale = 0.25,
    frames: Frames = 12,
    every: Every = 4,
    report: Report = None,
) -> None:
    """Measure cost and benefit of every setting over sequences and twins (default: museum and painter)."""
    show_trade(folders or [], twins, scale, Plan(frames, every), report)


def show_trade(folders: Sequence[Path], twins: str | None, scale: float, plan: Plan, report: Path | None) -> None:
    """Print all points and the Pareto fronts; with `report`, write them, a plot and a summary into that folder."""
    recordings: list[Recording] = list(find_recordings(folders))
    names = twins if twins is not None else "" if recordings else _TWINS
    recordings += [TwinRecording(make_twin(name, scale)) for name in names.split(",") if name]
    swept, rows = variants(), list[Row]()
    # After Ctrl-C the figures measured so far are still printed.
    with suppress(KeyboardInterrupt), Progress(console=Console(stderr=True)) as bar:
        for recording in recordings:
            task = bar.add_task(f"{recording.name}, {len(swept)} variants", total=step_count(plan, recording))
            rows += sweep(recording, swept, plan, lambda task=task: bar.advance(task))  # type: ignore[misc]
    points = summarise(rows, swept)
    console = Console(width=140)
    console.print(_table(points, "all points"))
    by_time, by_bytes = fronts(points)
    console.print(_table(by_time, "the front, time against IV-PSNR"))
    console.print(_table(by_bytes, "the front, bytes against IV-PSNR as it arrives"))
    if report:
        console.print(f"report: {write_report(report, rows, points)}")


def _table(points: Sequence[Point], title: str) -> Table:
    table = Table(title=title)
    for number, column in enumerate(TITLES):
        table.add_column(column, justify="left" if number < 2 else "right")
    for row in point_table(points):
        table.add_row(*row)
    return table
