"""`farside bench live`: a sequence served over localhost, while its video plays and then without it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from farside.engine.io.recording import open_recording
from farside.server.protocol import MAX_EYE_PX
from rich.console import Console
from rich.table import Table

from ..render import parse_size
from .live_run import LiveFigures, measure_live
from .options import Quality, SequenceFolder

__all__ = ["command", "pause_ms", "show_live"]

_LONGEST_STALL_MS, _LONGEST_PAUSE_MS = 5, 10  # targets
_STALLS = {
    "stall": "longest event-loop stall",
    "own_stall": "without waiting for a core",
    "busy": "most work of the loop at once",
}


def command(
    folder: SequenceFolder,
    fps: Annotated[
        float | None, typer.Option(help="Video frames a second (default: the sequence's).", min=0.01, max=1000.0)
    ] = None,
    seconds: Annotated[float, typer.Option(help="Time for which the video plays.", min=1.0)] = 20.0,
    size: Annotated[str, typer.Option(metavar="WxH", help="Picture size of an eye.")] = "640x720",
    quality: Quality = "best",
) -> None:
    """Measure server, replay and headset over localhost: rates, stalls, pauses, memory."""
    if max(parse_size(size)) > MAX_EYE_PX:
        raise ValueError(f"--size: {size!r}: expected at most {MAX_EYE_PX} pixels in each direction")
    show_live(folder, fps, seconds, quality, parse_size(size))


def show_live(folder: Path, fps: float | None, seconds: float, quality: str, size: tuple[int, int]) -> None:
    """Print the figures of a live run, while the video plays and then without it."""
    sequence = open_recording(folder)
    views = [sequence.camera(name) for name in sequence.source_names]
    frame_bytes = sum(5 * view.width * view.height for view in views)  # 4:2:0 in 2 B a sample, and depth
    playing, still = measure_live(folder, fps, seconds, quality, size)
    table = Table(title=f"{sequence.name}, {len(views)} views of {views[0].width}x{views[0].height}, {quality}, live")
    table.add_column(f"pairs of {size[0]}x{size[1]} an eye")
    for name in ("while video plays", "without"):
        table.add_column(name, justify="right")
    for name, *values in zip(*map(_rows, (playing, still)), strict=True):
        table.add_row(name[0], name[1], values[0][1])
    console = Console(width=120)
    console.print(table)
    console.print(_judged(playing, still))
    console.print(
        f"a frame is {frame_bytes / 1e6:.3g} MB; server and engine: {playing.server.resident_mb:.0f} MB resident, "
        f"at most {playing.server.peak_mb:.0f} MB"
    )


def pause_ms(figures: LiveFigures, still: LiveFigures) -> float:
    """Time of the longest picture (during an update, if there was one) minus the median without updates, ms."""
    pictures, without = figures.status["pictures"], still.status["stages_ms"].get("picture", {"p50": math.nan})
    longest = pictures["longest_picture_during_update_ms"] or pictures["longest_picture_ms"]
    return float(longest - without["p50"])


def _judged(playing: LiveFigures, still: LiveFigures) -> Table:
    """Stalls and pauses next to their targets, and next to those of an idle event loop and without video."""
    table = Table("while video plays", "ms", "wanted, at most", "idle, or without video")
    stalls = playing.status["event_loop"]
    for kind, name in _STALLS.items():
        stall, idle = (_shown(figures[f"longest_{kind}_ms"]) for figures in (stalls, playing.idle))
        table.add_row(name, stall, f"{_LONGEST_STALL_MS:g}", idle)
    pause, without = (f"{pause_ms(figures, still):.1f}" for figures in (playing, still))
    table.add_row("longest picture during an update, beyond a median without", pause, f"{_LONGEST_PAUSE_MS:g}", without)
    return table


def _shown(milliseconds: float | None) -> str:
    """A time that not every system tells."""
    return "unknown" if milliseconds is None else f"{milliseconds:.1f}"


def _rows(figures: LiveFigures) -> Iterator[tuple[str, str]]:
    status, frames = figures.status, figures.frames
    yield "pairs a second", f"{figures.rate:.1f}"
    yield "pose sent to picture received, p50 p95 p99 ms", " ".join(f"{ms:.0f}" for ms in figures.motion_to_photon)
    yield "kB a pair", f"{figures.picture_bytes / 1e3:.0f}"
    yield "frames a second updated", f"{frames['updated'] / figures.seconds:.2f}"
    yield "frames dropped, failed", f"{frames['dropped']}, {frames['failed']}"
    for name, what in _STALLS.items():
        both = (status["event_loop"][f"longest_{name}{when}_ms"] for when in ("", "_during_update"))
        yield f"{what}; during updates, ms", ", ".join(map(_shown, both))
    for name in ("picture", "picture_during_update"):
        median = status["stages_ms"].get(name, {"p50": math.nan})["p50"]
        longest = status["pictures"][f"longest_{name}_ms"]
        yield f"{name.replace('_', ' ')}: median, longest, ms", f"{median:.0f}, {longest:.0f}"
    for name in ("ingest", "update.total"):
        yield f"{name}, median, ms", f"{status['stages_ms'].get(name, {'p50': math.nan})['p50']:.0f}"
    yield "cores of server and engine, event loop, replay", " ".join(f"{cores:.3f}" for cores in figures.cores)
