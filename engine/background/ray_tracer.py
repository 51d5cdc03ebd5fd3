"""What the background model asks of a ray tracer, in whole operations; and Embree behind them.

The operations are coarse, so that a tracer can do each in one go where its geometry lies: the default runs compiled
kernels that call Embree; one on a GPU would run programs there.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..geometry.embree import MarkQuery, RayScene, intersect_address, occluded_address
from ..kernels.background import culling, hidden, pbi, triangle_filter
from ..kernels.background.picture import Picture
from ..kernels.background.rays import Tracer
from ..kernels.background.surfaces import (
    CAMERA,
    CAPTURE,
    MARKS,
    MARKS_SIZE,
    POINTS,
    SURFACE_SIZE,
    TRIANGLES,
    UV,
    WORDS,
)
from ..kernels.base.memory import address_of
from ..kernels.base.tolerance import Delta
from ..rig.frame import View
from ..support.array_types import F64, I64, U8
from .capture import Capture, Captures, Present
from .surface import Surface

__all__ = ["EmbreeTracer", "RayTracer"]

_RUN = 64  # neighbouring triangles that begin with the same camera


class RayTracer(Protocol):
    """The surfaces of the PBS, and the rays that are cast at them.

    Surfaces are shared, not copied: a triangle is not there while its `invalid` is not 0, and marks are written to.
    Other changes of geometry count after `commit`. Cameras are packed and relative to the scene origin; delta: see
    `kernels.base.tolerance`. Operations return how many rays they cast.
    """

    @property
    def memory(self) -> int:
        """Bytes of its own: what it keeps besides the arrays of the surfaces."""

    def set(self, geometry: int, surface: Surface) -> None:
        """Puts a surface under a number, in the place of the one that was there."""

    def commit(self) -> None:
        """Makes changes of geometry count."""

    def mark_by_pixel(self, camera: int, packed: F64, stride: int, delta: Delta) -> int:
        """Foreground culling's rays, two for every stride-th pixel both ways, each with its complementary ray (section
        3.3.2, Fig. 6a): sets a camera's bit in the marks of what they find."""

    def mark_by_triangle(
        self, cameras: F64, order: I64, surface: Surface, triangles: I64, delta: Delta, *, share: bool
    ) -> int:
        """Sets in the marks of triangles (numbers [n]) the bit of the first of the cameras, in the given order, behind
        one of whose sample points nothing lies by more than delta / 2, as that camera sees it. With `share` the cameras
        start on other triangles each."""

    def filter_pixels(
        self, capture: Capture, delta: Delta, neighbours: int, blocks: I64, size: tuple[int, int]
    ) -> I64:
        """The triangle filter (section 3.3.3, Fig. 6b) on blocks [n, 2] of a capture's maximum depth image, of `size`
        rows and columns; what passes needs `neighbours` that do as well. Returns [n, COUNTS_SIZE], see
        `kernels.background.triangle_filter`."""

    def mark_seen(
        self, eyes: F64, surface: Surface, present: Present, delta: Delta, wraps: bool, cells: U8, seen: U8
    ) -> int:
        """Sets seen [m] to 1 for valid triangles of which one of some eyes [n, CAMERA_SIZE] is shown a sample point,
        unless they touch a cell that is set (`kernels.background.hidden`)."""

    def render_pbi(
        self, view: View, packed: F64, captures: Captures, present: Present, delta: Delta, *, sparse: bool, wanted: U8
    ) -> int:
        """Fills a view with the background that its camera is shown (section 3.4.1; `kernels.background.pbi`)."""


class EmbreeTracer:
    """Embree 4, by compiled kernels (`geometry.embree`, `kernels.background.rays`)."""

    def __init__(self) -> None:
        self._scene = RayScene()
        # Tables that kernels read (`kernels.background.surfaces`), a row a geometry.
        self._surfaces = np.zeros((0, SURFACE_SIZE), np.int64)
        self._marks = np.zeros((0, MARKS_SIZE), np.int64)
        self.packed = Tracer(intersect_address(), occluded_address(), self._scene.address, np.zeros((2, 3)))

    @property
    def memory(self) -> int:
        """See `RayTracer`."""
        return self._scene.memory

    def set(self, geometry: int, surface: Surface) -> None:
        """See `RayTracer`."""
        mesh, marks = surface.mesh, surface.marks
        self._scene.set(geometry, mesh.points, mesh.triangles, surface.invalid)
        if missing := max(geometry + 1 - len(self._surfaces), 0):
            self._surfaces = np.pad(self._surfaces, ((0, missing), (0, 0)))
            self._marks = np.pad(self._marks, ((0, missing), (0, 0)))
        self._marks[geometry, [MARKS, WORDS]] = address_of(marks), marks.strides[0] // marks.itemsize
        for column, array in ((TRIANGLES, mesh.triangles), (UV, mesh.uv), (POINTS, mesh.points)):
            self._surfaces[geometry, column] = address_of(array)
        self._surfaces[geometry, [CAMERA, CAPTURE]] = surface.camera, surface.capture

    def commit(self) -> None:
        """See `RayTracer`."""
        self._scene.commit()
        bounds = self._scene.bounds()
        # Rays start on the bounds: a little room keeps them from starting on, or behind, a surface.
        room = 1e-3 * max(float(np.max(bounds[1] - bounds[0])), 1e-3)
        self.packed = self.packed._replace(bounds=bounds + np.array([[-room], [room]]))

    def mark_by_pixel(self, camera: int, packed: F64, stride: int, delta: Delta) -> int:
        """See `RayTracer`."""
        word, bit = camera // 64, np.uint64(1 << (camera % 64))
        query = MarkQuery(self._marks, word, int(bit))
        bits = bit.astype(np.int64)
        return int(
            culling.mark_by_pixel(self.packed, query.address, packed, stride, delta, self._marks, word, bits)
        )

    def mark_by_triangle(
        self, cameras: F64, order: I64, surface: Surface, triangles: I64, delta: Delta, *, share: bool
    ) -> int:
        """See `RayTracer`."""
        run = _RUN if share else 0
        return int(
            culling.mark_by_triangle(
                self.packed, cameras, order, run, surface.packed, triangles, delta, surface.marks
            )
        )

    def filter_pixels(
        self, capture: Capture, delta: Delta, neighbours: int, blocks: I64, size: tuple[int, int]
    ) -> I64:
        """See `RayTracer`."""
        counts, image = np.empty((len(blocks), triangle_filter.COUNTS_SIZE), np.int64), capture.image
        coding = image.camera.depth.packed()
        triangle_filter.filter_pixels(
            self.packed, capture.packed, coding, image.codes, image.flags, delta, neighbours, blocks, size, counts
        )
        return counts

    def mark_seen(
        self, eyes: F64, surface: Surface, present: Present, delta: Delta, wraps: bool, cells: U8, seen: U8
    ) -> int:
        """See `RayTracer`."""
        return int(
            hidden.mark_seen(
                self.packed, eyes, surface.packed, surface.invalid, self._surfaces, present.packed(), delta, wraps,
                cells, seen,
            )
        )  # fmt: skip

    def render_pbi(
        self, view: View, packed: F64, captures: Captures, present: Present, delta: Delta, *, sparse: bool, wanted: U8
    ) -> int:
        """See `RayTracer`."""
        texture, tables = view.texture, pbi.Tables(self._surfaces, captures.table)
        picture = Picture(view.codes, texture.y, texture.cb, texture.cr)
        coding = view.camera.depth.packed()
        return int(
            pbi.render_pbi(
                self.packed, packed, coding, tables, present.packed(), delta, sparse, wanted, picture
            )
        )
