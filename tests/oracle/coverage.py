"""The redundancy test of section 3.3.2, one pixel after the other."""

from __future__ import annotations

import numpy as np
from oracle.rays import delta_at


def farther_pixels(view, earlier, delta, edge):
    """True where, in every earlier view that has four pixels around the point, one of these is without depth, or
    their surface is nearer than the point by more than the delta: at a depth edge (a step of disparity of more
    than `edge`) the nearest of them, elsewhere the surface between them."""
    keep = np.ones(view.codes.shape, bool)
    depth = view.camera.depth.depth(view.codes)
    for row, column in np.argwhere(np.isfinite(depth)):
        point = view.camera.unproject((column + 0.5, row + 0.5), depth[row, column])
        for other in earlier:
            (u, v), there = other.camera.project(point)
            if not (there > 0 and 0.5 <= u < other.camera.width - 0.5 and 0.5 <= v < other.camera.height - 0.5):
                continue
            x, y = int(np.floor(u - 0.5)), int(np.floor(v - 0.5))
            seen = other.camera.depth.disparity(other.codes[y : y + 2, x : x + 2])
            across, down = u - 0.5 - x, v - 0.5 - y
            between = np.array([1 - down, down]) @ seen @ np.array([1 - across, across])
            if 1 / (seen.max() if np.ptp(seen) > edge else between) >= there - delta_at(delta, there):  # nan: not
                keep[row, column] = False
    return keep
