"""Questions about the background model and their answers, as arrays.

Places and lengths are metres in the world. This module loads no compiler: a program may check a question, and read an
answer, that another process answers.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ..support.array_types import B1, F32, F64, I32

__all__ = ["LARGEST", "MOST_LISTED", "Hits", "NoModelError", "Points", "Rays", "Spheres", "Touched"]

LARGEST = 1e6  # metres, of coordinates; what is farther from the origin cannot be told apart
MOST_LISTED = 64  # triangles of a sphere


class NoModelError(ValueError):
    """There is no model yet that could be asked."""


@dataclass(frozen=True, slots=True)
class Hits:
    """What was found, for each ray or point: distances float32 [n], metres (infinity: nothing); points float64 [n, 3],
    metres in the world, and unit normals float32 [n, 3] on the side that the ray or point is on (NaN: nothing).

    ages int32 [n]: how many frames ago the reference camera that the surface stems from last saw it there (0: in the
    newest frame; in a rig of more than six, the true number may be a few frames lower), see `background.sightings`; -1:
    nobody knows, or nothing was found. Of a camera that has moved, at most that many: since it saw the surface from
    where it was then. frame: the number of frames that the model has taken.
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


class Rays(NamedTuple):
    """Rays: origins float64 [n, 3]; directions float64 [n, 3], of any length; far float64 [n], how far they go."""

    origins: F64
    directions: F64
    far: F64

    @classmethod
    def of(cls, origins: npt.ArrayLike, directions: npt.ArrayLike, far: npt.ArrayLike = math.inf) -> Rays:
        """Checked rays. far: one number above 0 or [n]. Raises ValueError, which names the argument, for arrays of
        another shape, coordinates that are not finite or above LARGEST, and directions without a length."""
        starts, ways = _places("origins", origins), _array("directions", directions)
        if ways.shape != starts.shape:
            raise ValueError(f"directions: {list(ways.shape)}: expected {list(starts.shape)}, as many as origins")
        squares = np.einsum("ij,ij->i", ways, ways)
        bad = ~((squares > 1e-200) & (squares < 1e200))
        if bad.any():
            raise ValueError(f"directions: {_first(ways, bad)}: expected finite numbers, not all 0")
        return cls(starts, ways, _lengths("far", far, len(starts)))

    def part(self, which: slice) -> Rays:
        """Some of them."""
        return Rays(self.origins[which], self.directions[which], self.far[which])


class Points(NamedTuple):
    """Points: places float64 [n, 3]; within float64 [n]: only what is nearer than this counts."""

    places: F64
    within: F64

    @classmethod
    def of(cls, points: npt.ArrayLike, within: npt.ArrayLike = math.inf) -> Points:
        """Checked points. within: one number above 0 or [n]. Raises ValueError as `Rays.of` does."""
        places = _places("points", points)
        return cls(places, _lengths("within", within, len(places)))


class Spheres(NamedTuple):
    """Spheres: centres float64 [n, 3]; radii float64 [n]; listed: of how many triangles of each the corners are wanted.
    """

    centres: F64
    radii: F64
    listed: int

    @classmethod
    def of(cls, centres: npt.ArrayLike, radii: npt.ArrayLike, listed: int = 0) -> Spheres:
        """Checked spheres. radii: one number above 0 and finite, or [n]; listed: at most MOST_LISTED. Raises ValueError
        as `Rays.of` does."""
        places = _places("centres", centres)
        if isinstance(listed, bool) or not isinstance(listed, int) or not 0 <= listed <= MOST_LISTED:
            raise ValueError(f"listed: {listed!r}: expected an integer from 0 to {MOST_LISTED}")
        return cls(places, _lengths("radii", radii, len(places), LARGEST), listed)


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


def _lengths(name: str, given: npt.ArrayLike, count: int, most: float = math.inf) -> F64:
    """Lengths [n] above 0 from one number or [n]."""
    try:
        array = np.asarray(given, np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: {type(given).__name__}: expected numbers") from error
    if array.shape not in ((), (count,)):
        raise ValueError(f"{name}: {list(array.shape)}: expected one number or [{count}]")
    bad = ~((array > 0.0) & (array <= most))
    if bad.any():
        value = float(array.reshape(-1)[np.flatnonzero(bad)[0]])
        raise ValueError(f"{name}: {value!r}: expected metres above 0" + _at_most(most))
    return np.ascontiguousarray(np.broadcast_to(array, (count,)))


def _at_most(most: float) -> str:
    return f" and at most {most:g}" if math.isfinite(most) else ""


def _first(array: F64, bad: B1) -> str:
    """The first row that is bad, and which it is."""
    index = int(np.flatnonzero(bad)[0])
    return f"[{index}] = {array[index].tolist()}"
