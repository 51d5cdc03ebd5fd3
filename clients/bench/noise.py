"""`farside bench noise`: the gain by the background model in every frame of a twin, and the model's own error."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import numpy as np
import typer
from farside.engine.evaluation.ghosts import inside_cameras
from farside.engine.evaluation.noise import WorthSample, watch_noise
from farside.engine.settings import Settings
from farside.engine.synth import make_twin
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Frames, Quality, Scale, TwinName, Views

__all__ = ["command", "show_noise"]

_ROWS = 10  # frames in which the model's own error is measured


def command(
    name: TwinName,
    scale: Scale = 0.25,
    frames: Frames = 100,
    quality: Quality = "best",
    views: Views = 5,
    depth_noise: Annotated[
        float | None, typer.Option(help="Strength of the twin's depth errors (default: the twin's own).")
    ] = None,
) -> None:
    """Judge every frame of a twin with and without the model, and measure the model's error."""
    show_noise(name, scale, frames, quality, views, depth_noise)


def show_noise(name: str, scale: float, frames: int, quality: str, views: int, strength: float | None) -> None:
    """Print the model's error over time, and for each camera the gain by the model, with the worst frames."""
    twin = make_twin(name, scale, depth_noise=strength)
    cameras = inside_cameras(twin)
    samples: list[WorthSample] = []
    every = max(1, frames // _ROWS)
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("playing", total=frames * len(cameras))
        for sample in watch_noise(twin, cameras, frames, every, Settings.preset(quality, n_render=views)):
            samples.append(sample)
            bar.advance(task)
    title = f"{name} at scale {scale:g}, depth noise {twin.depth_noise:g}, quality {quality}, {views} views"
    console = Console(width=140)
    console.print(_errors(samples, title))
    console.print(_worth(samples, title))


def _errors(samples: Sequence[WorthSample], title: str) -> Table:
    table = Table(title=f"{title}: the model against the true background")
    columns = ("frame", "triangles", "surface, RMS mm", "of delta", "luma, RMS codes", "once hidden", "other", "holes")
    for column in columns:
        table.add_column(column, justify="right")
    for frame in sorted({s.frame for s in samples if s.error is not None}):
        moment = [s for s in samples if s.frame == frame]
        names = ("surface_m", "surface_delta", "colour", "colour_once_hidden", "other", "holes")
        mean = {n: float(np.nanmean([getattr(s.error, n) for s in moment])) for n in names}
        table.add_row(
            str(frame), str(moment[0].triangles), f"{1e3 * mean['surface_m']:.2f}", f"{mean['surface_delta']:.3f}",
            f"{mean['colour']:.2f}", f"{mean['colour_once_hidden']:.2f}", f"{100 * mean['other']:.2f} %",
            f"{100 * mean['holes']:.2f} %",
        )  # fmt: skip
    return table


def _worth(samples: Sequence[WorthSample], title: str) -> Table:
    table = Table(title=f"{title}: dB with the model less dB without, every frame")
    columns = ("camera", "mean", "worst", "in frame", "worse by > 0.1", "frames uncovered", "there, mean", "worst")
    for column in columns:
        table.add_column(column, justify="right")
    for camera in dict.fromkeys(s.camera for s in samples):
        own = [s for s in samples if s.camera == camera]
        gains = np.array([s.model - s.without for s in own])
        there = [s.uncovered_model - s.uncovered_without for s in own if s.uncovered > 0]
        table.add_row(
            camera, f"{gains.mean():+.2f}", f"{gains.min():+.2f}", str(own[int(gains.argmin())].frame),
            str(int((gains < -0.1).sum())), str(len(there)),
            *((f"{np.mean(there):+.2f}", f"{np.min(there):+.2f}") if there else ("", "")),
        )  # fmt: skip
    return table
