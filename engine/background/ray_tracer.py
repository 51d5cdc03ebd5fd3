"""The ray tracer's operations for the background model, and their implementation with Embree.

The operations are coarse, so that a tracer can do each of them at once where its geometry is: the default runs compiled
kernels that call Embree; a tracer on a GPU would run its programs there.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from ..geometry.embree import MarkQuery, RayScene, intersect_address, occluded_address, point_query_address
from ..kernels.background import complementary_rays, culling, hidden, near, pbi, query_rays, triangle_filter
from ..kernels.background.picture import Picture
from ..kernels.background.queried import Found, Queried
from ..kernels.background.rays import Tracer
from ..kernels.background.surfaces import (
    CAMERA,
    CAPTURE,
    LATE,
    MARKS,
    MARKS_SIZE,
    POINTS,
    SURFACE_SIZE,
    TRIANGLES,
    UV,
    WORDS,
)
from ..kernels.base.callbacks import Callback
from ..kernels.base.memory import address_of
from ..kernels.base.tolerance import Delta
from ..rig.frame import View
from ..rig.questions import Rays
from ..support.array_types import F64, I32, I64, U8
from .capture import Capture, Captures, Present
from .surface import Surface

__all__ = ["EmbreeTracer", "RayTracer"]

_RUN = 64  # neighbouring triangles that begin with the same camera


class RayTracer(Protocol):
    """The surfaces of the PBS, and the rays that are cast at them.

    Surfaces are shared, not copied: rays ignore a triangle while its `invalid` is not 0, and operations write to the
    surfaces' marks. Other changes of geometry take effect with `commit`. Cameras are packed, float64 [CAMERA_SIZE], and
    relative to the scene origin; delta: see `kernels.base.tolerance`. Operations return the number of rays cast, unless
    they say otherwise.
    """

    @property
    def memory(self) -> int:
        """Bytes that the tracer keeps besides the arrays of the surfaces."""

    def set(self, geometry: int, surface: Surface, *, lasting: bool) -> None:
        """Puts a surface under a number and removes the one that was there. lasting: it will not be replaced soon."""

    def commit(self) -> None:
        """Makes changes of geometry take effect."""

    def mark_by_pixel(self, camera: int, packed: F64, stride: int, delta: Delta) -> int:
        """Casts the rays of foreground culling: two for every stride-th pixel in both directions, each with its
        complementary ray (section 3.3.2, Fig. 6a). Sets the camera's bit in the marks of the triangles that they find.
        """

    def mark_by_triangle(
        self, cameras: F64, order: I64, surface: Surface, triangles: I64, delta: Delta, *, share: bool
    ) -> int:
        """Marks triangles (numbers [n]) of a surface by the first camera, in the given order, that finds each of them
        to be background: from that camera, nothing lies more than delta / 2 behind one of the triangle's sample points.
        With `share`, each camera is the first one for a different part of the triangles."""

    def filter_pixels(
        self, capture: Capture, delta: Delta, neighbours: int, blocks: I64, size: tuple[int, int]
    ) -> I64:
        """The triangle filter (section 3.3.3, Fig. 6b) on blocks [n, 2], of `size` rows and columns, of a capture's
        maximum depth image. A pixel passes only if at least `neighbours` of its neighbours are kept or pass as well.
        Returns counts [n, COUNTS_SIZE], see `kernels.background.triangle_filter`."""

    def mark_seen(
        self, eyes: F64, surface: Surface, present: Present, delta: Delta, wraps: bool, cells: U8, seen: U8
    ) -> int:
        """Sets seen [m] to 1 for valid triangles of which one of the eyes [n, CAMERA_SIZE] sees a sample point, except
        for triangles that touch a cell that is set (`kernels.background.hidden`)."""

    def render_pbi(
        self, view: View, packed: F64, captures: Captures, present: Present, delta: Delta, *, sparse: bool, wanted: U8
    ) -> int:
        """Fills a view with the background as its camera sees it (section 3.4.1; `kernels.background.pbi`)."""

    def surface(self, geometry: int) -> Surface:
        """The surface under a number, as rays meet it since the last commit."""

    def cast_rays(self, asked: Asked, rays: Rays, which: int, found: Found) -> None:
        """Casts rays and writes the hit of each that is the nearest or the farthest (`which`:
        `kernels.background.query_rays`)."""

    def mark_free(self, asked: Asked, rays: Rays, free: U8) -> None:
        """Sets free [n] to 1 where rays hit nothing, else to 0."""

    def find_closest(self, asked: Asked, points: F64, within: F64, found: Found) -> None:
        """Finds the place on valid triangles that is nearest to each point [n, 3], metres in the world, and less than
        `within` [n] metres away."""

    def count_touched(self, asked: Asked, centres: F64, radii: F64, counts: I32, triangles: I32) -> None:
        """Counts the valid triangles that spheres touch: centres [n, 3], metres in the world; radii [n], metres; counts
        [n]. Lists of each the first ones that there is room for: triangles [n, room, 2], geometry and primitive."""


class Asked(NamedTuple):
    """What the tracer does not know of the model that it is asked about: the scene's origin [3], metres in the world; a
    table of sightings and the number of the newest frame (`kernels.background.queried`)."""

    origin: F64
    seen: I64
    frame: int


class EmbreeTracer:
    """Embree 4, by compiled kernels (`geometry.embree`, `kernels.background.rays`)."""

    def __init__(self) -> None:
        self._scene = RayScene()
        # Tables that kernels read (`kernels.background.surfaces`), one row per geometry.
        self._surfaces = np.zeros((0, SURFACE_SIZE), np.int64)
        self._marks = np.zeros((0, MARKS_SIZE), np.int64)
        self._invalid = np.zeros(0, np.int64)  # addresses of flags
        self._kept: dict[int, Surface] = {}  # the tables have addresses of their arrays
        self.packed = Tracer(intersect_address(), occluded_address(), self._scene.address, np.zeros((2, 3)))

    @property
    def memory(self) -> int:
        """See `RayTracer`."""
        return self._scene.memory

    def set(self, geometry: int, surface: Surface, *, lasting: bool) -> None:
        """See `RayTracer`."""
        mesh, marks = surface.mesh, surface.marks
        self._scene.set(geometry, mesh.points, mesh.triangles, surface.invalid, lasting=lasting)
        if missing := max(geometry + 1 - len(self._surfaces), 0):
            self._surfaces = np.pad(self._surfaces, ((0, missing), (0, 0)))
            self._marks = np.pad(self._marks, ((0, missing), (0, 0)))
            self._invalid = np.pad(self._invalid, (0, missing))
        self._marks[geometry, [MARKS, WORDS]] = address_of(marks), marks.strides[0] // marks.itemsize
        for column, array in ((TRIANGLES, mesh.triangles), (UV, mesh.uv), (POINTS, mesh.points)):
            self._surfaces[geometry, column] = address_of(array)
        self._surfaces[geometry, [CAMERA, CAPTURE, LATE]] = surface.camera, surface.capture, surface.late
        self._invalid[geometry] = address_of(surface.invalid)
        self._kept[geometry] = surface

    def commit(self) -> None:
        """See `RayTracer`."""
        self._scene.commit()
        bounds = self._scene.bounds()
        # Rays start on the bounds. With a little room, none starts on a surface or behind it.
        room = 1e-3 * max(float(np.max(bounds[1] - bounds[0])), 1e-3)
        self.packed = self.packed._replace(bounds=bounds + np.array([[-room], [room]]))

    def mark_by_pixel(self, camera: int, packed: F64, stride: int, delta: Delta) -> int:
        """See `RayTracer`."""
        word, bit = camera // 64, np.uint64(1 << (camera % 64))
        query = MarkQuery(self._marks, word, int(bit))
        bits = bit.astype(np.int64)
        return int(
            complementary_rays.mark_by_pixel(self.packed, query.address, packed, stride, delta, self._marks, word, bits)
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

    def surface(self, geometry: int) -> Surface:
        """See `RayTracer`."""
        return self._kept[geometry]

    def _queried(self, asked: Asked) -> Queried:
        return Queried(self._surfaces, self._invalid, asked.seen, asked.origin, asked.frame)

    def _near(self, taken: Callback) -> near.Near:
        return near.Near(point_query_address(), self._scene.address, taken.address)

    def cast_rays(self, asked: Asked, rays: Rays, which: int, found: Found) -> None:
        """See `RayTracer`."""
        query_rays.cast_rays(self.packed, self._queried(asked), which, *rays, found)

    def mark_free(self, asked: Asked, rays: Rays, free: U8) -> None:
        """See `RayTracer`."""
        query_rays.mark_free(self.packed, asked.origin, *rays, free)

    def find_closest(self, asked: Asked, points: F64, within: F64, found: Found) -> None:
        """See `RayTracer`."""
        from ..kernels.background.point_callbacks import take_nearer  # late, as it is compiled when it is imported

        near.find_closest(self._near(take_nearer), self._queried(asked), points, within, found)

    def count_touched(self, asked: Asked, centres: F64, radii: F64, counts: I32, triangles: I32) -> None:
        """See `RayTracer`."""
        from ..kernels.background.point_callbacks import take_touched  # late, as it is compiled when it is imported

        room, search = triangles.shape[1], self._near(take_touched)
        near.count_touched(search, self._queried(asked), centres, radii, counts, address_of(triangles), room)
