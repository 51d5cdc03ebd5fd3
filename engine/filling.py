"""Disocclusion filling (paper section 3.4.3)."""

from __future__ import annotations

import itertools
import math

import numpy as np
import numpy.typing as npt

from .kernels import fill as kernels

__all__ = ["fill", "hole_fraction"]

_FADE_PX = 8.0  # how far structure is carried into a hole before it fades into something smooth
_FEW = 50_000  # elements of a level below which threads cost more than they bring

Plane = npt.NDArray[np.float32]


def hole_fraction(disparity: Plane) -> float:
    """Fraction of pixels where nothing was drawn."""
    rows = np.empty(disparity.shape[0], np.int64)
    kernels.count_holes(disparity, rows)
    return float(rows.sum() / disparity.size)


def fill(disparity: Plane, planes: tuple[Plane, Plane, Plane]) -> None:
    """Colour the holes of [h, w] planes in place from their neighbourhood, farther surfaces first.

    Something must have been drawn.
    """
    levels = _levels(*disparity.shape)
    kernels.first_level(disparity, *planes, levels[0])
    for fine, coarse in itertools.pairwise(levels):
        (kernels.next_level if fine.size > _FEW else kernels.next_level_serially)(fine, coarse)
    for fine, coarse in zip(levels[-2::-1], levels[:0:-1], strict=True):
        (kernels.refine_level if fine.size > _FEW else kernels.refine_level_serially)(coarse, fine)
    kernels.fill_holes(disparity, levels[0], _FADE_PX, *planes)


def _levels(height: int, width: int) -> list[Plane]:
    """Empty levels [rows, columns, 5], each half the size of the one before, down to a single cell."""
    height, width = math.ceil(height / kernels.CELL), math.ceil(width / kernels.CELL)
    levels = [np.empty((height, width, 5), np.float32)]
    while height * width > 1:
        height, width = (height + 1) // 2, (width + 1) // 2
        levels.append(np.empty((height, width, 5), np.float32))
    return levels
