"""The PBS as a mesh with the pictures of its captures, for export."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..io.coloured_meshes import TexturedMesh, TexturedPart
from ..support.array_types import F32, F64, I64
from .capture import Captures
from .pbs import ProbableBackgroundSurface, Surface
from .texture_pages import Part, arrange, paint

__all__ = ["BLOCK", "textured_mesh", "within_pixels"]

BLOCK = 128  # pixels: triangles of a capture share a part of its picture by blocks; a multiple of triangles' legs
_PAD = 4  # pixels round the used ones: what programs read that halve textures by themselves, as Blender does


def textured_mesh(pbs: ProbableBackgroundSurface, captures: Captures, origin: F64) -> TexturedMesh:
    """The valid triangles in the world, with the parts of their captures' pictures that they use; origin: the scene's,
    metres in the world. The arrays are copies; any thread may call this."""
    with pbs.lock:
        valid, captures = [(surface, surface.invalid == 0) for surface in pbs.surfaces()], captures.snapshot()
    triangles = _Triangles.of(valid, captures)
    parts, numbers = _parts(triangles)
    pages = arrange(parts)
    corners = np.array([(part.left, part.top) for part in parts], np.int64).reshape(-1, 2)
    shifts = pages.places[:, 1:] - corners  # from a capture's picture to the page
    meshes = []
    for page, picture in enumerate(paint(parts, pages, captures)):
        here = pages.places[numbers, 0] == page
        # A vertex of triangles with different parts lies at a place in each part.
        pairs = numbers[here, None] * len(triangles.points) + triangles.corners[here]
        used, renumbered = np.unique(pairs, return_inverse=True)
        part, vertex = np.divmod(used, len(triangles.points))
        uv = (triangles.uv[vertex] + shifts[part]).astype(np.float32)
        vertices = triangles.points[vertex] + origin
        meshes.append(TexturedPart(vertices, renumbered.reshape(-1, 3).astype(np.int32), uv, picture))
    return TexturedMesh(tuple(meshes))


@dataclass(frozen=True, slots=True)
class _Triangles:
    """Triangles of many surfaces: points float32 [n, 3] and uv float32 [n, 2] of their vertices as in `Mesh`, corners
    int64 [m, 3], and the number of each triangle's capture, int64 [m]."""

    points: F32
    uv: F32
    corners: I64
    captures: I64

    @classmethod
    def of(cls, valid: Sequence[tuple[Surface, npt.NDArray[np.bool_]]], captures: Captures) -> _Triangles:
        """The triangles of surfaces for which the flag [m] is true."""
        points, uv = [np.empty((0, 3), np.float32)], [np.empty((0, 2), np.float32)]
        corners, numbers = [np.empty((0, 3), np.int64)], [np.empty(0, np.int64)]
        start = 0
        for surface, which in valid:
            triangles = surface.mesh.triangles[which].astype(np.int64)
            points.append(surface.mesh.points)
            is_seed = surface.capture in captures.atlases  # `Seed` has seen to its rims
            uv.append(surface.mesh.uv if is_seed else within_pixels(surface.mesh.uv, triangles))
            corners.append(triangles + start)
            numbers.append(np.full(len(triangles), surface.capture, np.int64))
            start += len(surface.mesh.points)
        return cls(np.concatenate(points), np.concatenate(uv), np.concatenate(corners), np.concatenate(numbers))


def within_pixels(uv: F32, triangles: I64) -> F32:
    """Picture coordinates [n, 2] of a camera's triangles [m, 3], with those of rims moved to the centre of their pixel.

    A rim is the rest of a pixel's square at a depth edge. A filter that interpolates there would mix in the pixel on
    the other side of the edge, which belongs to another surface. Rims share no vertices with other triangles.
    """
    off_centre = (uv % 1.0 != 0.5).any(axis=1)
    rims = triangles[off_centre[triangles].any(axis=1)]
    moved = uv.copy()
    moved[rims] = np.floor(uv[rims].mean(axis=1, keepdims=True)) + np.float32(0.5)
    return moved


def _parts(triangles: _Triangles) -> tuple[list[Part], I64]:
    """The parts of pictures that triangles use, and the number [m] of each triangle's part: one for each block of each
    capture."""
    if not len(triangles.corners):
        return [], np.empty(0, np.int64)
    uv = triangles.uv[triangles.corners]  # [m, 3, 2]
    blocks = ((uv.mean(axis=1) - 0.5) // BLOCK).astype(np.int64)
    keys = np.stack([triangles.captures, blocks[:, 1], blocks[:, 0]], axis=-1)
    found, numbers = np.unique(keys, axis=0, return_inverse=True)
    order = np.argsort(numbers := numbers.reshape(-1), kind="stable")
    starts = np.searchsorted(numbers[order], np.arange(len(found)))
    low = np.minimum.reduceat(uv.min(axis=1)[order], starts)
    high = np.maximum.reduceat(uv.max(axis=1)[order], starts)
    first, last = np.floor(low - 0.5).astype(np.int64) - _PAD, np.ceil(high - 0.5).astype(np.int64) + _PAD
    return [Part.holding(int(key[0]), *ends) for key, *ends in zip(found, first, last, strict=True)], numbers
