"""The pyramid for push-pull algorithms: each level has half the size of the one before."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

__all__ = ["empty_levels"]


def empty_levels(shape: tuple[int, ...], cell: int) -> list[npt.NDArray[np.float32]]:
    """Uninitialised levels [rows, columns, 5] of a picture [h, w], from cells of `cell` pixels to a single cell."""
    height, width = (math.ceil(size / cell) for size in shape)
    levels = [np.empty((height, width, 5), np.float32)]
    while height * width > 1:
        height, width = (height + 1) // 2, (width + 1) // 2
        levels.append(np.empty((height, width, 5), np.float32))
    return levels
