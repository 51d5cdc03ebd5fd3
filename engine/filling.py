"""Disocclusion filling (paper section 3.4.3)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from .kernels import fill as kernels

__all__ = ["fill", "hole_fraction"]

Plane = npt.NDArray[np.float32]


def hole_fraction(disparity: Plane) -> float:
    """Fraction of pixels where nothing was drawn."""
    rows = np.empty(disparity.shape[0], np.int64)
    kernels.count_holes(disparity, rows)
    return float(rows.sum() / disparity.size)


def fill(disparity: Plane, planes: tuple[Plane, Plane, Plane], radius: int) -> None:
    """Colour the holes of [h, w] planes in place from their neighbours, those with farther depths first."""
    above, below = np.empty(disparity.shape, np.int32), np.empty(disparity.shape, np.int32)
    kernels.nearest_in_columns(disparity, above, below)
    kernels.fill_holes(disparity, above, below, radius, *planes)
