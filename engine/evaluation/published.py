"""Figures that the paper gives for its experiments, by table or figure.

Times are milliseconds on the named NVIDIA GPUs: the first of a pair was taken with the headset not synchronised, the
second (in the paper in parentheses) with the headset synchronised at 80 Hz.
"""

from __future__ import annotations

from typing import NamedTuple

__all__ = ["MOVING_MS", "SPBS", "TABLE_3", "UPDATE_LIMIT_MS", "Gpu", "StaticSurface"]


class Gpu(NamedTuple):
    """A row of Table 3: a stereo pair of Museum, filled, by all views (DIBR) and with the model (ours)."""

    name: str
    dibr_ms: tuple[float, float]
    ours_ms: tuple[float, float]

    @property
    def ratio(self) -> float:
        """How many times longer all views take than five views with the model, headset not synchronised."""
        return self.dibr_ms[0] / self.ours_ms[0]


class StaticSurface(NamedTuple):
    """The S-PBS of a sequence: seconds to build it, and its triangles."""

    seconds: float
    triangles: float


# Table 3. It repeats the row Museum of Table 2b for other GPUs.
TABLE_3 = (
    Gpu("3090", (30.36, 46.32), (8.93, 15.31)),
    Gpu("3090, two of them", (16.28, 33.59), (5.13, 13.13)),
    Gpu("A6000", (31.46, 41.03), (9.10, 14.14)),
    Gpu("A6000, two of them", (16.57, 27.06), (5.51, 12.79)),
    Gpu("4090", (16.26, 25.00), (4.33, 12.50)),
)

# Section 4.1, on Fig. 11.
SPBS = {
    "museum": StaticSurface(1.27, 32.82e6),
    "hijack": StaticSurface(0.33, 9.05e6),
    "painter": StaticSurface(0.26, 6.30e6),
    "frog": StaticSurface(0.30, 5.39e6),
}

# Fig. 11b and section 4.2: an update "stably fell below one time interval of video frames".
UPDATE_LIMIT_MS = 1000.0 / 30.0

# Section 4.2: a stereo pair of Gymnasium-a without and with the moving camera.
MOVING_MS = ((3.51, 13.22), (4.60, 15.57))
