"""`farside bench layers`: what the model keeps and drops beyond the paper's limits, and what that costs and gains."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
import typer
from farside.engine.evaluation.ghosts import inside_cameras
from farside.engine.evaluation.layers import VARIANTS, LayerCost, LayerSample, play_layers
from farside.engine.synth import make_twin
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Every, Frames, Quality, Scale, TwinName, Views

__all__ = ["command", "show_layers"]

_SETTLED = 3  # first frames whose times do not count: they compile kernels, and the first one builds the S-PBS

Reach = Annotated[
    float | None, typer.Option(min=0.1, help="Metres up to which sensors find depth (default: any distance).")
]


def command(
    name: TwinName, scale: Scale = 0.25, frames: Frames = 100, every: Every = 12, quality: Quality = "best",
    views: Views = 2, reach: Reach = None,
) -> None:  # fmt: skip
    """Compare models with and without what goes beyond the paper's limits, on a twin."""
    show_layers(name, scale, frames, every, quality, views, reach)


def show_layers(
    name: str, scale: float, frames: int, every: int, quality: str, views: int, reach: float | None
) -> None:
    """Print a row for each variant: means over the inside cameras and judged frames, and the costs of all frames."""
    twin = make_twin(name, scale)
    cameras, samples, costs = inside_cameras(twin), list[LayerSample](), list[LayerCost]()
    with Progress(console=Console(stderr=True)) as bar:
        task = bar.add_task("playing", total=frames * len(VARIANTS))
        for item in play_layers(twin, cameras, frames, every, quality, views, math.inf if reach is None else reach):
            if isinstance(item, LayerCost):
                costs.append(item)
                bar.advance(task)
            else:
                samples.append(item)
    seen = "any distance" if reach is None else f"{reach:g} m"
    title = f"{name} at scale {scale:g}, quality {quality}, {views} views, depth up to {seen}; filled pixels only"
    table = Table(title=title)
    columns = (
        "model", "filled, %", "PSNR-Y", "IV-PSNR", "wrong, %", "unknown, %", "missed, %", "ghosts, %", "triangles",
        "CPU ms", "ratio", "MB",
    )  # fmt: skip
    for column in columns:
        table.add_column(column, justify="right")
    pixels = float(np.mean([camera.width * camera.height for camera in cameras]))
    base = next(iter(VARIANTS))
    for variant in VARIANTS:
        own = [sample for sample in samples if sample.variant == variant]
        table.add_row(variant, *_qualities(own, pixels), *_costs(costs, variant, base))
    Console(width=130).print(table)


def _qualities(own: Sequence[LayerSample], pixels: float) -> list[str]:
    filled = sum(sample.filled for sample in own)
    shares = (100 * sum(getattr(sample, name) for sample in own) / max(filled, 1) for name in ("wrong", "unknown"))
    means = (_mean([getattr(sample, name) for sample in own]) for name in ("psnr_y", "iv_psnr"))
    come, missed = (sum(getattr(sample, name) for sample in own) for name in ("come", "missed"))
    ghosts = 100 * float(np.mean([sample.ghosts for sample in own]))
    return [
        f"{100 * filled / (pixels * len(own)):.2f}", *(f"{mean:.2f}" for mean in means),
        *(f"{share:.2f}" for share in shares), f"{100 * missed / come:.2f}" if come else "-", f"{ghosts:.3f}",
    ]  # fmt: skip


def _mean(values: Sequence[float]) -> float:
    """The mean of the finite ones."""
    finite = [value for value in values if math.isfinite(value)]
    return float(np.mean(finite)) if finite else math.nan


def _costs(costs: Sequence[LayerCost], variant: str, base: str) -> list[str]:
    """Triangles and memory at the end; the mean update, and its ratio to the base's, without the slowest tenth of the
    frames: some kernels are called late, and are loaded then."""
    late = [cost for cost in costs if cost.frame >= _SETTLED]
    timed = [sorted(cost.update_ms for cost in late if cost.variant == name) for name in (variant, base)]
    timed = [times[: len(times) - len(times) // 10] for times in timed]
    last = [cost for cost in costs if cost.variant == variant][-1]
    own, other = (float(np.mean(times)) if times else math.nan for times in timed)
    return [str(last.triangles), f"{own:.2f}", f"{own / other:.3f}", f"{last.memory / 1e6:.1f}"]
