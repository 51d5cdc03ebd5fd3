"""3D warping of selected views and of the backdrop onto a virtual camera (paper section 3.4.2)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .camera import Camera, Equirectangular
from .frame import Texture
from .kernels import antialias, composite, rasterise, shade, view_table
from .kernels import fill as fill_kernels
from .mesh import Mesh
from .prepared import Part, PreparedView, ViewTable, pixels_per_radian

__all__ = ["Canvas", "Target"]

_BANDS = 16
_CHUNKS = 4
_EVERYWHERE = np.empty((0, 0), np.uint8)  # no tiles: triangles go anywhere
_GREY = 512.0  # what is left where nothing was seen and nothing filled


class _Kernels(NamedTuple):
    transform: Callable[..., None]
    mark_nearer: Callable[..., None]
    sort: Callable[..., None]
    draw: Callable[..., None]


_PARALLEL = _Kernels(
    rasterise.transform_points, rasterise.mark_nearer, rasterise.sort_into_bands, rasterise.draw_bands
)
_SERIAL = _Kernels(
    rasterise.transform_points_serially, rasterise.mark_nearer_serially,
    rasterise.sort_into_bands_serially, rasterise.draw_bands_serially,
)
_FEW = 20000  # points and triangles below which threads cost more than they bring


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
        self._tiles = np.zeros(_tiling(height, width), np.uint8)
        self._open_tiles = np.zeros(_tiling(height, width), np.uint8)
        self._marks: npt.NDArray[np.uint8] | None = None  # pixels of a picture of half the size that are meant
        self._marked_tiles = _EVERYWHERE
        self.planes = (np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.float32))
        self._band_rows = max(1, math.ceil(height / _BANDS))
        self._counts = np.empty((_CHUNKS, math.ceil(height / self._band_rows)), np.int64)
        self._lists = np.empty(0, np.int32)
        self._screen = np.empty(0, np.float32)
        self._nearer = np.empty(0, np.uint8)

    def clear(self, marks: npt.NDArray[np.uint8] | None = None) -> None:
        """Forget the last picture's surfaces.

        With `marks`, pixels of a picture of half the size, only what belongs to those is drawn and shaded.
        """
        self.disparity.fill(0.0)
        self._marks, self._marked_tiles = marks, _EVERYWHERE
        if marks is not None:
            self._marked_tiles = np.empty_like(self._tiles)
            antialias.mark_tiles(marks, rasterise.TILE // 2, self._marked_tiles)

    def grey(self) -> None:
        """Paint everything grey: what will be seen where nothing is drawn or filled."""
        for plane in self.planes:
            plane.fill(_GREY)

    def hole_tiles(self) -> npt.NDArray[np.uint8]:
        """Tiles of the picture with pixels that nothing was drawn to; valid until the next call."""
        rasterise.mark_hole_tiles(self.disparity, self._tiles)
        if self._marks is not None:
            self._tiles &= self._marked_tiles
        return self._tiles

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
        tiles: npt.NDArray[np.uint8] | None = None,
    ) -> int:  # fmt: skip
        """Draw a view's mesh as view `number`; it wins a pixel where it is nearer by `margin` (disparity).

        With `tiles` only triangles that touch a marked one are drawn; without, of a view after the first, those that
        may win a pixel. Returns the number of triangles drawn.
        """
        open_tiles = _EVERYWHERE
        if number > 0 and tiles is None:
            open_tiles = self._open_tiles
            if number == 1:  # what a later view changes lies in tiles that are open now
                rasterise.mark_open_tiles(self.disparity, margin, open_tiles)
        tiles = self._marked_tiles if tiles is None else tiles
        if tiles.size and not tiles.any():
            return 0
        return self._rasterise(
            mesh, target, number, near, margin, 0.0, self.disparity, self.winner, tiles, open_tiles
        )

    def draw_holes(self, part: Part, views: Sequence[PreparedView], target: Target, near: float) -> int:
        """Draw a part of the views into what is still empty; returns the number of triangles drawn."""
        having = [number for number, view in enumerate(views) if part == "rims" or part in view.parts]
        if not having:
            return 0
        tiles = self.hole_tiles()
        if not tiles.any():
            return 0
        return sum(self.draw(views[number].mesh(part), target, number, near, math.inf, tiles) for number in having)

    def draw_backdrop(
        self, backdrop: PreparedView, present: ViewTable, drawn: Sequence[int], target: Target, near: float,
        push: float, *, holes_only: bool = False,
    ) -> int:  # fmt: skip
        """Lay a backdrop behind what was drawn, `push` metres farther away than it is (section 3.4.2).

        What one of the present views looks through is a ghost of the past and left out; where one that is not among
        `drawn` has a surface on a hole's ray before the backdrop's, that is what is seen (`kernels.composite`). With
        `holes_only` it is drawn only near holes. Returns the number of triangles drawn.
        """
        tiles = self.hole_tiles() if holes_only else self._marked_tiles
        self._backdrop.fill(0.0)
        number = len(drawn)
        triangles = self._rasterise(
            backdrop.mesh(), target, number, near, 0.0, push, self._backdrop, self._nobody, tiles
        )
        if self._marks is not None:
            antialias.keep_marked(self._marks, self._backdrop)
        composite.lay_backdrop(
            self._backdrop, target.packed, present.rows, present.addresses, _others(present, drawn, target), push,
            number, self.disparity, self.winner,
        )  # fmt: skip
        return triangles

    def _rasterise(
        self, mesh: Mesh, target: Target, number: int, near: float, margin: float, push: float,
        disparity: npt.NDArray[np.float32], winner: npt.NDArray[np.uint8], tiles: npt.NDArray[np.uint8],
        open_tiles: npt.NDArray[np.uint8] = _EVERYWHERE,
    ) -> int:  # fmt: skip
        camera, starts = target.packed, mesh.starts
        visible = np.empty(len(starts) - 1, np.int64)
        visible = visible[: rasterise.visible_blocks(mesh.spheres, camera, near, tiles, visible)]
        if len(visible) == 0:
            return 0
        kernels = _SERIAL if (starts[visible + 1] - starts[visible]).sum() < _FEW else _PARALLEL
        screen = self._room("_screen", len(mesh.points) * 4).reshape(-1, 4)
        kernels.transform(mesh.points, starts, visible, camera, screen)
        nearer = self._room("_nearer", len(mesh.points))
        if open_tiles.size:
            kernels.mark_nearer(screen, starts, visible, disparity, margin, nearer)
        # Chunks of blocks with about as many triangles each.
        sums = np.concatenate([[0], np.cumsum(starts[visible + 1, 1] - starts[visible, 1])])
        shares = np.searchsorted(sums, np.linspace(0, sums[-1], _CHUNKS + 1))
        shares[0], shares[-1] = 0, len(visible)
        drawn = np.empty(_CHUNKS, np.int64)
        most = int(np.diff(sums[shares]).max())
        lists = self._room("_lists", self._counts.size * most).reshape(*self._counts.shape, most)
        kernels.sort(
            screen, mesh.triangles, starts, visible, shares, camera, near, self._band_rows, tiles, open_tiles,
            nearer, self._counts, lists, drawn,
        )  # fmt: skip
        kernels.draw(
            screen, mesh.triangles, camera, target.columns, target.rows, near, self._band_rows,
            self._counts, lists, number, margin, push, disparity, winner,
        )  # fmt: skip
        return int(drawn.sum())

    def _room(self, name: str, size: int) -> npt.NDArray[Any]:
        """A kept buffer of at least `size` elements, cut to that size."""
        if size > len(getattr(self, name)):
            setattr(self, name, np.empty(size + size // 4, getattr(self, name).dtype))
        room: npt.NDArray[Any] = getattr(self, name)[:size]
        return room

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
            self.disparity, self.winner, target.packed, views.rows, views.addresses, table, addresses,
            n_views, blend, cubic, *self.planes,
        )  # fmt: skip

    def texture(self) -> Texture:
        """The picture as a new 10-bit 4:2:0 texture."""
        h, w = self.disparity.shape
        half = ((h + 1) // 2, (w + 1) // 2)
        out = Texture(np.empty((h, w), np.uint16), np.empty(half, np.uint16), np.empty(half, np.uint16))
        fill_kernels.pack_420(*self.planes, out.y, out.cb, out.cr)
        return out


def _tiling(height: int, width: int) -> tuple[int, int]:
    return math.ceil(height / rasterise.TILE), math.ceil(width / rasterise.TILE)


class Target:
    """A virtual camera as kernels read it."""

    def __init__(self, camera: Camera, origin: npt.NDArray[np.float64]) -> None:
        self.packed = camera.packed(origin)
        self.columns, self.rows = _directions(camera)
        self.radians_a_pixel = 1.0 / pixels_per_radian(camera)


def _others(present: ViewTable, drawn: Sequence[int], target: Target) -> npt.NDArray[np.int64]:
    """Rows of the views that are not drawn, those nearest to the virtual camera first; as many as have a number."""
    distance = np.linalg.norm(present.rows[:, 16:19] - target.packed[16:19], axis=1)
    distance[list(drawn)] = np.inf
    numbered = np.iinfo(np.uint8).max - len(drawn)
    order: npt.NDArray[np.int64] = np.argsort(distance, kind="stable")[: len(distance) - len(drawn)]
    return order[order < numbered]


def _directions(camera: Camera) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Cosines and sines [w, 2] of an equirectangular camera's azimuths and [h, 2] of its elevations."""
    p = camera.projection
    if not isinstance(p, Equirectangular):
        return np.empty((0, 2), np.float32), np.empty((0, 2), np.float32)
    phi = p.hor_range[1] - (np.arange(p.width) + 0.5) * (p.hor_range[1] - p.hor_range[0]) / p.width
    theta = p.ver_range[1] - (np.arange(p.height) + 0.5) * (p.ver_range[1] - p.ver_range[0]) / p.height
    tables = (np.stack([np.cos(angle), np.sin(angle)], axis=-1) for angle in (phi, theta))
    columns, rows = (table.astype(np.float32) for table in tables)
    return columns, rows
