"""A view's contribution to a pixel of a picture, in double precision: its share and its luma (blending one view)."""

from __future__ import annotations

import numpy as np
from farside.engine.kernels.geometry.cuts import CUT_DOWN, CUT_RIGHT


def look(view, cuts, edge, tolerance, eye, uv, disparity):
    """(share, luma, (u, v), margin). The share is 0 if the view has another depth there, or none. `margin` is the
    smallest change, in codes, with which a decision would go the other way."""
    camera, codes = view.camera, view.codes.astype(float)
    (u, v), depth = camera.project(eye.unproject(uv, 1.0 / disparity))
    h, w = codes.shape
    if not (depth > 0 and 0 <= u <= w and 0 <= v <= h):
        return 0.0, 0.0, (u, v), np.inf
    x, y = np.clip(u - 0.5, 0, w - 1), np.clip(v - 0.5, 0, h - 1)
    x0, y0 = min(int(x), w - 2), min(int(y), h - 2)
    weights = np.outer([1 - (y - y0), y - y0], [1 - (x - x0), x - x0])
    around = codes[y0 : y0 + 2, x0 : x0 + 2]
    wanted = (1.0 / depth - camera.depth.offset) / camera.depth.step
    least = 1.0 if camera.depth.has_invalid else 0.0
    here, below, right = cuts[y0, x0], cuts[y0 + 1, x0], cuts[y0, x0 + 1]
    cut = (here & (CUT_RIGHT | CUT_DOWN)) | (below & CUT_RIGHT) | (right & CUT_DOWN)
    whole = around.min() >= least and (np.ptp(around) <= edge or not cut)
    if whole:
        off = abs((weights * around).sum() - wanted)
        share, margin = float(off <= tolerance), abs(off - tolerance)
    else:
        off = np.abs(around - wanted)
        weights = np.where((off <= 0.5 * edge + tolerance) & (around >= least), weights, 0.0)
        share, margin = weights.sum(), np.abs(off - 0.5 * edge - tolerance).min()
        weights = weights / max(share, 1e-3)
        margin = 0.0 if share < 2e-3 else margin
    luma = (weights * view.texture.y[y0 : y0 + 2, x0 : x0 + 2]).sum()
    return share, luma, (u, v), margin
