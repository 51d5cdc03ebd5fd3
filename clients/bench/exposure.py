"""`farside bench exposure`: the gain of following the exposure of views."""

from __future__ import annotations

from farside.engine.evaluation.exposure import measure_exposure
from rich.console import Console
from rich.table import Table

from .options import Quality, Scale, TwinName

__all__ = ["command", "show_exposure"]


def command(name: TwinName, scale: Scale = 0.25, quality: Quality = "best") -> None:
    """Judge pictures of a twin whose views have random exposures and white balances."""
    show_exposure(name, scale, quality)


def show_exposure(name: str, scale: float, quality: str) -> None:
    """Print the quality of a twin's pictures from views of random exposures, and the views' remaining differences."""
    report = measure_exposure(name, scale, quality)
    table = Table(title=f"{name} at scale {scale:g}, quality {quality}: PSNR-Y / IV-PSNR in dB, up to a gain")
    for column in ("camera", "unaltered views", "exposures left", "exposures followed"):
        table.add_column(column, justify="right")
    for row in report.rows:
        table.add_row(row.camera, *(f"{p:.2f} / {iv:.2f}" for p, iv in (row.clean, row.off, row.on)))
    console = Console(width=100)
    console.print(table)
    for title, codes in (("before", report.before), ("after", report.after)):
        figures = ", ".join(f"{plane} {code:.2f}" for plane, code in zip(("Y'", "Cb", "Cr"), codes, strict=True))
        console.print(f"views' differences at mid grey {title}, root mean square in codes: {figures}")
    console.print(f"following costs {report.update_ms:.1f} ms a frame")
