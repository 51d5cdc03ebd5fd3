"""Directions in which geometry has changed, for each camera: only there can its culling rays give another result."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..kernels.background.directions import COLUMNS, ROWS, forget_marks, note_directions
from ..kernels.base.tolerance import Delta
from .surface import Surface

__all__ = ["ChangedDirections"]


class ChangedDirections:
    """The directions from each camera in which there is new geometry since its last turn, and its distance.

    packed [n, CAMERA_SIZE]: the packed cameras; the array is shared and read at each call. cells float32 [n, ROWS,
    COLUMNS]: distance of the farthest new geometry, metres; 0: there is none.
    """

    def __init__(self, packed: npt.NDArray[np.float64]) -> None:
        self._packed = packed
        self.cells = np.zeros((len(packed), ROWS, COLUMNS), np.float32)

    def add(self, surface: Surface, which: npt.NDArray[np.int64]) -> None:
        """Notes that triangles (numbers [m]) of a surface are new or have moved."""
        note_directions(self._packed, surface.packed, which, self.cells)

    def add_all(self) -> None:
        """Notes that all geometry may have moved."""
        self.cells[:] = np.inf

    def forget(self, camera: int, surfaces: list[Surface], delta: Delta) -> None:
        """A camera's turn: removes its marks from triangles that have changes more than delta / 2 behind them, then
        forgets the changes."""
        cells, word, bit = self.cells[camera], camera // 64, np.uint64(1 << (camera % 64))
        if cells.any():
            for surface in surfaces:
                forget_marks(self._packed[camera], surface.packed, cells, delta, surface.marks, word, bit)
            cells[:] = 0
