"""The probable background surface: a static and a progressive part, in one ray tracing scene (section 3.3.1)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..geometry.embree import Scene, intersect_address, occluded_address
from ..geometry.mesh import Mesh
from ..kernels.background.rays import Tracer
from ..kernels.background.surfaces import (
    CAMERA,
    CAPTURE,
    MARKS_SIZE,
    POINTS,
    SURFACE_SIZE,
    TRIANGLES,
    UV,
    Triangles,
)

__all__ = ["ProbableBackgroundSurface", "Surface"]

# Where at least this share of a surface's triangles is valid, rays lose less time by passing through the others than it
# takes to build its hierarchy without them.
_DENSE = 0.9


@dataclass(frozen=True, slots=True)
class Surface:
    """A camera's triangles in the S-PBS or in the P-PBS.

    marks uint64 [m, words]: bit c of a triangle's words is set where camera c's last rays found it to be
    background. invalid uint8 [m]: no camera did; rays pass through.
    """

    mesh: Mesh
    marks: npt.NDArray[np.uint64]
    invalid: npt.NDArray[np.uint8]

    @property
    def packed(self) -> Triangles:
        """The mesh as kernels take it."""
        return Triangles(self.mesh.points, self.mesh.uv, self.mesh.triangles)

    @property
    def valid_count(self) -> int:
        """Triangles that are there."""
        return len(self.invalid) - int(np.count_nonzero(self.invalid))

    @property
    def memory(self) -> int:
        """Bytes of its arrays, the ray tracer's own not among them."""
        mesh = self.mesh
        mine = mesh.points.nbytes + mesh.uv.nbytes + mesh.triangles.nbytes
        return mine + self.marks.nbytes + self.invalid.nbytes


class ProbableBackgroundSurface:
    """S-PBS and P-PBS, per camera at most one surface in each; each surface is a geometry of one scene.

    The S-PBS' triangles are only ever flagged as invalid, or moved as noise is averaged away; a camera's surface in the
    P-PBS is replaced whole.
    """

    def __init__(self, camera_count: int) -> None:
        self.words = (camera_count + 63) // 64
        self.version = 0  # counts changes of geometry
        self.static: dict[int, Surface] = {}
        self.progressive: dict[int, Surface] = {}
        self._camera_count = camera_count
        self._scene = Scene()
        # Tables that kernels read (`kernels.background.surfaces`).
        self.marks_table = np.zeros((2 * camera_count, MARKS_SIZE), np.int64)
        self.surface_table = np.zeros((2 * camera_count, SURFACE_SIZE), np.int64)
        self.tracer = Tracer(intersect_address(), occluded_address(), self._scene.address, np.zeros((2, 3)))

    def set_static(self, camera: int, mesh: Mesh) -> None:
        """A camera's part of the S-PBS, without marks."""
        self.static[camera] = self._put(self._camera_count + camera, camera, mesh)

    def set_progressive(self, camera: int, mesh: Mesh) -> Surface:
        """Replaces a camera's part of the P-PBS, without marks."""
        self.progressive[camera] = self._put(camera, camera, mesh)
        return self.progressive[camera]

    def move(self, camera: int, moved: Callable[[Mesh], npt.NDArray[np.float32]]) -> None:
        """Puts the points [n, 3] of a camera's surfaces elsewhere; what is invalid or marked stays so."""
        for part, geometry in ((self.static, self._camera_count + camera), (self.progressive, camera)):
            if camera in part:
                old = part[camera]
                mesh = Mesh(moved(old.mesh), old.mesh.uv, old.mesh.triangles)
                part[camera] = new = self._put(geometry, camera, mesh)
                new.marks[:], new.invalid[:] = old.marks, old.invalid

    def compact_static(self) -> None:
        """Drops the invalid triangles of the S-PBS where they are many; marks stay. Counts after `commit`."""
        for camera, surface in list(self.static.items()):
            valid = surface.invalid == 0
            if np.count_nonzero(valid) > _DENSE * len(valid):
                continue
            self.set_static(camera, surface.mesh.only(valid))
            self.static[camera].marks[:] = surface.marks[valid]

    def commit(self) -> None:
        """Makes changes of geometry count."""
        self._scene.commit()
        bounds = self._scene.bounds()
        # Rays start on the bounds: a little room keeps them from starting on, or behind, a surface.
        room = 1e-3 * max(float(np.max(bounds[1] - bounds[0])), 1e-3)
        self.tracer = self.tracer._replace(bounds=bounds + np.array([[-room], [room]]))

    def surfaces(self) -> Iterator[Surface]:
        """All surfaces of the S-PBS, then of the P-PBS."""
        yield from self.static.values()
        yield from self.progressive.values()

    def _put(self, geometry: int, camera: int, mesh: Mesh) -> Surface:
        count = len(mesh.triangles)
        mesh = Mesh(
            np.ascontiguousarray(mesh.points), np.ascontiguousarray(mesh.uv), np.ascontiguousarray(mesh.triangles)
        )
        surface = Surface(mesh, np.zeros((count, self.words), np.uint64), np.zeros(count, np.uint8))
        self._scene.set(geometry, mesh.points, mesh.triangles, surface.invalid)
        self.marks_table[geometry] = surface.marks.ctypes.data, 8 * self.words
        addresses = {UV: mesh.uv, TRIANGLES: mesh.triangles, POINTS: mesh.points}
        for column, array in addresses.items():
            self.surface_table[geometry, column] = array.ctypes.data
        self.surface_table[geometry, [CAMERA, CAPTURE]] = camera
        self.version += 1
        return surface
