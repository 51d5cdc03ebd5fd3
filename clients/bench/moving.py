"""`farside bench moving`: what reference cameras that move add to the background model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from farside.engine.evaluation.moving import Moment, WalkSample, is_walk, play_rig, play_walk, side_by_side
from farside.engine.evaluation.trend import trend
from farside.engine.evaluation.twin_recording import open_recording_or_twin
from farside.engine.io.recording import Recording
from farside.engine.settings import Settings
from PIL import Image
from rich.console import Console
from rich.progress import Progress, track
from rich.table import Table

from .options import Quality, Report, Scale

__all__ = ["command"]

_ROUNDS = 6  # fewer tell no trend

Names = Annotated[str, typer.Argument(metavar="NAME,...", help="Twins with moving cameras, or sequences' folders.")]
_Frames = Annotated[int | None, typer.Option(min=2, help="Most frames played (default: all).")]
_Every = Annotated[int, typer.Option(metavar="N", min=1, help="Every N-th frame is rendered.")]
_Views = Annotated[int, typer.Option(min=1, help="Fixed views from which a picture is rendered.")]
_HeldOut = Annotated[int, typer.Option(metavar="N", min=2, help="Walks: every N-th frame is not played, but judged.")]


def command(
    names: Names, scale: Scale = 0.5, frames: _Frames = None, every: _Every = 50, views: _Views = 2,
    held_out: _HeldOut = 5, quality: Quality = "balanced", report: Report = None,
) -> None:  # fmt: skip
    """Play rigs with a moving camera without and with it, and walks with a single hand-held camera to their end."""
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
    for name in names.split(","):
        recording = open_recording_or_twin(name, scale)
        count = min(frames or recording.frame_count, recording.frame_count)
        if is_walk(recording):
            _show_walk(recording, Settings.preset(quality), held_out, quality, report)
        else:
            settings = Settings.preset(quality, n_render=views, n_init=4, n_update=1)
            _show_rig(recording, settings, count, every, quality, report)


def _show_rig(
    recording: Recording, settings: Settings, frames: int, every: int, quality: str, report: Path | None
) -> None:
    """Print a row for each sampled frame: holes, the cost of updates, and triangles since the frame before."""
    cameras = [recording.camera(name) for name in recording.truth_names]
    moments: list[Moment] = []
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task(recording.name, total=frames)
        for moment in play_rig(recording, cameras, frames, every, settings):
            moments.append(moment)
            bar.advance(task)
    names = [camera.name for camera in cameras]
    title = "holes before filling, % of pixels, without and with the moving camera"
    table = Table(title=f"{recording.name}, quality {quality}: {title}")
    for column in ("frame", *names, "update, ms", "p95", "asked", "added", "culled", "P-PBS", "captures"):
        table.add_column(column, justify="right")
    for since in _sampled(moments):
        now = since[-1]
        holes = [f"{100 * without:.3f} {100 * with_it:.3f}" for without, with_it in (now.holes[name] for name in names)]
        middle, late = (np.percentile([m.update_ms for m in since], share, axis=0) for share in (50, 95))
        table.add_row(
            str(now.frame), *holes, f"{middle[0]:.1f} {middle[1]:.1f}", f"{late[0]:.1f} {late[1]:.1f}",
            str(sum(m.asked for m in since)), str(sum(m.added for m in since)), str(sum(m.culled for m in since)),
            f"{now.p_pbs[0]} {now.p_pbs[1]}", str(now.captures),
        )  # fmt: skip
        if report is not None:
            for name, pictures in now.pictures.items():
                path = report / f"moving_{recording.name}_{name}_{now.frame}.png"
                Image.fromarray(side_by_side(pictures)).save(path)
    console = Console(width=170)
    console.print(table)
    console.print(_totals(moments, len(recording.source_names)))


def _totals(moments: Sequence[Moment], views: int) -> str:
    """Whether updates get slower, and the accumulated triangles with and without culling (Fig. 12b)."""
    last, lines = moments[-1], []
    # Cameras take turns, and a turn of one takes longer than that of another: rounds of all are alike.
    rounds = np.array([m.update_cpu_ms for m in moments[1:]])[: (len(moments) - 1) // views * views]
    means = rounds.reshape(-1, views, 2).mean(axis=1)
    if len(means) >= _ROUNDS:
        told = []
        for column in means.T / views:  # a round's slope is that of so many frames
            slope, low, high = (1e3 * value for value in trend(column.tolist()))
            told.append(f"{slope:+.1f} us a frame (95 %: {low:+.1f} to {high:+.1f})")
        what = f"CPU time of updates over {len(means)} rounds of {views} frames"
        lines.append(f"{what}: {told[0]} without, {told[1]} with")
    lines.append(
        f"triangles after frame {last.frame}, with the moving camera: {last.exposed:,} exposed, of which "
        f"{last.exposed - last.p_pbs[1]:,} were culled; the P-PBS has {last.p_pbs[1]:,}"
    )
    return "\n".join(lines)


def _sampled(moments: Sequence[Moment]) -> Iterator[list[Moment]]:
    """Runs of frames, each of which ends with a sampled one."""
    run: list[Moment] = []
    for moment in moments:
        run.append(moment)
        if moment.holes:
            yield run
            run = []


def _show_walk(recording: Recording, settings: Settings, held_out: int, quality: str, report: Path | None) -> None:
    """Print a row for each frame that was held out."""
    title = "the end of the walk from poses of frames that were held out"
    table = Table(title=f"{recording.name}, quality {quality}: {title}")
    for column in ("frame", "unseen, %", "holes, %", "filled, PSNR-Y there", "modelled", "gain"):
        table.add_column(column, justify="right")
    samples = list(track(play_walk(recording, held_out, settings), recording.name, console=Console(stderr=True)))
    for sample in samples:
        table.add_row(str(sample.frame), *_figures([sample]))
        if report is not None:
            path = report / f"moving_{recording.name}_{sample.frame}.png"
            Image.fromarray(side_by_side(sample.pictures)).save(path)
    table.add_row("mean", *_figures(samples))
    Console(width=120).print(table)


def _figures(samples: Sequence[WalkSample]) -> list[str]:
    names = ("unseen", "holes", "psnr_filled", "psnr_modelled")
    unseen, holes, filled, modelled = (float(np.mean([getattr(s, name) for s in samples])) for name in names)
    return [
        f"{100 * unseen:.2f}", f"{100 * holes:.2f}", f"{filled:.2f}", f"{modelled:.2f}", f"{modelled - filled:+.2f}",
    ]  # fmt: skip
