"""Solid things in a street: houses, trees, lamp posts and cars.

Each is built at the origin, in metres; `parts.placed` moves it. Integer arguments are material numbers of a `Palette`.
"""

from __future__ import annotations

from collections.abc import Sequence

from .parts import Group, box, capsule, cylinder, ellipsoid, placed
from .people import Actor, Path

__all__ = ["car", "driver", "house", "lamp_post", "tree"]

_STOREY = 3.2  # metres


def house(wall: int, windows: Sequence[int], roof: int, width: float, storeys: int, columns: int) -> Group:
    """A house 10 m deep; its front is in the y-z plane at x = 0 and looks towards x.

    Each storey has `columns` windows. The materials `windows` are used in turn.
    """
    height = _STOREY * storeys + 0.6
    parts = [box(wall, (-5, 0, height / 2), (10, width, height)), box(roof, (-4.8, 0, height), (10.4, width, 0.5))]
    pitch = width / columns
    for floor in range(storeys):
        for k in range(columns):
            pane = windows[(3 * floor + 5 * k) % len(windows)]
            centre = (0.05, pitch * (k + 0.5) - width / 2, _STOREY * floor + 1.8)
            parts.append(box(pane, centre, (0.24, 0.55 * pitch, 1.7)))
    return parts


def tree(bark: int, leaf: int, height: float) -> Group:
    """A tree with a round crown, `height` metres tall."""
    h = height
    return [
        capsule(bark, (0, 0, 0), (0, 0, 0.6 * h), 0.025 * h),
        ellipsoid(leaf, (0, 0, 0.72 * h), (0.2 * h, 0.2 * h, 0.26 * h)),
        ellipsoid(leaf, (0.1 * h, 0.12 * h, 0.58 * h), (0.16 * h, 0.15 * h, 0.14 * h)),
        ellipsoid(leaf, (-0.08 * h, -0.14 * h, 0.6 * h), (0.15 * h, 0.14 * h, 0.15 * h)),
    ]


def lamp_post(metal: int, glass: int, height: float) -> Group:
    """A lamp post whose arm reaches towards y."""
    return [
        cylinder(metal, (0, 0, 0), 0.09, height),
        cylinder(metal, (0, 0, 0), 0.16, 0.9),
        capsule(metal, (0, 0, height), (0, 1.2, height + 0.25), 0.05, (1, 0, 0)),
        ellipsoid(glass, (0, 1.3, height + 0.2), (0.14, 0.35, 0.1)),
    ]


def car(paint: int, glass: int, tyre: int) -> Group:
    """A car, 4.2 m long, that heads towards x."""
    parts = [
        box(paint, (0, 0, 0.62), (4.2, 1.74, 0.62)),
        box(glass, (-0.25, 0, 1.14), (2.1, 1.5, 0.46)),
        box(paint, (-0.3, 0, 1.4), (1.7, 1.46, 0.08)),
    ]
    return parts + [ellipsoid(tyre, (x, y, 0.33), (0.33, 0.12, 0.33)) for x in (-1.3, 1.3) for y in (-0.85, 0.85)]


def driver(group: Group, path: Path) -> Actor:
    """An actor: `group` (heading towards x) drives along `path`."""

    def moment(time: float) -> Group:
        position, heading, _ = path.at(time)
        return placed(group, (*position, 0), heading)

    return moment
