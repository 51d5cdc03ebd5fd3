"""Where geometry has changed, as each camera sees it: only there its culling rays can find something else."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..kernels.background.directions import COLUMNS, ROWS, forget_marks, note_directions
from ..kernels.base.tolerance import Delta
from .surface import Surface

__all__ = ["ChangedDirections"]


class ChangedDirections:
    """The directions from each camera in which there is new geometry since its last turn, and how far away.

    packed [n, CAMERA_SIZE]: the cameras as kernels take them, read when they are needed; cells float32 [n, ROWS,
    COLUMNS]: how far away there is new geometry, metres, 0: there is none.
    """

    def __init__(self, packed: npt.NDArray[np.float64]) -> None:
        self._packed = packed
        self.cells = np.zeros((len(packed), ROWS, COLUMNS), np.float32)

    def add(self, surface: Surface, which: npt.NDArray[np.int64]) -> None:
        """Triangles of a surface are new, or elsewhere."""
        note_directions(self._packed, surface.packed, which, self.cells)

    def add_all(self) -> None:
        """All geometry may be elsewhere."""
        self.cells[:] = np.inf

    def forget(self, camera: int, surfaces: list[Surface], delta: Delta) -> None:
        """A camera's turn: takes its marks from what has changes behind it, by delta / 2, and forgets these."""
        cells, word, bit = self.cells[camera], camera // 64, np.uint64(1 << (camera % 64))
        if cells.any():
            for surface in surfaces:
                forget_marks(self._packed[camera], surface.packed, cells, delta, surface.marks, word, bit)
            cells[:] = 0
