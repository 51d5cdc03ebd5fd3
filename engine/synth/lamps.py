"""Lamps that are dimmed and change their colour while a sequence plays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..support.array_types import F64

__all__ = ["Dimming", "Fade"]


@dataclass(frozen=True, slots=True)
class Fade:
    """A lamp (its number) whose light changes evenly from `start` on for `seconds`; then the shares `left` of its red,
    green and blue are left."""

    lamp: int
    start: float
    seconds: float
    left: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Dimming:
    """How the light of a scene's lamps, `count` of them, changes with time: each has one fade at most."""

    count: int
    fades: Sequence[Fade]

    @property
    def start(self) -> float:
        """When the first lamp begins to change, seconds."""
        return min(fade.start for fade in self.fades)

    @property
    def end(self) -> float:
        """From when on no lamp changes any more, seconds."""
        return max(fade.start + fade.seconds for fade in self.fades)

    def shares(self, time: float) -> F64:  # [count, 3]
        """The shares of red, green and blue of each lamp's light that are left at `time`, seconds."""
        shares = np.ones((self.count, 3))
        for fade in self.fades:
            done = min(max((time - fade.start) / fade.seconds, 0.0), 1.0)
            shares[fade.lamp] += done * (np.array(fade.left) - 1.0)
        return shares
