"""Where drawn views may leave holes for an eye near by, a block and a cell at a time and in float64."""

from __future__ import annotations

import math

import numpy as np

BLOCK, CELL = 16, 4  # pixels of a view, and of the background's picture
FARTHEST, WIDEST = 6, 40  # cells: by which a surface may be shifted, and that the image of a block may be wide
COVERED, CUT = 1, 2


def corners(view, camera, rows, columns):
    """(u, v, depth) in a camera's picture of a view's pixels at rows and columns; depth 0: nothing is seen there."""
    found = np.zeros((len(rows), len(columns), 3))
    for j, y in enumerate(rows):
        for i, x in enumerate(columns):
            depth = view.camera.depth.depth(view.codes[y, x])
            if not np.isnan(depth):
                uv, there = camera.project(view.camera.unproject([x + 0.5, y + 0.5], float(depth)))
                found[j, i] = [*uv, max(there, 0.0)]
    return found


def cells_of(view, broken, camera, shape):
    """(COVERED and CUT bits, nearest depth) of the cells of a camera's picture; broken [h, w]: pixels that a cut of the
    view's surface touches."""
    h, w = view.codes.shape
    rows = [min(BLOCK * k, h - 1) for k in range(max(1, (h - 2) // BLOCK + 1) + 1)]
    columns = [min(BLOCK * k, w - 1) for k in range(max(1, (w - 2) // BLOCK + 1) + 1)]
    images = corners(view, camera, rows, columns)
    bits, nearest = np.zeros(shape, int), np.full(shape, np.inf)

    def mark(bit, low, high, depth):
        left, top = (max(math.floor(at / CELL), 0) for at in low)
        right, bottom = (math.floor(at / CELL) for at in high)
        bits[top : bottom + 1, left : right + 1] |= bit
        part = nearest[top : bottom + 1, left : right + 1]
        np.minimum(part, depth, out=part)

    for j in range(len(rows) - 1):
        for i in range(len(columns) - 1):
            four = images[j : j + 2, i : i + 2].reshape(4, 3)
            there = four[four[:, 2] > 0]
            if not len(there):
                continue
            low, high = there[:, :2].min(axis=0), there[:, :2].max(axis=0)
            if (high < 0).any() or low[0] > camera.width or low[1] > camera.height:
                continue
            outer = j in (0, len(rows) - 2) or (not view.camera.wraps and i in (0, len(columns) - 2))
            cut = broken[rows[j] : rows[j + 1] + 1, columns[i] : columns[i + 1] + 1].any()
            if (high - low).max() > WIDEST * CELL:
                for u, v, depth in there:
                    if u >= 0 and v >= 0:
                        mark(CUT, (u, v), (u, v), depth)
            else:
                whole = len(there) == 4 and not outer and not cut
                mark(COVERED if whole else CUT, low, high, there[:, 2].min())
    return bits, nearest


def pixels_a_metre(camera, u, v):
    """By how many pixels a point at depth 1 moves, at most, when the camera moves by a metre: numerically."""
    if hasattr(camera.projection, "fx"):
        p = camera.projection
        away = [1.0, (p.cx - u) / p.fx, (p.cy - v) / p.fy]
        return max(p.fx, p.fy) * np.linalg.norm(away)
    p = camera.projection
    (left, right), (bottom, top) = p.hor_range, p.ver_range
    across, down = p.width / (right - left), p.height / (top - bottom)
    elevation = top - v / down
    return max(across / max(math.cos(elevation), 1e-3), down)


def uncovered(views, broken, camera, reach_m):
    """[ceil(h / CELL), ceil(w / CELL)]: 1 where an eye up to `reach_m` metres away may look past the views."""
    shape = math.ceil(camera.height / CELL), math.ceil(camera.width / CELL)
    wanted = np.ones(shape, np.uint8)
    for view, cuts in zip(views, broken, strict=True):
        bits, nearest = cells_of(view, cuts, camera, shape)
        for y, x in np.argwhere(bits == COVERED):
            cells = reach_m * pixels_a_metre(camera, CELL * (x + 0.5), CELL * (y + 0.5)) / CELL / nearest[y, x]
            if cells <= FARTHEST:
                far = int(cells) + 1
                around = bits[max(y - far, 0) : y + far + 1, max(x - far, 0) : x + far + 1]
                if (around == COVERED).all():
                    wanted[y, x] = 0
    return wanted
