"""`farside bench peers`: Farside's quality figures next to those of other renderers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from farside.engine.evaluation.peers import peer_rows, read_peer_table
from rich.console import Console
from rich.table import Table

from .options import Background, Quality

__all__ = ["command", "show_peers"]


def command(
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder of sequences; its README has a table of figures.")
    ],
    quality: Quality = "best",
    background: Background = True,
) -> None:
    """Compare Farside with other renderers, whose figures are in the README of a folder of sequences."""
    show_peers(folder, quality, background)


def show_peers(folder: Path, quality: str, background: bool) -> None:
    """Print the README's table of other renderers' figures, with Farside's next to them.

    Raises ValueError if the folder has no README.md.
    """
    if not (folder / "README.md").is_file():
        raise ValueError(f"{folder}: expected a folder of sequences with a README.md")
    names = list(dict.fromkeys(name for row in read_peer_table(folder / "README.md") for name in row.peers))
    table = Table(title=f"PSNR-Y / IV-PSNR in dB, Farside at quality {quality}")
    for column in ("sequence", "target", "views", "frame", *names, "Farside", "to the best, IV-PSNR"):
        table.add_column(column, justify="right")
    for row in peer_rows(folder, quality, background):
        best = max(figures[1] for figures in row.peers.values())
        cells = [f"{p:.2f} / {iv:.2f}" if (p := f[0]) and (iv := f[1]) else "" for f in _figures(row.peers, names)]
        table.add_row(
            row.sequence, row.target, str(row.views), str(row.frame), *cells,
            f"{row.ours[0]:.2f} / {row.ours[1]:.2f}", f"{row.ours[1] - best:+.2f}",
        )  # fmt: skip
    Console(width=150).print(table)


def _figures(peers: dict[str, tuple[float, float]], names: list[str]) -> list[tuple[float, float]]:
    return [peers.get(name, (0.0, 0.0)) for name in names]
