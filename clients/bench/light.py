"""`farside bench light`: the gain of following the light in the background model."""

from __future__ import annotations

from typing import Annotated

import typer
from farside.engine.evaluation.light import PARTS, Colours, LightMeter, watch_light
from farside.engine.settings import Settings
from farside.engine.synth import make_twin
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Every, Frames, Quality, Scale, TwinName, Views

__all__ = ["command", "show_light"]


def command(
    name: TwinName,
    scale: Scale = 0.125,
    frames: Frames = 210,
    every: Every = 3,
    quality: Quality = "best",
    views: Views = 2,
    seconds: Annotated[float, typer.Option(help="Time constant with which the light is followed.", min=0.01)] = 1.0,
    depth_noise: Annotated[
        float | None, typer.Option(help="Strength of the twin's depth errors (default: the twin's own).")
    ] = None,
    grain: Annotated[float, typer.Option(help="Noise of the views' luma, 10-bit codes.", min=0.0)] = 0.0,
) -> None:
    """Judge what the background model fills in while a twin's lamps change, without and with following of the light."""
    settings = Settings.preset(quality, n_render=views, light_s=seconds)
    show_light(name, scale, frames, every, settings, depth_noise, grain)


def show_light(
    name: str, scale: float, frames: int, every: int, settings: Settings, depth_noise: float | None, grain: float
) -> None:
    """Print quality and flicker by part of the sequence, and the cost of an update."""
    twin = make_twin(name, scale, depth_noise=depth_noise)
    cameras = [twin.camera(target) for target in twin.rig.target_names]
    meter = LightMeter()
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("playing", total=frames)
        for meter in watch_light(twin, cameras, frames, every, settings, grain):  # noqa: B007 (the last one counts)
            bar.advance(task)
    noise = f"depth noise {twin.depth_noise:g}, grain {grain:g}, {settings.n_render} views, {settings.light_s:g} s"
    console = Console(width=140)
    console.print(_table(meter, f"{name} at scale {scale:g}, {noise}: light not followed, followed"))


def _table(meter: LightMeter, title: str) -> Table:
    table = Table(title=title)
    columns = ("light changes", "pixels", "share, %", "PSNR-Y", "gain", "PSNR-C", "gain", "flicker", "CPU")
    for column in columns:
        table.add_column(column, justify="right")
    for part in PARTS:
        own = meter.parts[part]
        for name in ("whole", "filled", "model", "hidden") if own.judged else ():
            colours: Colours = getattr(own, name)
            cells = [part, name, f"{100 * colours.count / own.whole.count:.2f}"]
            for off, on in zip(colours.psnr(0), colours.psnr(1), strict=True):
                cells += f"{off:.2f}, {on:.2f}", f"{on - off:+.2f}"
            flicker = f"{own.changes(0):.3f}, {own.changes(1):.3f}" if name == "filled" else ""
            cost = f"{own.cost:.3f}" if name == "model" else ""
            table.add_row(*cells, flicker, cost, end_section=name == "hidden")
    return table
