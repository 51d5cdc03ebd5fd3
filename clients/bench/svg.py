"""Plots as SVG text, for pages that open from disk: lines over a number, and bars in groups."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

__all__ = ["Limit", "Series", "bars", "lines", "ticks"]

COLOURS = ("#2f6fb2", "#e07b28", "#3f8f4f", "#a0479d", "#7a7a7a")
WIDTH, HEIGHT = 560, 300
LEFT, RIGHT, TOP, BOTTOM = 62, 14, 34, 62  # margins: numbers and labels stand in them
ACROSS, UP = WIDTH - LEFT - RIGHT, HEIGHT - TOP - BOTTOM


@dataclass(frozen=True, slots=True)
class Series:
    """A named line: its points; or the bars of one colour: their heights, one for each group, in `ys`."""

    name: str
    ys: Sequence[float]
    xs: Sequence[float] = ()


@dataclass(frozen=True, slots=True)
class Limit:
    """A dashed line across the plot at the height `y`."""

    name: str
    y: float


def lines(title: str, across: str, up: str, series: Sequence[Series], limits: Sequence[Limit] = ()) -> str:
    """Lines over a number. `across` and `up` name the axes.

    Raises ValueError for no point at all, a number that is not finite, or a series without one x for each y.
    """
    xs = [x for each in series for x in each.xs]
    if any(len(each.xs) != len(each.ys) for each in series):
        raise ValueError(f"{title}: expected one x for each y")
    y_ticks = _heights(title, series, limits)
    if not all(map(math.isfinite, xs)):
        raise ValueError(f"{title}: {xs}: expected finite numbers")
    x_ticks = ticks(min(xs), max(xs))
    ends = (min(xs), max(xs)) if max(xs) > min(xs) else (x_ticks[0], x_ticks[-1])
    parts = []
    for number, each in enumerate(series):
        points = " ".join(
            f"{_x(x, ends):.1f},{_y(y, y_ticks):.1f}" for x, y in zip(each.xs, each.ys, strict=True)
        )
        colour = COLOURS[number % len(COLOURS)]
        parts.append(f'<polyline fill="none" stroke="{colour}" stroke-width="1.8" points="{points}"/>')
    parts += [_text(_x(x, ends), TOP + UP + 16, _number(x), "middle") for x in x_ticks if ends[0] <= x <= ends[1]]
    return _plot(title, across, up, y_ticks, [each.name for each in series], limits, parts)


def bars(title: str, up: str, groups: Sequence[str], series: Sequence[Series], limits: Sequence[Limit] = ()) -> str:
    """Groups of bars next to each other, from 0 upwards. Raises ValueError as `lines` does, and if a series has not one
    height for each group."""
    if any(len(each.ys) != len(groups) for each in series):
        raise ValueError(f"{title}: expected {len(groups)} heights in each series")
    y_ticks, parts = _heights(title, series, limits), []
    step = ACROSS / max(1, len(groups))
    wide = 0.8 * step / max(1, len(series))
    for g, group in enumerate(groups):
        for number, each in enumerate(series):
            top = _y(each.ys[g], y_ticks)
            x, tall = LEFT + step * (g + 0.1) + wide * number, TOP + UP - top
            label = f"<title>{escape(f'{group}, {each.name}: {each.ys[g]:.4g}')}</title>"
            box = f'x="{x:.1f}" y="{top:.1f}" width="{wide - 1:.1f}" height="{tall:.1f}"'
            parts.append(f'<rect {box} fill="{COLOURS[number % len(COLOURS)]}">{label}</rect>')
        parts.append(_text(LEFT + step * (g + 0.5), TOP + UP + 16, group, "middle"))
    return _plot(title, "", up, y_ticks, [each.name for each in series], limits, parts)


def ticks(low: float, high: float, most: int = 6) -> list[float]:
    """At most `most` + 1 round numbers at equal distances; the first is at most `low`, the last at least `high`."""
    size, tiny = max(abs(low), abs(high)), 1e-300
    span = high - low
    if span <= max(1e-6 * size, tiny):  # one number, as far as a plot can show
        span = size if size > tiny else 1.0
    rough = span / max(1, most - 1)
    unit = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * unit for factor in (1.0, 2.0, 5.0, 10.0) if factor * unit >= rough * (1 - 1e-9))
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [k * step for k in range(first, max(last, first + 1) + 1)]


def _heights(title: str, series: Sequence[Series], limits: Sequence[Limit]) -> list[float]:
    """The ticks of the upright axis, from 0 or from the lowest negative value."""
    values = [*(y for each in series for y in each.ys), *(limit.y for limit in limits)]
    if not any(each.ys for each in series):
        raise ValueError(f"{title}: nothing to draw: expected at least one number")
    if not all(map(math.isfinite, values)):
        raise ValueError(f"{title}: {values}: expected finite numbers")
    return ticks(min(0.0, *values), max(0.0, *values))


def _plot(
    title: str, across: str, up: str, y_ticks: Sequence[float], names: Sequence[str], limits: Sequence[Limit],
    parts: Sequence[str],
) -> str:  # fmt: skip
    """The picture: a frame, lines at the ticks, the parts, dashed limits and the names of the colours."""
    grid = [
        f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{_y(y, y_ticks):.1f}" y2="{_y(y, y_ticks):.1f}" '
        f'stroke="#e3e7ec"/>{_text(LEFT - 6, _y(y, y_ticks) + 4, _number(y), "end")}'
        for y in y_ticks
    ]
    dashed = [
        f'<line x1="{LEFT}" x2="{WIDTH - RIGHT}" y1="{_y(limit.y, y_ticks):.1f}" y2="{_y(limit.y, y_ticks):.1f}" '
        f'stroke="#b03030" stroke-dasharray="5 4"/>'
        f"{_text(WIDTH - RIGHT - 4, _y(limit.y, y_ticks) - 4, limit.name, 'end', '#b03030')}"
        for limit in limits
    ]
    legend, x = [], float(LEFT)
    for number, name in enumerate(names):
        legend.append(f'<rect x="{x:.0f}" y="{HEIGHT - 15}" width="11" height="11" fill="{COLOURS[number % 5]}"/>')
        legend.append(_text(x + 16, HEIGHT - 5, name, "start"))
        x += 28 + 6.6 * len(name)
    upright = f'<g transform="translate(13 {TOP + UP / 2:.0f}) rotate(-90)">{_text(0, 0, up, "middle")}</g>'
    labels = [_text(LEFT, 18, title, "start", "#1c2530", 13), upright, _text(LEFT + ACROSS / 2, TOP + UP + 33, across,
              "middle")]  # fmt: skip
    body = "\n".join([*grid, *parts, *dashed, *legend, *labels])
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        f'role="img" aria-label="{escape(title)}" font-family="system-ui, sans-serif">\n{body}\n</svg>'
    )


def _x(x: float, ends: tuple[float, float]) -> float:
    return LEFT + ACROSS * (x - ends[0]) / (ends[1] - ends[0])


def _y(y: float, y_ticks: Sequence[float]) -> float:
    return TOP + UP * (1 - (y - y_ticks[0]) / (y_ticks[-1] - y_ticks[0]))


def _text(x: float, y: float, text: str, anchor: str, colour: str = "#46525f", size: int = 11) -> str:
    place = f'x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}"'
    halo = 'stroke="#fff" stroke-width="3" paint-order="stroke"'  # readable on lines and bars
    return f'<text {place} {halo} font-size="{size}" fill="{colour}">{escape(text)}</text>'


def _number(value: float) -> str:
    """A tick's number: 12,000,000 is 12M."""
    for unit, letter in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= unit:
            return f"{value / unit:g}{letter}"
    return f"{value:g}"
