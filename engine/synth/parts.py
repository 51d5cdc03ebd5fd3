"""Building blocks of a scene: boxes, ellipsoids, capsules, cylinders, and groups of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..kernels.synth.patterns import MATERIAL_SIZE
from ..kernels.synth.solids import BOX, CAPSULE, CYLINDER, ELLIPSOID, GROUP_SIZE, PART_SIZE, Solids
from ..support.array_types import F64

__all__ = ["Group", "Palette", "Part", "box", "capsule", "cylinder", "ellipsoid", "pack", "placed", "turn"]

Vector = Sequence[float] | F64


@dataclass(frozen=True, slots=True)
class Part:
    """One solid: its kind (`kernels.synth.solids`), material, pose (metres, world from part) and half sizes."""

    kind: int
    material: int
    centre: F64  # [3]
    rotation: F64  # [3, 3]
    size: tuple[float, float, float]

    def radius(self) -> float:
        """Radius of a sphere around the part's centre that contains the part, metres."""
        a, b, c = self.size
        if self.kind == BOX:
            return float(np.hypot(np.hypot(a, b), c))
        if self.kind == ELLIPSOID:
            return max(self.size)
        return a + c if self.kind == CAPSULE else float(np.hypot(a, c))

    def row(self) -> F64:  # [PART_SIZE]
        """The part as the ray tracer reads it."""
        radius = self.radius() * (1 + 1e-9)  # rounding must not drop a ray that grazes the sphere
        return np.array([*self.centre, radius, self.kind, *self.rotation.ravel(), *self.size, self.material])


Group = list[Part]  # parts that lie close together: one piece of furniture, one person


class Palette:
    """Materials by number; `add` hands out the numbers. Another seed gives other pictures and other noise."""

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed
        self._rows: list[F64] = []

    def add(
        self,
        pattern: int,
        colour: Vector,
        other: Vector | None = None,
        scale: float = 0.2,
        rough: float = 0.4,
    ) -> int:
        """Add a material and return its number.

        pattern: one of `kernels.synth.patterns`. colour, other: linear RGB; by default `other` is a darker `colour`.
        scale: size of the pattern, metres. rough: contrast.
        """
        other = [0.55 * c for c in colour] if other is None else other
        self._rows.append(
            np.array([pattern, *colour, *other, scale, self._seed + 101 * len(self._rows), rough])
        )
        return len(self._rows) - 1

    def packed(self) -> F64:  # [k, MATERIAL_SIZE]
        """All materials as the ray tracer reads them."""
        return np.array(self._rows, np.float64).reshape(-1, MATERIAL_SIZE)


def turn(yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> F64:  # [3, 3]
    """The rotation matrix Rz(yaw) Ry(pitch) Rx(roll); angles in radians."""
    (cy, cp, cr), (sy, sp, sr) = np.cos([yaw, pitch, roll]), np.sin([yaw, pitch, roll])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    result: F64 = z @ y @ x
    return result


def box(material: int, centre: Vector, size: Vector, rotation: F64 | None = None) -> Part:
    """A box; `size` [3] holds its full edge lengths, metres."""
    return _solid(BOX, material, centre, tuple(0.5 * s for s in size), rotation)


def ellipsoid(material: int, centre: Vector, size: Vector, rotation: F64 | None = None) -> Part:
    """An ellipsoid; `size` [3] holds its half axes, metres."""
    return _solid(ELLIPSOID, material, centre, tuple(size), rotation)


def cylinder(material: int, base: Vector, radius: float, height: float) -> Part:
    """An upright cylinder; `base` [3] is the middle of its bottom face, metres."""
    x, y, z = base
    centre = (x, y, z + 0.5 * height)
    return _solid(CYLINDER, material, centre, (radius, radius, 0.5 * height), None)


def capsule(material: int, start: Vector, end: Vector, radius: float, side: Vector = (0.0, 1.0, 0.0)) -> Part:
    """A capsule around the segment from start to end, metres; `side` (not parallel to it) fixes its texture's turn."""
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    length = float(np.linalg.norm(b - a))
    z = (b - a) / length
    x = np.cross(np.asarray(side, np.float64), z)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z], axis=1)
    return _solid(CAPSULE, material, 0.5 * (a + b), (radius, radius, 0.5 * length), rotation)


def placed(group: Iterable[Part], position: Vector, yaw: float = 0.0) -> Group:
    """The group turned by `yaw` radians about the z axis, then moved by `position` [3], metres."""
    rotation, offset = turn(yaw), np.asarray(position, np.float64)
    return [
        Part(p.kind, p.material, rotation @ p.centre + offset, rotation @ p.rotation, p.size) for p in group
    ]


def pack(groups: Sequence[Group]) -> Solids:
    """Parts and bounding spheres of groups as the ray tracer reads them."""
    parts = [part.row() for group in groups for part in group]
    spheres, start = np.zeros((len(groups), GROUP_SIZE)), 0
    for sphere, group in zip(spheres, groups, strict=True):
        centres, radii = np.array([p.centre for p in group]), np.array([p.radius() for p in group])
        low, high = (centres - radii[:, None]).min(0), (centres + radii[:, None]).max(0)
        middle = 0.5 * (low + high)
        radius = float((np.linalg.norm(centres - middle, axis=1) + radii).max()) * (1 + 1e-9)
        sphere[:] = *middle, radius, start, start + len(group)
        start += len(group)
    return Solids(np.array(parts, np.float64).reshape(-1, PART_SIZE), spheres)


def _solid(
    kind: int, material: int, centre: Vector, size: tuple[float, ...], rotation: F64 | None
) -> Part:
    rotation = np.eye(3) if rotation is None else rotation
    a, b, c = (float(s) for s in size)
    return Part(kind, material, np.asarray(centre, np.float64), rotation, (a, b, c))
