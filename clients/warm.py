"""`farside warm`: compile kernels before they are needed, for images, installers and tests."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Annotated

import typer
from farside.engine.compiling.needed import USES, needed_for
from farside.engine.support.cpu_level import LEVELS
from farside.engine.support.kernel_folders import SHIPPED
from rich.console import Console

from .kernels import Uses, compile_shown

__all__ = ["command"]


def command(
    uses: Uses = None,
    into: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for the kernels (default: the user's cache); it can be moved."),
    ] = None,
    cpu: Annotated[
        str | None,
        typer.Option(metavar="LEVEL", help="Compile for all CPUs of a level, x86-64-v3 or -v4 (default: this CPU)."),
    ] = None,
    install: Annotated[
        bool, typer.Option("--install", help="Into the installation, for all its users; expects --cpu.")
    ] = False,
    workers: Annotated[int, typer.Option(min=0, help="Processes (default: as many as there are cores).")] = 0,
) -> None:
    """Compile the kernels now, on all cores, so that later starts take seconds. What is there already is kept."""
    if install:
        if cpu is None or into is not None:
            raise ValueError("--install: expected with --cpu and without --into")
        into = SHIPPED / cpu
    if cpu is not None:
        if cpu not in LEVELS:
            raise ValueError(f"cpu: {cpu!r}: expected {' or '.join(LEVELS)}")
        os.environ |= {"NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": ""}
    if into is not None:
        into.mkdir(parents=True, exist_ok=True)
        os.environ["NUMBA_CACHE_DIR"] = str(into.resolve())
    chosen, started = tuple(uses or USES), time.perf_counter()
    failed = compile_shown(chosen, workers=workers)
    total, took = len(needed_for(chosen)), time.perf_counter() - started
    Console(stderr=True).print(f"{total - failed} of {total} kernels are ready ({took:.0f} s)", highlight=False)
    if failed:
        raise typer.Exit(1)
