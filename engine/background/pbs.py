"""The probable background surface: a static and a progressive part, in one ray tracing scene (section 3.3.1)."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Callable, Iterator

import numpy as np

from ..geometry.mesh import Mesh
from ..support.array_types import F32
from .ray_tracer import EmbreeTracer, RayTracer
from .surface import Surface

__all__ = ["ProbableBackgroundSurface", "Surface"]

# A surface of which at least this share of triangles is valid is not compacted: rays lose less time by passing through
# the invalid ones than a new hierarchy takes to build. (With 7 % of them, rays take a fifth longer.)
_DENSE = 0.98


class ProbableBackgroundSurface:
    """S-PBS and P-PBS, each with at most one surface per capture; each surface is a geometry of the ray tracer.

    Triangles of the S-PBS are only flagged as invalid (and compacted after the first frame), or moved as noise is
    averaged away; a capture's surface in the P-PBS is replaced as a whole. Hold `lock` to replace, flag or list
    surfaces; any thread may list them. tracer: None: Embree.
    """

    def __init__(self, camera_count: int, tracer: RayTracer | None = None) -> None:
        self.tracer = EmbreeTracer() if tracer is None else tracer
        self.words = camera_count // 64 + 1  # with a bit that is no camera's (`seeding`)
        self.version = 0  # counts changes of geometry
        self.static: dict[int, Surface] = {}  # by capture number
        self.progressive: dict[int, Surface] = {}
        self.lock = threading.RLock()
        self._camera_count = camera_count
        self._changed: dict[int, tuple[Surface, bool]] = {}  # by geometry, and whether static; since the last commit

    def set_static(self, capture: int, camera: int, mesh: Mesh) -> Surface:
        """Sets a capture's part of the S-PBS, without marks."""
        return self.put(Surface.new(mesh, self.words, camera, capture), static=True)

    def set_progressive(self, capture: int, camera: int, mesh: Mesh) -> Surface:
        """Replaces a capture's part of the P-PBS, without marks."""
        return self.put(Surface.new(mesh, self.words, camera, capture), static=False)

    def put(self, surface: Surface, *, static: bool) -> Surface:
        """Sets a surface with its marks as its capture's surface in the S-PBS (`static`) or the P-PBS."""
        with self.lock:
            self._changed[self._geometry(surface.capture, static)] = surface, static
            (self.static if static else self.progressive)[surface.capture] = surface
            self.version += 1
        return surface

    def remove(self, capture: int) -> None:
        """Removes a capture's surface from the P-PBS, if there is one."""
        with self.lock:
            old = self.progressive.pop(capture, None)
            if old is not None:
                none = old.mesh.only(np.zeros(len(old.invalid), bool))
                empty = Surface.new(none, self.words, old.camera, capture)
                self._changed[self._geometry(capture, static=False)] = empty, False
                self.version += 1

    def move(self, capture: int, moved: Callable[[Mesh], F32]) -> None:
        """Moves the points of a capture's surfaces to `moved(mesh)` [n, 3]; flags and marks stay."""
        with self.lock:
            for static, part in ((True, self.static), (False, self.progressive)):
                if capture in part:
                    old = part[capture]
                    mesh = Mesh(moved(old.mesh), old.mesh.uv, old.mesh.triangles)
                    self.put(dataclasses.replace(old, mesh=mesh), static=static)

    def compact_static(self) -> None:
        """Drops the invalid triangles of surfaces of the S-PBS with many of them; marks stay. Needs `commit` after."""
        with self.lock:
            for capture, surface in list(self.static.items()):
                valid = surface.invalid == 0
                if np.count_nonzero(valid) > _DENSE * len(valid):
                    continue
                compact = self.set_static(capture, surface.camera, surface.mesh.only(valid))
                compact.marks[:] = surface.marks[valid]

    def commit(self) -> None:
        """Makes changes of geometry take effect for rays. The tracer changes here only, and while `lock` is held: other
        threads that hold it may cast rays."""
        with self.lock:
            for geometry, (surface, static) in self._changed.items():
                self.tracer.set(geometry, surface, lasting=static)
            self._changed.clear()
            self.tracer.commit()

    def surfaces(self) -> Iterator[Surface]:
        """All surfaces of the S-PBS, then of the P-PBS."""
        yield from self.static.values()
        yield from self.progressive.values()

    def counts(self) -> dict[str, int]:
        """Triangles: s_pbs (all of the S-PBS), s_pbs_valid (those not culled), p_pbs (valid ones)."""
        with self.lock:
            static, progressive = list(self.static.values()), list(self.progressive.values())
        return {
            "s_pbs": sum(len(surface.invalid) for surface in static),
            "s_pbs_valid": sum(surface.valid_count for surface in static),
            "p_pbs": sum(surface.valid_count for surface in progressive),
        }

    @property
    def memory(self) -> int:
        """Bytes of the surfaces: triangles, their points and marks."""
        with self.lock:
            return sum(surface.memory for surface in list(self.surfaces()))

    def _geometry(self, capture: int, static: bool) -> int:
        """A surface's number in the ray tracer: first the P-PBS of each camera's first capture, then the S-PBS."""
        count = self._camera_count
        later = capture // count * 2 * count  # captures after the first of each camera
        return later + capture % count + (count if static else 0)
