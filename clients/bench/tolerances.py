"""`farside bench tolerances`: tolerances that follow from a scene, next to smaller and larger ones."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from farside.engine.evaluation.tolerances import FRAMES, SCENES, Row, summarise, sweep
from farside.engine.settings import Settings
from farside.engine.synth import make_twin
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Quality, Report, Scale, Twins

__all__ = ["command", "show_tolerances"]

_UNITS = {"m": "m", "disparity": "1/m", "px": "px"}


def command(
    twins: Twins = None, scale: Scale = 0.07, quality: Quality = "best", report: Report = None
) -> None:
    """Compare automatic tolerances with smaller and larger ones, on twins."""
    show_tolerances(twins, scale, quality, report)


def show_tolerances(twins: str | None, scale: float, quality: str, report: Path | None) -> None:
    """Print the sweeps and a summary; with `report`, also write tolerances.csv there."""
    rows = {}
    for name in SCENES if twins is None else twins.split(","):
        twin = make_twin(name, scale)
        with Progress(console=Console(stderr=True)) as bar:
            task = bar.add_task(name, total=len(FRAMES))
            rows[name] = sweep(twin, Settings.preset(quality), FRAMES, partial(bar.advance, task))
        Console(width=140).print(_sweeps(rows[name], f"{name} at scale {scale:g}, quality {quality}"))
    Console(width=140).print(_summary(rows))
    if report is not None:
        _write(report, rows)


def _sweeps(rows: Sequence[Row], title: str) -> Table:
    table = Table(title=f"{title}: times the automatic value (1)")
    for column in ("tolerance", "times", "value", "IV-PSNR", "once hidden", "holes", "ghosts"):
        table.add_column(column, justify="left" if column == "tolerance" else "right")
    for row in rows:
        table.add_row(row.choice.name if row.label == "1" else "", row.label, _values(row.values), *_figures(row))
    return table


def _summary(rows: Mapping[str, Sequence[Row]]) -> Table:
    table = Table(title="automatic values next to the best; dB of what was hidden, of whole pictures for the last two")
    for column in ("scene", "tolerance", "value", "follows from", "best", "off by", "holes", "ghosts"):
        table.add_column(column, justify="right" if column in ("best", "off by") else "left")
    for name, own in rows.items():
        for row, best, off in summarise(own):
            pairs = zip(_figures(row), _figures(best), strict=True)
            moved = [mine if best is row else f"{mine} (best {other})" for mine, other in pairs]
            table.add_row(
                name, row.choice.name, _values(row.values), row.choice.follows, best.label, f"{off:.2f} dB", *moved[2:]
            )
    return table


def _values(values: Mapping[str, float]) -> str:
    return ", ".join(f"{value:.3g} {_UNITS[name.split('_')[-1]]}" for name, value in values.items())


def _figures(row: Row) -> list[str]:
    o = row.outcome
    return [f"{o.iv_psnr:.2f}", f"{o.hidden:.2f}", f"{100 * o.holes:.2f} %", f"{100 * o.ghosts:.3f} %"]


def _write(report: Path, rows: Mapping[str, Sequence[Row]]) -> None:
    report.mkdir(parents=True, exist_ok=True)
    with (report / "tolerances.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(("scene", "tolerance", "times", "value", "iv_psnr", "hidden_psnr", "holes", "ghosts"))
        for name, own in rows.items():
            for row in own:
                o = row.outcome
                writer.writerow((name, row.choice.name, row.label, _values(row.values), *(
                    f"{value:.6g}" for value in (o.iv_psnr, o.hidden, o.holes, o.ghosts)
                )))  # fmt: skip
