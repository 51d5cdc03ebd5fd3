"""`farside bench spared`: work and memory that scenes do not need and that is therefore saved."""

from __future__ import annotations

from typing import Annotated

import typer
from farside.engine.evaluation.spared import spared_rows
from farside.engine.synth import check_twin
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Frames, Scale

__all__ = ["command", "show_spared"]


def command(
    names: Annotated[str, typer.Argument(metavar="NAME,...", help="Names of twins, which are made in memory.")],
    scale: Scale = 0.25,
    frames: Frames = 30,
) -> None:
    """Measure work and memory that scenes do not need and that is therefore saved, on twins."""
    show_spared(names.split(","), scale, frames)


def show_spared(names: list[str], scale: float, frames: int) -> None:
    """Print a row for each kind of work or memory in each twin; raises ValueError for an unknown name."""
    for name in names:
        check_twin(name)
    title = f"Twins at scale {scale:g}, {frames} frames, balanced, one head amid the cameras; CPU of one thread"
    table = Table(title=title)
    for column in ("scene", "what", "all", "left", "saved"):
        table.add_column(column, justify="left" if column in ("scene", "what") else "right")
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("playing frames (the first run compiles kernels)", total=2 * frames * len(names))
        for row in spared_rows(names, scale, frames, lambda: bar.advance(task)):
            values = (f"{value:,.4g} {row.unit}" if row.unit else f"{value:,.0f}" for value in (row.all, row.left))
            table.add_row(row.scene, row.what, *values, f"{100 * row.saved:.0f} %")
    Console(width=140).print(table)
