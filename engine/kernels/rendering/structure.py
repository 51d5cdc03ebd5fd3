"""Continuation of structure into holes: coherence transport (Bornemann and Maerz, J. Math. Imaging Vision 28, 2007).

Hole pixels are coloured in layers, from the rims of farther surfaces inwards. Each pixel takes the weighted mean of the
pixels in a small disc that belong to that surface or are coloured already; pixels along the direction of the picture's
structure have most of the weight. The direction is measured at the rim and passed on inwards. Nearer surfaces never
contribute. A layer reads only the layers before it, so the result does not depend on the order within a layer.

depths float32 [n, 2] are disparities for each hole pixel: of the farthest surface that may continue there, and of the
nearest that may hide it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...support.array_types import F32, I32
from ..base.jit import inlined, serial
from .records import Planes

__all__ = [
    "ANGLES",
    "LEVELS",
    "SAME",
    "WINDOW",
    "Disc",
    "Holes",
    "continue_structure",
    "disc_weights",
    "spread_depths",
]


ANGLES = 32  # number of directions of structure, over half a turn
LEVELS = 9  # number of levels of its coherence
WINDOW = 3  # the direction at a rim is measured within this many pixels on each side
SAME = 1.06  # ratio of disparities up to which surfaces count as one
MIXED = 1e-6  # weight (others: 1) of a pixel whose colour may be mixed with that of the surface that hid the hole
_SWEEPS = 16  # largest number of sweeps in both directions; two are enough for holes without many turns


class Holes(NamedTuple):
    """The holes of a picture (pixels where nothing was drawn) in a list."""

    places: I32  # [n, 2]: their rows and columns in reading order
    numbers: I32  # [h, w]: each hole's number in that list; undefined for drawn pixels
    rims: I32  # [m]: numbers of the holes that touch a drawn pixel


class Disc(NamedTuple):
    """The pixels, relative to a hole pixel, from which its colour is taken, and their weights: see `disc_weights`."""

    offsets: I32  # [n, 2]: rows and columns
    weights: F32  # [ANGLES * LEVELS, n]


def disc_weights(radius: float, sharpness: float) -> Disc:
    """Offsets of a disc, and their weights.

    radius: of the disc, pixels. Row a * LEVELS + s of the weights is for structure at the angle a * pi / ANGLES (from
    right towards down) with the coherence s / (LEVELS - 1). `sharpness`: fall of the weights across the direction,
    1 / pixels.
    """
    reach = math.floor(radius)
    rows, columns = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    distance = np.hypot(rows, columns)
    disc = (distance > 0) & (distance <= radius)
    rows, columns, distance = rows[disc], columns[disc], distance[disc]
    angles = np.arange(ANGLES)[:, None, None] * (math.pi / ANGLES)
    across = np.cos(angles) * rows - np.sin(angles) * columns
    sureness = (np.arange(LEVELS) / (LEVELS - 1))[:, None]
    # Every pixel gets a little weight, so that the sum is never 0.
    along = np.exp(-0.5 * (sharpness * across) ** 2) + 1e-4
    weights = (sureness * along + (1.0 - sureness)) / distance
    offsets = np.stack([rows, columns], axis=-1).astype(np.int32)
    return Disc(offsets, weights.reshape(-1, len(rows)).astype(np.float32))


@serial
def spread_depths(disparity: F32, holes: Holes, rise: float, depths: F32) -> None:
    """Write depths from the holes' rims. `rise`: the difference of disparity, per pixel of their distance, between the
    surface that continues in a hole and the one that hides it.

    The holes' own disparity becomes the negative of the farthest, or minus infinity if nothing nearer hides it.
    """
    places, index, rims = holes
    h, w = disparity.shape
    for n in range(depths.shape[0]):
        depths[n, 0], depths[n, 1] = np.inf, -np.inf
    for n in rims:
        y, x = int(places[n, 0]), int(places[n, 1])
        farthest, nearest = np.float32(np.inf), np.float32(-np.inf)
        for v in range(max(y - 1, 0), min(y + 2, h)):
            for u in range(max(x - 1, 0), min(x + 2, w)):
                q = disparity[v, u]
                if q > 0.0:
                    farthest, nearest = min(farthest, q), max(nearest, q)
        depths[n, 0], depths[n, 1] = farthest, nearest
    for sweep in range(2 * _SWEEPS):
        if not _sweep(disparity, places, index, np.float32(rise), sweep % 2 == 0, depths) and sweep > 0:
            break
    for n in range(places.shape[0]):
        hidden = depths[n, 1] > SAME * depths[n, 0]
        disparity[places[n, 0], places[n, 1]] = -depths[n, 0] if hidden else -np.inf


@serial
def _sweep(disparity: F32, places: I32, index: I32, rise: float, forward: bool, depths: F32) -> bool:
    """Spread depths to the right and down, or to the left and up; returns whether anything changed."""
    h, w = disparity.shape
    changed, side = False, -1 if forward else 1
    for m in range(places.shape[0]):
        n = m if forward else places.shape[0] - 1 - m
        y, x = int(places[n, 0]), int(places[n, 1])
        farthest, nearest = depths[n, 0], depths[n, 1]
        v = y + side
        if 0 <= v < h:
            for u in range(max(x - 1, 0), min(x + 2, w)):
                if disparity[v, u] <= 0.0:
                    farthest = min(farthest, depths[index[v, u], 0] + rise)
                    nearest = max(nearest, depths[index[v, u], 1] - rise)
        if 0 <= x + side < w and disparity[y, x + side] <= 0.0:  # it is the hole just before this one in the list
            farthest = min(farthest, depths[n + side, 0] + rise)
            nearest = max(nearest, depths[n + side, 1] - rise)
        changed |= farthest != depths[n, 0] or nearest != depths[n, 1]
        depths[n, 0], depths[n, 1] = farthest, nearest
    return changed


@inlined
def _goes_on(disparity: F32, y: int, x: int, limit: float) -> bool:
    """Whether a drawn pixel belongs to a surface that continues where surfaces with disparities up to `limit` do."""
    return 0.0 < disparity[y, x] <= limit


@serial
def _sort_into_layers(disparity: F32, holes: Holes, depths: F32, layers: int, layer: I32, order: I32) -> int:
    """layer [h, w], all 0 before: the layers of holes, 1 to `layers`; order [n]: the holes, sorted by layer. Returns
    the number of holes in layers."""
    places, index, rims = holes
    h, w = disparity.shape
    start, count = 0, 0
    for n in rims:
        y, x = int(places[n, 0]), int(places[n, 1])
        for v in range(max(y - 1, 0), min(y + 2, h)):
            for u in range(max(x - 1, 0), min(x + 2, w)):
                if _goes_on(disparity, v, u, SAME * depths[n, 0]):
                    layer[y, x] = 1
        if layer[y, x] == 1:
            order[count] = n
            count += 1
    for number in range(2, layers + 1):
        stop = count
        for m in range(start, stop):
            y, x = int(places[order[m], 0]), int(places[order[m], 1])
            for v in range(max(y - 1, 0), min(y + 2, h)):
                for u in range(max(x - 1, 0), min(x + 2, w)):
                    # Every other layer does not grow diagonally: squares become octagons.
                    straight = v == y or u == x
                    if disparity[v, u] <= 0.0 and layer[v, u] == 0 and (number % 2 == 0 or straight):
                        layer[v, u] = number
                        order[count] = index[v, u]
                        count += 1
        start = stop
    return count


@serial
def _measure(disparity: F32, luma: F32, y: int, x: int, limit: float, tensor: F32) -> None:
    """tensor [3]: structure tensor (xx, xy, yy), round a pixel, of the surfaces that continue."""
    h, w = disparity.shape
    for v in range(max(y - WINDOW, 0), min(y + WINDOW, h - 1)):
        for u in range(max(x - WINDOW, 0), min(x + WINDOW, w - 1)):
            if (
                _goes_on(disparity, v, u, limit) and _goes_on(disparity, v, u + 1, limit)
                and _goes_on(disparity, v + 1, u, limit) and _goes_on(disparity, v + 1, u + 1, limit)
            ):  # fmt: skip
                a, b, c, d = luma[v, u], luma[v, u + 1], luma[v + 1, u], luma[v + 1, u + 1]
                gx, gy = b + d - a - c, c + d - a - b
                tensor[0] += gx * gx
                tensor[1] += gx * gy
                tensor[2] += gy * gy


@serial
def _hand_on(disparity: F32, index: I32, layer: I32, y: int, x: int, number: int, tensors: F32, tensor: F32) -> None:
    """tensor [3]: the mean of the tensors of neighbours in earlier layers."""
    h, w = disparity.shape
    count = 0
    for v in range(max(y - 1, 0), min(y + 2, h)):
        for u in range(max(x - 1, 0), min(x + 2, w)):
            if disparity[v, u] <= 0.0 and 0 < layer[v, u] < number:
                count += 1
                for k in range(3):
                    tensor[k] += tensors[index[v, u], k]
    for k in range(3):
        tensor[k] /= np.float32(count)


@inlined
def _row_of_weights(tensor: F32) -> int:
    """The row of weights for a structure tensor; the row without a direction if the tensor is NaN."""
    xx, xy, yy = tensor[0], tensor[1], tensor[2]
    coherence = math.sqrt((xx - yy) * (xx - yy) + 4.0 * xy * xy) / (xx + yy + 1e-6)
    if not coherence <= 1.0:  # NaN fails the comparison; rounding may give a little more than 1
        coherence = 1.0 if coherence > 1.0 else 0.0
    angle = 0.5 * math.atan2(2.0 * xy, xx - yy) + 0.5 * math.pi  # the direction of least change
    turn = int(angle * (ANGLES / math.pi) + 0.5) % ANGLES if angle >= 0.0 else 0
    return turn * LEVELS + int(coherence * coherence * (LEVELS - 1) + 0.5)


@inlined
def _at_a_hole(disparity: F32, y: int, x: int) -> bool:
    h, w = disparity.shape
    return (
        disparity[max(y - 1, 0), x] <= 0.0 or disparity[min(y + 1, h - 1), x] <= 0.0
        or disparity[y, max(x - 1, 0)] <= 0.0 or disparity[y, min(x + 1, w - 1)] <= 0.0
    )  # fmt: skip


@serial
def _colour(
    disparity: F32, layer: I32, y: int, x: int, limit: float, hidden: bool, disc: Disc, row: int, planes: Planes
) -> None:
    """Colour a hole pixel from the surfaces that continue, within a disc round it, by a row of its weights.

    limit: largest disparity of surfaces that continue there; hidden: something nearer hid the pixel, and its colour may
    be mixed into the rim.
    """
    offsets, weights = disc
    luma, chroma_b, chroma_r = planes
    h, w = disparity.shape
    number = layer[y, x]
    total, sum_y, sum_b, sum_r = 0.0, 0.0, 0.0, 0.0
    for k in range(offsets.shape[0]):
        v, u = y + offsets[k, 0], x + offsets[k, 1]
        if v < 0 or u < 0 or v >= h or u >= w:
            continue
        share = weights[row, k]
        q = disparity[v, u]
        if q <= 0.0:
            share = share if 0 < layer[v, u] < number else 0.0
        elif q > limit:
            share = 0.0
        elif hidden and _at_a_hole(disparity, v, u):
            share *= MIXED
        if share > 0.0:
            total += share
            sum_y += share * luma[v, u]
            sum_b += share * chroma_b[v, u]
            sum_r += share * chroma_r[v, u]
    luma[y, x], chroma_b[y, x], chroma_r[y, x] = sum_y / total, sum_b / total, sum_r / total


@serial
def continue_structure(
    disparity: F32, holes: Holes, depths: F32, layers: int, disc: Disc, layer: I32, planes: Planes
) -> None:
    """Colour the holes in the first `layers` layers; layer [h, w], all 0 before, is set to their layers."""
    places, index = holes.places, holes.numbers
    order = np.empty(places.shape[0], np.int32)
    tensors = np.zeros((places.shape[0], 3), np.float32)
    count = _sort_into_layers(disparity, holes, depths, layers, layer, order)
    for m in range(count):
        n = order[m]
        y, x, limit = int(places[n, 0]), int(places[n, 1]), SAME * depths[n, 0]
        if layer[y, x] == 1:
            _measure(disparity, planes.luma, y, x, limit, tensors[n])
        else:
            _hand_on(disparity, index, layer, y, x, layer[y, x], tensors, tensors[n])
        hidden = depths[n, 1] > limit
        _colour(disparity, layer, y, x, limit, hidden, disc, _row_of_weights(tensors[n]), planes)
