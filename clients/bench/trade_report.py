"""The results of `trade` in files: every row, the Pareto fronts, a plot and a summary for people."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from farside.engine.evaluation.trade import Row
from farside.engine.evaluation.trade_points import Point, pareto

__all__ = ["fronts", "plot_trade", "point_table", "write_report"]

INTRODUCTION = """Each row is `balanced` with one setting changed (`picture`, `model`), a preset, a rung of the
governor's ladder or a point of the grid. dB: IV-PSNR minus that of the base, before encoding; `dB sent`: after JPEG
encoding and decoding. Times are CPU times as ratios to the base's: `time` of rendering, `total` with encoding, `update`
of a later frame in the back end, `first` of the first frame. Holes are the pixels that filling had to colour; bytes are
the sizes of the JPEG pictures as ratios. The base is `balanced`; for `model` rows it is `balanced` with one view for
each picture. Means over """

TITLES = ("kind", "what", "dB", "dB sent", "time", "total", "update", "first", "holes", "bytes")


def fronts(points: Sequence[Point]) -> tuple[list[Point], list[Point]]:
    """The Pareto fronts of time against IV-PSNR (without JPEG qualities), and of bytes against IV-PSNR as sent."""
    timed = [point for point in points if point.knob != "jpeg_quality"]
    return pareto(timed, "time", "iv_psnr"), pareto(points, "bytes", "sent")


def point_table(points: Sequence[Point]) -> list[tuple[str, ...]]:
    """The points as text, columns as in TITLES."""
    return [
        (
            p.kind, p.label, f"{p.iv_psnr:+.2f}", f"{p.sent:+.2f}", f"{p.time:.2f}", f"{p.total:.2f}",
            f"{p.update:.2f}", f"{p.first:.2f}", f"{100 * p.holes:.3f} %", f"{p.bytes:.2f}",
        )
        for p in points
    ]  # fmt: skip


def write_report(folder: Path, rows: Sequence[Row], points: Sequence[Point]) -> Path:
    """Write trade.csv (all rows), front.csv, trade.md and, if matplotlib is installed (extra `plots`), trade.png.

    Returns the summary's path.
    """
    folder.mkdir(parents=True, exist_ok=True)
    by_time, by_bytes = fronts(points)
    _write_csv(folder / "trade.csv", rows, Row)
    _write_csv(folder / "front.csv", by_time, Point)
    materials = ", ".join(dict.fromkeys(row.material for row in rows))
    parts = [
        f"# Speed against accuracy: {materials}\n\n{INTRODUCTION}{materials}.\n",
        "## The front, time against IV-PSNR\n\n" + _markdown(by_time),
        "## The front, bytes against IV-PSNR as it arrives\n\n" + _markdown(by_bytes),
        "## All points\n\n" + _markdown(points),
    ]
    try:
        plot_trade(points, materials, folder / "trade.png")
        parts.insert(1, "![Speed against accuracy](trade.png)\n")
    except ImportError:
        parts.insert(1, "No plot: matplotlib is not installed (extra `plots`).\n")
    summary = folder / "trade.md"
    summary.write_text("\n".join(parts), "utf-8")
    return summary


def _write_csv(path: Path, rows: Sequence[Row] | Sequence[Point], kind: type[Row] | type[Point]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [column.name for column in fields(kind)])
        writer.writeheader()
        writer.writerows(asdict(row) for row in rows)


def _markdown(points: Sequence[Point]) -> str:
    lines = [TITLES, ("---",) * len(TITLES), *point_table(points)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def plot_trade(points: Sequence[Point], title: str, path: Path) -> None:
    """Draw time against IV-PSNR, time against holes, and bytes against IV-PSNR as it arrives.

    Raises ImportError without matplotlib.
    """
    from matplotlib.figure import Figure

    by_time, by_bytes = fronts(points)
    figure = Figure(figsize=(15, 5), layout="constrained")
    quality, holes, size = figure.subplots(1, 3)
    panels: tuple[tuple[Any, str, str, float, Sequence[Point], Sequence[Point]], ...] = (
        (quality, "time", "iv_psnr", 1.0, [p for p in points if p.knob != "jpeg_quality"], by_time),
        (holes, "time", "holes", 100.0, [p for p in points if p.knob != "jpeg_quality"], []),
        (size, "bytes", "sent", 1.0, points, by_bytes),
    )
    for axes, x, y, factor, shown, front in panels:
        _draw(axes, shown, x, y, factor)
        axes.plot(*_xy(front, x, y, factor), color="black", linewidth=1, zorder=1, label="front" if front else None)
        axes.set(xscale="log")
        axes.grid(alpha=0.3, which="both")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("{x:g}")
        axes.tick_params(axis="x", which="both", labelsize=8)
    label = "CPU time of a pair, ratio to balanced"
    quality.set(xlabel=label, ylabel="IV-PSNR, dB more than balanced", title="accuracy")
    holes.set(xlabel=label, ylabel="holes left to filling, % of pixels", title="holes")
    size.set(xlabel="bytes of a pair, ratio to balanced", ylabel="IV-PSNR as it arrives, dB", title="bytes")
    quality.legend(fontsize=7, loc="lower right")
    figure.suptitle(title)
    figure.savefig(path, dpi=90)


def _draw(axes: Any, points: Sequence[Point], x: str, y: str, factor: float) -> None:
    """A colour and marker for each setting, grey dots for the grid, names at the presets."""
    groups: dict[str, list[Point]] = {}
    for point in (point for point in points if point.kind != "model"):
        groups.setdefault("grid" if point.kind == "grid" else point.knob, []).append(point)
    for number, (knob, group) in enumerate(groups.items()):
        style = {"color": "0.75", "s": 12} if knob == "grid" else {"color": f"C{number % 10}", "s": 22}
        marker = {"preset": "*", "rung": "D"}.get(knob, "o^svPX"[number // 10 + number % 5] if knob != "grid" else ".")
        axes.scatter(*_xy(group, x, y, factor), label=knob, marker=marker, zorder=2, **style)
    for point in groups.get("preset", []):
        at = getattr(point, x), factor * getattr(point, y)
        axes.annotate(point.value, at, xytext=(4, 4), textcoords="offset points", fontsize=9)


def _xy(points: Sequence[Point], x: str, y: str, factor: float) -> tuple[list[float], list[float]]:
    return [getattr(p, x) for p in points], [factor * getattr(p, y) for p in points]
