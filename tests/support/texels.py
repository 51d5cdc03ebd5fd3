"""Samples of pictures."""

from __future__ import annotations

import numpy as np

__all__ = ["at"]


def at(rgb, uv):
    """Bilinear samples of a picture [h, w, 3] at pixel coordinates [n, 2], as a graphics card takes them."""
    (x0, y0), (fx, fy) = np.floor(uv - 0.5).astype(int).T, ((uv - 0.5) % 1.0).T
    weights = [(1 - fx) * (1 - fy), fx * (1 - fy), (1 - fx) * fy, fx * fy]
    h, w = rgb.shape[:2]
    texels = [rgb[np.clip(y0 + k // 2, 0, h - 1), np.clip(x0 + k % 2, 0, w - 1)] for k in range(4)]
    return sum(weight[:, None] * texel for weight, texel in zip(weights, texels, strict=True))
