"""Projection both ways and depth codes, one point after the other, from their definitions."""

from __future__ import annotations

import math

import numpy as np


def turn(quaternion, vector):
    """q v q* (Hamilton's product), without a matrix."""
    w, axis, v = quaternion[0], np.array(quaternion[1:]), np.asarray(vector, float)
    across = np.cross(axis, v)
    return v + 2.0 * (w * across + np.cross(axis, across))


def project(camera, point):
    """(u, v, depth) of a world point; the azimuth is the one nearest to the picture's middle."""
    w, x, y, z = camera.pose.orientation
    x, y, z = turn((w, -x, -y, -z), np.asarray(point) - camera.pose.position)
    p = camera.projection
    if hasattr(p, "fx"):
        return p.cx - p.fx * y / x, p.cy - p.fy * z / x, x
    length, (low, high), (bottom, top) = math.sqrt(x * x + y * y + z * z), p.hor_range, p.ver_range
    azimuth, elevation = math.atan2(y, x), math.asin(max(-1.0, min(1.0, z / length)))
    middle = (low + high) / 2
    azimuth -= 2 * math.pi * round((azimuth - middle) / (2 * math.pi))
    return p.width * (high - azimuth) / (high - low), p.height * (top - elevation) / (top - bottom), length


def unproject(camera, u, v, depth):
    """The world point that a camera sees at (u, v) and `depth`."""
    p = camera.projection
    if hasattr(p, "fx"):
        ray = np.array([1.0, (p.cx - u) / p.fx, (p.cy - v) / p.fy])
    else:
        azimuth = p.hor_range[1] + (p.hor_range[0] - p.hor_range[1]) * u / p.width
        elevation = p.ver_range[1] + (p.ver_range[0] - p.ver_range[1]) * v / p.height
        ray = np.array([
            math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation)
        ])  # fmt: skip
    return np.asarray(camera.pose.position) + turn(camera.pose.orientation, depth * ray)


def depth_of_code(near, far, bits, code):
    """Depth in metres: disparities are evenly spaced from the far end to the near one."""
    share = code / (2**bits - 1)
    return 1.0 / ((1.0 - share) / far + share / near)
