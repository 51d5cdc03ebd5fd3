"""The pyramid that fills holes, cell by cell in double precision; a cell is (weight, disparity, y, cb, cr)."""

from __future__ import annotations

import numpy as np


def worth(disparity, farthest):
    """Weight of a surface next to a farther one."""
    return (farthest / disparity) ** 8


def coarser(fine):
    """The next coarser level: means of 2 x 2 cells, in which farther surfaces weigh more."""
    h, w = fine.shape[:2]
    level = np.zeros(((h + 1) // 2, (w + 1) // 2, 5))
    for j, i in np.ndindex(level.shape[:2]):
        cells = fine[2 * j : 2 * j + 2, 2 * i : 2 * i + 2].reshape(-1, 5).astype(float)
        farthest = cells[:, 1].min()
        shares = np.array([weight * worth(q, farthest) if weight > 0 else 0.0 for weight, q in cells[:, :2]])
        total = shares.sum()
        colour = shares @ np.where(shares[:, None] > 0, cells[:, 2:], 0.0) / total if total > 0 else np.zeros(3)
        level[j, i] = min(total, 1.0), farthest, *colour
    return level


def refined(coarse, fine):
    """Colours [h, w, 3] of a level: a cell's missing weight goes to the four nearest cells of the coarser level."""
    colours = fine[..., 2:].astype(float)
    rows, columns = coarse.shape[:2]
    for j, i in np.ndindex(fine.shape[:2]):
        weight = float(fine[j, i, 0])
        if weight >= 1.0:
            continue
        (y, down), (x, across) = _between(0.5 * j - 0.25, rows), _between(0.5 * i - 0.25, columns)
        at = [(min(y + a, rows - 1), min(x + b, columns - 1)) for a in (0, 1) for b in (0, 1)]
        between = np.outer([1 - down, down], [1 - across, across]).ravel() + 1e-6
        cells = np.array([coarse[place] for place in at], float)
        shares = between * np.maximum(worth(cells[:, 1], cells[:, 1].min()), 1e-6)
        colours[j, i] = weight * colours[j, i] + (1.0 - weight) * (shares @ cells[:, 2:] / shares.sum())
    return colours


def _between(place, count):
    """The first of the two cells around a place, and the fraction of the way to the second: 0 or 1 at a border."""
    first = int(np.clip(np.floor(place), 0, max(count - 2, 0)))
    return first, float(np.clip(place - first, 0, 1))
