"""The redundancy test of section 3.3.2, one pixel after the other."""

from __future__ import annotations

import numpy as np


def farther_pixels(view, earlier, tolerance):
    """True where, in every earlier view that has four pixels around the point, one of these is
    without depth, or nearer than the point by more than the tolerance."""
    keep = np.ones(view.codes.shape, bool)
    depth = view.camera.depth.depth(view.codes)
    for row, column in np.argwhere(np.isfinite(depth)):
        point = view.camera.unproject((column + 0.5, row + 0.5), depth[row, column])
        for other in earlier:
            (u, v), there = other.camera.project(point)
            if not (there > 0 and 0.5 <= u < other.camera.width - 0.5 and 0.5 <= v < other.camera.height - 0.5):
                continue
            x, y = int(np.floor(u - 0.5)), int(np.floor(v - 0.5))
            seen = other.camera.depth.depth(other.codes[y : y + 2, x : x + 2])
            if np.all(there - tolerance <= seen):
                keep[row, column] = False
    return keep
