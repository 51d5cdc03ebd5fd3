"""Silhouettes compared with ground truth of FINE x FINE samples per pixel: their places, and thin structures.

A silhouette runs between neighbouring samples whose disparities differ by more than a factor 1 + `step`.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F64
from ..base.jit import parallel, serial

__all__ = ["FINE", "HALF", "silhouette_offsets", "thin_structures"]

FINE = 4  # samples of ground truth along each side of a pixel
HALF = 3  # pixels used on both sides of a silhouette
_SPREADS = 3.0  # least contrast between the sides, in standard deviations of light of both sides together


@serial
def _level(disparity: F64, py: int, px: int, step: float) -> float:
    """Disparity halfway between the sides of the greatest step in or about a pixel, or 0 if none is large enough."""
    greatest, level = 1.0 + step, 0.0
    for y in range(FINE * py - 1, FINE * py + FINE):
        for x in range(FINE * px - 1, FINE * px + FINE):
            for other in (disparity[y, x + 1], disparity[y + 1, x]):
                near, far = max(disparity[y, x], other), min(disparity[y, x], other)
                if near > greatest * far:
                    greatest, level = near / far, 0.5 * (near + far)
    return level


@serial
def _cover(disparity: F64, py: int, px: int, level: float, cover: F64) -> None:
    """Share of the samples nearer than `level`, of each pixel within HALF of a pixel."""
    for j in range(2 * HALF + 1):
        for i in range(2 * HALF + 1):
            count = 0
            y0, x0 = FINE * (py + j - HALF), FINE * (px + i - HALF)
            for y in range(y0, y0 + FINE):
                for x in range(x0, x0 + FINE):
                    count += disparity[y, x] > level
            cover[j, i] = count / (FINE * FINE)


@serial
def _slope(cover: F64) -> tuple[float, float]:
    """First moments of the coverage of a disc along x and y: they point to the near side, whatever the angle."""
    gx, gy = 0.0, 0.0
    for j in range(2 * HALF + 1):
        for i in range(2 * HALF + 1):
            if (i - HALF) ** 2 + (j - HALF) ** 2 <= (HALF + 0.5) ** 2:
                gx += cover[j, i] * (i - HALF)
                gy += cover[j, i] * (j - HALF)
    return gx, gy


@serial
def _crosses(profile: F64) -> bool:
    """Whether coverage rises from 0 to 1, and its sum is that of the near half and of a part of the middle pixel."""
    total = profile[0]
    for k in range(1, 2 * HALF + 1):
        if profile[k] < profile[k - 1]:
            return False
        total += profile[k]
    return bool(profile[0] == 0.0 and profile[2 * HALF] == 1.0 and HALF <= total < HALF + 1)


@serial
def _side(light: F64, cover: F64, value: float, along_x: bool) -> tuple[float, float]:
    """Mean and standard deviation of light over three lines' pixels whose coverage is `value`; as large as cover."""
    count, total, squares = 0, 0.0, 0.0
    for k in range(2 * HALF + 1):
        for line in range(HALF - 1, HALF + 2):
            j, i = (line, k) if along_x else (k, line)
            if cover[j, i] == value:
                count += 1
                total += light[j, i]
                squares += light[j, i] ** 2
    mean = total / count
    return mean, math.sqrt(max(0.0, squares / count - mean * mean))


@serial
def _share(light: float, far: float, near: float) -> float:
    """How much of a pixel's light is the near side's."""
    return min(1.0, max(0.0, (light - far) / (near - far)))


@serial
def _offset(cover: F64, truth: F64, picture: F64, contrast: float) -> float:
    """How many pixels farther the near side reaches in the picture than in truth; nan if it cannot be measured.

    All arrays are [2 HALF + 1, 2 HALF + 1] round a pixel with a silhouette.
    """
    gx, gy = _slope(cover)
    along_x = abs(gx) >= abs(gy)
    sign = 1 if (gx if along_x else gy) > 0 else -1
    profile = (cover[HALF] if along_x else cover[:, HALF])[::sign]
    if not _crosses(profile):
        return math.nan
    near, near_spread = _side(truth, cover, 1.0, along_x)
    far, far_spread = _side(truth, cover, 0.0, along_x)
    if not abs(near - far) >= max(contrast, _SPREADS * (near_spread + far_spread)):
        return math.nan
    total = 0.0
    for k in range(2 * HALF + 1):
        j, i = (HALF, k) if along_x else (k, HALF)
        total += _share(picture[j, i], far, near) - _share(truth[j, i], far, near)
    return total * max(abs(gx), abs(gy)) / math.hypot(gx, gy)


@parallel
def silhouette_offsets(
    disparity: F64,  # [FINE h, FINE w], 1/m, of truth, everywhere above 0
    truth: F64,  # [h, w], light: linear in coverage
    picture: F64,  # [h, w], light
    step: float,
    contrast: float,  # least difference of light between the sides
) -> F64:  # [h, w]
    """How far silhouettes of the picture lie outside those of truth, in pixels along their normal; else nan.

    Across a silhouette (along x or y, whichever is nearer to its normal), light is taken as a mixture of the near
    side's and the far side's. The sum of the shares minus the sum in truth is the displacement, independent of blur.
    There is one value per silhouette and line, at the pixel that the silhouette crosses, and only where coverage rises
    from 0 to 1 within HALF pixels and the lights of the sides differ clearly.
    """
    h, w = truth.shape
    size = 2 * HALF + 1
    offsets = np.full((h, w), math.nan)
    for y in numba.prange(HALF, h - HALF):
        cover = np.empty((size, size))
        for x in range(HALF, w - HALF):
            level = _level(disparity, y, x, step)
            if level > 0.0:
                _cover(disparity, y, x, level, cover)
                top, left = y - HALF, x - HALF
                window = truth[top : top + size, left : left + size], picture[top : top + size, left : left + size]
                offsets[y, x] = _offset(cover, window[0], window[1], contrast)
    return offsets


@serial
def _behind(line: F64, x: int, step: float, width: int) -> float:
    """The greater disparity of the farther surfaces on both sides of a sample, less than `width` apart; or 0."""
    limit = line[x] / (1.0 + step)
    left = x - 1
    while left >= 0 and x - left <= width and line[left] >= limit:
        left -= 1
    right = x + 1
    while right < len(line) and right - left <= width + 1 and line[right] >= limit:
        right += 1
    if left < 0 or right >= len(line) or right - left > width + 1:
        return 0.0
    return max(line[left], line[right])


@parallel
def thin_structures(disparity: F64, step: float, width: int) -> F64:  # [h, w], [h, w]
    """Disparity behind samples of structures at most `width` samples wide across or down; 0 elsewhere."""
    h, w = disparity.shape
    behind = np.zeros((h, w))
    for y in numba.prange(h):
        for x in range(w):
            behind[y, x] = max(_behind(disparity[y], x, step, width), _behind(disparity[:, x], y, step, width))
    return behind
