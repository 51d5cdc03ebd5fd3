"""`farside bench scaling`: how cost grows with the pixels of pictures and of views."""

from __future__ import annotations

from pathlib import Path

from farside.engine.evaluation.scaling import exponent, measure_growth, plot_growth
from rich.console import Console
from rich.table import Table

from .options import Quality, Report, Scale, TwinName

__all__ = ["command", "show_scaling"]


def command(name: TwinName, scale: Scale = 0.25, quality: Quality = "best", report: Report = None) -> None:
    """Measure how the cost of a stereo pair grows with the pixels of pictures and of views, on a twin."""
    show_scaling(name, scale, quality, report)


def show_scaling(name: str, scale: float, quality: str, report: Path | None, repeats: int = 9) -> None:
    """Print cost by size, and its exponents; with `report`, write a plot. Costs are medians of `repeats` runs."""
    console, rows = Console(width=120), []
    table = Table(title=f"{name}, views of scale {scale:g}, {quality}: CPU ms, medians of {repeats}")
    for column in ("grows", "pixels", "a pair", "an update"):
        table.add_column(column, justify="right")
    with Console(stderr=True).status("Measuring pairs and updates at four sizes of pictures and four of views"):
        for row in measure_growth(name, scale, quality, repeats):
            rows.append(row)
            table.add_row(row.grows, f"{row.pixels:,}", f"{row.pair:.1f}", f"{row.update:.1f}")
    console.print(table)
    for grows in ("output", "input"):
        pair, update = (exponent(rows, grows, cost) for cost in ("pair", "update"))
        console.print(f"{grows} pixels: a pair costs pixels^{pair:.2f}, an update pixels^{update:.2f}")
    if report is not None:
        report.mkdir(parents=True, exist_ok=True)
        try:
            plot_growth(rows, f"{name}, {quality}", report / "scaling.png")
            console.print(f"plot: {report / 'scaling.png'}")
        except ImportError as error:
            console.print(f"no plot: {error} (pip install farside[plots])")
