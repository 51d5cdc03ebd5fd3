"""A lounge; the cameras look along x."""

from __future__ import annotations

import math

import numpy as np

from ..kernels.synth import patterns as p
from .furniture import armchair, bookcase, column, plant, room, statue, table, vase
from .parts import Group, box, capsule, cylinder, placed, turn
from .people import Path, ball
from .scene import Scene
from .shop import Shop

__all__ = ["make"]


def make(name: str, rng: np.random.Generator) -> Scene:
    """The scene called `name`; `rng` draws its materials and its people."""
    shop = Shop(rng)
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
    groups += _furniture(shop)
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


def _furniture(shop: Shop) -> list[Group]:
    """Bookcases, armchairs, a tea table, a statue, plants, columns and a lamp."""
    groups: list[Group] = []
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
    return groups

