"""Continuation of structure into holes, slowly: dictionaries and sets of pixels, in float64."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
from farside.engine.kernels.rendering.structure import ANGLES, LEVELS, MIXED, SAME, WINDOW


def neighbours(shape, pixel):
    """The eight pixels around a pixel, without those outside the picture."""
    around = ((pixel[0] + dy, pixel[1] + dx) for dy, dx in product((-1, 0, 1), repeat=2) if (dy, dx) != (0, 0))
    return [(y, x) for y, x in around if 0 <= y < shape[0] and 0 <= x < shape[1]]


def spread(disparity, rise):
    """The farthest and the nearest disparity around each hole pixel, relaxed until nothing changes."""
    holes = [tuple(p) for p in np.argwhere(disparity <= 0)]
    far, near = dict.fromkeys(holes, math.inf), dict.fromkeys(holes, -math.inf)
    while True:
        before = dict(far), dict(near)
        for hole in holes:
            for other in neighbours(disparity.shape, hole):
                drawn = disparity[other] > 0
                far[hole] = min(far[hole], disparity[other] if drawn else far[other] + rise)
                near[hole] = max(near[hole], disparity[other] if drawn else near[other] - rise)
        if (far, near) == before:
            return far, near


def layers_of(disparity, far, count):
    """Sets of hole pixels, layer by layer inwards from the rims of surfaces that continue into the hole."""
    def goes_on(hole, other):
        return 0 < disparity[other] <= SAME * far[hole]

    layers = [{hole for hole in far if any(goes_on(hole, p) for p in neighbours(disparity.shape, hole))}]
    seen = set(layers[0])
    for number in range(2, count + 1):
        grown = {
            p
            for hole in layers[-1]
            for p in neighbours(disparity.shape, hole)
            if p in far and p not in seen and (number % 2 == 0 or p[0] == hole[0] or p[1] == hole[1])
        }
        layers.append(grown)
        seen |= grown
    return layers


def tensor_at_rim(disparity, luma, hole, limit):
    """Sum of the gradients' outer products over squares of four pixels of surfaces that continue."""
    (y0, x0), (h, w), tensor = hole, disparity.shape, np.zeros((2, 2))
    for y in range(max(y0 - WINDOW, 0), min(y0 + WINDOW, h - 1)):
        for x in range(max(x0 - WINDOW, 0), min(x0 + WINDOW, w - 1)):
            square = disparity[y : y + 2, x : x + 2]
            if np.all((square > 0) & (square <= limit)):
                (a, b), (c, d) = luma[y : y + 2, x : x + 2]
                gradient = np.array([b + d - a - c, c + d - a - b])  # along x, along y
                tensor += np.outer(gradient, gradient)
    return tensor


def continued(disparity, planes, rise, radius, sharpness, count):
    """Planes with the first `count` layers coloured, and each hole pixel's layer (0 for pixels left as they are)."""
    disparity = np.asarray(disparity, float)
    planes = [np.array(plane, float) for plane in planes]
    far, near = spread(disparity, rise)
    layer, tensors = np.zeros(disparity.shape, int), {}
    for number, pixels in enumerate(layers_of(disparity, far, count), 1):
        colours = {}
        for hole in pixels:
            if number == 1:
                tensors[hole] = tensor_at_rim(disparity, planes[0], hole, SAME * far[hole])
            else:
                before = [p for p in neighbours(disparity.shape, hole) if 0 < layer[p] < number]
                tensors[hole] = np.mean([tensors[p] for p in before], axis=0)
            shares = weights_of(disparity, layer, hole, far, near, tensors[hole], radius, sharpness)
            total = sum(shares.values())
            colours[hole] = [sum(s * plane[p] for p, s in shares.items()) / total for plane in planes]
        for hole, colour in colours.items():
            layer[hole] = number
            for plane, value in zip(planes, colour, strict=True):
                plane[hole] = value
    return planes, layer


def weights_of(disparity, layer, hole, far, near, tensor, radius, sharpness):
    """Weights of the pixels in a disc around a hole pixel."""
    limit, reach = SAME * far[hole], int(radius)
    values, vectors = np.linalg.eigh(tensor)
    angle = math.atan2(vectors[1, 0], vectors[0, 0])  # direction of least change
    angle = round(angle * ANGLES / math.pi) * math.pi / ANGLES
    sureness = ((values[1] - values[0]) / (values.sum() + 1e-6)) ** 2
    sureness = round(sureness * (LEVELS - 1)) / (LEVELS - 1)
    weights = {}
    for dy, dx in product(range(-reach, reach + 1), repeat=2):
        p, distance = (hole[0] + dy, hole[1] + dx), math.hypot(dy, dx)
        inside = 0 <= p[0] < disparity.shape[0] and 0 <= p[1] < disparity.shape[1]
        if not (inside and 0 < distance <= radius):
            continue
        if disparity[p] <= 0 and not layer[p]:
            continue
        if disparity[p] > limit:
            continue
        across = math.cos(angle) * dy - math.sin(angle) * dx
        along = math.exp(-0.5 * (sharpness * across) ** 2) + 1e-4
        weights[p] = (sureness * along + 1 - sureness) / distance
        straight = [q for q in neighbours(disparity.shape, p) if q[0] == p[0] or q[1] == p[1]]
        if disparity[p] > 0 and near[hole] > limit and any(disparity[q] <= 0 for q in straight):
            weights[p] *= MIXED
    return weights
