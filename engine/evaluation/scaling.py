"""Growth of the cost of a stereo pair with the pixels of the pictures (output) and with those of the views (input)."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..pipeline.engine import Engine
from ..rig.frame import Frame
from ..rig.viewer import StereoView
from ..settings import Settings
from ..synth import make_twin, twin_frame
from .targets import head_pose

__all__ = ["DOUBLINGS", "Growth", "exponent", "measure_growth", "plot_growth"]

DOUBLINGS = 3
_VIEWER = "viewer"


@dataclass(frozen=True, slots=True)
class Growth:
    """One size: medians of CPU time in ms.

    grows: "output" or "input". pixels: of a pair for "output", of one view for "input". pair: rendering of a stereo
    pair whose views are triangulated. update: all work of the back end for a frame and one viewer.
    """

    grows: str
    pixels: int
    pair: float
    update: float


def measure_growth(name: str, scale: float, quality: str, repeats: int) -> Iterator[Growth]:
    """Double the pictures' pixels DOUBLINGS times with the views of twin `name` at `scale`; then double the views'.

    `repeats` is the number of timed rounds, `quality` a preset. All sizes of a kind take turns, so that other load of
    the machine affects all equally. CPU time is that of the whole process, all threads together.
    """
    sizes = [_even(320 * math.sqrt(2) ** k) for k in range(DOUBLINGS + 1)]
    frames = _frames(name, scale)
    engine = Engine([view.camera for view in frames[0].views], Settings.preset(quality))
    for size, (pair, update) in zip(sizes, _in_turns([(engine, frames, s) for s in sizes], repeats), strict=True):
        yield Growth("output", 2 * size * size, pair, update)
    cases = []
    for k in range(DOUBLINGS + 1):
        frames = _frames(name, 0.5 * scale * math.sqrt(2) ** k)
        cases.append((Engine([view.camera for view in frames[0].views], Settings.preset(quality)), frames, sizes[2]))
    for (_, frames, _), (pair, update) in zip(cases, _in_turns(cases, repeats), strict=True):
        camera = frames[0].views[0].camera
        yield Growth("input", camera.width * camera.height, pair, update)


def _frames(name: str, scale: float) -> list[Frame]:
    twin = make_twin(name, scale)
    return [twin_frame(twin, index) for index in range(3)]


def _even(size: float) -> int:
    return 2 * round(size / 2)


def _in_turns(cases: Sequence[tuple[Engine, list[Frame], int]], repeats: int) -> list[tuple[float, float]]:
    """Medians of CPU ms of a pair and of an update for each case: engine, frames, width and height of an eye."""
    pairs: list[list[float]] = [[] for _ in cases]
    updates: list[list[float]] = [[] for _ in cases]
    for k in range(repeats + 3):  # every engine sees each frame once before anything counts
        for number, (engine, frames, size) in enumerate(cases):
            frame = frames[k % len(frames)]
            home = np.mean([view.camera.pose.position for view in frame.views], axis=0)
            view = StereoView.symmetric(head_pose(home, 0.25 * k), size, size, math.radians(90))
            start = time.process_time()
            engine.update(frame, {_VIEWER: view})
            middle = time.process_time()
            engine.render(view, _VIEWER)
            if k >= 3:
                updates[number].append(1e3 * (middle - start))
                pairs[number].append(1e3 * (time.process_time() - middle))
    return [(float(np.median(p)), float(np.median(u))) for p, u in zip(pairs, updates, strict=True)]


def exponent(rows: Sequence[Growth], grows: str, cost: str) -> float:
    """Slope of log cost over log pixels by least squares: 1 is linear, less than 1 is sublinear.

    `grows` is "output" or "input", `cost` is "pair" or "update".
    """
    chosen = [row for row in rows if row.grows == grows]
    slope, _ = np.polyfit(np.log([r.pixels for r in chosen]), np.log([getattr(r, cost) for r in chosen]), 1)
    return float(slope)


def plot_growth(rows: Sequence[Growth], title: str, path: Path) -> None:
    """Plot cost over pixels, both on logarithmic axes, into a PNG at `path`.

    Raises ImportError without matplotlib (extra `plots`).
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 4), layout="constrained")
    for axes, grows in zip(figure.subplots(1, 2), ("output", "input"), strict=True):
        chosen = [row for row in rows if row.grows == grows]
        pixels = np.array([row.pixels for row in chosen]) / 1e6
        for cost, mark in (("pair", "o-"), ("update", "s--")):
            values = [getattr(row, cost) for row in chosen]
            axes.loglog(pixels, values, mark, label=f"{cost}: pixels^{exponent(rows, grows, cost):.2f}")
        axes.loglog(pixels, chosen[0].pair * pixels / pixels[0], ":", color="grey", label="linear")
        axes.set_xlabel(f"megapixels {'of a pair' if grows == 'output' else 'of a view'}")
        axes.set_ylabel("CPU, ms")
        axes.legend()
    figure.suptitle(title)
    figure.savefig(path, dpi=110)
