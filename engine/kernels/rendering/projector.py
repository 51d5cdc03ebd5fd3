"""Projectors: a picture is thrown onto the surfaces of the background (projective textures, Segal et al. 1992).

A pixel of the eye has a depth, so it has a point in space. If that point lies in the projector's picture, and within
delta of the background that the projector sees there (a shadow map, Williams 1978), the pixel takes the picture's
colour. Nearer points are live foreground, farther ones lie in the shadow of the background; both stay as they are. The
comparison is made with the four texels of the shadow map around the point: with their range where they are one surface,
else with each of them, which softens the edges of shadows (percentage-closer filtering, Reeves et al. 1987).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from ...support.array_types import F32, F64, I64, U8, U16
from ...support.packed import CX, CY, FORWARD_X, FX, FY, POSITION_X
from ..base.jit import inlined, parallel, serial
from ..base.tolerance import Delta, delta_at
from ..base.tone import LARGEST
from .colour import BLACK, GREY
from .eye_directions import column_directions, row_direction
from .records import DepthBuffer, Planes

__all__ = [
    "FIRST",
    "OPAQUE",
    "PIXELS_HIGH",
    "PIXELS_WIDE",
    "Eye",
    "ProjectedPicture",
    "halve",
    "project",
    "take_planes",
]

OPAQUE = 1023  # alpha of a texel that hides what is behind it
FIRST, PIXELS_WIDE, PIXELS_HIGH = 0, 1, 2  # of a level: its first texel, its size
_COARSER = 1.5  # a level is used as long as a pixel of the eye covers at most this many of its texels
_LEAST = 1e-12
# Texels of the shadow map whose depths differ by at most twice the width of the tolerance are one surface: slanted, or
# with a small step, where a point between them is the background too.
_ONE_SURFACE = 2.0


class ProjectedPicture(NamedTuple):
    """A projector and its picture."""

    texels: U16  # [n, 4] of all levels: Y', Cb and Cr in 10-bit codes, multiplied with alpha / OPAQUE, and alpha
    levels: I64  # [levels, 3]: FIRST, PIXELS_WIDE, PIXELS_HIGH; each has half the size of the one before
    camera: F64  # packed: a perspective camera with the pixels of the first level
    codes: U16  # [h, w]: its shadow map, the background as it sees it; 0: none
    offset: float  # of the codes, 1/m: disparity is offset + step * code
    step: float
    delta: Delta  # how far from the background a drawn surface still counts as the background
    strength: float
    adds: bool


class Eye(NamedTuple):
    """The virtual camera on whose picture is projected."""

    camera: F64  # packed
    radians_a_pixel: float
    backdrop: int  # the winner's number of pixels of the backdrop
    push: Delta  # how far they were moved away


@parallel
def take_planes(y: U16, cb: U16, cr: U16, texels: U16) -> None:
    """texels [h w or more, 4]: an opaque picture of 4:2:0 planes as the first level."""
    h, w = y.shape
    for row in numba.prange(h):
        v = np.int64(row)
        for x in range(w):
            at = v * w + x
            texels[at, 0], texels[at, 3] = y[v, x], OPAQUE
            texels[at, 1], texels[at, 2] = cb[v >> 1, x >> 1], cr[v >> 1, x >> 1]


@parallel
def halve(texels: U16, fine: I64, coarse: I64) -> None:
    """Fill a level with the means of 2 x 2 texels of the level before; the last row and column are repeated."""
    w, h = fine[PIXELS_WIDE], fine[PIXELS_HIGH]
    for row in numba.prange(coarse[PIXELS_HIGH]):
        v = np.int64(row)
        above = fine[FIRST] + min(2 * v, h - 1) * w
        below = fine[FIRST] + min(2 * v + 1, h - 1) * w
        for x in range(coarse[PIXELS_WIDE]):
            left, right = min(2 * x, w - 1), min(2 * x + 1, w - 1)
            for k in range(4):
                total = np.int64(texels[above + left, k]) + np.int64(texels[above + right, k])
                total += np.int64(texels[below + left, k]) + np.int64(texels[below + right, k])
                texels[coarse[FIRST] + v * coarse[PIXELS_WIDE] + x, k] = (total + 2) >> 2


@inlined
def _unpushed(q: float, push: Delta) -> float:
    """The disparity of a surface of the backdrop before it was moved away to `q` (`backdrop._push_away`)."""
    by_length = q / max(1.0 - push[0] * q, _LEAST)
    by_disparity = 0.5 * (q + math.sqrt(q * q + 4.0 * push[1] * q))
    return max(by_length, by_disparity)


@serial
def _relative(eye: F64, projector: F64) -> F64:
    """[3, 4]: the projector's axes (forward, left, up) from the eye's, the shift in the last column."""
    out = np.zeros((3, 4))
    for i in range(3):
        for k in range(3):
            across = projector[FORWARD_X + 3 * k + i]
            for j in range(3):
                out[i, j] += across * eye[FORWARD_X + 3 * k + j]
            out[i, 3] += across * (eye[POSITION_X + k] - projector[POSITION_X + k])
    return out


@inlined
def _lit(thrown: ProjectedPicture, u: float, v: float, depth: float) -> float:
    """The share of the background around a point of the projector's picture, 0 to 1, that is at the point's depth.

    u, v: the point's place in the picture, as shares of its width and height.
    """
    h, w = thrown.codes.shape
    x, y = u * w - 0.5, v * h - 0.5
    left, top = math.floor(x), math.floor(y)
    fx, fy, around = x - left, y - top, delta_at(thrown.delta, depth)
    farthest = max((1.0 / (depth + around) - thrown.offset) / thrown.step, 0.5)
    nearest = (1.0 / max(depth - around, _LEAST) - thrown.offset) / thrown.step
    i, right = min(max(left, 0), w - 1), min(max(left + 1, 0), w - 1)
    j, below = min(max(top, 0), h - 1), min(max(top + 1, 0), h - 1)
    a, b = float(thrown.codes[j, i]), float(thrown.codes[j, right])
    c, d = float(thrown.codes[below, i]), float(thrown.codes[below, right])
    low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    if low > 0.0 and high - low <= _ONE_SURFACE * (nearest - farthest):
        return 1.0 if farthest <= high and low <= nearest else 0.0
    a, b = (1.0 if farthest <= a <= nearest else 0.0), (1.0 if farthest <= b <= nearest else 0.0)
    c, d = (1.0 if farthest <= c <= nearest else 0.0), (1.0 if farthest <= d <= nearest else 0.0)
    return (1.0 - fy) * ((1.0 - fx) * a + fx * b) + fy * ((1.0 - fx) * c + fx * d)


@inlined
def _weighted(texels: U16, at: int, k: int, step: int, fx: float, fy: float) -> float:
    """Bilinear sample of component k of the texels from `at` on, in rows of `step`."""
    upper = (1.0 - fx) * texels[at, k] + fx * texels[at + 1, k]
    lower = (1.0 - fx) * texels[at + step, k] + fx * texels[at + step + 1, k]
    return (1.0 - fy) * upper + fy * lower


@serial
def _sample(thrown: ProjectedPicture, level: int, u: float, v: float) -> tuple[float, float, float, float]:
    """The picture's colour, multiplied with alpha, and alpha from 0 to 1, bilinear. It is transparent beyond its
    border. u, v: shares of its width and height."""
    w, h = thrown.levels[level, PIXELS_WIDE], thrown.levels[level, PIXELS_HIGH]
    x, y = u * w - 0.5, v * h - 0.5
    left, top = math.floor(x), math.floor(y)
    fx, fy, texels = x - left, y - top, thrown.texels
    if left >= 0 and top >= 0 and left + 1 < w and top + 1 < h:
        at = thrown.levels[level, FIRST] + top * w + left
        luma, cb = _weighted(texels, at, 0, w, fx, fy), _weighted(texels, at, 1, w, fx, fy)
        cr, alpha = _weighted(texels, at, 2, w, fx, fy), _weighted(texels, at, 3, w, fx, fy)
        return luma, cb, cr, alpha / OPAQUE
    luma, cb, cr, alpha = 0.0, 0.0, 0.0, 0.0
    for k in range(4):
        i, j = left + (k & 1), top + (k >> 1)
        if 0 <= i < w and 0 <= j < h:
            at = thrown.levels[level, FIRST] + j * w + i
            weight = (fx if k & 1 else 1.0 - fx) * (fy if k >> 1 else 1.0 - fy)
            luma += weight * texels[at, 0]
            cb += weight * texels[at, 1]
            cr += weight * texels[at, 2]
            alpha += weight * texels[at, 3]
    return luma, cb, cr, alpha / OPAQUE


@inlined
def _blended(under: float, over: float, alpha: float, zero: float, share: float, adds: bool) -> float:
    """A code of the background and one of the picture, which is multiplied with alpha; zero: the code of no light."""
    if adds:
        code = under + share * (over - alpha * zero)
    else:
        code = under + share * (over - alpha * under)
    return min(max(code, 0.0), LARGEST)


@serial
def _paint(
    thrown: ProjectedPicture, u: float, v: float, texels: float, share: float, planes: Planes, y: int, x: int
) -> None:
    """Blend a share of the picture into a pixel, which covers `texels` texels of the first level across."""
    level = 0
    while texels > _COARSER and level < thrown.levels.shape[0] - 1:
        texels *= 0.5
        level += 1
    luma, cb, cr, alpha = _sample(thrown, level, u, v)
    planes.luma[y, x] = _blended(planes.luma[y, x], luma, alpha, BLACK, share, thrown.adds)
    planes.chroma_b[y, x] = _blended(planes.chroma_b[y, x], cb, alpha, GREY, share, thrown.adds)
    planes.chroma_r[y, x] = _blended(planes.chroma_r[y, x], cr, alpha, GREY, share, thrown.adds)


@serial
def _project_row(
    y: int, drawn: F32, winner: U8, eye: Eye, thrown: ProjectedPicture, to_projector: F64, across: F64, planes: Planes
) -> None:
    """Throw a picture onto row y of an eye; drawn, winner [w]: of its buffer; across: from `column_directions`."""
    projector, m = thrown.camera, to_projector
    fx, fy, cx, cy = projector[FX], projector[FY], projector[CX], projector[CY]
    wide, high = float(thrown.levels[0, PIXELS_WIDE]), float(thrown.levels[0, PIXELS_HIGH])
    scale, height = row_direction(eye.camera, y)
    for x in range(drawn.shape[0]):
        q = np.float64(drawn[x])
        if q <= 0.0:
            continue
        if winner[x] == eye.backdrop:
            q = _unpushed(q, eye.push)
        away = 1.0 / q
        dx, dy, dz = away * scale * across[0, x], away * scale * across[1, x], away * height
        depth = m[0, 0] * dx + m[0, 1] * dy + m[0, 2] * dz + m[0, 3]
        if not depth > _LEAST:
            continue
        inverse = 1.0 / depth
        u = cx - fx * inverse * (m[1, 0] * dx + m[1, 1] * dy + m[1, 2] * dz + m[1, 3])
        v = cy - fy * inverse * (m[2, 0] * dx + m[2, 1] * dy + m[2, 2] * dz + m[2, 3])
        # Up to half a texel beyond the border, the picture still fades.
        if not (-0.5 < u < wide + 0.5 and -0.5 < v < high + 0.5):
            continue
        share = thrown.strength * _lit(thrown, u / wide, v / high, depth)
        if share > 0.0:
            texels = eye.radians_a_pixel * away * fx * inverse
            _paint(thrown, u / wide, v / high, texels, share, planes, y, x)


@parallel
def project(buffer: DepthBuffer, eye: Eye, thrown: ProjectedPicture, planes: Planes) -> None:
    """Throw a picture onto the drawn pixels of an eye that show the background; planes: their colours, in place."""
    to_projector = _relative(eye.camera, thrown.camera)
    width = buffer.disparity.shape[1]
    across = np.empty((2, width))
    column_directions(eye.camera, width, across)
    for row in numba.prange(buffer.disparity.shape[0]):
        y = np.int64(row)
        _project_row(y, buffer.disparity[y], buffer.winner[y], eye, thrown, to_projector, across, planes)
