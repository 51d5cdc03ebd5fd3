"""`farside bench paper`: the gain of a preset over the published algorithm, and the paper's experiments repeated."""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from farside.engine.evaluation.experiments import QUALITIES, play_fixed
from farside.engine.evaluation.moving import is_walk, moving_names
from farside.engine.evaluation.moving_experiment import play_moving
from farside.engine.evaluation.paper import PAPER_TWINS, PaperRow, compare_with_paper
from farside.engine.evaluation.twin_recording import TwinRecording, default_targets, find_recordings
from farside.engine.io.recording import Recording
from farside.engine.synth import make_twin
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .all import commit_name, machine_name
from .options import Cameras, Every, Folders, Frames, Quality, Report, Scale
from .paper_report import TABLE_2, TABLE_3, PaperReport, heading, moving_table, table_2_cells, table_3_rows

__all__ = ["command", "distant_cameras", "show_experiments", "show_paper"]

MOVING_TWINS = ("gymnasium-a", "gymnasium-b")  # section 4.2


def command(
    folders: Folders = None,
    twins: Annotated[str | None, typer.Option(metavar="NAME,...", help="Twins (default: the paper's four).")] = None,
    scale: Scale = 0.25,
    frames: Frames = 21,
    every: Every = 5,
    quality: Quality = "balanced",
    cameras: Cameras = None,
    moving_frames: Annotated[
        int | None, typer.Option(min=1, help="Most frames of rigs with a moving camera (default: five times --frames).")
    ] = None,
    report: Report = None,
) -> None:
    """Compare a preset with the published algorithm: dB, holes, time, triangles and memory, on the paper's twins.

    With --report, the paper's experiments are repeated, too, in all qualities: DIR/paper.html opens in a browser.
    """
    recordings: list[Recording] = list(find_recordings(folders or []))
    usual = twins is None and not recordings
    names = ",".join(PAPER_TWINS) if usual else twins or ""
    recordings += [TwinRecording(make_twin(name, scale)) for name in names.split(",") if name]
    show_paper(recordings, cameras, frames, every, quality, report)
    if report is not None:
        more = [TwinRecording(make_twin(name, scale)) for name in MOVING_TWINS] if usual else []
        about = {"scale of twins": f"{scale:g}", "machine": machine_name(), "commit": commit_name()}
        experiments = PaperReport(report, about)
        show_experiments([*recordings, *more], cameras, frames, every, moving_frames or 5 * frames, experiments)


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


def show_experiments(
    recordings: Sequence[Recording], cameras: Sequence[str] | None, frames: int, every: int, moving_frames: int,
    report: PaperReport, qualities: Sequence[str] = QUALITIES,
) -> None:  # fmt: skip
    """Repeat the paper's experiments on each recording; print Table 2 and the table of moving cameras as soon as they
    are measured, and write the report anew after each recording.

    Virtual cameras with ground truth, by default those outside the rig. A recording all of whose cameras move is left
    out, and named: there is nothing to compare it with (`farside bench moving`).
    """
    with Progress(console=Console(stderr=True)) as bar:
        for recording in recordings:
            if is_walk(recording):
                print(f"{recording.name}: left out: all of its cameras move", flush=True)
                continue
            chosen = list(cameras or distant_cameras(recording))
            if moving_names(recording):
                count = min(moving_frames, recording.frame_count)
                task = bar.add_task(f"{recording.name}, section 4.2", total=count)
                moving = play_moving(recording, chosen, count, qualities, lambda t=task: bar.advance(t))  # type: ignore[misc]
                report.moving += moving
                _print(f"{recording.name}, section 4.2 of the paper", *moving_table(moving))
            else:
                count = min(frames, recording.frame_count)
                task = bar.add_task(f"{recording.name}, section 4.1", total=count)
                fixed = play_fixed(recording, chosen, count, every, qualities, lambda t=task: bar.advance(t))  # type: ignore[misc]
                report.fixed.append(fixed)
                _print(f"Table 2, {heading(fixed)}", TABLE_2, [table_2_cells(row) for row in fixed.summaries()])
            page = report.write()
    if report.fixed:
        _print("Table 3", TABLE_3, table_3_rows(report.fixed))
    if report.fixed or report.moving:
        print(f"report: {page}", flush=True)


def distant_cameras(recording: Recording) -> list[str]:
    """The virtual cameras with ground truth that stand outside the rig ("a rather large baseline", section 4.1); all of
    them, if none does."""
    try:
        inside = default_targets(recording)
    except ValueError:  # there is none
        inside = []
    return [name for name in recording.truth_names if name not in inside] or list(recording.truth_names)


def _print(title: str, titles: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """A table; the rows of a quality stand together."""
    table = Table(title=title)
    for number, name in enumerate(titles):
        table.add_column(name, justify="left" if number < 2 else "right", no_wrap=True)
    for number, row in enumerate(rows):
        table.add_row(*row, end_section=number + 1 == len(rows) or rows[number + 1][0] != row[0])
    Console(width=180).print(table)


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
