"""A studio seen from a wall of cameras at the origin that look along x; the floor is at z = -1.1."""

from __future__ import annotations

import math

import numpy as np

from .furniture import bookcase, plant, room, statue, table, vase
from .parts import box, capsule, ellipsoid, placed, turn
from .people import Actor, Path
from .scene import Scene
from .shop import Shop

__all__ = ["make"]


def make(name: str, rng: np.random.Generator) -> Scene:
    """The scene called `name`; `rng` draws its materials and its people."""
    shop = Shop(rng)
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


def _raised(actor: Actor, floor: float) -> Actor:
    return lambda time: placed(actor(time), (0.0, 0.0, floor))
