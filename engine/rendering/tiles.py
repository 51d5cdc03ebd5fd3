"""Tiles of a picture: with them, the processing of holes skips the rest of the picture."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..kernels.base.memory import BEYOND
from ..kernels.rendering import tiles as kernels
from ..kernels.rendering.tiles import TILE
from ..support.array_types import F32, I32

__all__ = ["EVERYWHERE", "HoleMap", "Tiles", "new_tiles"]

Tiles = npt.NDArray[np.uint8]

EVERYWHERE: Tiles = np.empty((0, 0), np.uint8)  # no tiles: nothing is skipped


def new_tiles(height: int, width: int) -> Tiles:
    """Unmarked tiles [ceil(height / TILE), ceil(width / TILE)] of a picture, as kernels read them."""
    shape = math.ceil(height / TILE), math.ceil(width / TILE)
    return np.zeros(shape[0] * shape[1] + BEYOND, np.uint8)[:-BEYOND].reshape(shape)


class HoleMap:
    """The number of holes (pixels with a disparity of 0 or less) in each tile of a picture."""

    def __init__(self, height: int, width: int) -> None:
        self.tiles = new_tiles(height, width)
        self._pixels = height * width

    @classmethod
    def of(cls, disparity: F32) -> HoleMap:
        """The map of a picture's disparity [h, w]."""
        holes = cls(*disparity.shape)
        holes.find(disparity)
        return holes

    def find(self, disparity: F32) -> None:
        """Count the holes of the whole picture."""
        kernels.count_holes(disparity, self.tiles)

    def shrink(self, disparity: F32) -> None:
        """Count again in tiles that had holes; new holes elsewhere are not possible."""
        kernels.recount_holes(disparity, self.tiles)

    @property
    def count(self) -> int:
        """Pixels where nothing was drawn."""
        return int(self.tiles.sum(dtype=np.int64))

    @property
    def fraction(self) -> float:
        """Fraction of the picture where nothing was drawn."""
        return self.count / self._pixels

    def listed(self, disparity: F32) -> tuple[I32, I32]:
        """Rows and columns int32 [n, 2] of the holes in reading order, and int32 [h, w] with each hole's number in that
        list (undefined elsewhere)."""
        places, index = np.empty((self.count, 2), np.int32), np.empty(disparity.shape, np.int32)
        kernels.list_holes(disparity, self.tiles, places, index)
        return places, index

    def rims(self, disparity: F32, index: I32) -> I32:
        """Numbers int32 [m], in the index of `listed`, of the holes that touch a drawn pixel, also diagonally."""
        rims = np.empty(self.count, np.int32)
        return rims[: kernels.list_rims(disparity, self.tiles, index, rims)]

    def neighbourhood(self, block: int) -> Tiles:
        """Blocks [rows, columns] of block x block tiles: 1 for blocks with holes and their neighbours, others 0."""
        rows, columns = (math.ceil(size / block) for size in self.tiles.shape)
        padded = np.zeros((rows * block, columns * block), np.uint8)
        padded[: self.tiles.shape[0], : self.tiles.shape[1]] = self.tiles
        with_holes = np.pad(padded.reshape(rows, block, columns, block).any(axis=(1, 3)), 1)
        near: Tiles = np.zeros((rows, columns), np.uint8)
        for j in range(3):
            for i in range(3):
                near |= with_holes[j : j + rows, i : i + columns]
        return near
