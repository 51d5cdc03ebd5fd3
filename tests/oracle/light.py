"""How colours of a maximum depth image follow the light, one quad after the other."""

from __future__ import annotations

import numpy as np
from farside.engine.kernels.background.maximum_depth import PHASES

CELL = 32


def same_surface(new, codes, provisional, margins, edge):
    """Whether a view's codes show the surface of an image's, [h, w]; a pixel that is next to something nearer does
    not."""
    h, w = codes.shape
    coding, margin_m, margin_disparity = margins
    same = np.zeros((h, w), bool)
    for y, x in np.ndindex(h, w):
        a, b = coding.disparity(new[y, x])[()], coding.disparity(codes[y, x])[()]
        if np.isnan(a) or np.isnan(b) or provisional[y, x]:
            continue
        apart = abs(1 / a - 1 / b) > margin_m and abs(a - b) > margin_disparity
        top = y // 2 * 2
        around = new[max(top - 1, 0) : top + 3, max(x - 1, 0) : x + 2]
        same[y, x] = not apart and int(around.max()) <= int(new[y, x]) + edge
    return same


def follow(new, known, same, tone, number, share, active, looks):
    """The planes (y, cb, cr) that are expected on average, float, and the sums of cells [rows, columns, 4].

    new, known: planes (y, cb, cr). active [rows, columns]: the cells in which colours follow; `looks`: all cells
    are summed. tone: (gain, offset, gain, share of luma, offset, gain, share of luma, offset).
    """
    h, w = known[0].shape
    planes = [np.array(plane, float) for plane in known]
    before = [plane.copy() for plane in planes]
    sums = np.zeros((-(-h // CELL), -(-w // CELL), 4))
    for row, column in np.ndindex((h + 1) // 2, (w + 1) // 2):
        if row % PHASES != number % PHASES:
            continue
        ys, xs = [2 * row, min(2 * row + 1, h - 1)], [2 * column, min(2 * column + 1, w - 1)]
        quad = np.ix_(ys, xs)
        raw = new[0][quad].mean()
        seen = tone[0] * raw + tone[1]
        chroma = [tone[2 + 3 * k] * new[1 + k][row, column] + tone[3 + 3 * k] * raw + tone[4 + 3 * k] for k in (0, 1)]
        have = before[0][quad].mean()
        cell = 2 * row // CELL, 2 * column // CELL
        if same[quad].all() and (looks or active[cell]):
            sampled = not active[cell] or column % 4 == row % 4
            if sampled and max(seen, have) <= 920:
                sums[cell] += [1, seen - have, *(chroma[k] - before[1 + k][row, column] for k in (0, 1))]
            for k in (0, 1) if active[cell] else ():
                code = np.floor(np.clip(chroma[k], 0, 1023) + 0.5)
                planes[1 + k][row, column] += share * (code - before[1 + k][row, column])
        for y, x in {(y, x) for y in ys for x in xs}:
            if same[y, x] and active[cell]:
                luma = np.floor(np.clip(tone[0] * new[0][y, x] + tone[1], 0, 1023) + 0.5)
                planes[0][y, x] += share * (luma - before[0][y, x])
    return planes, sums
