"""Depth completion in plain loops in double precision, the oracle of `farside.engine.kernels.geometry.complete`."""

from __future__ import annotations

import numpy as np


def spring(a, b):
    """Strength of the bond between two cells a and b (confidence, code, y, cb, cr)."""
    return 1.0 / (1.0 + (np.abs(a[2:] - b[2:]).sum() / 32.0) ** 2)


def halved(level):
    """The next level [rows, columns, 5]: codes are means of measured cells, colours of all cells; borders repeat."""
    h, w = level.shape[:2]
    out = np.zeros(((h + 1) // 2, (w + 1) // 2, 5))
    for j, i in np.ndindex(out.shape[:2]):
        cells = [level[min(2 * j + b, h - 1), min(2 * i + a, w - 1)] for b in (0, 1) for a in (0, 1)]
        measured = [cell[1] for cell in cells if cell[0] == 1.0]
        out[j, i, 2:] = np.mean([cell[2:] for cell in cells], axis=0)
        if measured:
            # At the border a coarse cell's two halves are the same fine cell, which then counts twice.
            out[j, i, :2] = 1.0, np.mean(measured)
    return out


def pushed(coarse, cell, j, i):
    """Confidence and code of a cell (j, i) from the level above."""
    rows, columns = coarse.shape[:2]
    trust, total, weights = 0.0, 0.0, 0.0
    for b in (0, 1):
        for a in (0, 1):
            y = np.clip(j // 2 + b * (1 if j % 2 else -1), 0, rows - 1)
            x = np.clip(i // 2 + a * (1 if i % 2 else -1), 0, columns - 1)
            other = coarse[y, x]
            weight = (0.25 if b else 0.75) * (0.25 if a else 0.75) * spring(other, cell)
            trust += weight * other[0]
            weights += weight * (other[0] + 1e-3)
            total += weight * (other[0] + 1e-3) * other[1]
    return 0.8 * trust, total / weights


def relax(level, measured):
    """One sweep over the cells that are not measured, black cells of the chess board first."""
    h, w = level.shape[:2]
    for colour in (0, 1):
        for j, i in np.ndindex(h, w):
            if (j + i) % 2 == colour and not measured[j, i]:
                around = [(max(j - 1, 0), i), (min(j + 1, h - 1), i), (j, max(i - 1, 0)), (j, min(i + 1, w - 1))]
                bonds = [spring(level[at], level[j, i]) for at in around]
                level[j, i, 1] = np.dot(bonds, [level[at][1] for at in around]) / np.sum(bonds)


def complete(codes, y, cb, cr, edge):
    """Completed codes and confidence [h, w], floating point, unrounded."""
    h, w = codes.shape
    full = np.zeros((h, w, 5))
    full[..., 0], full[..., 1], full[..., 2] = codes > 0, codes, y
    full[..., 3] = np.repeat(np.repeat(cb, 2, 0), 2, 1)[:h, :w]
    full[..., 4] = np.repeat(np.repeat(cr, 2, 0), 2, 1)[:h, :w]
    levels = [full]
    while levels[-1].shape[0] * levels[-1].shape[1] > 1:
        levels.append(halved(levels[-1]))
    for coarse, fine in zip(levels[:1:-1], levels[-2:0:-1], strict=True):
        measured = fine[..., 0] == 1.0
        for j, i in zip(*np.nonzero(~measured), strict=True):
            fine[j, i, :2] = pushed(coarse, fine[j, i], j, i)
        relax(fine, measured)
    out, confidence = codes.astype(float), np.full((h, w), 255.0)
    for j, i in zip(*np.nonzero(codes == 0), strict=True):
        pairs = [((max(j - 1, 0), i), (min(j + 1, h - 1), i)), ((j, max(i - 1, 0)), (j, min(i + 1, w - 1)))]
        ends = [(float(codes[a]), float(codes[b])) for a, b in pairs]
        bridges = [np.mean(pair) for pair in ends if min(pair) > 0 and abs(pair[0] - pair[1]) <= edge]
        if bridges:
            out[j, i], confidence[j, i] = np.mean(bridges), 254.0
        else:
            trust, out[j, i] = pushed(levels[1], full[j, i], j, i)
            confidence[j, i] = 254.0 * trust
    return out, confidence
