"""Two rooms and a doorway in the wall between them at x = 3; the cameras stand in the first and look along x."""

from __future__ import annotations

import math

import numpy as np

from .furniture import armchair, bench, bookcase, plant, room, statue
from .parts import box, placed
from .people import Path
from .scene import Scene
from .shop import Shop

__all__ = ["make"]


def make(name: str, rng: np.random.Generator) -> Scene:
    """The scene called `name`; `rng` draws its materials and its people."""
    shop = Shop(rng)
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
