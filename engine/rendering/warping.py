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
from ..kernels.rendering import added_mesh, antialias, projector, shade
from ..kernels.rendering import backdrop as backdrop_kernels
from ..kernels.rendering import fill as fill_kernels
from ..kernels.rendering import tiles as tile_kernels
from ..kernels.rendering.projector import Eye
from ..kernels.rendering.records import DepthBuffer, Planes
from ..rig.frame import Texture
from ..rig.texture import empty_texture
from ..support.packed import POSITION_SLICE
from .effects import Effects
from .rasteriser import Rasteriser
from .target import Target
from .tiles import EVERYWHERE, HoleMap, Tiles, new_tiles

__all__ = ["Canvas"]

_GREY = 512.0  # code of pixels where nothing was drawn or filled


class Canvas:
    """A virtual camera's buffers, kept from picture to picture because fresh memory costs more than drawing.

    Only one thread may use it at a time.
    """

    def __init__(self, width: int, height: int) -> None:
        shape = (height, width)
        self.disparity = np.zeros(shape, np.float32)
        self.winner = np.zeros(shape, np.uint8)
        self._backdrop = np.zeros(shape, np.float32)
        self._nobody = np.zeros(shape, np.uint8)
        self._holes, self._found_holes = HoleMap(height, width), False
        self._open_tiles = new_tiles(height, width)
        self._marks: npt.NDArray[np.uint8] | None = None  # pixels of a picture of half the size that are drawn
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
        """Disparity and winner of the pixels drawn so far."""
        return DepthBuffer(self.disparity, self.winner)

    def clear(self, marks: npt.NDArray[np.uint8] | None = None) -> None:
        """Forget the last picture's surfaces.

        With `marks`, pixels of a picture of half the size, only the samples of those pixels are drawn and shaded.
        """
        # New arrays, as the last picture's may still be in use. They are cheap: the system provides pages of zeros
        # when they are first touched.
        shape = self.disparity.shape
        self.disparity, self.winner = np.zeros(shape, np.float32), np.zeros(shape, np.uint8)
        self._found_holes = False
        self._marks, self._marked_tiles = marks, EVERYWHERE
        if marks is not None:
            self._marked_tiles = new_tiles(*self.disparity.shape)
            antialias.mark_tiles(marks, tile_kernels.TILE // 2, self._marked_tiles)

    def grey(self) -> None:
        """Paint everything grey, the colour of pixels where nothing is drawn or filled."""
        for plane in self.planes:
            plane.fill(_GREY)

    def holes(self) -> HoleMap:
        """The pixels where nothing was drawn, valid until something is. After the first call only holes may be drawn
        to."""
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
        """Average the marked pixels from a shaded canvas of twice the size that was cleared with marks."""
        assert fine._marks is not None
        antialias.average_marked(fine._marks, fine.disparity, *fine.planes, *self.planes)

    def draw(
        self, mesh: Mesh, target: Target, number: int, near: float, margin: float,
        tiles: Tiles | None = None,
    ) -> int:  # fmt: skip
        """Draw a view's mesh as view `number`; it wins a pixel where it is nearer by `margin` (disparity, 1/m).

        `near`: nothing nearer to the eye is drawn, metres. With `tiles`, only triangles that touch a marked tile are
        drawn; without, all triangles of the first view, and of later views those that may win a pixel. Returns the
        number of triangles drawn.
        """
        open_tiles = EVERYWHERE
        if number > 0 and tiles is None:
            open_tiles = self._open_tiles
            if number == 1:  # later views change only tiles that are open now
                tile_kernels.mark_open_tiles(self.disparity, margin, open_tiles)
        tiles = self._marked_tiles if tiles is None else tiles
        if tiles.size and not tiles.any():
            return 0
        return self._rasteriser.draw(mesh, target, number, near, margin, self.buffer, tiles, open_tiles)

    def draw_holes(self, part: Part, views: Sequence[PreparedView], target: Target, near: float) -> int:
        """Draw a part of the views into pixels that are still empty; returns the number of triangles drawn."""
        having = [number for number, view in enumerate(views) if part == "rims" or part in view.parts]
        if not having:
            return 0
        tiles = self.holes().tiles
        return sum(self.draw(views[number].mesh(part), target, number, near, math.inf, tiles) for number in having)

    def draw_backdrop(
        self, backdrop: PreparedView, present: ViewTable | None, drawn: Sequence[int], target: Target, near: float,
        push: Delta, delta: Delta, *, holes_only: bool = False,
    ) -> int:  # fmt: skip
        """Lay a backdrop, moved away by `push`, behind the pixels drawn so far (section 3.4.2).

        A surface of the backdrop is a ghost of the past, and is left out, if one of the `present` views sees past it.
        If a present view that is not among `drawn` (indices of views) has a surface on a hole's ray before the
        backdrop's surface, the hole shows it (`kernels.rendering.backdrop`). Without `present` only depths decide.
        `near`: as in `draw`; delta: the culling tolerance. With `holes_only`, the backdrop is drawn only near holes.
        Returns the number of triangles drawn.
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
        """Colour the drawn pixels from `views`, of which those after the first n_views are backdrops.

        At most `blend` views contribute to a pixel; `cubic`: with cubic interpolation. With `prefilter`, colours come
        from views reduced to about the picture's resolution (see `minification`).
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

    def add_effects(self, effects: Effects, target: Target, near: float, backdrop: int, push: Delta) -> None:
        """Throw pictures onto the shaded background, then draw the added meshes.

        backdrop: the number of the view that is the backdrop, which was moved away by `push`. `near`: as in `draw`.
        """
        eye = Eye(target.packed, target.radians_a_pixel, backdrop, push)
        for thrown in effects.projectors:
            projector.project(self.buffer, eye, thrown, self.planes)
        for mesh in effects.meshes:
            added_mesh.draw(mesh, target.packed, near, self.buffer, self.planes)

    def texture(self) -> Texture:
        """The picture as a new 10-bit 4:2:0 texture."""
        out = empty_texture(*self.disparity.shape)
        fill_kernels.pack_420(*self.planes, out.y, out.cb, out.cr)
        return out


def _others(present: ViewTable, drawn: Sequence[int], target: Target) -> npt.NDArray[np.int64]:
    """Rows of the views that are not drawn, those nearest to the virtual camera first, as far as winners (uint8) can
    name them."""
    distance = np.linalg.norm(present.rows[:, POSITION_SLICE] - target.packed[POSITION_SLICE], axis=1)
    distance[list(drawn)] = np.inf
    numbered = np.iinfo(np.uint8).max - len(drawn)
    order: npt.NDArray[np.int64] = np.argsort(distance, kind="stable")[: len(distance) - len(drawn)]
    return order[order < numbered]
