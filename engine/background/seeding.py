"""The beginning of the S-PBS with an earlier model: surfaces that no view of the first frame shows.

The paper's S-PBS takes of each view only the surfaces that no earlier one shows (section 3.3.2). An earlier model is
one more view in this sense, the last one: where the present views see a surface, they know it better. Then its
triangles are like all others. A camera that sees farther than one of them culls it, a surface in front of one of them
is foreground, and backdrops show it where it stands.

A triangle that is in no camera's picture would get no mark, and would be culled. It gets a mark of no camera instead,
the bit after those of the cameras, until a camera that has moved, or was left out so far, could see it in its turn.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.mesh import Mesh
from ..geometry.prepared_view import ViewTable
from ..geometry.refinement import refined
from ..kernels.background.seeding import judge_seed
from ..kernels.background.surfaces import Triangles
from ..kernels.base.tolerance import Delta
from ..support.array_types import F64, I64, U8
from .capture import Captures
from .pbs import ProbableBackgroundSurface
from .seed import Seed

__all__ = ["judged", "look_again", "plant"]

_SIDE_RAD = 0.03  # longest side of a triangle as the rig sees it: it stays or goes as a whole
_NEAREST = 0.25  # share of the scene's depth: sides nearer than this are seen from this distance
_LONGEST_PX = 1024.0  # in the atlas: exported textures hold triangles whole


def plant(
    seed: Seed, pbs: ProbableBackgroundSurface, captures: Captures, views: ViewTable, chosen: list[int],
    cameras: F64, seen: Sequence[int], delta: Delta, depth_m: float, origin: F64,
) -> None:  # fmt: skip
    """Puts into the S-PBS the triangles of a seed that the `chosen` views do not show. Needs `pbs.commit` after.

    views: of all cameras, in the first frame; cameras: packed, [n, CAMERA_SIZE]; seen: those whose views are not left
    out of the first frame; depth_m: the scene's typical depth; origin: the scene's, metres in the world.
    """
    for part in seed.parts:
        points, triangles, uv = refined(
            part.vertices - origin, part.triangles, part.uv, _SIDE_RAD, _NEAREST * depth_m, _LONGEST_PX
        )
        mesh = Mesh(points.astype(np.float32), uv, triangles)
        shown, unseen = judged(mesh, views.rows[chosen], views.addresses[chosen, 0], cameras[list(seen)], delta)
        kept = shown == 0
        if not kept.any():
            continue
        number = captures.add_atlas(part.atlas)
        surface = pbs.set_static(number, 0, mesh.only(kept))
        word, bit = _mark(len(cameras))
        surface.marks[unseen[kept] != 0, word] |= bit


def look_again(pbs: ProbableBackgroundSurface, captures: Captures, count: int, camera: F64) -> None:
    """Takes the mark of no camera from the triangles in the picture of a camera (packed) that is to cast its first rays
    from where it is; count: of the cameras."""
    word, bit = _mark(count)
    none = np.empty((0, 0)), np.empty(0, np.int64)
    for number in captures.atlases:
        surface = pbs.static.get(number)
        if surface is not None:
            _, unseen = judged(surface.mesh, *none, camera[None], (0.0, 0.0))
            surface.marks[unseen == 0, word] &= ~bit


def judged(mesh: Mesh, rows: F64, codes: I64, cameras: F64, delta: Delta) -> tuple[U8, U8]:
    """Which triangles of a mesh (relative to the scene's origin) views show, and which are in no camera's picture:
    1 or 0 for each triangle.

    rows [n, TABLE_SIZE], codes [n]: rows of a view table, and addresses of the views' depth codes; cameras: packed,
    [m, CAMERA_SIZE].
    """
    shown, unseen = np.empty((2, len(mesh.triangles)), np.uint8)
    triangles = Triangles(mesh.points, mesh.uv, mesh.triangles)
    judge_seed(rows, np.ascontiguousarray(codes), cameras, triangles, delta, shown, unseen)
    return shown, unseen


def _mark(count: int) -> tuple[int, np.uint64]:
    """The word and the bit of a triangle's marks that no one of `count` cameras has."""
    return count // 64, np.uint64(1 << (count % 64))
