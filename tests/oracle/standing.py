"""Which surface behind a pixel still stands, the slow way: every hit of a ray in order is tested in every view."""

from __future__ import annotations

import numpy as np
from oracle.rays import delta_at, hit_distances, pixel_ray


def _texels(camera, codes, point, delta):
    """Codes of the four texels around a point's image in a view, and its depth there; no codes without an image."""
    (u, v), depth = camera.project(point)
    h, w = codes.shape
    if not (depth > delta_at(delta, depth) and 0.5 <= u <= w - 0.5 and 0.5 <= v <= h - 0.5):
        return codes[:0], depth
    x, y = min(int(u - 0.5), w - 2), min(int(v - 0.5), h - 2)
    return codes[y : y + 2, x : x + 2], depth


def looks_through(camera, codes, point, delta):
    """Whether a view's depths on the texels around the point's image are all more than delta behind the point."""
    texels, depth = _texels(camera, codes, point, delta)
    limit = depth + delta_at(delta, depth)
    return bool(texels.size and np.all(camera.depth.depth(texels) > limit))  # nan: nothing known


def shows(camera, edge, codes, point, delta):
    """Whether these texels are one surface, without a step of more than `edge` codes, within delta of the point."""
    texels, depth = _texels(camera, codes, point, delta)
    depths = camera.depth.depth(texels)
    if not texels.size or np.isnan(depths).any() or np.ptp(texels.astype(int)) > edge:
        return False
    around = delta_at(delta, depth)
    return bool(depths.min() <= depth + around and depths.max() >= depth - around)


def standing(camera, u, v, near, meshes, views, delta, instead=None, late=()):
    """(distance, mesh, triangle) of the surface shown behind (u, v); the distance is nan if there is none.

    meshes: (points, triangles, owner); views: (camera, edge, present, memory), owners index them. instead: camera and
    present codes of some views, by index, instead of theirs. late: owners of meshes that stand unless a view sees past
    them now, whatever it has seen before.
    """
    start, direction = pixel_ray(camera, u, v)
    axis = camera.unproject([u, v], 1.0) - np.asarray(camera.pose.position)
    beyond = near * np.linalg.norm(axis)
    hits = []
    for number, (points, triangles, _owner) in enumerate(meshes):
        t = hit_distances(start, direction, points, triangles)
        hits += [(t[i], number, i) for i in np.flatnonzero(t > beyond)]
    hits.sort()
    for t, number, i in hits:
        point = start + t * direction
        owner, edge, present, _memory = views[meshes[number][2]]
        owner, present = (instead or {}).get(meshes[number][2], (owner, present))
        if shows(owner, edge, present, point, delta):
            return t, number, i
        if t >= hits[-1][0] - delta_at(delta, hits[-1][0]):
            return hits[-1]
        asked = [(view, memory) for view, _edge, _present, memory in views]
        if meshes[number][2] in late:
            now = [(view, present) for view, _edge, present, _memory in views]
            asked = [(instead or {}).get(k, one) for k, one in enumerate(now)]
        if not any(looks_through(view, codes, point, delta) for view, codes in asked):
            return t, number, i
    return hits[-1] if hits else (np.nan, -1, -1)
