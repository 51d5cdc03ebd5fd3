"""The scenes of the twins: furnished rooms and a street, and who moves in them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..kernels.synth import patterns as p
from ..kernels.synth.solids import END, FIRST, Solids
from ..support.array_types import F64
from .furniture import armchair, bench, bookcase, column, picture, plant, room, statue, table, vase
from .outdoors import car, driver, house, lamp_post, tree
from .parts import Group, Palette, box, capsule, cylinder, ellipsoid, pack, placed, turn
from .people import Actor, Clothes, Path, ball, carton, frog, stander, walker

__all__ = ["TWINS", "Scene", "make_scene"]


@dataclass(frozen=True, eq=False)
class Scene:
    """A static world, lit by fixed lamps, and actors that are functions of time."""

    name: str
    materials: F64  # [k, MATERIAL_SIZE]
    lamps: F64  # [l, 5]: position, strength, reach
    static: Sequence[Group]
    actors: Sequence[Actor]

    @cached_property
    def background(self) -> Solids:
        """What stands still, packed."""
        return pack(self.static)

    def packed(self, time: float) -> Solids:
        """Everything at `time` in seconds, packed: the background, then the actors."""
        parts, groups = self.background
        moving_parts, moving_groups = pack([actor(time) for actor in self.actors])
        moving_groups[:, [FIRST, END]] += len(parts)
        return Solids(np.concatenate([parts, moving_parts]), np.concatenate([groups, moving_groups]))


def make_scene(name: str, seed: int = 0) -> Scene:
    """The scene of a twin; raises ValueError for names not in TWINS."""
    if name not in TWINS:
        raise ValueError(f"twin: {name!r}: expected one of {', '.join(TWINS)}")
    return TWINS[name](name, np.random.default_rng(seed))


class _Shop:
    """Materials and clothes for one scene, drawn from a random generator."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.palette = Palette(int(rng.integers(1 << 20)))
        add = self.palette.add
        self.plaster = add(p.NOISE, (0.66, 0.61, 0.52), (0.46, 0.42, 0.37), 0.6, 0.6)
        self.bricks = add(p.BRICKS, (0.5, 0.22, 0.14), (0.55, 0.52, 0.48), 0.16, 0.5)
        self.panels = add(p.TILES, (0.2, 0.34, 0.36), (0.09, 0.15, 0.16), 0.6, 0.3)
        self.white = add(p.NOISE, (0.78, 0.78, 0.76), (0.58, 0.58, 0.57), 0.4, 0.5)
        self.coffers = add(p.TILES, (0.7, 0.69, 0.66), (0.42, 0.42, 0.42), 1.0, 0.4)
        self.parquet = add(p.PLANKS, (0.42, 0.24, 0.11), (0.1, 0.06, 0.03), 0.14, 0.4)
        self.marble = add(p.MARBLE, (0.74, 0.72, 0.69), (0.3, 0.28, 0.3), 0.35, 0.2)
        self.green_marble = add(p.MARBLE, (0.2, 0.32, 0.24), (0.62, 0.68, 0.62), 0.4, 0.3)
        self.bronze = add(p.NOISE, (0.3, 0.2, 0.09), (0.14, 0.2, 0.15), 0.12, 0.6)
        self.stone = add(p.NOISE, (0.45, 0.43, 0.4), (0.32, 0.3, 0.28), 0.15, 0.6)
        self.chess = add(p.CHECKER, (0.7, 0.68, 0.62), (0.16, 0.15, 0.16), 0.5, 0.8)
        self.wood = add(p.PLANKS, (0.36, 0.19, 0.08), (0.16, 0.08, 0.04), 0.2, 0.5)
        self.dark_wood = add(p.PLANKS, (0.16, 0.09, 0.05), (0.06, 0.04, 0.03), 0.25, 0.5)
        self.gold = add(p.NOISE, (0.62, 0.45, 0.14), (0.42, 0.28, 0.08), 0.05, 0.5)
        self.metal = add(p.NOISE, (0.3, 0.31, 0.33), (0.22, 0.23, 0.25), 0.1, 0.3)
        self.leaf = add(p.STRIPES, (0.08, 0.3, 0.07), (0.14, 0.42, 0.1), 0.03, 0.5)
        self.clay = add(p.STRIPES, (0.55, 0.25, 0.14), (0.2, 0.1, 0.08), 0.14, 0.4)
        self.red_cloth = add(p.CHECKER, (0.5, 0.06, 0.07), (0.36, 0.04, 0.06), 0.08, 0.5)
        self.blue_cloth = add(p.STRIPES, (0.08, 0.14, 0.4), (0.2, 0.28, 0.55), 0.07, 0.5)

    def image(self) -> int:
        """A new painting."""
        return self.palette.add(p.PICTURE, (0.5, 0.5, 0.5), scale=0.1, rough=0.35)

    def colour(self, low: float = 0.05, high: float = 0.6) -> list[float]:
        """A random linear RGB colour."""
        return [float(c) for c in self.rng.uniform(low, high, 3)]

    def books(self) -> list[int]:
        """Materials of a dozen books."""
        return [self.palette.add(p.STRIPES, self.colour(), self.colour(), 0.09, 0.5) for _ in range(12)]

    def clothes(self) -> Clothes:
        """Somebody's clothes, skin and hair."""
        add, rng = self.palette.add, self.rng
        tone = float(rng.uniform(0.35, 1.0))
        return Clothes(
            skin=add(p.NOISE, (0.62 * tone, 0.38 * tone, 0.27 * tone), scale=0.3, rough=0.3),
            hair=add(p.NOISE, self.colour(0.02, 0.2), scale=0.02, rough=0.9),
            top=add(
                int(rng.choice([p.STRIPES, p.CHECKER, p.NOISE])), self.colour(), self.colour(), 0.09, 0.5
            ),
            legs=add(p.NOISE, self.colour(0.03, 0.3), scale=0.08, rough=0.7),
            shoes=add(p.NOISE, self.colour(0.02, 0.15), scale=0.05, rough=0.5),
        )

    def height(self) -> float:
        """Somebody's height, metres."""
        return float(self.rng.uniform(1.6, 1.88))

    def walkers(self, paths: Sequence[Path]) -> list[Actor]:
        """Someone on each path."""
        return [walker(self.clothes(), self.height(), path) for path in paths]

    def standers(self, spots: Sequence[tuple[float, float, float]]) -> list[Actor]:
        """Someone at each (x, y, yaw)."""
        return [
            stander(self.clothes(), self.height(), (x, y), yaw, float(self.rng.uniform(0, 6)))
            for x, y, yaw in spots
        ]

    def hung(
        self, wall: str, at: float, along: Sequence[float], sizes: Sequence[tuple[float, float]]
    ) -> list[Group]:
        """Pictures in a row on the wall named by axis and side ("+x"), whose face is at coordinate `at`."""
        yaw = {"+x": math.pi, "-x": 0.0, "+y": -math.pi / 2, "-y": math.pi / 2}[wall]
        frames = [self.gold, self.dark_wood, self.metal]
        groups = []
        for k, (s, (width, height)) in enumerate(zip(along, sizes, strict=True)):
            position = (at, s, 1.75) if wall[1] == "x" else (s, at, 1.75)
            groups.append(placed(picture(self.image(), frames[k % 3], width, height), position, yaw))
        return groups


def _museum(name: str, rng: np.random.Generator) -> Scene:
    shop = _Shop(rng)
    sizes = [(1.5, 1.1), (1.0, 1.4), (1.9, 1.2), (0.9, 0.9), (1.4, 1.6)]
    groups = room(
        (-8, -6, 0),
        (8, 6, 4.6),
        (shop.plaster, shop.bricks, shop.panels, shop.plaster),
        shop.chess,
        shop.coffers,
    )
    groups += shop.hung("+x", 8, (-4.5, -1.8, 1.0, 4.2), sizes[:4])
    groups += shop.hung("-x", -8, (-4.0, -1.0, 1.8, 4.4), sizes[1:])
    groups += shop.hung("+y", 6, (-6.4, -3.6, -0.6, 2.2, 5.2), sizes)
    groups += shop.hung("-y", -6, (-6.0, -3.1, 0.2, 3.0, 6.0), sizes[::-1])
    groups += [placed(column(shop.marble, 4.6, 0.24), (x, y, 0)) for x in (-5.2, 5.2) for y in (-3.4, 3.4)]
    # Free-standing walls with a picture on both sides.
    for x, y, yaw in ((3.6, 4.3, 0.3), (-3.4, -4.2, 0.4), (-4.6, 3.9, -0.9)):
        wall = [box(shop.white, (0, 0, 1.35), (0.18, 2.0, 2.7))]
        for side in (0.0, math.pi):
            turned = placed(picture(shop.image(), shop.gold, 1.3, 1.0), (0.09 * math.cos(side), 0, 1.6), side)
            wall += turned
        groups.append(placed(wall, (x, y, 0), yaw))
    stones = [shop.marble, shop.bronze, shop.green_marble]
    spots = [
        (3.4, 0.4, 0),
        (-2.8, 2.4, 1),
        (0.8, -3.6, 2),
        (-5.6, -0.6, 0),
        (6.3, -2.2, 1),
        (0.4, 4.9, 2),
        (5.6, 1.9, 1),
    ]
    for k, (x, y, kind) in enumerate(spots):
        facing = math.atan2(-y, -x)
        groups.append(placed(statue(stones[k % 3], shop.stone, kind), (x, y, 0), facing))
    groups += [
        placed(bench(shop.wood, shop.metal, 1.8), (x, y, 0), yaw)
        for x, y, yaw in ((3.3, -1.9, 0.8), (-2.9, -1.0, 0.916), (0.6, 2.9, 1.5))
    ]
    groups += [
        placed(plant(shop.clay, shop.leaf), (x, y, 0))
        for x, y in ((7.2, 5.2), (-7.2, 5.1), (-7.1, -5.2), (7.2, -5.2))
    ]
    glass_case = [
        *table(shop.dark_wood, 1.4, 0.7, 0.9),
        box(shop.red_cloth, (0, 0, 0.93), (0.6, 1.2, 0.04)),
        *placed(vase(shop.clay, 0.5), (0, 0.3, 0.95)),
        *placed(vase(shop.green_marble, 0.35), (0, -0.3, 0.95)),
    ]
    groups.append(placed(glass_case, (-0.4, -5.0, 0), 1.57))
    groups.append(placed(glass_case, (4.6, -4.6, 0), 0.6))
    actors = shop.standers(
        [
            (2.5, 1.9, -2.2),
            (-1.9, 0.4, 0.2),
            (4.5, -1.0, 2.6),
            (-3.9, -2.2, 0.6),
            (-1.2, 5.0, -1.2),
            (1.6, -4.4, 1.2),
        ]
    )
    actors += shop.walkers(
        [
            Path([(1.9, -1.4), (2.0, 1.0), (1.2, 2.3), (-1.2, 2.4)], 1.2, 0.2),
            Path([(-1.3, -2.9), (-1.6, -1.1), (-4.2, 0.9), (-3.6, 2.9)], 1.0, 0.4),
            Path([(3.2, -3.3), (0.4, -2.4), (-0.9, -3.9), (-5.0, -2.6)], 1.4, 0.0),
        ]
    )
    ware = shop.palette.add(p.PICTURE, (0.5, 0.5, 0.5), rough=0.3)
    actors.append(carton(ware, 0.7, Path([(4.4, 2.8), (2.2, 3.4), (-2.2, 4.0)], 0.8, 0.5)))
    lamps = [(-4, 0, 4.2, 0.55, 4.0), (4, 0, 4.2, 0.55, 4.0), (0, 4, 4.2, 0.3, 3.0), (0, -4, 4.2, 0.3, 3.0)]
    return Scene(name, shop.palette.packed(), np.array(lamps), groups, actors)


def _hijack(name: str, rng: np.random.Generator) -> Scene:
    """A lounge; the cameras look along x."""
    shop = _Shop(rng)
    groups = room(
        (-2.5, -4.2, 0),
        (7.5, 4.2, 3.2),
        (shop.bricks, shop.plaster, shop.panels, shop.plaster),
        shop.parquet,
        shop.white,
    )
    carpet = shop.palette.add(p.PICTURE, (0.5, 0.5, 0.5), rough=0.6)
    groups.append([box(carpet, (3.0, 0, 0.01), (3.2, 3.0, 0.02))])
    groups += shop.hung("+x", 7.5, (-3.0, -0.6, 3.0), [(1.2, 0.9), (1.8, 1.2), (0.9, 1.3)])
    groups += shop.hung("+y", 4.2, (0.4, 2.6, 5.8), [(1.2, 0.9), (1.6, 1.2), (0.9, 1.3)])
    groups += shop.hung("-y", -4.2, (-0.6, 1.4), [(1.0, 1.2), (1.5, 1.0)])
    books = shop.books()
    groups.append(placed(bookcase(shop.dark_wood, books, 2.4, 2.2), (4.6, -4.2, 0), math.pi / 2))
    groups.append(placed(bookcase(shop.wood, books, 1.6, 1.7), (7.5, 1.3, 0), math.pi))
    groups += [
        placed(armchair(cloth, shop.dark_wood), (x, y, 0), yaw)
        for cloth, x, y, yaw in (
            (shop.red_cloth, 4.4, 1.9, -2.4),
            (shop.blue_cloth, 4.1, -1.7, 2.7),
            (shop.red_cloth, 1.4, -2.9, 1.4),
        )
    ]
    tea = [
        *table(shop.wood, 1.2, 0.7, 0.5),
        *placed(vase(shop.clay, 0.4), (0, 0.3, 0.5)),
        box(books[0], (0.1, -0.2, 0.52), (0.2, 0.28, 0.04)),
        box(books[1], (0.1, -0.2, 0.56), (0.18, 0.24, 0.04), turn(0.3)),
    ]
    groups.append(placed(tea, (3.1, 0.3, 0), 0.2))
    groups.append(placed(statue(shop.bronze, shop.stone, 1), (6.6, -2.9, 0), 2.7))
    groups += [
        placed(plant(shop.clay, shop.leaf), (6.9, 3.6, 0)),
        placed(plant(shop.clay, shop.leaf), (0.3, -3.6, 0)),
    ]
    groups += [placed(column(shop.marble, 3.2, 0.16), (5.9, y, 0)) for y in (-0.9, 2.4)]
    lamp = [
        cylinder(shop.metal, (0, 0, 0), 0.2, 0.04),
        capsule(shop.metal, (0, 0, 0.04), (0, 0, 1.6), 0.02),
        cylinder(shop.gold, (0, 0, 1.5), 0.24, 0.3),
    ]
    groups.append(placed(lamp, (5.4, 3.8, 0)))
    actors = shop.standers([(3.2, 2.2, -2.4), (2.6, -2.4, 1.9), (6.3, 0.4, 3.0)])
    actors += shop.walkers(
        [
            Path([(2.2, -1.3), (2.0, 1.6), (1.2, 2.9)], 1.1, 0.3),
            Path([(5.2, 0.4), (5.1, -2.6), (3.4, -3.0)], 1.0, 0.2),
            Path([(3.6, 3.3), (1.6, 3.4), (6.2, 3.1)], 1.3, 0.8),
        ]
    )
    toy = shop.palette.add(p.CHECKER, (0.7, 0.2, 0.05), (0.75, 0.75, 0.7), 0.12, 0.3)
    actors.append(ball(toy, 0.16, Path([(1.6, -1.9), (3.9, -0.9), (3.9, 1.2)], 0.9, 0.1)))
    lamps = [(1.0, 0, 2.9, 0.7, 3.0), (5.0, 1.5, 2.9, 0.55, 3.0), (5.0, -2.0, 2.9, 0.4, 3.0)]
    return Scene(name, shop.palette.packed(), np.array(lamps), groups, actors)


def _painter(name: str, rng: np.random.Generator) -> Scene:
    """A studio seen from a wall of cameras at the origin that look along x; the floor is at z = -1.1."""
    shop = _Shop(rng)
    floor = -1.1
    groups = room(
        (-0.8, -2.6, floor),
        (5.2, 2.6, 1.9),
        (shop.bricks, shop.plaster, shop.plaster, shop.panels),
        shop.parquet,
        shop.white,
    )
    items = shop.hung("+x", 5.2, (-1.9, 0.3, 1.5), [(0.8, 1.0), (0.7, 0.9), (1.0, 0.8)])
    canvas = [
        box(shop.image(), (0, 0, 0.25), (0.04, 0.8, 1.0), turn(0, -0.12)),
        capsule(shop.wood, (0.05, -0.3, -1.1), (0.0, -0.05, 0.9), 0.02),
        capsule(shop.wood, (0.05, 0.3, -1.1), (0.0, 0.05, 0.9), 0.02),
        box(shop.wood, (-0.05, 0, -0.29), (0.1, 0.9, 0.04)),
    ]
    groups.append(placed(canvas, (2.9, 0.62, 0), 0.35))
    desk = [
        *table(shop.wood, 1.0, 0.5, 0.7),
        *placed(vase(shop.clay, 0.35), (0, 0.2, 0.7)),
        *placed(vase(shop.green_marble, 0.25), (-0.05, -0.1, 0.7)),
        ellipsoid(shop.gold, (0, -0.35, 0.77), (0.07, 0.07, 0.07)),
    ]
    items.append(placed(desk, (2.6, -0.75, 0)))
    items.append(placed(bookcase(shop.dark_wood, shop.books(), 1.2, 1.6), (5.2, -0.75, 0), math.pi))
    items.append(placed(statue(shop.marble, shop.stone, 1), (4.5, 0.9, 0), 3.0))
    items.append(placed(plant(shop.clay, shop.leaf), (4.4, -1.7, 0)))
    actors = shop.walkers(
        [Path([(3.4, 0.5), (3.3, -1.2)], 0.7, 0.3), Path([(4.1, -1.3), (4.05, 0.7)], 1.0, 0.6)]
    )
    actors += shop.standers([(3.9, 1.5, -2.8)])
    groups += [placed(item, (0, 0, floor)) for item in items]
    raised = [_raised(actor, floor) for actor in actors]
    lamps = [(1.0, 1.5, 1.7, 0.7, 2.5), (3.5, -1.5, 1.7, 0.7, 2.5)]
    return Scene(name, shop.palette.packed(), np.array(lamps), groups, raised)


def _frog(name: str, rng: np.random.Generator) -> Scene:
    """A table top seen from a row of cameras at the origin that look along x."""
    shop = _Shop(rng)
    add, top = shop.palette.add, -0.24
    wall = add(p.BRICKS, (0.52, 0.45, 0.36), (0.3, 0.26, 0.22), 0.05, 0.5)
    cloth = add(p.CHECKER, (0.55, 0.5, 0.42), (0.3, 0.12, 0.12), 0.05, 0.5)
    groups = room(
        (-0.6, -1.5, top), (1.42, 1.5, 1.2), (wall, shop.plaster, shop.panels, shop.panels), cloth, shop.white
    )
    for y, z, width in ((-0.62, 0.12, 0.3), (-0.15, 0.2, 0.4), (0.35, 0.1, 0.3), (0.75, 0.2, 0.34)):
        groups.append([box(shop.image(), (1.41, y, z), (0.02, width, 0.26))])
    toys = [
        [box(shop.books()[0], (1.2, -0.55, top + 0.1), (0.2, 0.12, 0.2), turn(0.4))],
        placed(vase(shop.clay, 0.3), (1.25, 0.5, top)),
        placed(vase(shop.green_marble, 0.22), (1.05, -0.28, top)),
        [
            cylinder(shop.gold, (1.1, 0.22, top), 0.06, 0.12),
            ellipsoid(shop.red_cloth, (1.1, 0.22, top + 0.17), (0.05,) * 3),
        ],
        [
            box(shop.wood, (1.3, -0.05, top + 0.06), (0.16, 0.3, 0.12), turn(-0.2)),
            box(shop.blue_cloth, (1.3, -0.05, top + 0.15), (0.12, 0.2, 0.06), turn(0.1)),
        ],
        [box(shop.chess, (0.75, 0.36, top + 0.04), (0.12, 0.12, 0.08), turn(0.5))],
    ]
    groups += toys
    green = add(p.NOISE, (0.1, 0.42, 0.08), (0.2, 0.6, 0.12), 0.04, 0.6)
    belly = add(p.NOISE, (0.6, 0.65, 0.3), (0.5, 0.6, 0.22), 0.03, 0.4)
    eye, pupil = (
        add(p.NOISE, (0.9, 0.9, 0.85), scale=0.01, rough=0.1),
        add(p.NOISE, (0.03, 0.03, 0.03), scale=0.01),
    )
    sleeve = add(p.STRIPES, (0.5, 0.1, 0.12), (0.7, 0.65, 0.6), 0.03, 0.4)
    skin = add(p.NOISE, (0.6, 0.38, 0.28), scale=0.1, rough=0.3)
    marble = add(p.CHECKER, (0.1, 0.2, 0.6), (0.8, 0.7, 0.2), 0.025, 0.3)
    actors = [
        frog(
            green,
            belly,
            eye,
            pupil,
            sleeve,
            skin,
            Path([(0.85, 0.14), (0.8, -0.3), (0.95, 0.32)], 0.22, 0.1),
            top,
        ),
        ball(marble, 0.035, Path([(0.62, -0.2), (0.66, 0.2)], 0.25, 0.0), floor=top),
    ]
    lamps = [(0.3, 0.6, 0.9, 0.8, 1.0), (0.8, -0.8, 0.9, 0.5, 1.0)]
    return Scene(name, shop.palette.packed(), np.array(lamps), groups, actors)


def _gymnasium(name: str, rng: np.random.Generator) -> Scene:
    shop = _Shop(rng)
    add = shop.palette.add
    boards = add(p.PLANKS, (0.5, 0.31, 0.15), (0.2, 0.12, 0.06), 0.12, 0.35)
    blocks = add(p.BRICKS, (0.5, 0.5, 0.48), (0.36, 0.36, 0.36), 0.24, 0.4)
    groups = room(
        (-11, -7, 0), (11, 7, 7.5), (blocks, shop.bricks, shop.panels, blocks), boards, shop.coffers
    )
    paint = add(p.NOISE, (0.65, 0.65, 0.62), (0.5, 0.5, 0.5), 0.1, 0.4)
    lines = [box(paint, (x, 0, 0.004), (0.08, 11, 0.008)) for x in (-9.0, 0.0, 9.0)]
    lines += [box(paint, (0, y, 0.004), (18, 0.08, 0.008)) for y in (-5.5, 5.5)]
    groups += [[line] for line in lines]
    groups += shop.hung("+x", 11, (-5, 5), [(2.4, 1.6), (2.0, 1.5)]) + shop.hung(
        "-x", -11, (-5, 5), [(2.0, 1.5), (2.4, 1.6)]
    )
    groups += shop.hung("+y", 7, (-7, -2, 4), [(2.4, 1.4), (1.6, 1.6), (2.6, 1.4)])
    groups += shop.hung("-y", -7, (-6, 1, 7), [(2.4, 1.4), (1.6, 1.6), (2.6, 1.4)])
    mat = add(p.TILES, (0.1, 0.2, 0.5), (0.05, 0.08, 0.2), 0.4, 0.4)
    for x, sign in ((10.4, -1.0), (-10.4, 1.0)):  # baskets
        groups.append(
            [
                box(shop.image(), (x, 0, 3.3), (0.06, 1.8, 1.1)),
                capsule(shop.metal, (x - 0.45 * sign, 0, 0), (x, 0, 3.0), 0.08),
                cylinder(shop.red_cloth, (x + 0.45 * sign, 0, 2.9), 0.23, 0.06),
            ]
        )
    vault = [box(shop.wood, (0, 0, 0.2 + 0.25 * k), (0.6 - 0.06 * k, 1.6 - 0.08 * k, 0.24)) for k in range(4)]
    vault.append(box(shop.red_cloth, (0, 0, 1.13), (0.4, 1.3, 0.16)))
    groups += [placed(vault, (4.9, -1.3, 0), 0.6), placed(vault, (-5.4, 3.2, 0), -0.5)]
    groups += [
        [box(mat, (x, y, 0.15), (2.0, 1.2, 0.3), turn(yaw))]
        for x, y, yaw in ((-0.3, 5.2, 0.2), (-3.6, -5.4, -0.1), (6.6, 3.4, 1.0))
    ]
    groups += [
        placed(bench(shop.wood, shop.metal, 3.0), (x, y, 0), math.pi / 2)
        for x in (-6, 0, 6)
        for y in (-6.5, 6.5)
    ]
    bars = [cylinder(shop.metal, (x, y, 0), 0.05, 1.5) for x in (-0.8, 0.8) for y in (-0.5, 0.5)]
    bars += [capsule(shop.wood, (-1.2, y, 1.5), (1.2, y, 1.5), 0.04) for y in (-0.5, 0.5)]
    groups += [placed(bars, (-2.6, 3.6, 0), 0.3), placed(bars, (7.0, -3.9, 0), 1.2)]
    groups += [placed(column(shop.stone, 7.5, 0.22), (x, y, 0)) for x in (-10.3, 10.3) for y in (-6.3, 6.3)]
    runner_speed = 5.5 if name == "gymnasium-b" else 2.6
    actors = shop.walkers(
        [
            Path(
                [(3.0, 1.6), (-2.0, 2.4), (-4.2, 0.0), (-2.0, -2.2), (3.0, -1.6), (8.0, 0.5)],
                runner_speed,
                0.1,
            ),
            Path([(2.6, -2.2), (5.5, 1.2), (1.2, 4.9)], 2.2, 0.2),
            Path([(-3.4, 1.2), (-6.4, -2.5), (-1.6, -4.6)], 1.9, 0.3),
            Path([(-1.0, -2.4), (3.4, -4.6), (6.4, -1.4)], 1.4, 0.2),
        ]
    )
    actors += shop.standers(
        [(4.6, 3.0, -2.5), (-7.6, 0.4, 0.2), (1.4, -5.2, 1.4), (0.3, 3.4, -1.2), (7.4, -0.9, 3.0)]
    )
    toy = add(p.STRIPES, (0.75, 0.3, 0.06), (0.12, 0.08, 0.06), 0.11, 0.4)
    actors.append(ball(toy, 0.13, Path([(2.2, 0.6), (1.6, -2.8), (-2.6, -1.2)], 2.5, 0.2), bounce=0.9))
    lamps = [(x, y, 7.0, 0.42, 5.0) for x in (-6, 6) for y in (-3.5, 3.5)]
    return Scene(name, shop.palette.packed(), np.array(lamps), groups, actors)


def _doorway(name: str, rng: np.random.Generator) -> Scene:
    """Two rooms and a doorway in the wall between them at x = 3; the cameras stand in the first and look along x."""
    shop = _Shop(rng)
    walls = (shop.bricks, shop.plaster, shop.panels, shop.plaster)
    groups = room((-3, -3.6, 0), (9, 3.6, 3), walls, shop.parquet, shop.white)
    low, high, top = 0.0, 1.2, 2.2  # sides of the doorway, and its height
    for left, right, bottom in ((-3.6, low, 0.0), (high, 3.6, 0.0), (low, high, top)):
        size = (0.2, right - left, 3.0 - bottom)
        groups.append([box(shop.plaster, (3.1, 0.5 * (left + right), 0.5 * (bottom + 3.0)), size)])
    groups.append([box(shop.dark_wood, (3.1, y, 0.5 * top), (0.26, 0.08, top)) for y in (low, high)])
    groups += shop.hung("+x", 3.0, (-2.5, -1.0, 2.4), [(1.2, 0.9), (0.8, 1.1), (1.3, 1.0)])
    groups += shop.hung("-x", 3.2, (-1.8, 2.5), [(1.4, 1.0), (1.0, 1.2)])
    groups += shop.hung("+x", 9.0, (-2.2, 0.4, 2.6), [(1.6, 1.1), (1.4, 1.4), (1.1, 0.9)])
    groups += shop.hung("-y", -3.6, (-0.6, 1.4, 5.0, 7.2), [(1.0, 1.2), (1.2, 0.9), (1.5, 1.0), (0.9, 1.2)])
    groups += shop.hung("+y", 3.6, (0.2, 2.0, 5.6), [(1.2, 0.9), (0.8, 1.1), (1.6, 1.1)])
    groups.append(placed(bookcase(shop.wood, shop.books(), 1.4, 1.9), (7.6, 3.6, 0), -math.pi / 2))
    groups.append(placed(statue(shop.marble, shop.stone, 0), (6.8, 1.6, 0), 3.0))
    groups.append(placed(armchair(shop.red_cloth, shop.dark_wood), (6.4, -1.8, 0), 2.6))
    groups.append(placed(bench(shop.wood, shop.metal, 1.6), (2.5, -1.9, 0), 0.0))
    groups.append(placed(plant(shop.clay, shop.leaf), (2.5, 3.0, 0)))
    actors = shop.walkers(
        [
            Path([(1.2, -0.9), (2.2, 0.6), (4.6, 0.6), (5.8, -0.8)], 1.1, 0.1),  # through the doorway
            Path([(7.2, 2.4), (5.2, 0.8), (2.0, 0.5), (1.4, 1.8)], 1.3, 0.2),
            Path([(1.9, -2.6), (1.7, -0.4), (2.1, 2.6)], 0.9, 0.0),  # along the wall
            Path([(4.4, -2.4), (4.8, 2.6)], 1.0, 0.3),
        ]
    )
    actors += shop.standers([(2.2, 1.7, 2.8), (7.6, -0.3, 3.0)])
    lamps = [(0.5, 0.0, 2.8, 0.7, 3.0), (6.0, 0.5, 2.8, 0.7, 3.0)]
    return Scene(name, shop.palette.packed(), np.array(lamps), groups, actors)


def _street(name: str, rng: np.random.Generator) -> Scene:
    """A street along x with hills at its end, 320 m away; the cameras stand across its middle."""
    shop = _Shop(rng)
    add = shop.palette.add
    sky = add(p.NOISE, (0.5, 0.66, 0.9), (0.85, 0.87, 0.9), 60.0, 0.1)
    asphalt = add(p.NOISE, (0.16, 0.16, 0.17), (0.26, 0.25, 0.24), 0.8, 0.6)
    paving = add(p.TILES, (0.42, 0.4, 0.37), (0.2, 0.19, 0.18), 0.6, 0.5)
    paint = add(p.NOISE, (0.7, 0.7, 0.68), (0.55, 0.55, 0.54), 0.2, 0.4)
    grass = add(p.NOISE, (0.14, 0.3, 0.08), (0.26, 0.4, 0.14), 12.0, 0.6)
    crown = add(p.NOISE, (0.07, 0.22, 0.05), (0.2, 0.38, 0.1), 0.5, 0.7)
    glass = add(p.NOISE, (0.1, 0.13, 0.17), (0.2, 0.24, 0.28), 1.0, 0.3)
    tyre = add(p.NOISE, (0.03, 0.03, 0.03), scale=0.05)
    groups = room((-40, -200, 0), (320, 200, 160), (sky, sky, sky, sky), asphalt, sky)
    for y, width in ((6.5, 5.0), (-7.5, 5.0)):
        groups += [[box(paving, (x, y, 0.06), (60, width, 0.12))] for x in range(0, 300, 60)]
    groups += [[box(paint, (x, -0.5, 0.005), (3.0, 0.15, 0.01))] for x in range(6, 150, 8)]
    groups += [
        [ellipsoid(grass, (x, y, -30.0), (radius, 2.2 * radius, height + 30.0))]
        for x, y, radius, height in ((300, -90, 55, 38), (310, 70, 60, 52), (280, 10, 34, 10))
    ]
    walls = [add(p.BRICKS, shop.colour(0.2, 0.6), shop.colour(0.3, 0.6), 0.3, 0.5) for _ in range(5)]
    panes = [glass, *(add(p.CHECKER, shop.colour(0.05, 0.3), shop.colour(0.2, 0.5), 0.4, 0.4) for _ in range(3))]
    for side, front, yaw in ((1.0, 9.0, -math.pi / 2), (-1.0, -10.0, math.pi / 2)):
        x = -12.0
        for k in range(14):
            width = 10.0 + 2.0 * ((3 * k + (side > 0)) % 4)
            if k % 5 != 3:  # side streets
                columns, storeys = (4 if k < 7 else 2), 3 + (5 * k + (side > 0)) % 3
                front_k = (x + width / 2, front + side * (k % 3) * 0.8, 0)
                groups.append(placed(house(walls[k % 5], panes, shop.clay, width, storeys, columns), front_k, yaw))
            x += width + 0.5
    groups.append([box(shop.stone, (225, 24, 22), (9, 9, 44)), cylinder(shop.bronze, (225, 24, 44), 3.0, 9.0)])
    for x, y, height in (
        (9, 6.8, 6.0), (21, 7.2, 7.0), (36, 6.9, 6.5), (58, 7.0, 8.0), (88, 7.1, 7.5), (14, -7.6, 6.6), (27, -7.2, 7.2),
        (47, -7.5, 6.1), (75, -7.4, 8.2), (120, -7.3, 8.0),
    ):  # fmt: skip
        groups.append(placed(tree(shop.wood, crown, height), (x, y, 0), 0.7 * x))
    for x in (7, 24, 41, 66, 100, 140):
        groups.append(placed(lamp_post(shop.metal, paint, 5.6), (x, -5.2, 0)))
        groups.append(placed(lamp_post(shop.metal, paint, 5.6), (x + 6, 4.2, 0), math.pi))
    groups += [[cylinder(shop.metal, (5.0 + 1.5 * k, 4.3, 0), 0.07, 1.0)] for k in range(6)]
    groups.append(placed(bench(shop.wood, shop.metal, 1.8), (12.0, 7.6, 0.12), math.pi / 2))
    groups += [placed(plant(shop.clay, shop.leaf), (x, 7.9, 0.12)) for x in (6.5, 15.5)]
    colours = [add(p.NOISE, shop.colour(0.05, 0.5), scale=1.0, rough=0.2) for _ in range(7)]
    for k, x in enumerate((11.0, 17.5, 29.0, 52.0, 70.0)):
        groups.append(placed(car(colours[k], glass, tyre), (x, -4.0, 0), 0.04))
    actors = shop.walkers(
        [
            Path([(5.5, 4.9), (6.5, -4.4)], 1.5, 0.1),  # across the street
            Path([(7.5, -2.6), (9.0, 5.6)], 1.3, 0.0),
            Path([(4.8, 1.6), (14.0, 5.6), (30.0, 5.6)], 1.4, 0.0),
            Path([(17.0, -6.4), (9.0, -6.2), (8.0, -6.8)], 1.4, 0.2),
            Path([(14.0, 5.4), (20.0, -6.0)], 1.2, 0.0),
        ]
    )
    actors += shop.standers([(10.5, 2.2, 2.9), (13.0, -1.6, -2.6)])
    actors.append(driver(car(colours[5], glass, tyre), Path([(16.0, -2.0), (120.0, -2.2)], 9.0, 0.0)))
    actors.append(driver(car(colours[6], glass, tyre), Path([(50.0, 1.4), (11.0, 1.6)], 8.0, 0.2)))
    sun = [(-250.0, -300.0, 500.0, 1.0, 2000.0), (200.0, 100.0, 150.0, 0.25, 600.0)]
    return Scene(name, shop.palette.packed(), np.array(sun), groups, actors)


def _raised(actor: Actor, floor: float) -> Actor:
    return lambda time: placed(actor(time), (0.0, 0.0, floor))


TWINS: dict[str, Callable[[str, np.random.Generator], Scene]] = {
    "museum": _museum,
    "hijack": _hijack,
    "painter": _painter,
    "frog": _frog,
    "gymnasium-a": _gymnasium,
    "gymnasium-b": _gymnasium,
    "doorway": _doorway,
    "street": _street,
}
