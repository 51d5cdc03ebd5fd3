"""Late layers, the slow way: what stands before known background, and which pixels become a late layer."""

from __future__ import annotations

import itertools

import numpy as np
from oracle.projection import project
from oracle.rays import delta_at


def is_before(coding, code, known, delta):
    """Whether a known code is a depth that is farther than that of a code by more than delta."""
    near, far = coding.depth(np.array([code, known]))
    return bool(far > near + delta_at(delta, near))  # nan: nothing known


def is_same(coding, code, other, margin_m, margin_disparity):
    """Whether neither depth is farther than the other by both margins, metres and 1/m."""
    a, b = sorted(coding.depth(np.array([code, other])))
    return not (b > a + margin_m and 1.0 / b < 1.0 / a - margin_disparity)


def note(coding, new, known, margins, delta, need, codes, turns):
    """A camera's turn as `kernels.background.late_layers.note_standing`; codes and turns are written to."""
    count = 0
    for y, x in np.ndindex(codes.shape):
        code = new[2 * y, 2 * x]
        if code == 0 and coding.has_invalid:
            continue
        if not is_before(coding, code, known[2 * y, 2 * x], delta):
            turns[y, x] = 0
            continue
        if turns[y, x] and is_same(coding, code, codes[y, x], *margins):
            turns[y, x] = min(int(turns[y, x]) + 1, need + 8)
            count += turns[y, x] == need
        elif turns[y, x] > need and coding.depth(code) < coding.depth(codes[y, x]):
            turns[y, x] -= 1
        else:
            codes[y, x], turns[y, x] = code, 1
            count += need == 1
    return count


def select(coding, new, known, margins, delta, edge, need, codes, turns):
    """Which pixels become a late layer, as `kernels.background.late_layers.select_standing`; bool [h, w]."""
    h, w = new.shape
    keep = np.zeros((h, w), bool)
    stood = np.zeros((turns.shape[0] + 1, turns.shape[1] + 1), bool)
    for r, c in np.argwhere(turns >= need):
        shown = new[2 * r, 2 * c]
        stood[r, c] = (shown > 0 or not coding.has_invalid) and is_same(coding, shown, codes[r, c], *margins)
    for y, x in np.ndindex(h, w):
        code, (r, c) = int(new[y, x]), (y // 2, x // 2)
        if (code == 0 and coding.has_invalid) or not stood[r, c]:
            continue
        flat = abs(code - int(new[2 * r, 2 * c])) <= edge
        around = known[max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2].ravel()
        clear = all(is_before(coding, code, other, delta) for other in around)
        keep[y, x] = clear and (flat or stood[r : r + 2, c : c + 2].all())
    return keep


def across(a, b):
    return a[0] * b[1] - a[1] * b[0]


def covered(camera, codes, corners, delta):
    """Which pixels [h, w] of a view lie in the image of a triangle [3, 3] and within delta of its plane; and which of
    the others are so close to the image's sides that rounding decides."""
    (w, h), wraps = (camera.width, camera.height), camera.wraps
    images = [project(camera, corner) for corner in corners]
    uv, depth = np.array([image[:2] for image in images]), np.array([image[2] for image in images])
    inside, unsure = np.zeros((2, h, w), bool)
    if not (depth > 0).all():
        return inside, unsure
    if wraps:
        uv[:, 0] -= w * np.round((uv[:, 0] - uv[0, 0]) / w)
    turn = across(uv[1] - uv[0], uv[2] - uv[0])
    there = camera.depth.depth(codes)
    for y, x in itertools.product(range(h), range(-w, 2 * w) if wraps else range(w)):
        at = np.array([x + 0.5, y + 0.5])
        weights = np.array([across(uv[k - 2] - at, uv[k - 1] - at) for k in range(3)]) / turn
        found = 1.0 / (weights @ (1.0 / depth)) if weights.min() > -0.01 else np.nan
        if abs(there[y, x % w] - found) <= delta_at(delta, found):
            inside[y, x % w] |= weights.min() >= 0
            unsure[y, x % w] |= weights.min() < 0
    return inside, unsure
