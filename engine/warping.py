"""3D warping of selected views and of the backdrop onto a virtual camera (paper section 3.4.2)."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from .camera import Camera, Equirectangular, Perspective
from .completion import Completed, complete
from .frame import Texture, View
from .kernels import antialias, composite, rasterise, shade
from .kernels import fill as fill_kernels
from .kernels.tone import IDENTITY
from .mesh import Mesh
from .minification import Level, halved, level_for
from .triangulation import TriangulationOptions, depth_cuts, triangulate

__all__ = ["Canvas", "PreparedView", "Target", "ViewTable", "pixels_per_radian"]

Part = Literal["surface", "doubtful", "rims"]

_BANDS = 16
_CHUNKS = 4
_EVERYWHERE = np.empty((0, 0), np.uint8)  # no tiles: triangles go anywhere
_GREY = 512.0  # what is left where nothing was seen and nothing filled


def pixels_per_radian(camera: Camera) -> float:
    """Angular resolution in the middle of a camera's picture."""
    p = camera.projection
    if isinstance(p, Perspective):
        return math.sqrt(abs(p.fx * p.fy))
    return min(p.width / (p.hor_range[1] - p.hor_range[0]), p.height / (p.ver_range[1] - p.ver_range[0]))


@dataclass
class PreparedView:
    """A view with what warping needs of it; its meshes are made when first asked for, by one thread.

    With `completes` its pixels without depth get one (see `completion.complete`).
    """

    view: View  # as it was measured
    options: TriangulationOptions
    origin: npt.NDArray[np.float64]
    completes: bool = False
    _meshes: dict[Part, Mesh] = field(default_factory=dict)
    _levels: list[Level] = field(default_factory=list)
    _lock: threading.RLock = field(default_factory=threading.RLock)
    _completed: Completed | None = None

    @property
    def completed(self) -> Completed:
        """The view as it is drawn."""
        with self._lock:
            if self._completed is None:
                measured = Completed(self.view.codes, None)
                self._completed = complete(self.view, self.options.edge) if self.completes else measured
            return self._completed

    def mesh(self, part: Part = "surface") -> Mesh:
        """The view's surface as far as its depth is trusted, its doubtful rest, or its rims (see `triangulate`)."""
        with self._lock:
            if part not in self._meshes:
                self._meshes[part] = self._triangulate(part)
            return self._meshes[part]

    @property
    def parts(self) -> tuple[Part, ...]:
        """What the view has besides rims."""
        return ("surface",) if self.completed.doubtful is None else ("surface", "doubtful")

    def _triangulate(self, part: Part) -> Mesh:
        codes, doubtful = self.completed
        if part == "surface" and doubtful is not None:
            codes = np.where(doubtful, np.uint16(0), codes)
        keep, rims = doubtful if part == "doubtful" else None, part == "rims"
        cuts = self.cuts if rims or doubtful is None else None
        return triangulate(
            self.view.camera, codes, self.options, origin=self.origin, keep=keep, rims=rims, cuts=cuts
        )

    @cached_property
    def invalid_share(self) -> float:
        """About how much of the picture has no depth as it is drawn."""
        return float(np.mean(self.completed.codes[::8, ::8] == 0)) if self.view.camera.depth.has_invalid else 0.0

    @cached_property
    def table_row(self) -> npt.NDArray[np.float64]:  # [TABLE_SIZE]
        """The view as `kernels.shade` reads it."""
        return self._table_row(self.view.camera)

    def _table_row(self, camera: Camera) -> npt.NDArray[np.float64]:
        row = np.zeros(shade.TABLE_SIZE)
        row[: shade.OFFSET] = camera.packed(self.origin)
        coding = camera.depth
        row[shade.OFFSET], row[shade.STEP] = coding.offset, coding.step
        row[shade.INVALID] = coding.has_invalid
        row[shade.EDGE] = max(self.options.edge / coding.step, 1.0)
        row[shade.TOLERANCE] = row[shade.EDGE] + 1.0  # a step within which a surface is not cut is no disagreement
        row[shade.SHARPNESS] = pixels_per_radian(self.view.camera)  # whatever its size now: no view is worth less
        row[shade.SUBSAMPLED] = 1.0
        row[shade.PIXEL] = 1.0 / pixels_per_radian(camera)
        if isinstance(camera.projection, Equirectangular):
            row[shade.COLUMNS], row[shade.ROWS] = 1.0 / row[4], 1.0 / row[6]
        row[shade.TONE :] = IDENTITY
        return row

    def addresses(self, *, measured: bool = False) -> npt.NDArray[np.int64]:  # [4]
        """Addresses of the codes, completed or as measured, and of the colour planes; all must be C-contiguous."""
        texture = self.view.texture
        codes = self.view.codes if measured else self.completed.codes
        planes = (codes, texture.y, texture.cb, texture.cr)
        if not all(plane.flags.c_contiguous and plane.dtype == np.uint16 for plane in planes):
            raise ValueError(f"view {self.view.camera.name}: planes: expected C-contiguous uint16")
        return np.array([plane.ctypes.data for plane in planes], np.int64)

    def level(self, wanted: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """The view halved `wanted` times or, where its sizes do not allow that, as often as they do: what
        `kernels.shade` reads, [TABLE_SIZE] and addresses [5]."""
        with self._lock:
            if not self._levels:
                texture, codes = self.view.texture, self.completed.codes
                self._levels.append(Level(self.view.camera, codes, texture.y, texture.cb, texture.cr, self.cuts))
            while len(self._levels) <= wanted and (smaller := halved(self._levels[-1], self.options)):
                self._levels.append(smaller)
            level = self._levels[min(wanted, len(self._levels) - 1)]
        row = self._table_row(level.camera)
        row[shade.SUBSAMPLED] = level.subsampled
        arrays = (level.codes, level.y, level.cb, level.cr, level.cuts)
        return row, np.array([array.ctypes.data for array in arrays], np.int64)

    @cached_property
    def cuts(self) -> npt.NDArray[np.uint8]:  # [h, w]
        """Where the view's surface is cut, doubtful depth included (see `depth_cuts`)."""
        return depth_cuts(self.view.camera, self.completed.codes, self.options)


class ViewTable:
    """Views as `kernels.shade` reads them; keeps their arrays alive.

    tones [n, TONE_SIZE]: what is done to the views' colours, packed (`kernels.tone`); None: nothing. The first `drawn`
    come with their completed depth and the cuts of their surfaces, which colours are fetched by; the others with the
    measured depth.
    """

    def __init__(
        self, views: Sequence[PreparedView], tones: npt.NDArray[np.float64] | None = None, *, drawn: int = 0
    ) -> None:
        self.views = tuple(views)
        self.rows = np.stack([view.table_row for view in views])
        if tones is not None:
            self.rows[:, shade.TONE :] = tones
        planes = [view.addresses(measured=k >= drawn) for k, view in enumerate(views)]
        cuts = [view.cuts.ctypes.data if k < drawn else 0 for k, view in enumerate(views)]
        self.addresses = np.column_stack([planes, np.array(cuts, np.int64)])
        self._drawn = drawn

    def at(self, resolution: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """Rows and addresses with the drawn views at the size nearest to a picture's with so many pixels a radian."""
        wanted = [level_for(row[shade.SHARPNESS] / resolution) for row in self.rows[: self._drawn]]
        if not any(wanted):
            return self.rows, self.addresses
        rows, addresses = self.rows.copy(), self.addresses.copy()
        for k, number in enumerate(wanted):
            if number > 0:
                row, addresses[k] = self.views[k].level(number)
                rows[k, : shade.TONE] = row[: shade.TONE]
        return rows, addresses


class _Kernels(NamedTuple):
    transform: Callable[..., None]
    sort: Callable[..., None]
    draw: Callable[..., None]


_PARALLEL = _Kernels(rasterise.transform_points, rasterise.sort_into_bands, rasterise.draw_bands)
_SERIAL = _Kernels(
    rasterise.transform_points_serially, rasterise.sort_into_bands_serially, rasterise.draw_bands_serially
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
        self._marks: npt.NDArray[np.uint8] | None = None  # pixels of a picture of half the size that are meant
        self._marked_tiles = _EVERYWHERE
        self.planes = (np.empty(shape, np.float32), np.empty(shape, np.float32), np.empty(shape, np.float32))
        self._band_rows = max(1, math.ceil(height / _BANDS))
        self._counts = np.empty((_CHUNKS, math.ceil(height / self._band_rows)), np.int64)
        self._lists = np.empty(0, np.int32)
        self._screen = np.empty(0, np.float32)

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

        With `tiles` only triangles that touch a marked one are drawn. Returns the number of triangles drawn.
        """
        tiles = self._marked_tiles if tiles is None else tiles
        if tiles.size and not tiles.any():
            return 0
        return self._rasterise(mesh, target, number, near, margin, 0.0, self.disparity, self.winner, tiles)

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
    ) -> int:  # fmt: skip
        camera, starts = target.packed, mesh.starts
        visible = np.empty(len(starts) - 1, np.int64)
        visible = visible[: rasterise.visible_blocks(mesh.spheres, camera, near, tiles, visible)]
        if len(visible) == 0:
            return 0
        kernels = _SERIAL if (starts[visible + 1] - starts[visible]).sum() < _FEW else _PARALLEL
        screen = self._room("_screen", len(mesh.points) * 4).reshape(-1, 4)
        kernels.transform(mesh.points, starts, visible, camera, screen)
        # Chunks of blocks with about as many triangles each.
        sums = np.concatenate([[0], np.cumsum(starts[visible + 1, 1] - starts[visible, 1])])
        shares = np.searchsorted(sums, np.linspace(0, sums[-1], _CHUNKS + 1))
        shares[0], shares[-1] = 0, len(visible)
        drawn = np.empty(_CHUNKS, np.int64)
        most = int(np.diff(sums[shares]).max())
        lists = self._room("_lists", self._counts.size * most).reshape(*self._counts.shape, most)
        kernels.sort(
            screen, mesh.triangles, starts, visible, shares, camera, near, self._band_rows, tiles,
            self._counts, lists, drawn,
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
        table[:, shade.SHARPNESS] *= target.radians_a_pixel
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
