"""Vector types if nothing is compiled: sixteen float32, int32 or truths, in NumPy arrays.

They have the operators of the types of compiled code (`vectors_llvm`).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ...support.array_types import B1, F32, I32

__all__ = ["LANES", "Floats", "Integers", "Mask", "Number", "Whole", "as_floats", "as_integers"]

LANES = 16

Number = float | np.floating | np.integer
Whole = int | np.integer


class Mask:
    """Sixteen truths."""

    __slots__ = ("lanes",)

    def __init__(self, lanes: B1) -> None:
        self.lanes = lanes

    def __and__(self, other: Mask) -> Mask:
        return Mask(self.lanes & other.lanes)

    def __or__(self, other: Mask) -> Mask:
        return Mask(self.lanes | other.lanes)

    def __xor__(self, other: Mask) -> Mask:
        return Mask(self.lanes ^ other.lanes)

    def __invert__(self) -> Mask:
        return Mask(~self.lanes)


class Floats:
    """Sixteen float32; numbers that they are combined with are rounded to float32 first."""

    __slots__ = ("lanes",)

    def __init__(self, lanes: F32) -> None:
        self.lanes = lanes

    def __add__(self, other: Floats | Number) -> Floats:
        return _floats(self.lanes + as_floats(other))

    def __sub__(self, other: Floats | Number) -> Floats:
        return _floats(self.lanes - as_floats(other))

    def __mul__(self, other: Floats | Number) -> Floats:
        return _floats(self.lanes * as_floats(other))

    def __truediv__(self, other: Floats | Number) -> Floats:
        return _floats(self.lanes / as_floats(other))

    def __radd__(self, other: Number) -> Floats:
        return _floats(as_floats(other) + self.lanes)

    def __rsub__(self, other: Number) -> Floats:
        return _floats(as_floats(other) - self.lanes)

    def __rmul__(self, other: Number) -> Floats:
        return _floats(as_floats(other) * self.lanes)

    def __rtruediv__(self, other: Number) -> Floats:
        return _floats(as_floats(other) / self.lanes)

    def __neg__(self) -> Floats:
        return _floats(-self.lanes)

    def __lt__(self, other: Floats | Number) -> Mask:
        return Mask(self.lanes < as_floats(other))

    def __le__(self, other: Floats | Number) -> Mask:
        return Mask(self.lanes <= as_floats(other))

    def __gt__(self, other: Floats | Number) -> Mask:
        return Mask(self.lanes > as_floats(other))

    def __ge__(self, other: Floats | Number) -> Mask:
        return Mask(self.lanes >= as_floats(other))

    def __eq__(self, other: Floats | Number) -> Mask:  # type: ignore[override]
        return Mask(self.lanes == as_floats(other))

    def __ne__(self, other: Floats | Number) -> Mask:  # type: ignore[override]
        return Mask(self.lanes != as_floats(other))

    __hash__ = None  # type: ignore[assignment]
    __array_priority__ = 1.0  # a NumPy number on the left leaves the operation to this class
    __array_ufunc__ = None


class Integers:
    """Sixteen int32, which wrap round; shifts to the right are unsigned."""

    __slots__ = ("lanes",)

    def __init__(self, lanes: I32) -> None:
        self.lanes = lanes

    def __add__(self, other: Integers | Whole) -> Integers:
        return Integers(self.lanes + as_integers(other))

    def __sub__(self, other: Integers | Whole) -> Integers:
        return Integers(self.lanes - as_integers(other))

    def __mul__(self, other: Integers | Whole) -> Integers:
        return Integers(self.lanes * as_integers(other))

    def __radd__(self, other: Whole) -> Integers:
        return Integers(as_integers(other) + self.lanes)

    def __rsub__(self, other: Whole) -> Integers:
        return Integers(as_integers(other) - self.lanes)

    def __rmul__(self, other: Whole) -> Integers:
        return Integers(as_integers(other) * self.lanes)

    def __lshift__(self, other: Integers | Whole) -> Integers:
        return Integers(self.lanes << as_integers(other))

    def __rshift__(self, other: Integers | Whole) -> Integers:
        return Integers((self.lanes.view(np.uint32) >> as_integers(other).view(np.uint32)).view(np.int32))

    def __and__(self, other: Integers | Whole) -> Integers:
        return Integers(self.lanes & as_integers(other))

    def __or__(self, other: Integers | Whole) -> Integers:
        return Integers(self.lanes | as_integers(other))

    def __xor__(self, other: Integers | Whole) -> Integers:
        return Integers(self.lanes ^ as_integers(other))

    def __lt__(self, other: Integers | Whole) -> Mask:
        return Mask(self.lanes < as_integers(other))

    def __le__(self, other: Integers | Whole) -> Mask:
        return Mask(self.lanes <= as_integers(other))

    def __gt__(self, other: Integers | Whole) -> Mask:
        return Mask(self.lanes > as_integers(other))

    def __ge__(self, other: Integers | Whole) -> Mask:
        return Mask(self.lanes >= as_integers(other))

    def __eq__(self, other: Integers | Whole) -> Mask:  # type: ignore[override]
        return Mask(self.lanes == as_integers(other))

    def __ne__(self, other: Integers | Whole) -> Mask:  # type: ignore[override]
        return Mask(self.lanes != as_integers(other))

    __hash__ = None  # type: ignore[assignment]
    __array_ufunc__ = None


def _floats(lanes: npt.NDArray[np.floating]) -> Floats:
    return Floats(lanes.astype(np.float32, copy=False))


def as_floats(value: Floats | Number) -> F32:
    """The lanes of floats, or a number in all lanes."""
    return value.lanes if isinstance(value, Floats) else np.full(LANES, value, np.float32)


def as_integers(value: Integers | Whole) -> I32:
    """The lanes of integers, or a number in all lanes."""
    if isinstance(value, Integers):
        return value.lanes
    return np.full(LANES, int(value) & 0xFFFFFFFF, np.uint32).view(np.int32)
