"""Compiling the kernels that a command needs, with its progress on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer
from farside.engine.compiling.needed import USES
from farside.engine.compiling.pool import Compiling
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

__all__ = ["Uses", "compile_shown"]

Uses = Annotated[
    list[str] | None,
    typer.Option("--for", metavar="USE", help=f"One of {', '.join(USES)}; may be repeated (default: all)."),
]


def compile_shown(uses: Sequence[str], console: Console | None = None, workers: int = 0) -> int:
    """Compile what is missing for some uses (`needed.USES`), on all cores; returns how many kernels failed.

    It says nothing if nothing is missing.
    """
    console = console or Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, console=console, transient=True) as bar:
        compiling = Compiling(uses, workers, lambda progress: bar.update(task, completed=progress.done))
        task = bar.add_task("compiling kernels", total=compiling.progress.total, visible=False)
        try:
            compiling.start()
            bar.update(task, visible=not compiling.finished)
            compiling.wait()
        finally:
            compiling.stop()
    return compiling.progress.failed
