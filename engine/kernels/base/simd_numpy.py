"""Operations of `simd` by NumPy, if nothing is compiled, and for type checkers.

Results are those of compiled code, except for the last bit of sums of products: compiled code may round them once
instead of twice.
"""

from __future__ import annotations

from typing import TypeVar, overload

import numpy as np
import numpy.typing as npt

from .vectors_numpy import LANES, Floats, Integers, Mask, Number, Whole, as_floats, as_integers

__all__ = [
    "Floats",
    "Integers",
    "Mask",
    "any_of",
    "evens",
    "lane_numbers",
    "maximum",
    "minimum",
    "odds",
    "round_down",
    "round_up",
    "select",
    "spread",
    "square_root",
    "sum_pairs",
    "to_floats",
    "to_integers",
    "zipped",
    "zipped_rest",
]

V = TypeVar("V", Floats, Integers)


def spread(number: Number) -> Floats:
    """A number in all lanes, as floats."""
    return Floats(as_floats(number))


@overload
def select(condition: Mask, yes: Floats | Number, no: Floats) -> Floats: ...
@overload
def select(condition: Mask, yes: Floats, no: Number) -> Floats: ...
@overload
def select(condition: Mask, yes: Integers | Whole, no: Integers) -> Integers: ...
@overload
def select(condition: Mask, yes: Integers, no: Whole) -> Integers: ...
def select(condition: Mask, yes: object, no: object) -> object:
    """In each lane, `yes` if the condition is true, else `no`; one of them may be a number."""
    if isinstance(yes, Integers) or isinstance(no, Integers):
        return Integers(np.where(condition.lanes, as_integers(yes), as_integers(no)))  # type: ignore[arg-type]
    return Floats(np.where(condition.lanes, as_floats(yes), as_floats(no)))  # type: ignore[arg-type]


@overload
def minimum(x: Floats, y: Floats | Number) -> Floats: ...
@overload
def minimum(x: Integers, y: Integers | Whole) -> Integers: ...
def minimum(x: Floats | Integers, y: object) -> object:
    """The smaller of two in each lane; the second may be a number, and is taken where one of them is NaN."""
    return select(x < y, x, y)  # type: ignore[operator,call-overload]


@overload
def maximum(x: Floats, y: Floats | Number) -> Floats: ...
@overload
def maximum(x: Integers, y: Integers | Whole) -> Integers: ...
def maximum(x: Floats | Integers, y: object) -> object:
    """The larger of two in each lane; the second may be a number, and is taken where one of them is NaN."""
    return select(x > y, x, y)  # type: ignore[operator,call-overload]


def square_root(x: Floats) -> Floats:
    """Square roots of floats."""
    return Floats(np.sqrt(x.lanes))


def round_down(x: Floats) -> Floats:
    """The largest whole numbers not above floats, as floats."""
    return Floats(np.floor(x.lanes))


def round_up(x: Floats) -> Floats:
    """The smallest whole numbers not below floats, as floats."""
    return Floats(np.ceil(x.lanes))


def to_floats(x: Integers) -> Floats:
    """Integers as floats."""
    return Floats(x.lanes.astype(np.float32))


def to_integers(x: Floats) -> Integers:
    """Floats towards zero; they must be within int32."""
    inside = (x.lanes >= -(2.0**31)) & (x.lanes < 2.0**31)
    return Integers(np.where(inside, np.where(inside, x.lanes, 0.0).astype(np.int64), -(2**31)).astype(np.int32))


def any_of(x: Mask) -> bool:
    """Whether a lane is true."""
    return bool(x.lanes.any())


def _picked(x: V, y: V, lanes: npt.ArrayLike) -> V:
    """Some lanes of two concatenated vectors."""
    return type(x)(np.concatenate([x.lanes, y.lanes])[np.asarray(lanes)])


def evens(x: V, y: V) -> V:
    """Lanes 0, 2, 4 ... of two concatenated vectors."""
    return _picked(x, y, np.arange(0, 2 * LANES, 2))


def odds(x: V, y: V) -> V:
    """Lanes 1, 3, 5 ... of two concatenated vectors."""
    return _picked(x, y, np.arange(1, 2 * LANES, 2))


def zipped(x: V, y: V) -> V:
    """The first eight lanes of two vectors, interleaved."""
    return _picked(x, y, np.arange(2 * LANES).reshape(2, LANES).T.ravel()[:LANES])


def zipped_rest(x: V, y: V) -> V:
    """The last eight lanes of two vectors, interleaved."""
    return _picked(x, y, np.arange(2 * LANES).reshape(2, LANES).T.ravel()[LANES:])


def lane_numbers() -> Floats:
    """0, 1, 2 ... 15 as floats."""
    return Floats(np.arange(LANES, dtype=np.float32))


def sum_pairs(pairs: Integers, shares: Integers) -> Integers:
    """In each lane the sum of two products: of the int16 in the lower and in the upper halves of the integers."""
    a, b = (v.lanes.view(np.int16).reshape(LANES, 2).astype(np.int32) for v in (pairs, shares))
    return Integers((a * b).sum(axis=1, dtype=np.int32))
