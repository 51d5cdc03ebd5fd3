"""`farside bench backdrop`: a twin's backdrop from the farthest surfaces, and from the nearest that still stand."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from farside.engine.evaluation.backdrop import VIEWS, BackdropSample, compare_backdrops, pbi_costs
from farside.engine.evaluation.ghosts import inside_cameras
from farside.engine.rig.camera import Camera
from farside.engine.rig.frame import Frame
from farside.engine.settings import BACKDROPS
from farside.engine.synth import make_twin, twin_frame
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Every, Frames, Quality, Scale, TwinName

__all__ = ["command", "show_backdrops"]

_COST_FRAMES = 6


def command(
    name: TwinName, scale: Scale = 0.25, frames: Frames = 100, every: Every = 12, quality: Quality = "best"
) -> None:
    """Compare the two choices of the backdrop's surface, farthest or standing, on a twin."""
    show_backdrops(name, scale, frames, every, quality)


def show_backdrops(name: str, scale: float, frames: int, every: int, quality: str) -> None:
    """Print a row for each camera, number of views and mode, means over every `every`-th frame; then the costs."""
    twin = make_twin(name, scale)
    cameras, samples = inside_cameras(twin), []
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("comparing", total=len(cameras) * len(VIEWS) * len(BACKDROPS) * -(-frames // every))
        for sample in compare_backdrops(twin, cameras, frames, every, quality):
            samples.append(sample)
            bar.advance(task)
    table = Table(title=f"{name} at scale {scale:g}, quality {quality}; pixels of a picture, wrong: off by over delta")
    columns = ("camera", "views", "backdrop", "PSNR-Y", "IV-PSNR", "not warped", "PSNR-Y there", "too far", "too near")
    for column in columns:
        table.add_column(column, justify="right")
    for camera in (*(camera.name for camera in cameras), "all"):
        for views in VIEWS:
            for mode in BACKDROPS:
                group = [s for s in samples if s.views == views and s.mode == mode and camera in (s.camera, "all")]
                table.add_row(camera, str(views), mode, *_figures(group))
    Console(width=120).print(table)
    _show_costs([twin_frame(twin, index) for index in range(min(frames, _COST_FRAMES))], cameras, quality)


def _figures(group: Sequence[BackdropSample]) -> list[str]:
    pixels, squares = (np.mean([getattr(s, field) for s in group]) for field in ("pixels", "squares"))
    there = f"{10 * math.log10(1023**2 * pixels / squares):.2f}" if squares else ""
    far, near = (np.mean([getattr(s, field) for s in group]) for field in ("too_far", "too_near"))
    psnr_y, quality = (np.mean([getattr(s, field) for s in group]) for field in ("psnr_y", "iv_psnr"))
    return [f"{psnr_y:.2f}", f"{quality:.2f}", f"{pixels:.0f}", there, f"{far:.1f}", f"{near:.1f}"]


def _show_costs(frames: Sequence[Frame], cameras: Sequence[Camera], quality: str) -> None:
    table = Table(title="PBIs of all these cameras on one thread: rays, processor time")
    for column in ("backdrop", "rays", "ms", "to the farthest"):
        table.add_column(column, justify="right")
    costs, base = list(pbi_costs(frames, cameras, quality)), 0.0
    for mode in BACKDROPS:
        seconds = sum(cost.seconds for cost in costs if cost.mode == mode)
        base = base or seconds
        rays = sum(cost.rays for cost in costs if cost.mode == mode)
        table.add_row(mode, str(rays), f"{1000 * seconds:.1f}", f"{seconds / base:.2f}")
    Console(width=120).print(table)
