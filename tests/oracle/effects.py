"""Projected pictures and added meshes, pixel by pixel, with cameras of the rig instead of packed ones."""

from __future__ import annotations

import math

import numpy as np
from oracle.zbuffer import zbuffer

BLACK, GREY, OPAQUE = 64, 512, 1023


def before_push(disparity, push):
    """The disparity of a backdrop's pixel before it was moved away, by bisection of the way there."""
    low, high = disparity, 1e6
    for _ in range(200):
        q = 0.5 * (low + high)
        moved = q * q / (q + max(push[0] * q * q, push[1]))
        low, high = (q, high) if moved < disparity else (low, q)
    return 0.5 * (low + high)


def four(size, u, v):
    """The four texels around (u, v), pixels, and their bilinear weights."""
    x, y = math.floor(u - 0.5), math.floor(v - 0.5)
    fx, fy = u - 0.5 - x, v - 0.5 - y
    for k in range(4):
        i, j = x + k % 2, y + k // 2
        yield i, j, (fx if k % 2 else 1 - fx) * (fy if k // 2 else 1 - fy), 0 <= i < size[0] and 0 <= j < size[1]


def share_lit(map_camera, depths, point, depth, around):
    """The share of the four texels of a shadow map around a point that are no farther from it than `around`, metres. If
    they are one surface, the point may lie between them."""
    texels, weights = [], []
    for i, j, weight, _ in four((map_camera.width, map_camera.height), *map_camera.project(point)[0]):
        texels.append(depths[min(max(j, 0), map_camera.height - 1), min(max(i, 0), map_camera.width - 1)])
        weights.append(weight)
    texels = np.array(texels)
    range_of_disparity = np.ptp(1 / texels)  # NaN where one of them has no depth
    if range_of_disparity <= 2 * (1 / (depth - around) - 1 / (depth + around)):
        return float(texels.min() - around <= depth <= texels.max() + around)
    return float(np.sum(weights, where=np.abs(texels - depth) <= around))


def project(eye, planes, disparity, backdrop, push, projector, levels, shadow_map, delta, strength, adds):
    """New planes after a picture was thrown on them. backdrop [h, w]: pixels of it. levels: pictures [h, w, 4], each
    half as large as the one before. shadow_map: a camera, and its depths [h, w], NaN: none."""
    out = [plane.astype(float).copy() for plane in planes]
    map_camera, depths = shadow_map
    radians = 1 / math.sqrt(abs(eye.projection.fx * eye.projection.fy)) if hasattr(eye.projection, "fx") else (
        eye.projection.hor_range[1] - eye.projection.hor_range[0]
    ) / eye.projection.width  # fmt: skip
    for y, x in np.argwhere(disparity > 0):
        q = float(disparity[y, x])
        q = before_push(q, push) if backdrop[y, x] else q
        point = eye.unproject(np.array([x + 0.5, y + 0.5]), 1 / q)
        (u, v), depth = projector.project(point)
        if not (depth > 0 and -0.5 < u < projector.width + 0.5 and -0.5 < v < projector.height + 0.5):
            continue
        lit = share_lit(map_camera, depths, point, depth, max(delta[0], delta[1] * depth**2))
        texels, level = radians / q * projector.projection.fx / depth, 0
        while texels > 1.5 and level < len(levels) - 1:
            texels, level = texels / 2, level + 1
        picture = levels[level]
        h, w = picture.shape[:2]
        colour = np.zeros(4)
        for i, j, weight, inside in four((w, h), u * w / projector.width, v * h / projector.height):
            if inside:
                colour += weight * picture[j, i]
        alpha, share = colour[3] / OPAQUE, strength * lit
        for plane, over, zero in zip(out, colour[:3], (BLACK, GREY, GREY), strict=True):
            under = plane[y, x]
            plane[y, x] = min(max(under + share * (over - alpha * (zero if adds else under)), 0.0), 1023.0)
    return out


def nearest_of_both_sides(camera, points, triangles, near):
    """As `zbuffer`, but triangles have no back."""
    return zbuffer(camera, points, np.concatenate([triangles, triangles[:, ::-1]]), near)
