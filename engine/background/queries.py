"""Questions about the model for programs that use the room: what does a ray hit, what is near a point, what does a
sphere touch?

Places and lengths are metres in the world. Triangles that were culled are not there. A batch is answered by kernels on
all cores, in parts: between them the thread that updates may change the model, so the last answers of a large batch may
be of a newer frame than the first ones.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import numpy.typing as npt

from ..kernels.background.queried import Found
from ..kernels.background.query_rays import FARTHEST, NEAREST
from ..rig.questions import Hits, NoModelError, Points, Rays, Spheres, Touched
from ..support.array_types import B1, F64, I32, U8
from .pbs import ProbableBackgroundSurface
from .ray_tracer import Asked, RayTracer
from .sightings import Sightings

__all__ = ["ModelQueries"]

# Questions that are answered while the model waits: some tens of milliseconds.
_RAYS, _POINTS, _SPHERES = 1 << 15, 1 << 11, 1 << 8
_TURN_S = 1e-4  # in which a thread that waits for the model gets it
_Ask = Callable[[RayTracer, Asked, slice], None]


class ModelQueries:
    """Asks a model; `BackgroundModel.queries`. Any thread may ask, while another one updates the model.

    Methods raise NoModelError before the first frame, and ValueError, which names the argument, for arrays of another
    shape and for values that are no numbers or out of range. Integers and single precision are taken, too.
    """

    def __init__(self, pbs: ProbableBackgroundSurface, sightings: Sightings, origin: F64) -> None:
        self._pbs, self._sightings, self._origin = pbs, sightings, origin

    def cast_rays(
        self, origins: npt.ArrayLike, directions: npt.ArrayLike, far: npt.ArrayLike = math.inf, *,
        farthest: bool = False,
    ) -> Hits:  # fmt: skip
        """The nearest surface that each ray hits, or the farthest one.

        origins [n, 3]; directions [n, 3], of any length but 0; far: how far rays go, one number above 0 or [n].
        """
        rays = Rays.of(origins, directions, far)
        found, which = _found(len(rays.far)), FARTHEST if farthest else NEAREST
        frame = self._in_parts(
            len(rays.far), _RAYS,
            lambda tracer, asked, part: tracer.cast_rays(asked, rays.part(part), which, _part(found, part)),
        )  # fmt: skip
        return Hits(*found, frame)

    def are_free(self, origins: npt.ArrayLike, directions: npt.ArrayLike, far: npt.ArrayLike = math.inf) -> B1:
        """Whether rays hit nothing, [n]; faster than to ask what they hit. Rays as in `cast_rays`."""
        rays = Rays.of(origins, directions, far)
        free: U8 = np.zeros(len(rays.far), np.uint8)
        self._in_parts(
            len(rays.far), _RAYS, lambda tracer, asked, part: tracer.mark_free(asked, rays.part(part), free[part])
        )
        return free.astype(bool)

    def closest_points(self, points: npt.ArrayLike, within: npt.ArrayLike = math.inf) -> Hits:
        """The place on the model's surfaces that is nearest to each point [n, 3].

        within: only what is nearer than this counts, metres, one number above 0 or [n].
        """
        at, limits = Points.of(points, within)
        found = _found(len(at))
        frame = self._in_parts(
            len(at), _POINTS,
            lambda tracer, asked, part: tracer.find_closest(asked, at[part], limits[part], _part(found, part)),
        )  # fmt: skip
        return Hits(*found, frame)

    def overlaps(self, centres: npt.ArrayLike, radii: npt.ArrayLike, *, listed: int = 0) -> Touched:
        """The triangles that spheres touch.

        centres [n, 3]; radii: metres, above 0 and finite, one number or [n]; listed: of how many triangles of each
        sphere the corners are wanted, at most 64. A sphere's count ends at 4096 (`kernels.background.point_search`).
        """
        at, sizes, listed = Spheres.of(centres, radii, listed)
        counts: I32 = np.zeros(len(at), np.int32)
        corners: F64 = np.full((len(at), listed, 3, 3), np.nan)

        def count(tracer: RayTracer, asked: Asked, part: slice) -> None:
            triangles = np.full((len(at[part]), listed, 2), -1, np.int32)
            tracer.count_touched(asked, at[part], sizes[part], counts[part], triangles)
            _write_corners(tracer, self._origin, triangles, corners[part])

        return Touched(counts, corners, self._in_parts(len(at), _SPHERES, count))

    def _in_parts(self, count: int, size: int, ask: _Ask) -> int:
        """Asks `count` questions, `size` at a time; returns the number of the frame that the last answers are of."""
        for start in range(0, max(count, 1), size):
            with self._held(start > 0) as (tracer, asked):
                ask(tracer, asked, slice(start, min(start + size, count)))
        return asked.frame

    @contextmanager
    def _held(self, again: bool) -> Iterator[tuple[RayTracer, Asked]]:
        """The model does not change while the block runs. again: others have waited, and come first."""
        if again:
            time.sleep(_TURN_S)
        with self._pbs.lock:
            if not self._sightings.ready:
                raise NoModelError("model: there is none before the first frame: expected a source to be playing")
            table, _alive = self._sightings.table()
            yield self._pbs.tracer, Asked(self._origin, table, self._sightings.frame)


def _found(count: int) -> Found:
    points, normals = np.full((count, 3), np.nan), np.full((count, 3), np.nan, np.float32)
    return Found(np.full(count, np.inf, np.float32), points, normals, np.full(count, -1, np.int32))


def _part(found: Found, part: slice) -> Found:
    return Found(found.distances[part], found.points[part], found.normals[part], found.ages[part])


def _write_corners(tracer: RayTracer, origin: F64, triangles: I32, corners: F64) -> None:
    """Writes the corners [n, room, 3, 3] of triangles [n, room, 2] (geometry and primitive, -1: none)."""
    for geometry in np.unique(triangles[..., 0]):
        if geometry >= 0:
            which, mesh = triangles[..., 0] == geometry, tracer.surface(int(geometry)).mesh
            corners[which] = mesh.points[mesh.triangles[triangles[which][:, 1]]] + origin


