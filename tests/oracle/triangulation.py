"""Triangulation of depth codes, one quad after the other: the surface, without the merging of triangles.

A quad is cut into eighths by its diagonals and its middle lines: every half quad, every quarter around a corner
and every merged triangle is a union of eighths. `covered` counts triangles over each of them.
"""

from __future__ import annotations

import numpy as np

# A point inside each eighth of a quad, (u, v) from its first pixel's centre.
EIGHTHS = np.array([(2, 4), (4, 2), (6, 2), (8, 4), (8, 6), (6, 8), (4, 8), (2, 6)]) / 10


def is_cut(row, i, edge, has_invalid, wraps):
    """Whether a depth edge lies between the codes i and i + 1 of a row (or column) of codes."""

    def code(k, instead):
        if not wraps and not 0 <= k < len(row):
            return instead
        value = int(row[k % len(row)])
        return instead if has_invalid and value == 0 else value

    a, b = int(row[i]), int(row[(i + 1) % len(row)])
    if has_invalid and 0 in (a, b):
        return True
    slope = min(abs(a - code(i - 1, a)), abs(code(i + 2, b) - b))
    return abs(b - a) > edge and abs(b - a) > edge + 1.5 * slope


class Quads:
    """Cuts between the pixels of a depth map, and the surface that they leave."""

    def __init__(self, codes, edge, has_invalid, wraps, keep=None):
        h, w = codes.shape
        self.width, self.rows, self.columns = w, h - 1, w if wraps else w - 1
        self.valid = (codes > 0) | (not has_invalid)
        self.keep = np.ones((h, w), bool) if keep is None else keep > 0
        self.right = np.zeros((h, w), bool)
        self.down = np.zeros((h, w), bool)
        for y, x in np.ndindex(h, w):
            if x + 1 < w or wraps:
                self.right[y, x] = is_cut(codes[y], x, edge, has_invalid, wraps)
            if y + 1 < h:
                self.down[y, x] = is_cut(codes[:, x], y, edge, has_invalid, False)

    def between(self, p, q):
        """Whether a depth edge lies between two 4-neighbours, (x, y) each."""
        (ax, ay), (_, by) = min(p, q), max(p, q)
        return self.right[ay, ax % self.width] if ay == by else self.down[ay, ax % self.width]

    def is_cut(self, x, y):
        """Whether a depth edge crosses a side of the quad at (x, y)."""
        corners = [(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)]
        return any(self.between(corners[k], corners[k - 1]) for k in range(4))

    def halves(self, x, y):
        """The halves of a quad as (a, b, c) with the right angle at c; diagonals join pixels with even x + y."""
        for c in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)]:
            if sum(c) % 2:
                yield (2 * x + 1 - c[0], c[1]), (c[0], 2 * y + 1 - c[1]), c

    def triangles(self):
        """Every half quad of the surface, as a set of three pixels (x, y)."""
        found = []
        for y, x in np.ndindex(self.rows, self.columns):
            for a, b, c in self.halves(x, y):
                kept = any(self.keep[q, p % self.width] for p, q in (a, b, c))
                if kept and not self.between(a, c) and not self.between(b, c):
                    found.append(frozenset((a, b, c)))
        return found

    def surface(self):
        """Eighths [rows, columns, 8] of the surface."""
        half_quads = [[np.array(corner, float) for corner in half] for half in self.triangles()]
        return covered(half_quads, self.rows, self.columns)

    def rims(self):
        """Eighths of cut quads that belong to the quarters of valid, kept corners."""
        out = np.zeros((self.rows, self.columns, 8), int)
        for y, x in np.ndindex(self.rows, self.columns):
            if self.is_cut(x, y):
                for k, (u, v) in enumerate(EIGHTHS):
                    px, py = (x + round(u)) % self.width, y + round(v)
                    out[y, x, k] = self.valid[py, px] and self.keep[py, px]
        return out

    def cut(self):
        """Eighths of quads that a depth edge crosses."""
        out = np.zeros((self.rows, self.columns, 8), int)
        for y, x in np.ndindex(self.rows, self.columns):
            out[y, x] = self.is_cut(x, y)
        return out


def barycentric(triangle, points):
    """Barycentric coordinates [..., 3] of points [..., 2] in a triangle of three (u, v)."""
    a, b, c = (np.asarray(corner, float) for corner in triangle)
    inverse = np.linalg.inv(np.stack([b - a, c - a], axis=1))
    weights = (points - a) @ inverse.T
    return np.concatenate([1 - weights.sum(-1, keepdims=True), weights], axis=-1)


def covered(triangles, rows, columns):
    """For each eighth, the number of triangles (three (u, v) from the first pixel's centre) that cover it."""
    corners = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
    points = corners[:, :, None] + EIGHTHS
    count = np.zeros(points.shape[:3], int)
    for triangle in triangles:
        (x0, y0), (x1, y1) = np.floor(np.min(triangle, 0)).astype(int), np.ceil(np.max(triangle, 0)).astype(int)
        near = np.s_[y0:y1, x0:x1]
        count[near] += (barycentric(triangle, points[near]) > 0).all(-1)
    return count
