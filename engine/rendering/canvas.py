"""3D warping of selected views and of the backdrop onto a virtual camera (paper section 3.4.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from ..geometry.mesh import Mesh
from ..geometry.prepared_view import Part, PreparedView, ViewTable
from ..kernels.base import view_table
from ..kernels.base.tolerance import Delta
from ..kernels.base.view_table import Views
from ..kernels.rendering import antialias, shade
from ..kernels.rendering import backdrop as backdrop_kernels
from ..kernels.rendering import fill as fill_kernels
from ..kernels.rendering import tiles as tile_kernels
from ..kernels.rendering.records import DepthBuffer, Planes
from ..rig.frame import Texture
from ..rig.texture import empty_texture
from ..support.packed import POSITION_SLICE
from .rasteriser import Rasteriser
from .target import Target
from .tiles import EVERYWHERE, HoleMap, Tiles, new_tiles

__all__ = ["Canvas"]

_GREY = 512.0  # what is left where nothing was seen and nothing filled


class Canvas:
    """A virtual camera's buffers, kept from picture to picture: fresh memory costs more than drawing.

    Not for two threads at once.
    """

    def __init__(self, width: int, height: int) -> None:
        shape = (height, width)
        self.disparity = np.zeros(shape, np.float32)
        self.winner = np.zeros(shape, np.uint8)
        self._backdrop = np.zeros(shape, np.float32)
        self._nobody = np.zeros(shape, np.uint8)
        self._holes, self._found_holes = HoleMap(height, width), False
        self._open_tiles = new_tiles(height, width)
        self._marks: npt.NDArray[np.uint8] | None = None  # pixels of a picture of half the size that are meant
        self._marked_tiles = EVERYWHERE
        self.planes = Planes(np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.float32))
        self._rasteriser = Rasteriser(height)

    @property
    def nbytes(self) -> int:
        """Bytes of memory that it keeps from picture to picture."""
        planes = (self.disparity, self.winner, self._backdrop, self._nobody, *self.planes)
        return sum(plane.nbytes for plane in planes) + self._rasteriser.nbytes

    @property
    def buffer(self) -> DepthBuffer:
        """What was drawn."""
        return DepthBuffer(self.disparity, self.winner)

    def clear(self, marks: npt.NDArray[np.uint8] | None = None) -> None:
        """Forget the last picture's surfaces.

        With `marks`, pixels of a picture of half the size, only what belongs to those is drawn and shaded.
        """
        # New ones, not the last picture's, which may be looked at still: pages of zeros come as they are touched.
        shape = self.disparity.shape
        self.disparity, self.winner = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
        self._found_holes = False
        self._marks, self._marked_tiles = marks, EVERYWHERE
        if marks is not None:
            self._marked_tiles = new_tiles(*self.disparity.shape)
            antialias.mark_tiles(marks, tile_kernels.TILE // 2, self._marked_tiles)

    def grey(self) -> None:
        """Paint everything grey: what will be seen where nothing is drawn or filled."""
        for plane in self.planes:
            plane.fill(_GREY)

    def holes(self) -> HoleMap:
        """Where nothing was drawn; valid until something is. Once they were asked for, only holes are drawn to."""
        if self._found_holes:
            self._holes.shrink(self.disparity)
        else:
            self._holes.find(self.disparity)
            if self._marks is not None:
                self._holes.tiles[self._marked_tiles == 0] = 0
        self._found_holes = True
        return self._holes

    def silhouettes(self, step: float) -> npt.NDArray[np.uint8]:
        """Pixels [h, w] at which surfaces more than `step` (disparity, 1/m) apart meet: 1, others 0."""
        marks = np.empty(self.disparity.shape, np.uint8)
        antialias.mark_silhouettes(self.disparity, step, marks)
        return marks

    def average(self, fine: Canvas) -> None:
        """Take what is marked from a shaded canvas of twice the size that was cleared with marks."""
        assert fine._marks is not None
        antialias.average_marked(fine._marks, fine.disparity, *fine.planes, *self.planes)

    def draw(
        self, mesh: Mesh, target: Target, number: int, near: float, margin: float,
        tiles: Tiles | None = None,
    ) -> int:  # fmt: skip
        """Draw a view's mesh as view `number`; it wins a pixel where it is nearer by `margin` (disparity).

        With `tiles` only triangles that touch a marked one are drawn; without, of a view after the first, those that
        may win a pixel. Returns the number of triangles drawn.
        """
        open_tiles = EVERYWHERE
        if number > 0 and tiles is None:
            open_tiles = self._open_tiles
            if number == 1:  # what a later view changes lies in tiles that are open now
                tile_kernels.mark_open_tiles(self.disparity, margin, open_tiles)
        tiles = self._marked_tiles if tiles is None else tiles
        if tiles.size and not tiles.any():
            return 0
        return self._rasteriser.draw(mesh, target, number, near, margin, self.buffer, tiles, open_tiles)

    def draw_holes(self, part: Part, views: Sequence[PreparedView], target: Target, near: float) -> int:
        """Draw a part of the views into what is still empty; returns the number of triangles drawn."""
        having = [number for number, view in enumerate(views) if part == "rims" or part in view.parts]
        if not having:
            return 0
        tiles = self.holes().tiles
        return sum(self.draw(views[number].mesh(part), target, number, near, math.inf, tiles) for number in having)

    def draw_backdrop(
        self, backdrop: PreparedView, present: ViewTable | None, drawn: Sequence[int], target: Target, near: float,
        push: Delta, delta: Delta, *, holes_only: bool = False,
    ) -> int:  # fmt: skip
        """Lay a backdrop behind what was drawn, by `push` farther away than it is (section 3.4.2).

        What one of the present views looks through is a ghost of the past and left out; where one that is not among
        `drawn` has a surface on a hole's ray before the backdrop's, that is what is seen
        (`kernels.rendering.backdrop`). Without `present` only depths decide. With `holes_only` it is drawn only near
        holes. Returns the number of triangles drawn.
        """
        tiles = self.holes().tiles if holes_only else self._marked_tiles
        self._backdrop.fill(0.0)
        number = len(drawn)
        triangles = self._rasteriser.draw(
            backdrop.mesh(), target, number, near, 0.0, DepthBuffer(self._backdrop, self._nobody), tiles
        )
        if self._marks is not None:
            antialias.keep_marked(self._marks, self._backdrop)
        if present is None:
            seen, others, delta = ViewTable([]), np.empty(0, np.int64), (0.0, 0.0)
        else:
            seen, others = present, _others(present, drawn, target)
        backdrop_kernels.lay_backdrop(
            self._backdrop, target.packed, Views(seen.rows, seen.addresses), others, push, delta, number, self.buffer,
        )  # fmt: skip
        return triangles

    def shade(
        self, target: Target, views: ViewTable, n_views: int, blend: int, *, cubic: bool = False,
        prefilter: bool = False,
    ) -> None:  # fmt: skip
        """Colour what was drawn; views after the first n_views are backdrops.

        With `prefilter` colours come from views reduced to about the picture's own resolution (see `minification`).
        """
        if self._marks is not None:
            antialias.keep_marked(self._marks, self.disparity)
        rows, addresses = views.at(1.0 / target.radians_a_pixel) if prefilter else (views.rows, views.addresses)
        table = rows.copy()
        table[:, view_table.SHARPNESS] *= target.radians_a_pixel
        shade.shade(
            self.buffer, target.packed, Views(views.rows, views.addresses), Views(table, addresses), n_views, blend,
            cubic, self.planes,
        )  # fmt: skip

    def texture(self) -> Texture:
        """The picture as a new 10-bit 4:2:0 texture."""
        out = empty_texture(*self.disparity.shape)
        fill_kernels.pack_420(*self.planes, out.y, out.cb, out.cr)
        return out


def _others(present: ViewTable, drawn: Sequence[int], target: Target) -> npt.NDArray[np.int64]:
    """Rows of the views that are not drawn, those nearest to the virtual camera first; as many as have a number."""
    distance = np.linalg.norm(present.rows[:, POSITION_SLICE] - target.packed[POSITION_SLICE], axis=1)
    distance[list(drawn)] = np.inf
    numbered = np.iinfo(np.uint8).max - len(drawn)
    order: npt.NDArray[np.int64] = np.argsort(distance, kind="stable")[: len(distance) - len(drawn)]
    return order[order < numbered]
