"""Triangles that can cover no more than 2 x 2 pixels are drawn as all others are, bit for bit."""

from __future__ import annotations

import numba
import numpy as np
from farside.engine.kernels.base.simd import LANES
from farside.engine.kernels.rendering.strips import (
    SET_UP_SIZE,
    SPECKS_SIZE,
    draw_speck,
    draw_triangle,
    find_specks,
    pixels_of,
    prepared,
    row_count,
    set_up,
)

WIDTH, HEIGHT = 37, 29
MARGIN = np.float32(0.004)


@numba.njit
def draw(screen, triangles, numbers, disparity, winner, as_specks):
    """Draws sixteen triangles at a time; returns how many were specks, and how many of these cover a pixel."""
    room, specks, covering = np.empty(SET_UP_SIZE + SPECKS_SIZE, np.float32), 0, 0
    ready, found = room.ctypes.data, room.ctypes.data + 4 * SET_UP_SIZE
    for k in range(0, len(numbers), LANES):
        n = min(LANES, len(numbers) - k)
        set_up(
            screen.ctypes.data, triangles.ctypes.data, numbers.ctypes.data + 4 * k, n, 1, np.float32(0.01),
            (0, HEIGHT - 1), (WIDTH, HEIGHT), ready,
        )  # fmt: skip
        find_specks(ready, found)
        for lane in range(n):
            pixels = pixels_of(found, lane)
            specks, covering = specks + (pixels >= 0), covering + (pixels > 0)
            if as_specks and pixels >= 0:
                draw_speck(prepared(ready, lane), found, lane, disparity, winner, MARGIN, 3)
            elif row_count(prepared(ready, lane)) >= 0:
                draw_triangle(prepared(ready, lane), disparity.ctypes.data, winner.ctypes.data, WIDTH, MARGIN, 3)
    return specks, covering


def test_specks_are_drawn_as_triangles_are():
    rng, count = np.random.default_rng(0), 3000
    middles = rng.uniform((-2, -2), (WIDTH + 2, HEIGHT + 2), (count, 2))
    corners = middles[:, np.newaxis] + rng.uniform(-1, 1, (count, 3, 2)) * rng.choice([0.3, 1.0, 2.0], (count, 1, 1))
    corners[::7] = np.round(corners[::7] * 2) / 2  # sides and corners on the centres of pixels, some triangles lines
    screen = np.zeros((3 * count, 4), np.float32)
    screen[:, :2], screen[:, 2] = corners.reshape(-1, 2), rng.uniform(0.2, 2.0, 3 * count)
    screen[:, 3] = 1.0 / screen[:, 2]
    triangles, numbers = np.arange(3 * count, dtype=np.int32).reshape(-1, 3), np.arange(count, dtype=np.int32)
    before = (rng.uniform(0.2, 1.0, (HEIGHT, WIDTH)) * (rng.random((HEIGHT, WIDTH)) < 0.5)).astype(np.float32)
    results = []
    for as_specks in (True, False):
        disparity, winner = before.copy(), np.zeros((HEIGHT, WIDTH), np.uint8)
        counts = [
            draw(screen, triangles, numbers[k : k + 50], disparity, winner, as_specks) for k in range(0, count, 50)
        ]
        specks, covering = np.sum(counts, axis=0)
        assert 0.5 * count < specks < count
        assert 0.05 * count < covering < specks
        results.append((disparity, winner))
    (disparity, winner), (expected, expected_winner) = results
    np.testing.assert_array_equal(disparity, expected)
    np.testing.assert_array_equal(winner, expected_winner)
    assert 0.1 < (winner == 3).mean() < 1.0
    assert (disparity != before).any()
