"""Matches of pixels near their place in another picture (IV-PSNR, IV-SSIM), and structural similarity (SSIM)."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from ..base.jit import parallel

__all__ = ["SEARCH_RANGE", "block_similarity", "match_errors", "matched_picture", "similarity_rows"]

SEARCH_RANGE = 2  # pixels in each direction: a 5x5 neighbourhood


@parallel
def match_errors(
    picture: npt.NDArray[np.uint16],  # [3, h, w]
    other: npt.NDArray[np.uint16],  # [3, h, w]
    shift: npt.NDArray[np.int64],  # [3], added to picture
    weights: npt.NDArray[np.int64],  # [3], of the squared errors when matches are compared
) -> npt.NDArray[np.int64]:  # [h, 3]
    """Squared errors of every pixel of `picture` to its best match in `other`, summed over each row."""
    _, height, width = picture.shape
    rows = np.zeros((height, 3), np.int64)
    for y in numba.prange(height):
        top, bottom = max(0, y - SEARCH_RANGE), min(height, y + SEARCH_RANGE + 1)
        sums = (np.int64(0), np.int64(0), np.int64(0))
        for x in range(width):
            left, right = max(0, x - SEARCH_RANGE), min(width, x + SEARCH_RANGE + 1)
            c0, c1, c2 = (
                picture[0, y, x] + shift[0],
                picture[1, y, x] + shift[1],
                picture[2, y, x] + shift[2],
            )
            least, best = np.iinfo(np.int64).max, sums
            for v in range(top, bottom):
                for u in range(left, right):
                    e0, e1, e2 = (
                        (c0 - other[0, v, u]) ** 2,
                        (c1 - other[1, v, u]) ** 2,
                        (c2 - other[2, v, u]) ** 2,
                    )
                    error = weights[0] * e0 + weights[1] * e1 + weights[2] * e2
                    if error < least:
                        least, best = error, (e0, e1, e2)
            sums = (sums[0] + best[0], sums[1] + best[1], sums[2] + best[2])
        rows[y, 0], rows[y, 1], rows[y, 2] = sums
    return rows


@parallel
def matched_picture(
    picture: npt.NDArray[np.uint16],  # [3, h, w]
    other: npt.NDArray[np.uint16],  # [3, h, w]
    shift: npt.NDArray[np.int64],  # [3], added to picture, and subtracted from the matches
    weights: npt.NDArray[np.int64],  # [3], of the squared errors when matches are compared
    peak: int,
) -> npt.NDArray[np.uint16]:  # [3, h, w]
    """The best match in `other` of every pixel of `picture`: the first of equally good ones."""
    _, height, width = picture.shape
    found = np.empty(picture.shape, np.uint16)
    for y in numba.prange(height):
        top, bottom = max(0, y - SEARCH_RANGE), min(height, y + SEARCH_RANGE + 1)
        for x in range(width):
            left, right = max(0, x - SEARCH_RANGE), min(width, x + SEARCH_RANGE + 1)
            c0, c1, c2 = picture[0, y, x] + shift[0], picture[1, y, x] + shift[1], picture[2, y, x] + shift[2]
            least, row, column = np.iinfo(np.int64).max, top, left
            for v in range(top, bottom):
                for u in range(left, right):
                    e0, e1, e2 = (c0 - other[0, v, u]) ** 2, (c1 - other[1, v, u]) ** 2, (c2 - other[2, v, u]) ** 2
                    error = weights[0] * e0 + weights[1] * e1 + weights[2] * e2
                    if error < least:
                        least, row, column = error, v, u
            for c in range(3):
                found[c, y, x] = min(max(other[c, row, column] - shift[c], 0), peak)
    return found


@parallel
def block_similarity(
    ref: npt.NDArray[np.uint16],  # [3, h, w]
    test: npt.NDArray[np.uint16],  # [3, h, w]
    half: int,  # of a window's side, and from window to window
    c1: float,
    c2: float,
    luminance: bool,  # else contrast and structure only
) -> npt.NDArray[np.float64]:  # [3, rows]
    """SSIM with windows of equal weights that lie inside the pictures: means over each row of windows."""
    cells = ref.shape[2] // half
    rows, area = ref.shape[1] // half - 1, 4.0 * half * half
    means = np.zeros((3, rows))
    for k in numba.prange(3 * rows):
        plane, row = np.int64(k) // rows, np.int64(k) % rows
        total, zero = 0.0, np.int64(0)
        left_a, left_b, left_aa, left_bb, left_ab = zero, zero, zero, zero, zero
        for i in range(cells):
            a, b, aa, bb, ab = zero, zero, zero, zero, zero
            for y in range(row * half, (row + 2) * half):
                for x in range(i * half, (i + 1) * half):
                    p, q = np.int64(ref[plane, y, x]), np.int64(test[plane, y, x])
                    a, b, aa, bb, ab = a + p, b + q, aa + p * p, bb + q * q, ab + p * q
            if i > 0:
                mean_a, mean_b = (a + left_a) / area, (b + left_b) / area
                var_a, var_b = (aa + left_aa) / area - mean_a**2, (bb + left_bb) / area - mean_b**2
                alike = (2 * ((ab + left_ab) / area - mean_a * mean_b) + c2) / (var_a + var_b + c2)
                if luminance:
                    alike *= (2 * mean_a * mean_b + c1) / (mean_a**2 + mean_b**2 + c1)
                total += alike
            left_a, left_b, left_aa, left_bb, left_ab = a, b, aa, bb, ab
        means[plane, row] = total / (cells - 1)
    return means


@parallel
def similarity_rows(
    ref: npt.NDArray[np.uint16],  # [h, w]
    test: npt.NDArray[np.uint16],  # [h, w]
    window: npt.NDArray[np.float64],  # [k], sums to 1: weights along each axis
    c1: float,
    c2: float,
) -> npt.NDArray[np.float64]:  # [h - k + 1]
    """SSIM of all windows that lie inside the pictures, summed over each row of them."""
    height, width = ref.shape
    taps = len(window)
    rows = np.empty(height - taps + 1)
    for y in numba.prange(height - taps + 1):
        # Down the columns first: means of a, b, a^2, b^2 and a b.
        columns = np.zeros((5, width))
        for k in range(taps):
            for x in range(width):
                a, b = float(ref[y + k, x]), float(test[y + k, x])
                columns[0, x] += window[k] * a
                columns[1, x] += window[k] * b
                columns[2, x] += window[k] * a * a
                columns[3, x] += window[k] * b * b
                columns[4, x] += window[k] * a * b
        total = 0.0
        for x in range(width - taps + 1):
            a, b, aa, bb, ab = 0.0, 0.0, 0.0, 0.0, 0.0
            for k in range(taps):
                a += window[k] * columns[0, x + k]
                b += window[k] * columns[1, x + k]
                aa += window[k] * columns[2, x + k]
                bb += window[k] * columns[3, x + k]
                ab += window[k] * columns[4, x + k]
            luminance = (2 * a * b + c1) / (a * a + b * b + c1)
            structure = (2 * (ab - a * b) + c2) / (aa - a * a + bb - b * b + c2)
            total += luminance * structure
        rows[y] = total
    return rows
