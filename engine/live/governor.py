"""Holds a frame rate: moves along a ladder of settings as load changes, down quickly, up only when the next rung fits.

It measures the time from the request for a viewer's pair until the pair is there, including the wait for a thread; the
slowest viewer counts. The time on another rung is predicted from the time on the present one and the ratio of their
costs. If a climb has shown that a rung costs more on this machine, that is remembered for a while. The caller provides
the clock.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..settings import PER_PICTURE, QUALITIES, Settings

__all__ = ["LADDER", "Governor", "Rung", "make_ladder"]


@dataclass(frozen=True, slots=True)
class Rung:
    """A point on the ladder; `cost`: time to render and encode a pair, relative to `balanced`."""

    name: str
    cost: float
    settings: Settings


# Name, cost, preset, and changes to the preset: points of the front that `farside bench --trade` prints, cheapest
# first, with the costs that it has measured.
LADDER: tuple[tuple[str, float, str, Mapping[str, object]], ...] = (
    ("fast, half size", 0.20, "fast", {"output_scale": 0.5, "n_render": 3}),
    ("fast, 0.7 of the size", 0.26, "fast", {"output_scale": 0.7, "n_render": 3}),
    ("fast", 0.42, "fast", {}),
    ("balanced, two views", 0.66, "balanced", {"n_render": 2}),
    ("balanced, three views", 0.85, "balanced", {"n_render": 3}),
    ("balanced", 1.00, "balanced", {}),
    ("best", 1.94, "best", {}),
)


def make_ladder(quality: str, **given: object) -> list[Rung]:
    """The rungs up to the preset `quality`, cheapest first; the settings in `given` hold on all of them.

    The settings of the model and of the meshes are the preset's on all rungs: rungs differ only in settings that
    rendering reads (`PER_PICTURE`). Raises ValueError for the preset `paper`, which has no cheaper points.
    """
    if quality not in QUALITIES:
        raise ValueError(
            f"quality: {quality!r}: expected one of {', '.join(QUALITIES)} where a frame rate is to be held "
            "(target_fps): others have no cheaper settings to move to"
        )
    top = Settings.preset(quality, **given)
    highest = max(number for number, (_, _, preset, _) in enumerate(LADDER) if preset == quality)
    rungs: list[Rung] = []
    for name, cost, preset, changes in LADDER[: highest + 1]:
        rung = Settings.preset(preset, **{**changes, **given})
        settings = replace(top, **{knob: getattr(rung, knob) for knob in PER_PICTURE})
        if all(settings != other.settings for other in rungs):
            rungs.append(Rung(name, cost, settings))
    return rungs


class Governor:
    """Chooses the rung; begins at the top. Used by one thread. Raises ValueError for rungs that are not in ascending
    order of cost, and for a target that is not positive."""

    WINDOW = 9  # number of a viewer's pictures in the mean, which leaves out the slowest: a single hitch is not load
    FEWEST = 3  # number of pictures before a step down; if their median is far too slow, it does not wait for the mean
    FAR, SLOW, FITS = 1.3, 1.06, 0.88  # shares of the target's time: far too slow, too slow, fast enough for a rung
    DWELL_S = 1.5  # least time on a rung before a climb
    TRIAL_S = 5.0  # a fall within this time after a climb shows that the rung costs more than predicted
    FORGET_S = 30.0  # time after which half of that knowledge is forgotten
    SILENT_S = 2.0  # a viewer without pictures for this time does not count

    def __init__(self, rungs: Sequence[Rung], target_fps: float) -> None:
        if not rungs or any(a.cost >= b.cost for a, b in itertools.pairwise(rungs)):
            raise ValueError(f"rungs: costs {[rung.cost for rung in rungs]}: expected some, in ascending order")
        if not (math.isfinite(target_fps) and target_fps > 0):
            raise ValueError(f"target_fps: {target_fps!r}: expected a number above 0")
        self.rungs, self.target_fps = tuple(rungs), target_fps
        self.changes = 0
        self._at = len(self.rungs) - 1
        self._times: dict[str, deque[float]] = {}
        self._seen: dict[str, float] = {}
        self._since = -math.inf  # when the rung was chosen
        self._climb: tuple[float, float] | None = None  # time of the last climb, and the predicted time of a pair
        self._dearer: dict[int, tuple[float, float]] = {}  # rung -> when it was too expensive, and by what factor
        self._reason = "waiting for pictures"

    @property
    def rung(self) -> Rung:
        """The rung that pictures are rendered on now."""
        return self.rungs[self._at]

    def observe(self, viewer: str, seconds: float, now: float) -> bool:
        """Note that a viewer's pair took `seconds`, at time `now` (s); returns whether the rung has changed."""
        self._times.setdefault(viewer, deque(maxlen=self.WINDOW)).append(seconds)
        self._seen[viewer] = now
        for name in [name for name, last in self._seen.items() if last < now - self.SILENT_S]:
            del self._times[name], self._seen[name]
        took, budget = self._slowest(self.FEWEST), 1.0 / self.target_fps
        if took is None:
            return False
        latest = self._latest()
        if took > self.SLOW * budget or latest > self.FAR * budget:
            return self._fall(max(took, latest), budget, now)
        return self._rise(budget, now)

    def _latest(self) -> float:
        """Median time of the last FEWEST pictures, for the viewer for whom it is longest."""
        return max(sorted(list(times)[-self.FEWEST :])[self.FEWEST // 2] for times in self._times.values())

    def _slowest(self, least: int) -> float | None:
        """Mean time of the slowest viewer's pictures, without the slowest one; None if a viewer has less than `least`.
        """
        if not self._times or min(map(len, self._times.values())) < least:
            return None
        return max((sum(times) - max(times)) / (len(times) - 1) for times in self._times.values())

    def _fall(self, took: float, budget: float, now: float) -> bool:
        if self._climb is not None and now - self._climb[0] < self.TRIAL_S:
            self._dearer[self._at] = now, max(took / self._climb[1], 1.0) * self._factor(self._at, now)
        fitting = [k for k in range(self._at) if self._predicted(k, took, now) <= self.FITS * budget]
        if self._at == 0:
            self._reason = "slower than the target on the lowest rung"
            return False
        self._climb = None
        return self._go(max(fitting, default=0), now, f"{1e3 * took:.1f} ms were too slow")

    def _rise(self, budget: float, now: float) -> bool:
        took, up = self._slowest(self.WINDOW), self._at + 1
        if up == len(self.rungs):
            self._reason = "the highest rung fits"
        elif took is None or now - self._since < self.DWELL_S:
            self._reason = "settling"
        elif (wanted := self._predicted(up, took, now)) <= self.FITS * budget:
            self._climb = now, wanted
            return self._go(up, now, f"{1e3 * wanted:.1f} ms were predicted")
        else:
            self._reason = f"{self.rungs[up].name} would take {1e3 * wanted:.1f} ms"
        return False

    def _predicted(self, rung: int, took: float, now: float) -> float:
        ratio = self.rungs[rung].cost / self.rung.cost
        return took * ratio * self._factor(rung, now) / self._factor(self._at, now)

    def _factor(self, rung: int, now: float) -> float:
        """The ratio of a rung's real cost, as a climb has shown, to its listed cost."""
        since, factor = self._dearer.get(rung, (now, 1.0))
        return float(factor ** (0.5 ** ((now - since) / self.FORGET_S)))

    def _go(self, rung: int, now: float, reason: str) -> bool:
        self._at, self._since, self._reason = rung, now, reason
        self.changes += 1
        for times in self._times.values():
            times.clear()
        return True

    def status(self, now: float) -> dict[str, Any]:
        """The present rung and the reason for it; milliseconds of a pair, measured on this rung and predicted for the
        others, None until there are enough pictures."""
        took = self._slowest(self.FEWEST)
        times = [None if took is None else 1e3 * self._predicted(k, took, now) for k in range(len(self.rungs))]
        return {
            "target_fps": self.target_fps,
            "rung": self.rung.name,
            "reason": self._reason,
            "changes": self.changes,
            "measured_ms": None if took is None else 1e3 * took,
            "predicted_ms": dict(zip((rung.name for rung in self.rungs), times, strict=True)),
        }
