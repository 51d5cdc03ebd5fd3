"""`farside bench compile`: the CPU time that compiling takes, by kernel; it can also renew the list of kernels."""

from __future__ import annotations

import json
from collections import defaultdict
from typing import Annotated

import typer
from farside.engine.compiling.listing import Recording, join, record
from farside.engine.compiling.needed import USES, write
from rich.console import Console
from rich.table import Table

from ..kernels import Uses
from .options import Report

__all__ = ["command"]

_MOST = 20  # kernels in the table


def command(
    uses: Uses = None,
    renew: Annotated[
        bool, typer.Option("--renew", help="Write the list of needed kernels anew, into the installation.")
    ] = False,
    report: Report = None,
) -> None:
    """Compile everything from nothing, in a folder of its own, and tell what took how long."""
    chosen = tuple(uses or USES)
    for use in chosen:
        if use not in USES:
            raise ValueError(f"--for: {use!r}: expected one of {', '.join(USES)}")
    if renew and set(chosen) != set(USES):
        raise ValueError("--renew: expected without --for: the list has all uses")
    console = Console()
    with Console(stderr=True).status("compiling for minutes") as status:
        found = record(chosen, lambda use: status.update(f"compiling for minutes; now for: {use}"))
    for use, recording in found.items():
        _show(use, recording, console)
    if renew:
        write(join(found))
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
        rows = {
            use: {"kernels": len(kernels), "cpu_s": sum(k.own_s for k in kernels)}
            for use, (kernels, _) in found.items()
        }
        (report / "compile.json").write_text(json.dumps(rows, indent=1) + "\n", "utf-8")


def _show(use: str, recording: Recording, console: Console) -> None:
    """A table of the kernels that took longest, over all types for which they were compiled."""
    kernels, _ = recording
    spent: dict[tuple[str, str], list[float]] = defaultdict(list)
    for kernel in kernels:
        spent[kernel.module, kernel.name].append(kernel.own_s)
    total = sum(kernel.own_s for kernel in kernels)
    table = Table(title=f"for {use}: {len(kernels)} kernels, {total:.1f} s of CPU time")
    for column in ("kernel", "times", "CPU s"):
        table.add_column(column, justify="left" if column == "kernel" else "right")
    for (module, name), seconds in sorted(spent.items(), key=lambda item: -sum(item[1]))[:_MOST]:
        table.add_row(f"{module}.{name}", str(len(seconds)), f"{sum(seconds):.2f}")
    console.print(table)
