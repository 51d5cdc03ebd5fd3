"""Solid things that stand still: walls, columns, furniture, pictures and statues.

Each is built at the origin, in metres; `parts.placed` moves it. Integer arguments are material numbers of a `Palette`.
"""

from __future__ import annotations

from collections.abc import Sequence

from .parts import Group, box, capsule, cylinder, ellipsoid, turn

__all__ = ["armchair", "bench", "bookcase", "column", "picture", "plant", "room", "statue", "table", "vase"]

THICKNESS = 0.2  # of walls


def room(
    low: Sequence[float], high: Sequence[float], walls: Sequence[int], floor: int, ceiling: int
) -> list[Group]:
    """A closed room between the corners `low` and `high` [3], metres.

    `walls` are the materials of the walls at +x, -x, +y and -y, in this order.
    """
    (x0, y0, z0), (x1, y1, z1), t = low, high, THICKNESS
    size = (x1 - x0, y1 - y0, z1 - z0)
    x, y, z = (x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2
    slabs = [
        box(walls[0], (x1 + t / 2, y, z), (t, size[1] + 2 * t, size[2])),
        box(walls[1], (x0 - t / 2, y, z), (t, size[1] + 2 * t, size[2])),
        box(walls[2], (x, y1 + t / 2, z), (size[0], t, size[2])),
        box(walls[3], (x, y0 - t / 2, z), (size[0], t, size[2])),
        box(floor, (x, y, z0 - t / 2), (size[0] + 2 * t, size[1] + 2 * t, t)),
        box(ceiling, (x, y, z1 + t / 2), (size[0] + 2 * t, size[1] + 2 * t, t)),
    ]
    return [[slab] for slab in slabs]


def column(stone: int, height: float, radius: float) -> Group:
    """A round column with a square base and capital."""
    return [
        cylinder(stone, (0, 0, 0), radius, height),
        box(stone, (0, 0, 0.12), (3 * radius, 3 * radius, 0.24)),
        box(stone, (0, 0, height - 0.12), (3 * radius, 3 * radius, 0.24)),
        cylinder(stone, (0, 0, 0.24), 1.3 * radius, 0.12),
    ]


def picture(image: int, frame: int, width: float, height: float) -> Group:
    """A framed picture on a wall in the y-z plane, looking towards x; the wall's face is at x = 0."""
    return [
        box(image, (0.02, 0, 0), (0.04, width, height)),
        box(frame, (0.035, 0, height / 2 + 0.03), (0.07, width + 0.12, 0.06)),
        box(frame, (0.035, 0, -height / 2 - 0.03), (0.07, width + 0.12, 0.06)),
        box(frame, (0.035, width / 2 + 0.03, 0), (0.07, 0.06, height)),
        box(frame, (0.035, -width / 2 - 0.03, 0), (0.07, 0.06, height)),
    ]


def statue(stone: int, plinth: int, kind: int) -> Group:
    """A statue on a plinth, about 2 m tall; `kind` is 0 for a standing figure, 1 for a bust, 2 for an abstract pile."""
    if kind == 0:
        return [
            box(plinth, (0, 0, 0.3), (0.7, 0.7, 0.6)),
            ellipsoid(stone, (0, 0, 1.45), (0.16, 0.22, 0.36)),
            ellipsoid(stone, (0, 0, 1.05), (0.2, 0.24, 0.3)),
            capsule(stone, (0.05, -0.1, 0.62), (0, -0.1, 1.0), 0.1),
            capsule(stone, (-0.05, 0.12, 0.62), (0, 0.1, 1.0), 0.1),
            ellipsoid(stone, (0.02, 0, 1.98), (0.11, 0.1, 0.14)),
            capsule(stone, (0, 0, 1.75), (0, 0, 1.9), 0.06),
            capsule(stone, (0, 0.22, 1.68), (0.2, 0.42, 1.95), 0.06, (1, 0, 0)),
            capsule(stone, (0.2, 0.42, 1.95), (0.25, 0.4, 2.3), 0.05),
            capsule(stone, (0, -0.22, 1.68), (0.12, -0.34, 1.35), 0.06, (1, 0, 0)),
        ]
    if kind == 1:
        return [
            cylinder(plinth, (0, 0, 0), 0.28, 1.1),
            box(plinth, (0, 0, 1.13), (0.62, 0.62, 0.06)),
            ellipsoid(stone, (0, 0, 1.3), (0.16, 0.27, 0.2)),
            capsule(stone, (0, 0, 1.4), (0.02, 0, 1.55), 0.08),
            ellipsoid(stone, (0.03, 0, 1.7), (0.14, 0.12, 0.18)),
            ellipsoid(stone, (0.17, 0, 1.69), (0.035, 0.025, 0.04)),
        ]
    return [
        box(plinth, (0, 0, 0.25), (0.9, 0.9, 0.5)),
        box(stone, (0, 0, 0.8), (0.45, 0.45, 0.6), turn(0.4)),
        ellipsoid(stone, (0, 0, 1.35), (0.32, 0.32, 0.32)),
        box(stone, (0, 0, 1.85), (0.5, 0.16, 0.5), turn(0.3, 0.6, 0.5)),
        ellipsoid(stone, (0.05, 0.05, 2.3), (0.12, 0.12, 0.2)),
    ]


def bench(wood: int, metal: int, length: float) -> Group:
    """A bench, `length` metres along y."""
    parts = [box(wood, (x, 0, 0.45), (0.13, length, 0.05)) for x in (-0.16, 0.0, 0.16)]
    return parts + [box(metal, (0, y, 0.21), (0.4, 0.06, 0.42)) for y in (-0.4 * length, 0.4 * length)]


def table(wood: int, width: float, depth: float, height: float) -> Group:
    """A table with four legs; `width` is along y, `depth` along x."""
    parts = [box(wood, (0, 0, height - 0.025), (depth, width, 0.05))]
    parts += [
        box(
            wood,
            (x * (depth / 2 - 0.05), y * (width / 2 - 0.05), height / 2 - 0.025),
            (0.06, 0.06, height - 0.05),
        )
        for x in (-1, 1)
        for y in (-1, 1)
    ]
    return parts


def armchair(cloth: int, wood: int) -> Group:
    """An armchair facing x."""
    return [
        box(cloth, (0, 0, 0.32), (0.75, 0.7, 0.26)),
        box(cloth, (-0.33, 0, 0.65), (0.16, 0.8, 0.75), turn(0, -0.15)),
        box(wood, (0.02, 0.41, 0.42), (0.7, 0.1, 0.32)),
        box(wood, (0.02, -0.41, 0.42), (0.7, 0.1, 0.32)),
        box(wood, (0, 0, 0.1), (0.65, 0.7, 0.2)),
    ]


def bookcase(wood: int, books: Sequence[int], width: float, height: float) -> Group:
    """A bookcase with rows of books; its back is at x = 0, and it opens towards x."""
    shelves = max(2, round(height / 0.42))
    pitch = height / shelves
    parts = [box(wood, (0.02, 0, height / 2), (0.04, width, height))]
    parts += [box(wood, (0.16, y, height / 2), (0.32, 0.04, height)) for y in (-width / 2, width / 2)]
    parts += [box(wood, (0.16, 0, k * pitch + 0.02), (0.32, width, 0.04)) for k in range(shelves)]
    parts += [box(wood, (0.16, 0, height), (0.32, width + 0.04, 0.04))]
    for k in range(shelves):
        y = -width / 2 + 0.06
        while y < width / 2 - 0.2:
            step = 0.13 + 0.05 * ((7 * k + len(parts)) % 4)
            tall = pitch * (0.55 + 0.1 * ((3 * k + len(parts)) % 4))
            material = books[(5 * k + len(parts)) % len(books)]
            parts.append(
                box(material, (0.16, y + step / 2, k * pitch + 0.04 + tall / 2), (0.22, step - 0.01, tall))
            )
            y += step
    return parts


def plant(pot: int, leaf: int) -> Group:
    """A plant in a pot, 1.5 m tall."""
    parts = [cylinder(pot, (0, 0, 0), 0.22, 0.4), capsule(leaf, (0, 0, 0.4), (0, 0.03, 0.9), 0.03)]
    for k in range(9):
        r = turn(2.4 * k, -0.9 + 0.12 * k)
        parts.append(ellipsoid(leaf, (0, 0.02, 0.8 + 0.04 * k) + r @ (0.3, 0, 0), (0.3, 0.09, 0.015), r))
    return parts


def vase(clay: int, height: float) -> Group:
    """A vase, `height` metres tall."""
    return [
        ellipsoid(clay, (0, 0, 0.4 * height), (0.28 * height, 0.28 * height, 0.4 * height)),
        cylinder(clay, (0, 0, 0.7 * height), 0.12 * height, 0.25 * height),
        cylinder(clay, (0, 0, 0.93 * height), 0.18 * height, 0.05 * height),
    ]
