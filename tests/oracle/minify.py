"""Halving a view by surfaces, one texel after the other."""

from __future__ import annotations

import numpy as np
from farside.engine.kernels.geometry.cuts import CUT_DOWN, CUT_RIGHT


def one_surface(codes, cuts, y, x):
    """Those of the 2x2 texels at (y, x) that are connected with the nearest one without crossing a cut."""
    square = [(y, x), (y, x + 1), (y + 1, x), (y + 1, x + 1)]

    def joined(one, other):
        first, second = min(one, other), max(one, other)
        if second == (first[0], first[1] + 1):
            return not cuts[first] & CUT_RIGHT
        return second == (first[0] + 1, first[1]) and not cuts[first] & CUT_DOWN

    found = [max(square, key=lambda at: codes[at])]
    for at in found:
        found += [other for other in square if other not in found and joined(at, other)]
    return found


def halve(codes, cuts, planes):
    """Codes [h, w] and planes of the same size at half the size, halves rounded up."""
    h, w = codes.shape[0] // 2, codes.shape[1] // 2
    outs = [np.zeros((h, w), np.uint16) for _ in range(len(planes) + 1)]
    for y in range(h):
        for x in range(w):
            texels = one_surface(codes, cuts, 2 * y, 2 * x)
            for plane, out in zip((codes, *planes), outs, strict=True):
                out[y, x] = int(np.floor(np.mean([plane[at] for at in texels]) + 0.5))
    return outs
