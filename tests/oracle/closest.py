"""The place on each triangle that is nearest to a point, the slow way: on its plane, or else on one of its sides."""

from __future__ import annotations

import numpy as np


def closest_places(point, corners):
    """Places [m, 3] on triangles, corners [m, 3, 3], float64. Triangles without area count as their sides."""
    best, least = np.full((len(corners), 3), np.nan), np.full(len(corners), np.inf)

    def offer(places, allowed):
        distances = np.where(allowed, np.linalg.norm(places - point, axis=1), np.inf)
        nearer = distances < least
        best[nearer], least[nearer] = places[nearer], distances[nearer]

    a, b, c = (corners[:, k] for k in range(3))
    normal = np.cross(b - a, c - a)
    square = np.maximum(np.sum(normal * normal, axis=1), 1e-300)
    foot = point - (np.sum((point - a) * normal, axis=1) / square)[:, None] * normal
    sides = [np.sum(np.cross(q - p, foot - p) * normal, axis=1) for p, q in ((a, b), (b, c), (c, a))]
    offer(foot, np.all([side >= 0 for side in sides], axis=0) & (square > 1e-24))
    for p, q in ((a, b), (b, c), (c, a)):
        length = np.maximum(np.sum((q - p) ** 2, axis=1), 1e-300)
        t = np.clip(np.sum((point - p) * (q - p), axis=1) / length, 0.0, 1.0)
        offer(p + t[:, None] * (q - p), True)
    return best
