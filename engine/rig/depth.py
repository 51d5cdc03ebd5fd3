"""Depth codes: integers that are linear in disparity (1 / depth)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..support.packed import Coding

__all__ = ["DepthCoding"]

_NEAREST_M = 1e-9  # disparities and their squares stay finite


@dataclass(frozen=True, slots=True)
class DepthCoding:
    """How a view codes depth: 1/d = 1/far + code / (2^bits - 1) (1/near - 1/far); metres, far may be inf.

    Code 0 means "no depth" if `has_invalid` is set, else the far plane. With far = inf the far plane is read as
    code 1, as the reference renderer does. Raises ValueError unless 0 < near < far and bits is 1 to 16.
    """

    near: float
    far: float
    bits: int = 16
    has_invalid: bool = False

    def __post_init__(self) -> None:
        if not (_NEAREST_M <= self.near < self.far) or math.isinf(self.near):
            expected = f"expected 0 < near < far, near at least {_NEAREST_M:g}"
            raise ValueError(f"depth range: {(self.near, self.far)!r}: {expected}")
        if not 1 <= self.bits <= 16:
            raise ValueError(f"depth bits: {self.bits!r}: expected 1 to 16")

    @property
    def max_code(self) -> int:
        """The largest code: the near plane."""
        return (1 << self.bits) - 1

    @property
    def offset(self) -> float:
        """Disparity of code 0, 1/m."""
        return 1.0 / self.far

    @property
    def step(self) -> float:
        """Disparity of one code step, 1/m."""
        return (1.0 / self.near - 1.0 / self.far) / self.max_code

    @property
    def min_code(self) -> int:
        """The smallest code that stands for a finite depth."""
        return 1 if self.has_invalid or math.isinf(self.far) else 0

    def packed(self) -> Coding:
        """The coding as kernels take it."""
        return Coding(self.offset, self.step, 1 if self.has_invalid else 0, self.min_code, self.max_code)

    def disparity(self, codes: npt.NDArray[np.integer]) -> npt.NDArray[np.float64]:
        """Codes -> disparity in 1/m; nan where a code says "no depth"."""
        out: npt.NDArray[np.float64] = self.offset + self.step * np.maximum(codes, self.min_code).astype(np.float64)
        if self.has_invalid:
            out = np.where(codes == 0, np.nan, out)
        return out

    def depth(self, codes: npt.NDArray[np.integer]) -> npt.NDArray[np.float64]:
        """Codes -> depth in metres; nan where a code says "no depth"."""
        result: npt.NDArray[np.float64] = 1.0 / self.disparity(codes)
        return result

    def codes(self, depth: npt.NDArray[np.floating]) -> npt.NDArray[np.uint16]:
        """Depth in metres -> nearest codes, clipped to the range; nan becomes 0."""
        with np.errstate(divide="ignore", invalid="ignore"):
            exact = np.rint((1.0 / depth - self.offset) / self.step)
        exact = np.where(np.isnan(exact), 0, np.clip(exact, self.min_code, self.max_code))
        return exact.astype(np.uint16)
