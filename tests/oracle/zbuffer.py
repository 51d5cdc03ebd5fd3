"""A z-buffer by rays: every pixel against every triangle, in float64."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Offset of extra rays from a pixel's centre, in pixels: if they do not hit the same triangle, the pixel lies on a
# triangle's side, and rounding decides.
BESIDE_PX = 4e-3


@dataclass(frozen=True)
class Picture:
    """Disparity [h, w] (0: nothing is hit), triangle hit (-1: none), and where a rasteriser must agree on each."""

    disparity: np.ndarray
    triangle: np.ndarray
    sure_of_coverage: np.ndarray
    sure_of_triangle: np.ndarray


def zbuffer(camera, points, triangles, near=0.0):
    """The nearest front faces [m, 3] of points [n, 3] (world) that a camera sees, no nearer than depth `near`."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    directions = camera.unproject(np.stack([u, v], -1), np.ones_like(u)) - camera.pose.position
    width = np.linalg.norm(directions, axis=-1, keepdims=True)
    side = np.cross(directions, camera.pose.rotation() @ np.array([0.3, 0.5, 0.8]))
    side *= BESIDE_PX * _radians_a_pixel(camera) * width / np.linalg.norm(side, axis=-1, keepdims=True)
    down = np.cross(directions, side) / width
    depth, hit = _nearest(camera, directions, points, triangles, near)
    same, covered = np.ones(hit.shape, bool), np.ones(hit.shape, bool)
    for angle in np.arange(8) * np.pi / 4:
        moved = directions + np.cos(angle) * side + np.sin(angle) * down
        _, other = _nearest(camera, moved, points, triangles, near)
        same &= other == hit
        covered &= (other < 0) == (hit < 0)
    return Picture(np.where(hit < 0, 0.0, 1 / depth), hit, covered, same)


def _radians_a_pixel(camera):
    p = camera.projection
    return 1 / abs(p.fx) if hasattr(p, "fx") else (p.hor_range[1] - p.hor_range[0]) / p.width


def _nearest(camera, directions, points, triangles, near):
    """Depth along directions [h, w, 3] and index of the nearest front face, inf and -1 where there is none."""
    rays = directions.reshape(-1, 3)
    a, b, c = np.moveaxis(np.asarray(points, float)[triangles] - camera.pose.position, 1, 0)
    normals = np.cross(b - a, c - a)
    volumes = np.sum(a * normals, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = volumes / (rays @ normals.T)  # [pixels, triangles]
    hit = (volumes < 0) & (depth > near)  # hit from the front, and in front of the eye
    for p, q in ((a, b), (b, c), (c, a)):
        hit &= rays @ np.cross(q, p).T >= 0
    depth = np.where(hit, depth, np.inf)
    number = np.where(hit.any(axis=1), np.argmin(depth, axis=1), -1)
    shape = directions.shape[:2]
    return depth.min(axis=1).reshape(shape), number.reshape(shape)
