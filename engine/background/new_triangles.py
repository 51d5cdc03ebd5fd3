"""New triangles: pixels of reference views that are back-projected into space (sections 3.3.2 and 3.3.3, Fig. 4)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from ..geometry.mesh import Mesh
from ..geometry.prepared_view import PreparedView, ViewTable
from ..geometry.triangulation import TriangulationOptions, triangulate
from ..rig.camera import Camera
from ..rig.frame import View
from ..support.array_types import F64, U8, U16
from .viewing_space import ViewingSpace

__all__ = ["NewTriangles"]


class NewTriangles:
    """Makes the triangles of the PBS.

    options: bounds of each reference camera's triangulation; origin: the scene's, metres in the world, to which points
    are relative; space: where heads stay, None: anywhere; rims: pixels at depth edges keep their full squares.
    Otherwise a gap of one pixel between a person and the wall would be a hole in the background, through which rays
    reach the surfaces behind it.
    """

    def __init__(
        self, options: Sequence[TriangulationOptions], origin: F64, space: ViewingSpace | None, *, rims: bool = True
    ) -> None:
        self.options, self.origin, self._space, self._rims = tuple(options), origin, space, rims

    def derive(self, index: int, camera: Camera, codes: U16, keep: U8) -> Mesh:
        """The mesh of the pixels of reference camera `index` with keep [h, w] != 0, without the triangles that face
        away from the whole viewing space."""
        options = dataclasses.replace(self.options[index], extend_edges=self._rims)
        mesh = triangulate(camera, codes, options, origin=self.origin, keep=keep)
        return mesh if self._space is None else self._space.seen(mesh)

    def table(self, views: Sequence[View]) -> ViewTable:
        """The reference cameras' views as kernels read them, with these bounds."""
        return ViewTable([self.prepared(index, view) for index, view in enumerate(views)])

    def prepared(self, index: int, view: View) -> PreparedView:
        """A view of reference camera `index`, with its bounds."""
        return PreparedView(view, self.options[index], self.origin)

    def tolerance(self, cameras: Sequence[Camera]) -> float:
        """The largest error of the triangles' depth, as disparity, 1/m."""
        return max(max(o.tolerance, c.depth.step) for o, c in zip(self.options, cameras, strict=True))
