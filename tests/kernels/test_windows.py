"""Squares and windows: compiled code picks what NumPy picks, on processors with and without the permutation."""

from __future__ import annotations

import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from farside.engine.kernels.base import simd, windows, windows_numpy
from farside.engine.kernels.base.memory import address_of, load, store
from farside.engine.kernels.base.simd import LANES, evens, odds
from farside.engine.kernels.base.vectors_numpy import Floats, Integers, Mask
from farside.engine.kernels.base.windows import WINDOW_COLUMNS, WINDOW_ROWS

ROWS, COLUMNS = 11, 21


@numba.njit
def picked(halves, marks, first, places, out):
    """Pairs, quads and bytes at places of a window whose first element is number `first`."""
    where = simd.to_integers(load(places, 0))
    window = windows.window_of_halves(halves, first, COLUMNS)
    pairs = windows.pairs_within(window, where)
    store(out, 0, simd.to_floats(pairs & 0xFFFF))
    store(out, LANES, simd.to_floats(pairs >> 16))
    some, rest = windows.quads_within(window, where)
    store(out, 2 * LANES, simd.to_floats(evens(some, rest) & 0xFFFF))
    store(out, 3 * LANES, simd.to_floats(odds(some, rest) >> 16))
    marked = windows.pairs_within(windows.window_of_bytes(marks, first, COLUMNS), where)
    store(out, 4 * LANES, simd.to_floats(marked & 0xFFFF))
    windows.prefetch_window(halves, 1 << 40, COLUMNS)


@pytest.mark.parametrize("corner", [(0, 0), (ROWS - WINDOW_ROWS, COLUMNS - WINDOW_COLUMNS)])
def test_lanes_pick_from_a_window(corner):
    """Both at the picture's first element and at its last one: no more than the window is read."""
    rng = np.random.default_rng(0)
    halves = rng.integers(0, 1 << 16, (ROWS, COLUMNS)).astype(np.uint16)
    marks = rng.integers(0, 256, (ROWS, COLUMNS)).astype(np.uint8)
    row, column = rng.integers(0, WINDOW_ROWS, LANES), rng.integers(0, WINDOW_COLUMNS - 3, LANES)
    row[:2], column[:2] = (0, WINDOW_ROWS - 1), (0, WINDOW_COLUMNS - 4)
    places, out = (row * WINDOW_COLUMNS + column).astype(np.float32), np.empty((5, LANES), np.float32)
    first = corner[0] * COLUMNS + corner[1]
    picked(halves.ctypes.data, marks.ctypes.data, first, places.ctypes.data, out.ctypes.data)
    y, x = corner[0] + row, corner[1] + column
    expected = [halves[y, x], halves[y, x + 1], halves[y, x], halves[y, x + 3], marks[y, x]]
    np.testing.assert_array_equal(out, expected)
    where = Integers(places.astype(np.int32))
    twin = windows_numpy.window_of_halves(address_of(halves), first, COLUMNS)
    np.testing.assert_array_equal(windows_numpy.pairs_within(twin, where).lanes & 0xFFFF, halves[y, x])
    some, rest = windows_numpy.quads_within(twin, where)
    np.testing.assert_array_equal(np.concatenate([some.lanes, rest.lanes])[1::2] >> 16 & 0xFFFF, halves[y, x + 3])


def test_a_window_beyond_an_array_is_told_where_nothing_is_compiled():
    halves = np.zeros((WINDOW_ROWS, COLUMNS), np.uint16)
    windows_numpy.window_of_halves(address_of(halves), COLUMNS - WINDOW_COLUMNS, COLUMNS)
    with pytest.raises(IndexError, match="beyond it"):
        windows_numpy.window_of_halves(address_of(halves), COLUMNS - WINDOW_COLUMNS + 1, COLUMNS)


def test_other_processors_pick_the_same():
    """In a process of its own, that compiles for a processor without the permutation."""
    code = (
        "import pytest, sys; from farside.engine.kernels.base import windows, kernel; import numba;"
        "assert not numba.njit(lambda: windows.fast_windows())();"
        f"sys.exit(pytest.main(['-q', '-p', 'no:cacheprovider', {__file__!r}, '-k', 'from_a_window or squares']))"
    )
    environment = {**os.environ, "NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@numba.njit
def extent(x, y, among):
    return windows.extent_of(
        simd.to_integers(load(x, 0)), simd.to_integers(load(y, 0)), load(among, 0) > 0.0
    )


@pytest.mark.parametrize("kept", [0.0, 0.1, 0.5, 1.0])
def test_extents_are_those_of_chosen_lanes(kept):
    rng = np.random.default_rng(1)
    for _ in range(50):
        x, y = rng.integers(0, 65535, (2, LANES)).astype(np.float32)
        among = (rng.random(LANES) < kept).astype(np.float32)
        found = extent(x.ctypes.data, y.ctypes.data, among.ctypes.data)
        chosen = [(values.min(initial=65535), values.max(initial=0)) for values in (x[among > 0], y[among > 0])]
        (left, right), (top, bottom) = chosen
        assert found == (left, top, right, bottom)
        twin = windows_numpy.extent_of(Integers(x.astype(np.int32)), Integers(y.astype(np.int32)), Mask(among > 0))
        assert twin == found


@numba.njit
def by_square(source, target, sums):
    """Moves squares of a cell of 8 x 8 numbers, and adds its blocks of 2 x 2."""
    a, b = windows.load_square(source, 0, 8), windows.load_square(source, 4, 8)
    c, d = windows.load_square(source, 32, 8), windows.load_square(source, 36, 8)
    windows.store_square(target, 0, 8, a)
    windows.store_square(target, 4, 8, b)
    windows.store_square(target, 32, 8, c)
    windows.store_square(target, 36, 8, d)
    top, bottom = evens(a, b) + odds(a, b), evens(c, d) + odds(c, d)
    store(sums, 0, windows.upper_rows(top, bottom) + windows.lower_rows(top, bottom))
    return windows.lane_of(simd.to_integers(a), 3)


def test_squares_of_a_cell():
    cell = np.random.default_rng(2).integers(0, 99, (8, 8)).astype(np.float32)
    moved, sums = np.full_like(cell, np.nan), np.empty((4, 4), np.float32)
    assert by_square(cell.ctypes.data, moved.ctypes.data, sums.ctypes.data) == cell[0, 3]
    np.testing.assert_array_equal(moved, cell)
    np.testing.assert_array_equal(sums, cell.reshape(4, 2, 4, 2).sum(axis=(1, 3)))
    parts = [windows_numpy.load_square(address_of(cell), first, 8) for first in (0, 4, 32, 36)]
    halves = [Floats(np.add.reduceat(np.r_[l.lanes, r.lanes], np.arange(0, 32, 2))) for l, r in (parts[:2], parts[2:])]  # noqa: E741
    rows = [kernel(*halves).lanes for kernel in (windows_numpy.upper_rows, windows_numpy.lower_rows)]
    np.testing.assert_array_equal(np.sum(rows, axis=0).reshape(4, 4), sums)
    copied = np.zeros_like(cell)
    for first, part in zip((0, 4, 32, 36), parts, strict=True):
        windows_numpy.store_square(address_of(copied), first, 8, part)
    np.testing.assert_array_equal(copied, cell)
