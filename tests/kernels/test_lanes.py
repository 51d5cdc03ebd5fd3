"""Rows of 64 pixels are treated as a pixel at a time would be, in whole numbers; what lies beside them stays."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from farside.engine.kernels.base import lanes, lanes_numpy
from farside.engine.kernels.base.lanes import LANES

MOST = 65535
EDGES = (0, 1, 2, 3, MOST // 2, MOST // 2 + 1, MOST - 1, MOST)
WORDS = (0, 1, -1, 1 << 62, -(1 << 63), 0x0F0F0F0F0F0F0F0F, 6148914691236517205)
SEEDS = range(12)


def calls(name, count):
    """Both: the compiled operation with so many arguments, and NumPy's."""
    names = ", ".join(f"a{k}" for k in range(count))
    scope = {"operation": getattr(lanes, name)}
    exec(f"def run({names}):\n    return operation({names})", scope)
    return numba.njit(scope["run"]), getattr(lanes_numpy, name)


def rows(seed, count, length=LANES):
    """Rows of codes, extremes among them, that begin anywhere: vectors need not be aligned."""
    rng = np.random.default_rng(seed)
    room = rng.integers(0, MOST + 1, (count, length + 8)).astype(np.uint16)
    room[rng.random(room.shape) < 0.4] = 0
    extreme = rng.random(room.shape) < 0.4
    room[extreme] = rng.choice(EDGES, extreme.sum())
    return [row[1 + k % 5 : 1 + k % 5 + length] for k, row in enumerate(room)]


def near(seed, count):
    """Rows whose codes are close to one another, as surfaces' are; few are 0."""
    rng = np.random.default_rng(seed)
    room = rng.integers(900, 960, (count, LANES)).astype(np.uint16)
    room[rng.random(room.shape) < 0.1] = 0
    return list(room)


def bits(word):
    return [(int(word) >> x) & 1 for x in range(LANES)]


def word_of(truths):
    """The word whose bits are these, as a signed number."""
    word = sum(1 << x for x, truth in enumerate(truths) if truth)
    return word - (1 << 64) if word >> 63 else word


def at(row):
    return row.ctypes.data


@pytest.mark.parametrize("word", WORDS)
def test_bits_of_a_word(word):
    for ones, lowest in zip(calls("ones", 1), calls("lowest", 1), strict=True):
        assert ones(word) == sum(bits(word))
        if word:
            assert lowest(word) == bits(word).index(1)


@pytest.mark.parametrize("mask", [1, 2, 0x81, 0xFF])
def test_bits_of_bytes(mask):
    room = np.random.default_rng(mask).integers(0, 256, LANES + 3).astype(np.uint8)
    row = room[3:]
    for bits_of in calls("bits_of", 2):
        assert bits_of(at(row), mask) == word_of(code & mask for code in row.tolist())


def test_bytes_from_words_and_back():
    words = [*WORDS[2:5], 0x123456789ABCDEF, -2]
    for bytes_from in calls("bytes_from", 6):
        room = np.full(LANES + 2, 99, np.uint8)
        bytes_from(*words, at(room[1:]))
        assert room[1:-1].tolist() == [sum(bits(word)[x] << k for k, word in enumerate(words)) for x in range(LANES)]
        assert room[0] == room[-1] == 99


@pytest.mark.parametrize("seed", SEEDS)
def test_codes_that_are_there_or_differ(seed):
    a, b = rows(seed, 2)
    b[::3] = a[::3]
    for there, differ in zip(calls("codes_there", 1), calls("differ", 2), strict=True):
        assert there(at(a)) == word_of(code != 0 for code in a)
        assert differ(at(a), at(b)) == word_of(x != y for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("word", WORDS)
def test_rows_are_moved_and_marked(word):
    (source,) = rows(3, 1)
    for move, mark in zip(calls("move", 2), calls("mark", 2), strict=True):
        room = np.full(LANES + 2, 77, np.uint16)
        move(at(source), at(room[1:]))
        np.testing.assert_array_equal(room, [77, *source, 77])
        mark(word, at(room[1:]))
        np.testing.assert_array_equal(room, [77, *(MOST * bit for bit in bits(word)), 77])


def is_cut(p, q, r, s, edge, odd, has_invalid):
    """Whether no surface joins q and r of four codes in a row."""
    if has_invalid and 0 in (q, r):
        return True
    before = 0 if has_invalid and p == 0 else abs(q - p)
    after = 0 if has_invalid and s == 0 else abs(s - r)
    slope = min(before, after)
    return abs(r - q) > edge + slope + slope // 2 + (slope % 2) * odd


@pytest.mark.parametrize("has_invalid", [False, True])
@pytest.mark.parametrize("odd", [0, 1])
@pytest.mark.parametrize("edge", [0, 7, 30, MOST])
def test_cuts(edge, odd, has_invalid):
    found = set()
    for seed in SEEDS:
        a, b, c, d = (rows if seed % 2 else near)(seed, 4)
        expected = [is_cut(*(int(row[x]) for row in (a, b, c, d)), edge, odd, has_invalid) for x in range(LANES)]
        found |= set(expected)
        for cuts in calls("cuts", 7):
            assert cuts(at(a), at(b), at(c), at(d), edge, odd, has_invalid) == word_of(expected)
    assert found == ({False} if edge == MOST and not has_invalid else {False, True})


def deviation(code, a, b):
    """Twice the distance of a code from the middle of two others, as far as codes go."""
    return min(abs(2 * code - a - b), MOST)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("limit", [0, 40, MOST - 1, MOST])
def test_errors_of_sides(seed, limit):
    reach = 2 * (1 + seed % 4)  # bytes
    step = reach // 2
    make = rows if seed % 2 else near
    code, a, b, least = make(seed, 4)
    above, below = rows(seed + 100, 2, LANES + 2 * step)
    if seed % 2 == 0:
        above[:], below[:], least[:] = above % 50, below % 50, least % 2
    expected = []
    for x in range(LANES):
        children = max(int(row[place]) for row in (above, below) for place in (x, x + 2 * step))
        error = min(deviation(*(int(row[x]) for row in (code, a, b))) + children, MOST)
        expected.append(error | int(least[x]))
    places = at(above[step:]), at(below[step:])
    for side_errors in calls("side_errors", 9):
        out = np.full(LANES + 2, 55, np.uint16)
        over = side_errors(at(code), at(a), at(b), at(least), *places, reach, limit, at(out[1:]))
        np.testing.assert_array_equal(out, [55, *expected, 55])
        assert over == word_of(error > limit for error in expected)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("limit", [0, 40, MOST])
def test_errors_of_squares(seed, limit):
    rng = np.random.default_rng(seed)
    step, width = 1 + seed % 3, LANES + 10  # pixels to the corners, and of a row
    codes, sides = (rng.integers(0, 60 if seed % 2 else MOST + 1, (7, width)).astype(np.uint16) for _ in range(2))
    least, inside, falling = rng.integers(0, 2, LANES).astype(np.uint16), *rng.integers(-(1 << 63), (1 << 63) - 1, 2)
    expected = []
    for x in range(LANES):
        at_x = x + 4
        up, down, before, after = 3 - step, 3 + step, at_x - step, at_x + step
        left = codes[up, before] if bits(falling)[x] else codes[down, before]
        right = codes[down, after] if bits(falling)[x] else codes[up, after]
        children = max(map(int, (sides[up, at_x], sides[down, at_x], sides[3, before], sides[3, after])))
        error = min(deviation(int(codes[3, at_x]), int(left), int(right)) + children, MOST) | int(least[x])
        expected.append(error if bits(inside)[x] else 0)
    for square_errors in calls("square_errors", 9):
        out = np.full(LANES + 2, 55, np.uint16)
        over = square_errors(
            at(codes[3, 4:]), step * codes.strides[0], 2 * step, falling, at(least), at(sides[3, 4:]), inside, limit,
            at(out[1:]),
        )  # fmt: skip
        np.testing.assert_array_equal(out, [55, *expected, 55])
        assert over == word_of(error > limit for error in expected)
