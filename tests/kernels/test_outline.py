"""Parallel loops become functions of their own, which do what the loops do, on any number of threads."""

from __future__ import annotations

import functools
import sys
from typing import NamedTuple

import numba
import numpy as np
import pytest
from farside.engine.kernels.base.jit import parallel, serial
from farside.engine.kernels.base.outline import outline
from farside.engine.support.runtime import one_thread, set_thread_count, thread_count
from numba import prange
from numba.extending import intrinsic

pytestmark = pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")


made = functools.cache(parallel)


def sums(a, b, factor=3):
    more = factor + 1
    for i in numba.prange(a.shape[0]):
        total = 0.0
        for x in range(a.shape[1]):
            total += a[i, x]
        b[i] = total * more
    for i in prange(2, a.shape[0]):
        if a[i, 0] < 0:
            continue
        b[i] += i


def count(a, least):
    found = 10
    for row in numba.prange(a.shape[0]):
        for x in range(a.shape[1]):
            if a[row, x] >= least:
                found += 1
    return found


def by_level(levels, a):
    for level in range(levels):
        share = level + 1
        for i in numba.prange(a.shape[0]):
            a[i] += share


def takes_last(a):
    last = 0
    for i in numba.prange(a.shape[0]):
        last = i
    return last


class Plane(NamedTuple):
    samples: np.ndarray
    mask: np.ndarray


def knows_twice(plane):
    samples = plane.samples
    for i in numba.prange(samples.shape[0]):
        plane.samples[i] = samples[i] + 1


def knows_a_slice(a):
    later = a[1:]
    for i in numba.prange(later.shape[0]):
        later[i] = a[i]


def turned(planes, out):
    for i in numba.prange(out.shape[0]):
        samples, mask = planes[0]
        row = samples[i]
        out[i] = row[::-1].sum() if mask[i] else planes[1].samples[i, 0]


@intrinsic
def owner(typing, array):
    """The address of what counts the references to an array."""

    def generate(context, builder, signature, arguments):
        data = context.make_array(array)(context, builder, arguments[0])
        return builder.ptrtoint(data.meminfo, context.get_value_type(numba.intp))

    return numba.intp(array), generate


def owned(planes, out):
    for i in numba.prange(out.shape[0]):
        out[i, 0], out[i, 1], out[i, 2] = owner(planes[0].samples), owner(planes[1].mask), owner(out)


def returns(a):
    for i in numba.prange(a.shape[0]):
        if a[i] > 0:
            return i
    return -1


def multiplies(a):
    product = 1
    for i in numba.prange(a.shape[0]):
        product *= a[i]
    return product


def note_threads(numbers):
    for i in numba.prange(numbers.shape[0]):
        numbers[i] = numba.get_thread_id()


def fails(a):
    for i in numba.prange(a.shape[0]):
        if a[i] > 0:
            raise ValueError("positive")
        a[i] = 1


@pytest.mark.parametrize("rows", [0, 1, 2, 3, 7, 1000])
@pytest.mark.parametrize("threads", [1, thread_count()])
def test_loops_do_what_they_do_uncompiled(rows: int, threads: int) -> None:
    before, a = thread_count(), np.random.default_rng(rows).normal(size=(rows, 5))
    expected, got = np.zeros(rows), np.zeros(rows)
    sums(a, expected)
    steps_expected, steps = np.zeros(rows), np.zeros(rows)
    by_level(3, steps_expected)
    set_thread_count(threads)
    try:
        made(sums)(a, got)
        made(by_level)(3, steps)
        assert made(count)(a, 0.5) == count(a, 0.5)
    finally:
        set_thread_count(before)
    np.testing.assert_allclose(got, expected, rtol=1e-12)
    np.testing.assert_array_equal(steps, steps_expected)


@pytest.mark.parametrize("function", [takes_last, returns, multiplies, knows_twice, knows_a_slice])
def test_loops_that_do_more_than_write_and_count_are_refused(function) -> None:
    with pytest.raises(ValueError, match=rf"{function.__name__}, line \d+: .*expected"):
        outline(function, "share")


def test_an_exception_in_any_part_is_told() -> None:
    kernel = made(fails)
    for where in (0, 99):
        a = np.zeros(100)
        a[where] = 1
        with pytest.raises(RuntimeError, match="a part of a parallel loop failed"):
            kernel(a)
    kernel(np.zeros(100))


def test_each_thread_takes_a_part() -> None:
    """As many threads work as the calling one may use: their numbers are those of the pool."""
    numbers = np.full(1000, -1)
    kernel = made(note_threads)
    kernel(numbers)
    assert 1 <= len(set(numbers)) <= thread_count()
    with one_thread():
        kernel(numbers)
    assert len(set(numbers)) == 1


def _private(x):
    return x + 1


def test_arrays_in_records_are_lent_to_the_threads() -> None:
    planes = tuple(Plane(np.full((64, 3), float(k)), np.arange(64) % 2 == k) for k in range(2))
    out = np.zeros(64)
    counts = [sys.getrefcount(array) for plane in planes for array in plane]
    for _ in range(50):
        made(turned)(planes, out)
    assert out.tolist() == [0.0, 1.0] * 32
    assert [sys.getrefcount(array) for plane in planes for array in plane] == counts


def test_no_thread_changes_the_count_of_an_arrays_references() -> None:
    """Atomic changes of one count by all threads would cost more than the rest of a loop: there is no owner to count
    for."""
    planes = tuple(Plane(np.ones((4, 3)), np.ones(4, bool)) for _ in range(2))
    owners = np.full((8, 3), -1)
    made(owned)(planes, owners)
    np.testing.assert_array_equal(owners, np.zeros((8, 3)))


def test_a_private_kernel_is_called_by_kernels_only() -> None:
    inner = serial(_private)

    @numba.njit
    def outer(x):
        return inner(x)

    assert outer(1) == 2
    with pytest.raises(TypeError, match="_private: called from Python"):
        inner(1)


def test_a_loop_takes_no_name_that_is_there_already() -> None:
    assert "_sums_loop1" in outline(sums, "share").loops
    made(sums)
    with pytest.raises(ValueError, match="_sums_loop1: expected no other thing of this name"):
        parallel(sums)
