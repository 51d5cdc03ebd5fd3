"""Farside's pictures next to those of other renderers, over sequences whose README holds the figures of the others.

The README's table has the columns sequence, target, "nearest views given", frame, then PSNR-Y / IV-PSNR of each
renderer. Farside gets the n source views nearest to the target. As in a live session, it also knows earlier frames.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..io.recording import Recording, open_recording
from ..io.text import read_text
from ..pipeline.engine import Engine
from ..settings import Settings
from .metrics import iv_psnr, psnr

__all__ = ["PeerRow", "nearest_views", "peer_rows", "read_peer_table"]


@dataclass(frozen=True, slots=True)
class PeerRow:
    """One case. peers: for each renderer's name its (PSNR-Y, IV-PSNR), dB. ours: the same of Farside."""

    sequence: str
    target: str
    views: int
    frame: int
    peers: dict[str, tuple[float, float]]
    ours: tuple[float, float] = (np.nan, np.nan)


def read_peer_table(readme: Path) -> list[PeerRow]:
    """The rows of the README's table; raises ValueError if there are none."""
    names: list[str] = []
    rows = []
    for line in read_text(readme).splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")]
        if not line.startswith("|") or len(cells) < 5 or set(cells[0]) <= {"-"}:
            continue
        if cells[0] == "sequence":
            names = cells[4:]
            continue
        figures = {
            name: (float(m[1]), float(m[2]))
            for name, cell in zip(names, cells[4:], strict=True)
            if (m := re.fullmatch(r"([\d.]+) / ([\d.]+)", cell))
        }
        rows.append(PeerRow(cells[0], cells[1], int(cells[2]), int(cells[3]), figures))
    if not rows:
        raise ValueError(f"{readme}: no table of renderers: expected the columns sequence, target, ...")
    return rows


def nearest_views(sequence: Recording, target: str, count: int) -> tuple[str, ...]:
    """Names of the `count` source views nearest to the camera `target` by position, in the sequence's order."""
    position = np.array(sequence.camera(target).pose.position)
    distance = {
        name: np.linalg.norm(sequence.camera(name).pose.position - position) for name in sequence.source_names
    }
    nearest = sorted(sequence.source_names, key=lambda name: distance[name])[:count]
    return tuple(name for name in sequence.source_names if name in nearest)


def peer_rows(folder: Path, quality: str, background: bool = True) -> Iterator[PeerRow]:
    """Render every case of the folder's table with a preset, with or without the model; yields rows with `ours` set."""
    for row in read_peer_table(folder / "README.md"):
        sequence = open_recording(folder / row.sequence)
        names = nearest_views(sequence, row.target, row.views)
        settings = Settings.preset(quality, n_render=row.views, background=background)
        engine = Engine([sequence.camera(name) for name in names], settings, f_vin=sequence.fps)
        target = sequence.camera(row.target)
        for index in range(row.frame + 1):
            engine.update(sequence.frame(index, names), {row.target: target} if index == row.frame else None)
        picture = engine.render_camera(target, row.target).texture
        truth = sequence.texture(row.target, row.frame)
        ours = (psnr(truth, picture)[0], iv_psnr(truth, picture))
        yield PeerRow(row.sequence, row.target, row.views, row.frame, row.peers, ours)
