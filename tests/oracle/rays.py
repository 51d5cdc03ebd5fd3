"""Rays against triangles, the slow way (Moeller and Trumbore 1997), in float64."""

from __future__ import annotations

import numpy as np


def hit_distances(origin, direction, points, triangles):
    """Distances [m] along the ray to all m triangles, in lengths of `direction`, nan where a triangle is missed."""
    a, b, c = (np.asarray(points, np.float64)[triangles[:, k]] for k in range(3))
    across = np.cross(direction, c - a)
    determinant = np.sum((b - a) * across, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        start = origin - a
        u = np.sum(start * across, axis=1) / determinant
        normal = np.cross(start, b - a)
        v = normal @ direction / determinant
        t = np.sum((c - a) * normal, axis=1) / determinant
        inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return np.where(inside, t, np.nan)


def pixel_ray(camera, u, v, origin=(0.0, 0.0, 0.0)):
    """Start (relative to the origin) and unit direction of the ray from a camera through (u, v)."""
    direction = camera.unproject([u, v], 1.0) - camera.pose.position
    return np.asarray(camera.pose.position) - origin, direction / np.linalg.norm(direction)


def farthest(camera, u, v, points, triangles):
    """(distance, triangle) of the farthest hit behind (u, v); (nan, -1) if there is none."""
    t = hit_distances(*pixel_ray(camera, u, v), points, triangles)
    return (np.nan, -1) if np.all(np.isnan(t)) else (float(np.nanmax(t)), int(np.nanargmax(t)))


def delta_at(delta, distance):
    """delta at a distance, metres: delta[0], or the error of disparity delta[1] (1/m) where that is more."""
    return max(delta[0], delta[1] * distance**2)


def marked(camera, uvs, points, triangles, delta):
    """Triangles that culling rays through the given picture positions mark as background (Fig. 6a)."""
    result = np.zeros(len(triangles), bool)
    for u, v in uvs:
        t = hit_distances(*pixel_ray(camera, u, v), points, triangles)
        if not np.all(np.isnan(t)):
            result |= t >= np.nanmax(t) - 0.5 * delta_at(delta, np.nanmax(t))
    return result


def background(cameras, samples, points, triangles, delta):
    """[cameras, triangles]: whether a camera has no surface more than delta / 2 behind a sample point of a triangle."""
    result = np.zeros((len(cameras), len(triangles)), bool)
    for c, camera in enumerate(cameras):
        start = np.asarray(camera.pose.position)
        for i, corners in enumerate(points[triangles].astype(np.float64)):
            for p, q in samples:
                at = np.array([p, q, 1 - p - q]) @ corners
                (u, v), depth = camera.project(at)
                if not (depth > 0 and 0 <= u < camera.width and 0 <= v < camera.height):
                    continue
                distance = np.linalg.norm(at - start)
                t = hit_distances(start, (at - start) / distance, points, triangles)
                t[i] = np.nan
                result[c, i] |= not np.any(t > distance + 0.5 * delta_at(delta, distance))
    return result
