"""`farside bench paper`: the gain of a preset over the published algorithm."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from farside.engine.evaluation.paper import PAPER_TWINS, PaperRow, compare_with_paper
from farside.engine.evaluation.twin_recording import TwinRecording, default_targets, find_recordings
from farside.engine.io.recording import Recording
from farside.engine.synth import make_twin
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Cameras, Every, Folders, Frames, Quality, Report, Scale

__all__ = ["command", "show_paper"]


def command(
    folders: Folders = None,
    twins: Annotated[str | None, typer.Option(metavar="NAME,...", help="Twins (default: the paper's four).")] = None,
    scale: Scale = 0.25,
    frames: Frames = 21,
    every: Every = 5,
    quality: Quality = "balanced",
    cameras: Cameras = None,
    report: Report = None,
) -> None:
    """Compare a preset with the published algorithm: dB, holes, time, triangles and memory, on the paper's twins."""
    recordings: list[Recording] = list(find_recordings(folders or []))
    names = ",".join(PAPER_TWINS) if twins is None and not recordings else twins or ""
    recordings += [TwinRecording(make_twin(name, scale)) for name in names.split(",") if name]
    show_paper(recordings, cameras, frames, every, quality, report)


def show_paper(
    recordings: Sequence[Recording], cameras: Sequence[str] | None, frames: int, every: int, quality: str,
    report: Path | None,
) -> None:  # fmt: skip
    """Print a table for each recording as soon as it is measured; with `report`, write paper.csv there."""
    rows = list[PaperRow]()
    with Progress(console=Console(stderr=True)) as bar:
        for recording in recordings:
            targets = list(cameras or default_targets(recording))
            task = bar.add_task(f"{recording.name}, three ways", total=min(frames, recording.frame_count))
            found = compare_with_paper(recording, targets, frames, every, quality, lambda t=task: bar.advance(t))  # type: ignore[misc]
            Console(width=150).print(_table(found, f"{recording.name}, {frames} frames, means over those judged"))
            print(_gain(found, quality), flush=True)
            rows += found
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
        with (report / "paper.csv").open("w", newline="") as file:
            writer = csv.DictWriter(file, [each.name for each in dataclasses.fields(PaperRow)])
            writer.writeheader()
            writer.writerows(map(dataclasses.asdict, rows))


def _table(rows: Sequence[PaperRow], title: str) -> Table:
    table = Table(title=title)
    columns = (
        "camera", "", "PSNR-Y", "IV-PSNR", "holes", "after backdrop", "picture, ms", "update, ms", "first, s",
        "drawn", "modelled", "model, MB",
    )  # fmt: skip
    for column in columns:
        table.add_column(column, justify="left" if column in ("camera", "") else "right", no_wrap=True)
    for number, row in enumerate(rows):
        last = number + 1 == len(rows) or rows[number + 1].camera != row.camera
        table.add_row(
            row.camera, row.mode, f"{row.psnr_y:.2f}", f"{row.iv_psnr:.2f}", f"{100 * row.holes_warped:.2f} %",
            f"{100 * row.holes_backdrop:.2f} %", f"{1e3 * row.picture_s:.1f}", f"{1e3 * row.update_s:.1f}",
            f"{row.first_s:.2f}", f"{row.drawn:,.0f}", f"{row.modelled:,}", f"{row.model_bytes / 1e6:.1f}",
            end_section=last,
        )  # fmt: skip
    return table


def _gain(rows: Sequence[PaperRow], quality: str) -> str:
    """One line: differences preset minus paper in quality, ratios preset to paper in time, triangles and memory."""
    paper, own = ([row for row in rows if row.mode == mode] for mode in ("paper", quality))

    def mean(group: Sequence[PaperRow], name: str) -> float:
        return float(np.mean([getattr(row, name) for row in group]))

    gains = {name: mean(own, name) - mean(paper, name) for name in ("psnr_y", "iv_psnr", "holes_backdrop")}
    shares = (("picture_s", "a picture"), ("update_s", "an update"), ("first_s", "the first frame"))
    times = ", ".join(f"{text} {mean(own, name) / mean(paper, name):.2f}" for name, text in shares)
    sizes = (("drawn", "triangles drawn"), ("modelled", "modelled"), ("model_bytes", "memory"))
    counts = ", ".join(f"{text} {mean(own, name) / max(mean(paper, name), 1):.3f}" for name, text in sizes)
    return (
        f"{rows[0].recording}: {quality} over the paper: PSNR-Y {gains['psnr_y']:+.2f} dB, "
        f"IV-PSNR {gains['iv_psnr']:+.2f} dB, holes {100 * gains['holes_backdrop']:+.2f} %; "
        f"its share of the paper's time: {times}; {counts}"
    )
