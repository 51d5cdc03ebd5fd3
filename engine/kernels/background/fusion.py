"""Temporal fusion: the mean of a surface that a maximum depth image's camera sees again and again.

Where depth flickers, the maximum over many frames is too far by some standard deviations, and each pixel has the error
of a single frame. Instead, a pixel takes a recursive mean where a new view shows the same surface again. A surface that
is farther by a nontrivial amount still replaces it; a nearer one is something in front and is ignored. This is not in
the paper.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F32, F64, U8, U16
from ..base.jit import inlined, parallel
from ..base.project import project_point, unproject_point
from ..base.tone import (
    CB_FROM_Y,
    CB_GAIN,
    CB_OFFSET,
    CR_FROM_Y,
    CR_GAIN,
    CR_OFFSET,
    Y_GAIN,
    Y_OFFSET,
    mean_luma,
    toned_code,
)
from .flags import PROVISIONAL, beside_nearer
from .maximum_depth import PHASES
from .nontrivial import Rules
from .picture import Picture
from .surfaces import Triangles

__all__ = ["COLOUR_FRAMES", "DEPTH_FRAMES", "fuse_maximum_depth", "settle_points"]

# Largest number of frames in a mean; with more, the mean would hardly follow changes. It is lower for colours: they
# change with light and shadow, and a first colour that was mixed with that of a leaving person is soon forgotten.
DEPTH_FRAMES, COLOUR_FRAMES = 32, 8


@inlined
def _toward(old: int, new: int, count: int, chance: float) -> int:
    """The mean of `count` codes including the new one. It is rounded at random (`chance`), as otherwise small
    differences would never have an effect."""
    return int(old + math.floor((np.int32(new) - np.int32(old)) / count + chance))


@parallel
def fuse_maximum_depth(
    new: Picture, known: Picture, flags: U8, fused: U8, rules: Rules, tone: F64, number: int
) -> None:
    """Takes the mean where the new view shows the same surface: neither is farther by a nontrivial amount.

    fused [h, w]: the number of views in a pixel's mean, at most DEPTH_FRAMES. Colours next to something nearer stay,
    and so does chroma unless all pixels that share it show the same surface. A call processes every PHASES-th pair of
    rows; `number` counts the calls. Other arguments: see `update_maximum_depth`.
    """
    new_codes, new_y, new_cb, new_cr = new.codes, new.y, new.cb, new.cr
    codes, y, cb, cr, by_code = known.codes, known.y, known.cb, known.cr, rules.by_code
    h, w = codes.shape
    lowest, edge = np.int32(rules.lowest), np.int32(rules.edge)
    first = number % PHASES
    for k in numba.prange(((h + 1) // 2 - first + PHASES - 1) // PHASES):
        pair = first + np.int64(k) * PHASES
        last = min(2 * pair + 2, h)
        state = np.uint32(2654435761 * (number + 1) + 40503 * pair)
        for column in range((w + 1) // 2):
            whole, count = True, DEPTH_FRAMES
            for row in range(2 * pair, last):
                for x in range(2 * column, min(2 * column + 2, w)):
                    code, old = np.int32(new_codes[row, x]), np.int32(codes[row, x])
                    if code < lowest or code - lowest < by_code[old] or old - lowest < by_code[code]:
                        whole = False
                        continue
                    state = np.uint32(state * np.uint32(1664525) + np.uint32(1013904223))
                    chance = (state >> np.uint32(8)) * 2.0**-24
                    fused[row, x] = min(fused[row, x] + 1, DEPTH_FRAMES)
                    codes[row, x] = _toward(old, code, fused[row, x], chance)
                    if flags[row, x] & PROVISIONAL != 0 or beside_nearer(new_codes, row, x, edge):
                        whole = False
                        continue
                    count = min(count, fused[row, x])
                    luma = toned_code(tone[Y_GAIN], new_y[row, x], tone[Y_OFFSET])
                    y[row, x] = _toward(y[row, x], luma, min(fused[row, x], COLOUR_FRAMES), chance)
            if whole:
                count = min(count, COLOUR_FRAMES)
                chance = (state >> np.uint32(8)) * 2.0**-24
                mean = mean_luma(new_y, 2 * pair, 2 * column)
                blue = toned_code(tone[CB_GAIN], new_cb[pair, column], tone[CB_FROM_Y] * mean + tone[CB_OFFSET])
                red = toned_code(tone[CR_GAIN], new_cr[pair, column], tone[CR_FROM_Y] * mean + tone[CR_OFFSET])
                cb[pair, column] = _toward(cb[pair, column], blue, count, chance)
                cr[pair, column] = _toward(cr[pair, column], red, count, chance)


@inlined
def _code_at(depth: float, rules: Rules) -> int:
    """The code of a depth, clipped to the range of codes; 0 for NaN."""
    code = (1.0 / depth - rules.offset) / rules.step + 0.5
    return int(min(code, 65535.0)) if code > 0.0 else 0  # NaN fails the comparison


@parallel
def settle_points(mesh: Triangles, camera: F64, rules: Rules, codes: U16, moved: F32) -> None:
    """moved [n, 3]: the points of a mesh of this image, moved to the depths of its present codes.

    A point between pixels takes the mean of the pixels round it, of which only those count that show the point's
    surface. A point without such pixels stays.
    """
    h, w = codes.shape
    points, uv = mesh.points, mesh.uv
    for i in numba.prange(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        u, v = float(uv[i, 0]), float(uv[i, 1])
        _u, _v, depth = project_point(camera, x, y, z)
        nearest = _code_at(depth, rules)
        total, count = 0.0, 0
        for row in range(math.ceil(v - 1.0), math.floor(v) + 1):
            for column in range(math.ceil(u - 1.0), math.floor(u) + 1):
                code = int(codes[min(max(row, 0), h - 1), column % w])
                above, nearest_above = code - rules.lowest, nearest - rules.lowest
                if above >= rules.by_code[nearest] and nearest_above >= rules.by_code[code]:
                    total += code
                    count += 1
        if count > 0:
            x, y, z = unproject_point(camera, u, v, 1.0 / (rules.offset + rules.step * total / count))
        moved[i, 0], moved[i, 1], moved[i, 2] = x, y, z
