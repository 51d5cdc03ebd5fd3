"""`farside bench minified`: the gain of prefiltering for pictures coarser than the views."""

from __future__ import annotations

from farside.engine.evaluation.minified import halving_cost, measure_minified
from farside.engine.synth import make_twin
from rich.console import Console
from rich.table import Table

from .options import Quality, Scale, TwinName, Views

__all__ = ["command", "show_minified"]


def command(name: TwinName, scale: Scale = 0.25, quality: Quality = "best", views: Views = 5) -> None:
    """Judge pictures that are coarser than a twin's views, prefiltered or not."""
    show_minified(name, scale, quality, views)


def show_minified(name: str, scale: float, quality: str, views: int) -> None:
    """Print a row for each picture size, given as view pixels for each of its pixels, and the cost of halving views."""
    table = Table(title=f"{name} at scale {scale:g}, quality {quality}, {views} views: PSNR-Y / IV-PSNR / SSIM")
    for column in ("view pixels a pixel", "width", "as they are", "prefiltered"):
        table.add_column(column, justify="right")
    for row in measure_minified(name, scale, quality, views):
        figures = (f"{p:.2f} / {iv:.2f} / {s:.4f}" for p, iv, s in (row.off, row.on))
        table.add_row(f"{row.ratio:g}", str(row.width), *figures)
    console = Console(width=110)
    console.print(table)
    twin = make_twin(name, scale)
    cost = halving_cost(twin.view(twin.source_names[0], 0))
    console.print(f"halving a view costs {cost:.2f} ms of CPU time for each of its megapixels")
