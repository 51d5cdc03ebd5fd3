"""`farside bench extremes`: errors against exact oracles for numbers at their extremes."""

from __future__ import annotations

import csv
from pathlib import Path

import typer
from farside.engine.evaluation.extremes import Row, all_cases, run
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Report

__all__ = ["command", "show_extremes"]


def command(report: Report = None) -> None:
    """Measure errors against exact oracles at the extremes of every number; the exit code is 1 if any case fails."""
    show_extremes(report)


def show_extremes(report: Path | None) -> None:
    """Print a row for each case; with `report`, also write extremes.csv there. Exits with 1 if a case fails."""
    cases = all_cases()
    with Progress(console=Console(stderr=True)) as bar:
        rows = [run(case) for case in bar.track(cases, description="measuring")]
    table = Table(title="numerical stability at the extremes: largest error against the oracle, by its bound")
    for column in ("case", "value", "error", "bound", "unit", "verdict"):
        table.add_column(column, justify="right" if column in ("error", "bound") else "left")
    for row in rows:
        table.add_row(*_cells(row))
    Console(width=140).print(table)
    counts = [f"{sum(row.verdict == verdict for row in rows)} {verdict}" for verdict in ("holds", "limit", "fails")]
    print(f"{len(rows)} cases: {', '.join(counts)}")
    if report is not None:
        _write(report, rows)
    if any(row.verdict == "fails" for row in rows):
        raise typer.Exit(1)


def _cells(row: Row) -> list[str]:
    found = ["", "", row.said]
    if row.measured is not None:
        found = [f"{row.measured.error:.3g}", f"{row.measured.bound:.3g}", row.measured.unit]
    return [row.case.group, row.case.value, *found, row.verdict]


def _write(report: Path, rows: list[Row]) -> None:
    report.mkdir(parents=True, exist_ok=True)
    with (report / "extremes.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("case", "value", "error", "bound", "unit or what was said", "verdict"))
        writer.writerows(_cells(row) for row in rows)
