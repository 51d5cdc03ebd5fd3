"""Maximum depth images, one pixel after the other; and settled points of their meshes, one after the other."""

from __future__ import annotations

import numpy as np


def update(image, view, margin_m, margin_disparity):
    """The new (codes, luma, updated) of an image (codes, luma) after a view (codes, luma) of the same camera."""
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


def settle(mesh, camera, codes, margin_m, margin_disparity):
    """Points of a camera's mesh at the mean disparity of the pixels around that show the same surface."""
    moved = mesh.points.copy()
    for i, (u, v) in enumerate(mesh.uv):
        _uv, depth = camera.project(mesh.points[i].astype(float))
        own = camera.depth.disparity(camera.depth.codes(depth))
        found = []
        for row in {int(np.floor(v - 0.25)), int(np.ceil(v - 0.75))}:
            for column in {int(np.floor(u - 0.25)), int(np.ceil(u - 0.75))}:
                if not (0 <= row < codes.shape[0] and 0 <= column < codes.shape[1]):
                    continue
                there = camera.depth.disparity(codes[row, column])
                off = abs(1 / there - 1 / own) > margin_m and abs(there - own) > margin_disparity
                if np.isfinite(there) and not off:
                    found.append(there)
        if found:
            moved[i] = camera.unproject(np.array([u, v], float), 1 / np.mean(found))
    return moved
