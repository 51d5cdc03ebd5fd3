"""Samples of surfaces that two views both see, and the normal equations of their tones: one sample at a time."""

from __future__ import annotations

import numpy as np

DARKEST, BRIGHTEST, REACH, SCALES = 72, 920, 2, 2.0


def common_samples(one, two, columns, rows, edge, tolerance):
    """Colours [n, 2, 3] relative to black and grey of common samples; edge and tolerance of both views, in codes."""
    out = []
    for v in range(rows):
        for u in range(columns):
            at = np.array([_corner(u, columns, one.camera.width), _corner(v, rows, one.camera.height)])
            code = _surface(one, at, edge[0])
            if code is None:
                continue
            depth = 1.0 / (one.camera.depth.offset + one.camera.depth.step * code)
            there, distance = two.camera.project(one.camera.unproject(at, depth))
            if not (np.isfinite(there).all() and distance > 0):
                continue
            seen = _surface(two, there, edge[1])
            expected = (1.0 / distance - two.camera.depth.offset) / two.camera.depth.step
            if seen is None or abs(expected - seen) > tolerance[1]:
                continue
            pair = np.stack([_colour(one.texture, at), _colour(two.texture, there)])
            if ((pair[:, 0] >= DARKEST) & (pair[:, 0] <= BRIGHTEST)).all():
                out.append(pair - [64.0, 512.0, 512.0])
    return np.array(out).reshape(-1, 2, 3)


def _corner(k, count, size):
    return 2 * int((k + 0.5) * size / (2 * count)) + 1.0


def _surface(view, at, edge):
    x, y = int(np.floor(at[0])), int(np.floor(at[1]))
    h, w = view.codes.shape
    if not (REACH <= x < w - REACH and REACH <= y < h - REACH):
        return None
    codes = view.codes[np.ix_((y - REACH, y + REACH - 1), (x - REACH, x + REACH - 1))].astype(float)
    invalid = view.camera.depth.has_invalid and codes.min() == 0
    return None if np.ptp(codes) > edge or invalid else codes.mean()


def _colour(texture, at):
    return np.array([_bilinear(texture.y, at), _bilinear(texture.cb, at / 2), _bilinear(texture.cr, at / 2)])


def _bilinear(plane, at):
    x, y = (np.clip(c - 0.5, 0, size - 1) for c, size in zip(at, plane.shape[::-1], strict=True))
    x0, y0 = min(int(x), plane.shape[1] - 2), min(int(y), plane.shape[0] - 2)
    wx, wy = np.array([1 - (x - x0), x - x0]), np.array([1 - (y - y0), y - y0])
    return wy @ plane[y0 : y0 + 2, x0 : x0 + 2].astype(float) @ wx


def normal_equations(samples, one, two):
    """information [3, 3, 3] and evidence [3, 3] of a pair's channels, from samples and the two views' tones [3, 3]."""
    information, evidence = np.zeros((3, 3, 3)), np.zeros((3, 3))
    lumas = [(samples[:, k, 0] - tone[0, 1]) / tone[0, 0] for k, tone in enumerate((one, two))]
    for channel in range(3):
        common = [
            (samples[:, k, channel] - tone[channel, 1] - tone[channel, 2] * lumas[k]) / tone[channel, 0]
            for k, tone in enumerate((one, two))
        ]
        tint = np.mean(lumas, axis=0) if channel else np.zeros(len(samples))
        basis = np.stack([np.mean(common, axis=0), np.ones(len(samples)), tint], axis=1)
        difference = samples[:, 0, channel] - samples[:, 1, channel]
        residual = difference - basis @ (one[channel] - two[channel])
        scale = max(1.4826 * np.median(np.abs(residual)), 1.0)
        weight = 1 / (1 + (residual / (SCALES * scale)) ** 2) ** 2 / scale**2
        information[channel] = basis.T @ (weight[:, None] * basis)
        evidence[channel] = basis.T @ (weight * difference)
    return information, evidence


def solve(information, evidence, nodes, weights, precision, expected):
    """Differences of tones [n, 3, 3] from neutral, solved by a dense matrix of all unknowns of a channel."""
    count = len(expected)
    off = np.empty((count, 3, 3))
    for channel in range(3):
        left, right = np.zeros((3 * count, 3 * count)), np.zeros(3 * count)
        for k, pair in enumerate(nodes):
            sides = np.zeros((3, 3 * count))
            for node, sign in zip(pair, (1.0, -1.0), strict=True):
                if node < count:
                    sides[:, 3 * node : 3 * node + 3] = sign * np.eye(3)
            left += weights[k] * sides.T @ information[k, channel] @ sides
            right += weights[k] * sides.T @ evidence[k, channel]
        prior = np.tile(precision, count)
        right += prior * expected[:, channel].ravel()
        off[:, channel] = np.linalg.solve(left + np.diag(prior), right).reshape(-1, 3)
    return off
