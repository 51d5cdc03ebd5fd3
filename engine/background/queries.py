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
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..kernels.background.queried import Found
from ..kernels.background.query_rays import FARTHEST, NEAREST
from ..support.array_types import B1, F32, F64, I32, U8
from .pbs import ProbableBackgroundSurface
from .ray_tracer import Asked, Rays, RayTracer
from .sightings import Sightings

__all__ = ["LARGEST", "Hits", "ModelQueries", "NoModelError", "Touched"]

LARGEST = 1e6  # metres, of coordinates; what is farther from the origin cannot be told apart
_MOST_LISTED = 64  # triangles of a sphere
_PART = 1 << 16  # questions that are answered while the model waits
_TURN_S = 1e-4  # in which a thread that waits for the model gets it
_Ask = Callable[[RayTracer, Asked, slice], None]


class NoModelError(ValueError):
    """There is no model yet that could be asked."""


@dataclass(frozen=True, slots=True)
class Hits:
    """What was found, for each ray or point: distances float32 [n], metres (infinity: nothing); points float64 [n, 3],
    metres in the world, and unit normals float32 [n, 3] on the side that the ray or point is on (NaN: nothing).

    ages int32 [n]: how many frames ago the reference camera that the surface stems from last saw it there (0: in the
    newest frame), see `sightings`; -1: nobody knows, or nothing was found. frame: the number of frames that the model
    has taken.
    """

    distances: F32
    points: F64
    normals: F32
    ages: I32
    frame: int

    @property
    def hit(self) -> B1:  # [n]
        """Whether anything was found."""
        return np.isfinite(self.distances)


@dataclass(frozen=True, slots=True)
class Touched:
    """How many triangles each sphere touches, counts int32 [n], and the corners of the first ones, float64 [n, room, 3,
    3], metres in the world (NaN: there are no more), in no order. frame: as in `Hits`."""

    counts: I32
    corners: F64
    frame: int


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
        rays = _rays(origins, directions, far)
        found, which = _found(len(rays.far)), FARTHEST if farthest else NEAREST
        frame = self._in_parts(
            len(rays.far),
            lambda tracer, asked, part: tracer.cast_rays(asked, rays.part(part), which, _part(found, part)),
        )
        return Hits(*found, frame)

    def are_free(self, origins: npt.ArrayLike, directions: npt.ArrayLike, far: npt.ArrayLike = math.inf) -> B1:
        """Whether rays hit nothing, [n]; faster than to ask what they hit. Rays as in `cast_rays`."""
        rays = _rays(origins, directions, far)
        free: U8 = np.zeros(len(rays.far), np.uint8)
        self._in_parts(
            len(rays.far), lambda tracer, asked, part: tracer.mark_free(asked, rays.part(part), free[part])
        )
        return free.astype(bool)

    def closest_points(self, points: npt.ArrayLike, within: npt.ArrayLike = math.inf) -> Hits:
        """The place on the model's surfaces that is nearest to each point [n, 3].

        within: only what is nearer than this counts, metres, one number above 0 or [n].
        """
        at = _places("points", points)
        limits, found = _lengths("within", within, len(at), least=0.0), _found(len(at))
        frame = self._in_parts(
            len(at),
            lambda tracer, asked, part: tracer.find_closest(asked, at[part], limits[part], _part(found, part)),
        )
        return Hits(*found, frame)

    def overlaps(self, centres: npt.ArrayLike, radii: npt.ArrayLike, *, listed: int = 0) -> Touched:
        """The triangles that spheres touch.

        centres [n, 3]; radii: metres, above 0 and finite, one number or [n]; listed: of how many triangles of each
        sphere the corners are wanted, at most 64.
        """
        at = _places("centres", centres)
        sizes = _lengths("radii", radii, len(at), least=0.0, most=LARGEST)
        if not 0 <= listed <= _MOST_LISTED:
            raise ValueError(f"listed: {listed!r}: expected 0 to {_MOST_LISTED}")
        counts: I32 = np.zeros(len(at), np.int32)
        corners: F64 = np.full((len(at), listed, 3, 3), np.nan)

        def count(tracer: RayTracer, asked: Asked, part: slice) -> None:
            triangles = np.full((len(at[part]), listed, 2), -1, np.int32)
            tracer.count_touched(asked, at[part], sizes[part], counts[part], triangles)
            _write_corners(tracer, self._origin, triangles, corners[part])

        return Touched(counts, corners, self._in_parts(len(at), count))

    def _in_parts(self, count: int, ask: _Ask) -> int:
        """Asks `count` questions, a part at a time; returns the number of the frame that the last answers are of."""
        for start in range(0, max(count, 1), _PART):
            with self._held(start > 0) as (tracer, asked):
                ask(tracer, asked, slice(start, min(start + _PART, count)))
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


def _rays(origins: npt.ArrayLike, directions: npt.ArrayLike, far: npt.ArrayLike) -> Rays:
    starts, ways = _places("origins", origins), _array("directions", directions)
    if ways.shape != starts.shape:
        raise ValueError(f"directions: {list(ways.shape)}: expected {list(starts.shape)}, as many as origins")
    squares = np.einsum("ij,ij->i", ways, ways)
    bad = ~((squares > 1e-200) & (squares < 1e200))
    if bad.any():
        raise ValueError(f"directions: {_first(ways, bad)}: expected finite numbers, not all 0")
    return Rays(starts, ways, _lengths("far", far, len(starts), least=0.0))


def _array(name: str, given: npt.ArrayLike) -> F64:
    """An array [n, 3] of numbers."""
    try:
        array: F64 = np.ascontiguousarray(given, np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: {type(given).__name__}: expected numbers [n, 3]") from error
    if array.size == 0 and array.ndim == 1:
        return np.empty((0, 3))
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"{name}: {list(array.shape)}: expected [n, 3]")
    return array


def _places(name: str, given: npt.ArrayLike) -> F64:
    array = _array(name, given)
    bad: B1 = ~np.all(np.abs(array) <= LARGEST, axis=1)
    if bad.any():
        raise ValueError(f"{name}: {_first(array, bad)}: expected metres from {-LARGEST:g} to {LARGEST:g}")
    return array


def _lengths(name: str, given: npt.ArrayLike, count: int, least: float, most: float = math.inf) -> F64:
    """Lengths [n] above `least` from one number or [n]."""
    try:
        array = np.asarray(given, np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: {type(given).__name__}: expected numbers") from error
    if array.shape not in ((), (count,)):
        raise ValueError(f"{name}: {list(array.shape)}: expected one number or [{count}]")
    bad = ~((array > least) & (array <= most))
    if bad.any():
        value = float(array.reshape(-1)[np.flatnonzero(bad)[0]])
        raise ValueError(f"{name}: {value!r}: expected metres above {least:g}" + _at_most(most))
    return np.ascontiguousarray(np.broadcast_to(array, (count,)))


def _at_most(most: float) -> str:
    return f" and at most {most:g}" if math.isfinite(most) else ""


def _first(array: F64, bad: B1) -> str:
    """The first row that is bad, and which it is."""
    index = int(np.flatnonzero(bad)[0])
    return f"[{index}] = {array[index].tolist()}"
