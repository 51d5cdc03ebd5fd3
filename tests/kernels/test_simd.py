"""Vectors in kernels compute the same as NumPy in each lane, and gathers read only the lanes of their mask."""

from __future__ import annotations

import operator

import numba
import numpy as np
import pytest
from farside.engine.kernels.base import memory, records, records_numpy, simd, simd_numpy
from farside.engine.kernels.base.memory import address_of, load, store
from farside.engine.kernels.base.simd import LANES, evens, maximum, minimum, odds, select, spread
from farside.engine.kernels.base.vectors_numpy import Floats, Integers, Mask

rng = np.random.default_rng(0)
X, Y = rng.uniform(-9, 9, LANES).astype(np.float32), rng.uniform(1, 9, LANES).astype(np.float32)
X[:4] = Y[:4]


@numba.njit
def as_integers(x):
    return simd.to_integers(x)


@numba.njit
def as_floats(x):
    return simd.to_floats(x)


def lanes(function, *arrays):
    """A compiled function of vectors, applied to arrays."""
    compiled = numba.njit(function)
    out = np.full(LANES, np.nan, np.float32)
    if len(arrays) == 1:

        @numba.njit
        def run(x, out):
            store(out, 0, compiled(load(x, 0)))
    else:

        @numba.njit
        def run(x, y, out):
            store(out, 0, compiled(load(x, 0), load(y, 0)))

    run(*(array.ctypes.data for array in arrays), out.ctypes.data)
    return out


ARITHMETIC = {
    "sum": lambda x, y: x + y,
    "difference": lambda x, y: x - y,
    "product": lambda x, y: x * y,
    "ratio": lambda x, y: x / y,
    "with numbers": lambda x, y: 2 * x - y / 4.0 + 1,
    "negative": lambda x, y: -x,
}


@pytest.mark.parametrize("name", ARITHMETIC)
def test_arithmetic(name):
    function = ARITHMETIC[name]
    np.testing.assert_allclose(lanes(function, X, Y), function(X, Y), rtol=2e-7, atol=1e-6)


def test_in_place():
    def changed(x, y):
        x += y
        x *= y
        x -= 1.0
        return x

    np.testing.assert_allclose(lanes(changed, X, Y), (X + Y) * Y - 1, rtol=1e-6)


@pytest.mark.parametrize("compare", [operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne])
def test_comparisons_choose(compare):
    found = lanes(lambda x, y: select(compare(x, y), x, -100.0), X, Y)
    np.testing.assert_array_equal(found, np.where(compare(X, Y), X, np.float32(-100)))


@pytest.mark.parametrize("compare", [operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne])
def test_what_is_no_number_compares_as_in_numpy(compare):
    """It differs from everything, itself as well; nothing else is true of it: here, in NumPy, and in the twin of it."""
    special = np.array([np.nan, np.inf, -np.inf, 0.0, -0.0, 1.0], np.float32)
    x, y = (np.resize(array, 3 * LANES).reshape(3, LANES) for array in (special, np.repeat(special, 6)))
    assert {(*pair,) for pair in zip(np.isnan(x.ravel()), np.isnan(y.ravel()), strict=True)} == {
        (False, False), (False, True), (True, False), (True, True),
    }  # fmt: skip
    for one, other in zip(x, y, strict=True):
        expected = compare(one, other)
        found = lanes(lambda x, y: select(compare(x, y), spread(1.0), spread(0.0)), one, other)
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(compare(Floats(one), Floats(other)).lanes, expected)


@pytest.mark.parametrize("kernel", [minimum, maximum])
def test_of_a_number_and_none_the_second_is_taken(kernel):
    x, y = X.copy(), Y.copy()
    x[::3], y[1::3] = np.nan, np.nan
    expected = np.where(x < y if kernel is minimum else x > y, x, y)
    np.testing.assert_array_equal(lanes(lambda x, y: kernel(x, y), x, y), expected)
    twin = simd_numpy.minimum if kernel is minimum else simd_numpy.maximum
    np.testing.assert_array_equal(twin(Floats(x), Floats(y)).lanes, expected)


def test_truths_combine():
    found = lanes(lambda x, y: select((x < 0.0) & ~(y < 5.0) | (x > 4.0) ^ (y > 7.0), spread(1.0), 0.0), X, Y)
    np.testing.assert_array_equal(found, (X < 0) & ~(Y < 5) | (X > 4) ^ (Y > 7))


def test_extremes_and_roots():
    np.testing.assert_array_equal(lanes(lambda x, y: minimum(x, y), X, Y), np.minimum(X, Y))
    np.testing.assert_array_equal(lanes(lambda x, y: maximum(x, y), X, Y), np.maximum(X, Y))
    np.testing.assert_array_equal(lanes(lambda x: maximum(x, 0.0), X), np.maximum(X, 0))
    np.testing.assert_allclose(lanes(lambda x: simd.square_root(x), Y), np.sqrt(Y), rtol=2e-7)


def test_rounding():
    np.testing.assert_array_equal(lanes(lambda x: simd.round_down(x), X), np.floor(X))
    np.testing.assert_array_equal(lanes(lambda x: simd.round_up(x), X), np.ceil(X))


def test_integers():
    a, b = X.astype(np.int32), Y.astype(np.int32)  # towards zero

    def mixed(x, y):
        i, j = as_integers(x), as_integers(y)
        return as_floats((((i & 7) | (j << 3)) ^ 5) + minimum(i, j) * 2 - (j >> 1))

    np.testing.assert_array_equal(lanes(mixed, X, Y), (((a & 7) | (b << 3)) ^ 5) + np.minimum(a, b) * 2 - (b >> 1))
    shifted = lanes(lambda x: as_floats(as_integers(x) >> 28), X)  # as unsigned
    np.testing.assert_array_equal(shifted, a.view(np.uint32) >> 28)


def test_every_other():
    both = np.concatenate([X, Y])
    np.testing.assert_array_equal(lanes(lambda x, y: evens(x, y), X, Y), both[::2])
    np.testing.assert_array_equal(lanes(lambda x, y: odds(x, y), X, Y), both[1::2])
    in_turn = np.stack([X, Y], axis=1).ravel()
    np.testing.assert_array_equal(lanes(lambda x, y: simd.zipped(x, y), X, Y), in_turn[:LANES])
    np.testing.assert_array_equal(lanes(lambda x, y: simd.zipped_rest(x, y), X, Y), in_turn[LANES:])


def test_pairs_of_products():
    low, high = np.rint(X * 100), np.rint(Y * 100)  # of either sign

    def sums(x, y):
        i, j = as_integers(x), as_integers(y)
        return as_floats(simd.sum_pairs((i & 0xFFFF) | (j << 16), (j & 0xFFFF) | ((i + j) << 16)))

    np.testing.assert_array_equal(lanes(sums, low, high), low * high + high * (low + high))


@pytest.mark.parametrize("lane", [None, 0, LANES - 1])
def test_any_lane(lane):
    x = np.zeros(LANES, np.float32)
    if lane is not None:
        x[lane] = 1
    found = lanes(lambda x: spread(1.0) if simd.any_of(x > 0.0) else spread(0.0), x)
    assert (found == (lane is not None)).all()


GATHERS = {
    "halves": lambda at, i, m: as_floats(memory.gather_halves(at, i, m) & 0xFFFF),
    "second halves": lambda at, i, m: as_floats(memory.gather_halves(at, i, m) >> 16),
    "quads": lambda at, i, m: as_floats(evens(*memory.gather_quads(at, i, m)) & 0xFFFF),
    "last of quads": lambda at, i, m: as_floats(odds(*memory.gather_quads(at, i, m)) >> 16),
    "bytes": lambda at, i, m: as_floats(memory.gather_bytes(at, i << 1, m) & 0xFFFF),
}
AHEAD = {"halves": 0, "second halves": 1, "quads": 0, "last of quads": 3, "bytes": 0}


@pytest.mark.parametrize("name", GATHERS)
def test_gathers_read_where_the_mask_is_true(name):
    gather, data = numba.njit(GATHERS[name]), rng.integers(0, 1 << 16, 100).astype(np.uint16)
    index = rng.integers(0, 96, LANES).astype(np.float32)
    index[3] = 2e9  # beyond all memory: masked out
    out, address = np.empty(LANES, np.float32), data.ctypes.data

    @numba.njit
    def run(index, out):
        places = as_integers(load(index, 0))
        memory.prefetch(address, places)
        store(out, 0, gather(address, places, load(index, 0) < 1000.0))

    run(index.ctypes.data, out.ctypes.data)
    expected = [data[int(i) + AHEAD[name]] if i < 1000 else 0 for i in index]
    np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize("kind", [np.float32, np.int32])
def test_gathers_of_whole_numbers_and_floats(kind):
    gather = memory.gather_floats if kind is np.float32 else memory.gather_integers
    whole = kind is np.int32
    data = rng.integers(-1000, 1000, 100).astype(kind)
    index = rng.integers(0, 100, LANES).astype(np.float32)
    index[5] = 2e9
    out, address = np.empty(LANES, np.float32), data.ctypes.data

    @numba.njit
    def run(index, out):
        found = gather(address, as_integers(load(index, 0)), load(index, 0) < 1000.0)
        store(out, 0, as_floats(found) if whole else found)

    run(index.ctypes.data, out.ctypes.data)
    np.testing.assert_array_equal(out, [data[int(i)] if i < 1000 else 0 for i in index])


@pytest.mark.parametrize("least", [-100.0, 3.0, 100.0])
def test_packed_are_those_where_the_mask_is_true(least):
    out, x = np.full(LANES, -7, np.int32), np.rint(X * 10)

    @numba.njit
    def run(x, out):
        return memory.store_packed(out, as_integers(load(x, 0)), load(x, 0) > least)

    expected = x[x > least].astype(np.int32)
    assert run(x.ctypes.data, out.ctypes.data) == len(expected)
    np.testing.assert_array_equal(out[: len(expected)], expected)


def test_the_larger_is_stored():
    out = np.empty(LANES, np.float32)
    larger = numba.njit(lambda x, y, out: memory.store_larger(out, 0, load(x, 0), load(y, 0)))
    larger(X.ctypes.data, Y.ctypes.data, out.ctypes.data)
    np.testing.assert_array_equal(out, np.maximum(X, Y))


def test_scalars_by_address():
    floats, integers = np.arange(4, dtype=np.float32) / 2, np.arange(4) - (1 << 40)
    found = numba.njit(lambda a, b: (memory.load_f32(a, 3), memory.load_i64(b, 1)))
    assert found(floats.ctypes.data, integers.ctypes.data) == (1.5, 1 - (1 << 40))


def test_masked_memory_is_touched_only_where_the_mask_is_true():
    @numba.njit
    def move(source, target, bytes_, below):
        mask = simd.lane_numbers() < np.float32(below)
        memory.store_where(target, 1, memory.load_where(source, 0, mask) + 1.0, mask)
        memory.store_byte_where(bytes_, 2, 300, mask)

    source, target = np.arange(5, 21, dtype=np.float32), np.full(18, -1, np.float32)
    bytes_ = np.full(20, 7, np.uint8)
    move(source.ctypes.data, target.ctypes.data, bytes_.ctypes.data, 6)
    np.testing.assert_array_equal(target, [-1, *(source[:6] + 1), *[-1] * 11])
    np.testing.assert_array_equal(bytes_, [7, 7, *[300 & 255] * 6, *[7] * 12])


def test_records_are_gathered_field_by_field():
    data = rng.uniform(-9, 9, (50, 4)).astype(np.float32)
    index = rng.integers(0, 50, LANES).astype(np.float32)
    index[[2, 9]] = 2e9  # beyond all memory: masked out
    out = np.empty((4, LANES), np.float32)

    @numba.njit
    def run(data, index, out):
        fields = records.gather_records(data, as_integers(load(index, 0)), load(index, 0) < 1000.0)
        for k in range(4):
            store(out, k * LANES, fields[k])

    run(data.ctypes.data, index.ctypes.data, out.ctypes.data)
    chosen = np.where(index < 1000, index, 0).astype(int)
    np.testing.assert_array_equal(out, data[chosen].T)
    twin = records_numpy.gather_records(address_of(data), Integers(chosen.astype(np.int32)), Mask(index < 1000))
    np.testing.assert_array_equal([field.lanes for field in twin], out)


def test_triples_are_loaded_field_by_field():
    data, out = rng.integers(-1000, 1000, (LANES + 2, 3)).astype(np.int32), np.empty((3, LANES), np.float32)

    @numba.njit
    def run(data, out):
        fields = records.load_triples(data, 2)
        for k in range(3):
            store(out, k * LANES, as_floats(fields[k]))

    run(data.ctypes.data, out.ctypes.data)
    np.testing.assert_array_equal(out, data[2:].T)
    np.testing.assert_array_equal([field.lanes for field in records_numpy.load_triples(address_of(data), 2)], out)
