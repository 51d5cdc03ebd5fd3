"""A surface: the triangles of a capture in one of the two parts of the PBS."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..geometry.mesh import Mesh
from ..kernels.background.surfaces import Triangles
from ..support.array_types import U8, U64

__all__ = ["Surface"]


@dataclass(frozen=True, slots=True)
class Surface:
    """A capture's triangles in the S-PBS or in the P-PBS.

    marks uint64 [m, words]: bit c of a triangle's words is set if the last rays of reference camera c found it to be
    background (the paper's "valid"). invalid uint8 [m]: 1 if no camera found it; rays pass through. camera: index of
    the reference camera; capture: number of the capture (`capture.Capture`) that the triangles stem from. late: a late
    layer (`late_layers`): only present views tell whether it stands.
    """

    mesh: Mesh
    marks: U64
    invalid: U8
    camera: int
    capture: int
    late: bool = False

    @classmethod
    def new(cls, mesh: Mesh, words: int, camera: int, capture: int) -> Surface:
        """A surface without marks, with all triangles valid."""
        count = len(mesh.triangles)
        mesh = Mesh(
            np.ascontiguousarray(mesh.points), np.ascontiguousarray(mesh.uv), np.ascontiguousarray(mesh.triangles)
        )
        return cls(mesh, np.zeros((count, words), np.uint64), np.zeros(count, np.uint8), camera, capture)

    @property
    def packed(self) -> Triangles:
        """The mesh as kernels take it."""
        return Triangles(self.mesh.points, self.mesh.uv, self.mesh.triangles)

    @property
    def valid_count(self) -> int:
        """The number of valid triangles."""
        return len(self.invalid) - int(np.count_nonzero(self.invalid))

    @property
    def memory(self) -> int:
        """Bytes of its arrays, without the ray tracer's own."""
        mesh = self.mesh
        return sum(a.nbytes for a in (mesh.points, mesh.uv, mesh.triangles, self.marks, self.invalid))
