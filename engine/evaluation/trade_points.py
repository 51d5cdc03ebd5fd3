"""Results of a sweep of `trade` over all sequences and twins: a point for each variant, and the best of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .trade import Row
from .trade_variants import Variant

__all__ = ["Point", "pareto", "summarise"]


@dataclass(frozen=True, slots=True)
class Point:
    """A variant over all materials (sequences and twins).

    iv_psnr, sent: mean gain over the base, dB. time, total, update, first, bytes: geometric means of ratios to the
    base. holes: mean fraction of pixels after the backdrop. The names are those of `trade.Row`.
    """

    kind: str
    knob: str
    value: str
    iv_psnr: float
    sent: float
    time: float
    total: float
    update: float
    first: float
    holes: float
    bytes: float

    @property
    def label(self) -> str:
        """The variant's name in tables and plots."""
        return self.value if self.kind in ("preset", "ladder") else f"{self.knob} {self.value}"


def summarise(rows: Sequence[Row], swept: Sequence[Variant]) -> list[Point]:
    """A point over all materials for each variant that has rows."""
    points = []
    for variant in swept:
        base = next(other for other in swept if other.is_base and other.base == variant.base)
        own, against = ([row for row in rows if _names(row) == _names(v)] for v in (variant, base))
        if own:
            points.append(_point(variant, own, against))
    return points


def _names(of: Row | Variant) -> tuple[str, str, str]:
    return of.kind, of.knob, of.value


def _point(variant: Variant, own: Sequence[Row], base: Sequence[Row]) -> Point:
    gains = {
        name: float(np.mean([getattr(a, name) - getattr(b, name) for a, b in zip(own, base, strict=True)]))
        for name in ("iv_psnr", "sent")
    }
    ratios = {name: _geometric(getattr(row, name) for row in own) for name in ("time", "total", "update", "first")}
    size = _geometric(a.bytes / b.bytes for a, b in zip(own, base, strict=True))
    holes = float(np.mean([row.holes_backdrop for row in own]))
    return Point(variant.kind, variant.knob, variant.value, **gains, **ratios, holes=holes, bytes=size)


def _geometric(ratios: Iterator[float]) -> float:
    return float(np.exp(np.mean(np.log(np.maximum(list(ratios), 1e-9)))))


def pareto(points: Sequence[Point], cost: str, worth: str, least: float = 0.02) -> list[Point]:
    """The points that no other point beats in both `cost` and `worth`, cheapest first.

    `cost` and `worth` are names of figures. Each point is worth at least `least` more than the one before it. Points of
    the model's knobs are left out, because they have another base.
    """
    front: list[Point] = []
    for point in sorted(points, key=lambda p: (getattr(p, cost), -getattr(p, worth))):
        if point.kind != "model" and (not front or getattr(point, worth) >= getattr(front[-1], worth) + least):
            front.append(point)
    return front
