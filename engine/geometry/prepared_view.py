"""Source views prepared for rendering: their meshes, their reduced sizes, and the tables that kernels read."""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from ..kernels.base import view_table
from ..kernels.base.memory import address_of
from ..kernels.base.tone import IDENTITY
from ..rig.camera import Camera, Equirectangular, Perspective
from ..rig.frame import View
from ..support.lazy import lazy
from ..support.packed import HEIGHT, RADIANS_A_COLUMN, RADIANS_A_ROW, WIDTH
from .completion import Completed, complete
from .mesh import Mesh
from .minification import Level, halved, level_for
from .triangulation import TriangulationOptions, depth_cuts, triangulate
from .triangulator import Triangulator

__all__ = ["Part", "PreparedView", "ViewTable", "pixels_per_radian"]

Part = Literal["surface", "doubtful", "rims"]


def pixels_per_radian(camera: Camera) -> float:
    """Angular resolution in the middle of a camera's picture, pixels per radian."""
    p = camera.projection
    if isinstance(p, Perspective):
        return math.sqrt(abs(p.fx * p.fy))
    return min(p.width / (p.hor_range[1] - p.hor_range[0]), p.height / (p.ver_range[1] - p.ver_range[0]))


def _coarser_axis(camera: Camera) -> float:
    """Pixels per radian along the axis with fewer of them: views are reduced by the same factor in both directions."""
    p = camera.projection
    return min(abs(p.fx), abs(p.fy)) if isinstance(p, Perspective) else pixels_per_radian(camera)


@dataclass
class PreparedView:
    """A view prepared for warping; each of its meshes is made on first use, by one thread.

    completes: pixels without depth are completed (see `completion.complete`). origin: the scene's, metres in the
    world. triangulator: of this camera; it reuses the parts that are the same as in the camera's last frame.
    """

    view: View  # as it was measured
    options: TriangulationOptions
    origin: npt.NDArray[np.float64]
    completes: bool = False
    triangulator: Triangulator | None = None
    _meshes: dict[Part, Mesh] = field(default_factory=dict)
    _levels: list[Level] = field(default_factory=list)
    _lock: threading.RLock = field(default_factory=threading.RLock)
    _completed: Completed | None = None
    _cuts: npt.NDArray[np.uint8] | None = None
    _addresses: dict[bool, list[int]] = field(default_factory=dict)  # by `measured`: each picture asks for them

    @property
    def completed(self) -> Completed:
        """The view as it is drawn."""
        with self._lock:
            if self._completed is None:
                measured = Completed(self.view.codes, None)
                self._completed = complete(self.view, self.options.edge) if self.completes else measured
            return self._completed

    def mesh(self, part: Part = "surface") -> Mesh:
        """The view's surface of trusted depth, of doubtful depth, or its rims (see `triangulate`)."""
        with self._lock:
            if part not in self._meshes:
                self._meshes[part] = self._triangulate(part)
            return self._meshes[part]

    def warm(self, parts: Sequence[Part]) -> None:
        """Make now everything that drawing these parts needs; otherwise the first picture has to make it."""
        for part in parts:
            self.mesh(part).warm()

    @property
    def triangle_count(self) -> int:
        """Triangles of the meshes that have been made so far."""
        return sum(len(mesh.triangles) for mesh in self._meshes.values())

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts that the view has, besides rims."""
        return ("surface",) if self.completed.doubtful is None else ("surface", "doubtful")

    def _triangulate(self, part: Part) -> Mesh:
        codes, doubtful = self.completed
        if part == "surface" and doubtful is None and self.triangulator is not None:
            mesh, cuts = self.triangulator.triangulate(self.view.camera, codes, self.options, self.origin)
            self._cuts = cuts if self._cuts is None else self._cuts  # kept: a table may hold its address
            return mesh
        if part == "rims" and doubtful is None and self.triangulator is not None:
            known_rims = self.triangulator.rims(self.cuts)
            if known_rims is not None:
                return known_rims
        if part == "surface" and doubtful is not None:
            codes = np.where(doubtful, np.uint16(0), codes)
        keep, rims = doubtful if part == "doubtful" else None, part == "rims"
        known = self.cuts if rims or doubtful is None else None
        return triangulate(
            self.view.camera, codes, self.options, origin=self.origin, keep=keep, rims=rims, cuts=known
        )

    @lazy
    def invalid_share(self) -> float:
        """The approximate share of the picture that has no depth when it is drawn (after completion)."""
        return float(np.mean(self.completed.codes[::8, ::8] == 0)) if self.view.camera.depth.has_invalid else 0.0

    @lazy
    def table_row(self) -> npt.NDArray[np.float64]:  # [TABLE_SIZE]
        """The view as `kernels.base.view_table` reads it. If it is left out of its frame, its picture has no pixels:
        every point is outside, whatever the depth coding."""
        row = self.camera_row()
        if not self.view.there:
            row[WIDTH] = row[HEIGHT] = 0.0
        return row

    def camera_row(self) -> npt.NDArray[np.float64]:  # [TABLE_SIZE]
        """The row of a view of this camera that is not left out."""
        return self._table_row(self.view.camera)

    def _table_row(self, camera: Camera) -> npt.NDArray[np.float64]:
        row = np.zeros(view_table.TABLE_SIZE)
        row[: view_table.OFFSET] = camera.packed(self.origin)
        coding = camera.depth
        row[view_table.OFFSET], row[view_table.STEP] = coding.offset, coding.step
        row[view_table.INVALID] = coding.has_invalid
        row[view_table.EDGE] = max(self.options.edge / coding.step, 1.0)
        # A step at which a surface is not cut does not count as a disagreement between views.
        row[view_table.TOLERANCE] = row[view_table.EDGE] + 1.0
        row[view_table.SHARPNESS] = pixels_per_radian(self.view.camera)  # of the full size: reducing costs no weight
        row[view_table.SUBSAMPLED] = 1.0
        row[view_table.PIXEL] = 1.0 / pixels_per_radian(camera)
        if isinstance(camera.projection, Equirectangular):
            row[view_table.COLUMNS], row[view_table.ROWS] = 1.0 / row[RADIANS_A_COLUMN], 1.0 / row[RADIANS_A_ROW]
        row[view_table.TONE :] = IDENTITY
        return row

    def addresses(self, *, measured: bool = False) -> list[int]:  # [4]
        """Addresses of the codes, completed or as measured, and of the colour planes.

        Raises ValueError if a plane is not C-contiguous uint16, or smaller than 4 x 4 pixels.
        """
        if measured not in self._addresses:
            self._addresses[measured] = self._find_addresses(measured)
        return self._addresses[measured]

    def _find_addresses(self, measured: bool) -> list[int]:
        texture = self.view.texture
        codes = self.view.codes if measured else self.completed.codes
        planes = (codes, texture.y, texture.cb, texture.cr)
        if not all(plane.flags.c_contiguous and plane.dtype == np.uint16 for plane in planes):
            raise ValueError(f"view {self.view.camera.name}: planes: expected C-contiguous uint16")
        if min(codes.shape) < 4:
            raise ValueError(f"view {self.view.camera.name}: size {codes.shape}: expected at least 4 x 4 pixels")
        return [address_of(plane) for plane in planes]

    def level(self, wanted: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """The view halved `wanted` times, or as often as its size allows, as `kernels.base.view_table` reads it: the
        row [TABLE_SIZE] and the addresses [5]."""
        with self._lock:
            if not self._levels:
                texture, codes = self.view.texture, self.completed.codes
                self._levels.append(Level(self.view.camera, codes, texture.y, texture.cb, texture.cr, self.cuts))
            while len(self._levels) <= wanted and (smaller := halved(self._levels[-1], self.options)):
                self._levels.append(smaller)
            level = self._levels[min(wanted, len(self._levels) - 1)]
        row = self._table_row(level.camera)
        row[view_table.SUBSAMPLED] = level.subsampled
        arrays = (level.codes, level.y, level.cb, level.cr, level.cuts)
        return row, np.array([address_of(array) for array in arrays], np.int64)

    @property
    def cuts(self) -> npt.NDArray[np.uint8]:  # [h, w]
        """Where the view's surface is cut (see `depth_cuts`), including doubtful depth."""
        with self._lock:
            if self._cuts is None:
                self._cuts = depth_cuts(self.view.camera, self.completed.codes, self.options)
            return self._cuts


class ViewTable:
    """Views as `kernels.base.view_table` reads them; keeps their arrays alive.

    tones [n, TONE_SIZE]: the tone that is applied to each view's colours, packed (`kernels.base.tone`); None: none. The
    first `drawn` views have their completed depth and the cuts of their surfaces, which the fetching of colours needs;
    the others have the measured depth.
    """

    def __init__(
        self, views: Sequence[PreparedView], tones: npt.NDArray[np.float64] | None = None, *, drawn: int = 0
    ) -> None:
        self.views = tuple(views)
        self.rows = np.array([view.table_row for view in views]).reshape(-1, view_table.TABLE_SIZE)
        if tones is not None:
            self.rows[:, view_table.TONE :] = tones
        cuts = [address_of(view.cuts) if k < drawn else 0 for k, view in enumerate(views)]
        planes = [[*view.addresses(measured=k >= drawn), cuts[k]] for k, view in enumerate(views)]
        self.addresses = np.array(planes, np.int64).reshape(-1, 5)
        self._drawn = drawn

    def warm(self, resolution: float | None) -> None:
        """Make now the reduced views that `at` returns for a resolution (pixels per radian); None: none are needed."""
        if resolution is not None:
            self.at(resolution)

    def at(self, resolution: float) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
        """Rows and addresses, with the drawn views reduced for a picture of `resolution` (pixels per radian)."""
        wanted = [level_for(_coarser_axis(view.view.camera) / resolution) for view in self.views[: self._drawn]]
        if not any(wanted):
            return self.rows, self.addresses
        rows, addresses = self.rows.copy(), self.addresses.copy()
        for k, number in enumerate(wanted):
            if number > 0:
                row, addresses[k] = self.views[k].level(number)
                rows[k, : view_table.TONE] = row[: view_table.TONE]
        return rows, addresses
