"""Maximum depth images, one pixel after the other."""

from __future__ import annotations

import numpy as np


def update(image, view, margin_m, margin_disparity):
    """New (codes, luma, updated) of an image (codes, luma) that sees a view (codes, luma) of the same camera."""
    coding = view.camera.depth
    codes, luma = image[0].copy(), image[1].copy()
    updated = np.zeros(codes.shape, bool)
    for at in np.ndindex(codes.shape):
        new, old = coding.disparity(view.codes[at])[()], coding.disparity(codes[at])[()]
        if np.isnan(new):
            continue
        farther = 1 / new > 1 / old + margin_m and new < old - margin_disparity
        if np.isnan(old) or farther:
            codes[at], luma[at], updated[at] = view.codes[at], view.texture.y[at], True
    return codes, luma, updated
