"""`farside bench targets`: speed and loss of quality next to their targets."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from farside.engine.evaluation.targets import (
    Target,
    loss_targets,
    one_eye_targets,
    pair_targets,
    update_targets,
)
from farside.engine.pipeline.engine import Engine
from farside.engine.settings import Settings
from farside.engine.synth import make_twin, twin_frame
from rich.console import Console
from rich.progress import Progress

from .options import Every, Frames, Scale, TwinName

__all__ = ["command", "show_targets"]

_EYE = (1280, 1440)


def command(name: TwinName, scale: Scale = 0.25, frames: Frames = 30, every: Every = 1) -> None:
    """Measure speed and loss of quality next to their targets, on a twin."""
    show_targets(name, scale, frames, every)


def show_targets(name: str, scale: float, frames: int, every: int, repeats: int = 15) -> None:
    """Print each figure next to its target as soon as it is measured, after `frames` frames of a twin have been played.

    Only every `every`-th frame is played, so that people move on. Times are medians of `repeats` runs. Twins of scale 1
    are as large as the paper's sequences.
    """
    with Progress(console=Console(stderr=True)) as bar:

        def steps(description: str, total: int | None) -> Callable[[], None]:
            task = bar.add_task(description, total=total)
            return lambda: bar.advance(task)

        _warm_up(name, steps("compiling", 1))
        played = range(0, frames * every, every)
        print(f"{name} at scale {scale:g}, frame {played[-1]}", flush=True)
        for row in _all_targets(name, scale, played, repeats, steps):
            print(_line(row), flush=True)


def _all_targets(
    name: str, scale: float, frames: range, repeats: int, steps: Callable[[str, int | None], Callable[[], None]]
) -> Iterator[Target]:
    yield from one_eye_targets(make_twin(name, 0.5 * scale), repeats, steps("one eye", 4 * repeats + 4))
    twin = make_twin(name, scale)
    engines = {quality: Engine(twin.sources, Settings.preset(quality)) for quality in ("fast", "balanced")}
    yield from update_targets(twin, engines, frames, 3, steps("playing frames", len(frames)))
    size = (max(2, round(_EYE[0] * scale)), max(2, round(_EYE[1] * scale)))
    yield from pair_targets(twin_frame(twin, frames[-1]), engines, size, repeats, steps("stereo pairs", repeats))
    engines.clear()  # their models must not fill memory together with the largest meshes
    yield from loss_targets(twin, frames[-1], steps("loss", None))


def _warm_up(name: str, advance: Callable[[], None]) -> None:
    """Compile all kernels on a tiny twin, so that the first figures do not include compilation."""
    tiny = make_twin(name, 0.05)
    engines = {quality: Engine(tiny.sources, Settings.preset(quality)) for quality in ("fast", "balanced")}
    list(update_targets(tiny, engines, range(4), 1, lambda: None))
    list(pair_targets(twin_frame(tiny, 3), engines, (64, 72), 1, lambda: None))
    advance()


def _line(row: Target) -> str:
    sign = ">=" if row.at_least else "<="
    wanted = "" if row.wanted is None else f"{sign} {row.wanted:.3g} {row.unit}"
    met = {None: "", True: "yes", False: "no"}[row.met]
    return f"{row.what:96} {f'{row.value:.4g} {row.unit}':>12} {wanted:>12} {met:>4}".rstrip()
