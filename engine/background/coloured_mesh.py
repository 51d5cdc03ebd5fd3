"""The PBS as a mesh with colours at its vertices, for export."""

from __future__ import annotations

from ..io.coloured_meshes import ColouredMesh, srgb_from_ycbcr
from ..support.array_types import F64
from .capture import Captures
from .pbs import ProbableBackgroundSurface

__all__ = ["coloured_mesh"]


def coloured_mesh(pbs: ProbableBackgroundSurface, captures: Captures, origin: F64) -> ColouredMesh:
    """The valid triangles in the world, each vertex with the colour of its capture at that place; origin: the scene's,
    metres in the world. The arrays are copies; any thread may call this."""
    with pbs.lock:
        parts, captures = [(surface, surface.invalid == 0) for surface in pbs.surfaces()], captures.snapshot()
    return ColouredMesh.joined(
        [
            ColouredMesh(
                surface.mesh.points + origin, surface.mesh.triangles[valid],
                srgb_from_ycbcr(captures.colours(surface.capture, surface.mesh.uv)),
            )
            for surface, valid in parts
        ]
    )  # fmt: skip
