"""`farside synth`: write a twin of one of the known sequences."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from farside.engine.io.whole_sequence import NewSequence
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from .ending import unfinished

__all__ = ["command"]


def command(
    name: Annotated[
        str,
        typer.Argument(
            help="museum, hijack, painter, frog, gymnasium-a, gymnasium-b, doorway, street, lounge, museum-lamps or "
            "gymnasium-lamps"
        ),
    ],
    out: Annotated[Path, typer.Argument(help="New or empty folder to write; the sequence's JSON is named after it")],
    scale: Annotated[float, typer.Option(help="Size of the pictures; 1: the paper's size")] = 1.0,
    frames: Annotated[
        int | None, typer.Option(help="Number of frames (default 300; 250 for the gymnasium twins)")
    ] = None,
    seed: Annotated[
        int, typer.Option(help="Seed of the random choice of clothes, wall pictures and depth errors")
    ] = 0,
    depth_noise: Annotated[
        float | None,
        typer.Option(
            help="Strength of simulated depth-estimation errors (default 1 for painter and frog, 0 for the others)"
        ),
    ] = None,
    truth: Annotated[
        bool, typer.Option("--truth/--no-truth", help="With virtual cameras and their ground truth")
    ] = True,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace the sequence that OUT holds")] = False,
) -> None:
    """Make a twin of one of the known sequences, with ground truth in OUT/truth."""
    try:
        new = NewSequence(out, overwrite=overwrite)
    except FileExistsError as error:
        hint = "" if overwrite else " (--overwrite replaces a sequence)"
        raise ValueError(f"{error}{hint}") from error
    with new, unfinished(new.folder):
        sources, targets = _write(new, name, scale, frames, seed, depth_noise, truth)
        new.finish()
    print(f"{out}: {sources} source views, {targets} virtual cameras with ground truth")


def _write(
    new: NewSequence, name: str, scale: float, frames: int | None, seed: int, depth_noise: float | None, truth: bool
) -> tuple[int, int]:
    """Write a twin; returns the numbers of its source views and of its virtual cameras."""
    console = Console(stderr=True)
    with console.status("Loading the ray tracer (it is compiled on the first run: about half a minute)"):
        from farside.engine.synth import make_twin, twin_frame, write_twin

        twin = make_twin(name, scale, seed, depth_noise)
        tiny = make_twin(name, 0.01, seed, depth_noise)
        twin_frame(tiny, 0, tiny.source_names[:1])
    columns = (
        TextColumn(name),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("pictures"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(name)
        write_twin(
            name,
            new.folder,
            scale,
            frames,
            seed,
            depth_noise,
            progress=lambda done, total: bar.update(task, completed=done, total=total),
            json_name=new.path.name,
            truth=truth,
        )
    return len(twin.source_names), len(twin.rig.target_names) if truth else 0
