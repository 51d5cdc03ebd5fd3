"""Drawing meshes into a virtual camera's disparity: calls the kernels and provides their scratch memory."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..geometry.mesh import Mesh
from ..kernels.base.memory import BEYOND
from ..kernels.rendering import blocks, rasterise, sorting, spherical
from ..kernels.rendering.records import Bands, DepthBuffer, Regions, VisibleBlocks
from ..support.array_types import I64
from ..support.runtime import one_thread
from .target import Target
from .tiles import EVERYWHERE, Tiles

__all__ = ["Rasteriser"]

_NOTHING = np.empty((0, 0), np.float32)
_BANDS = 16
_CHUNKS = 4
_PARTS = np.arange(_CHUNKS + 1)
_FEW = 20000  # points and triangles below which threads cost more time than they save


class Rasteriser:
    """Draws into pictures of a height; keeps scratch memory from mesh to mesh. Only one thread may use it at a time."""

    def __init__(self, height: int) -> None:
        self._band_rows = max(1, math.ceil(height / _BANDS))
        self._counts = np.empty((_CHUNKS, math.ceil(height / self._band_rows)), np.int64)
        self._lists = np.empty(0, np.int32)
        self._screen = np.empty(0, np.float32)
        self._nearer = np.empty(0, np.uint8)

    @property
    def nbytes(self) -> int:
        """Bytes of scratch memory."""
        return self._lists.nbytes + self._screen.nbytes + self._nearer.nbytes

    def draw(
        self, mesh: Mesh, target: Target, number: int, near: float, margin: float, buffer: DepthBuffer, tiles: Tiles,
        open_tiles: Tiles = EVERYWHERE,
    ) -> int:  # fmt: skip
        """Draw a mesh as view `number` where it is nearer by `margin` (1/m), and not before `near` (metres).

        `tiles`: where triangles are drawn; `open_tiles`: where triangles of a later view may win
        (`kernels.rendering.sorting`); both from `tiles.new_tiles`, or EVERYWHERE. Returns the number of triangles
        drawn.
        """
        starts = mesh.starts
        visible = np.empty(len(starts) - 1, np.int64)
        visible = visible[: blocks.visible_blocks(mesh.spheres, target.packed, near, tiles, visible)]
        if len(visible) == 0:
            return 0
        sizes = starts[visible + 1] - starts[visible]  # points and triangles
        with one_thread(sizes.sum() < _FEW):
            regions = Regions(tiles, open_tiles, self._room("_nearer", len(mesh.points) + BEYOND))
            return self._draw(mesh, visible, sizes[:, 1], target, number, near, margin, buffer, regions)

    def _draw(
        self, mesh: Mesh, visible: I64, triangles: I64, target: Target, number: int, near: float, margin: float,
        buffer: DepthBuffer, regions: Regions,
    ) -> int:  # fmt: skip
        """Draw the visible blocks of a mesh; triangles: how many each of them has."""
        camera, starts = target.packed, mesh.starts
        screen = self._room("_screen", len(mesh.points) * 4).reshape(-1, 4)
        drawn_before = buffer.disparity if regions.open_tiles.size else _NOTHING
        blocks.place_points(
            mesh.points, starts, visible, camera, drawn_before, margin, screen, regions.nearer
        )
        # Chunks of blocks with about as many triangles each.
        sums = np.zeros(len(visible) + 1, np.int64)
        np.cumsum(triangles, out=sums[1:])
        shares = np.searchsorted(sums, sums[-1] / _CHUNKS * _PARTS)
        shares[0], shares[-1] = 0, len(visible)
        drawn = np.empty(_CHUNKS, np.int64)
        ends = sums[shares]
        most = int((ends[1:] - ends[:-1]).max())
        lists = self._room("_lists", self._counts.size * most).reshape(*self._counts.shape, most)
        shown, bands = VisibleBlocks(starts, visible, shares), Bands(self._band_rows, self._counts, lists)
        if len(target.directions.columns):
            spherical.sort_into_bands(screen, mesh.triangles, shown, camera, bands, drawn)
            spherical.draw_bands(
                screen, mesh.triangles, camera, target.directions, bands, number, margin, buffer
            )
        else:
            sorting.sort_into_bands(screen, mesh.triangles, shown, camera, near, regions, bands, drawn)
            rasterise.draw_bands(screen, mesh.triangles, camera, near, bands, number, margin, buffer)
        return int(drawn.sum())

    def _room(self, name: str, size: int) -> npt.NDArray[Any]:
        """A kept buffer of at least `size` elements, cut to that size."""
        if size > len(getattr(self, name)):
            setattr(self, name, np.empty(size + size // 4, getattr(self, name).dtype))
        room: npt.NDArray[Any] = getattr(self, name)[:size]
        return room
