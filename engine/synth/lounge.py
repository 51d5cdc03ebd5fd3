"""A room with furniture in its middle, which people walk before and behind; the cameras stand along one end of it.

Someone stands at the table for a while and leaves; an armchair is carried from one place to another, once.
"""

from __future__ import annotations

import numpy as np

from .furniture import armchair, bench, bookcase, column, plant, room, statue, table
from .parts import Group, box, placed
from .people import Actor, Path
from .scene import Scene
from .shop import Shop

__all__ = ["CARRIED_S", "LEAVES_S", "make"]

LEAVES_S = 1.0  # when those who stand begin to walk, seconds
CARRIED_S = (0.4, 1.2)  # when the armchair is carried, seconds


def make(name: str, rng: np.random.Generator) -> Scene:
    """The scene called `name`; `rng` draws its materials and its people."""
    shop = Shop(rng)
    walls = (shop.bricks, shop.plaster, shop.panels, shop.plaster)
    groups = room((-2.5, -4, 0), (8, 4, 3.2), walls, shop.parquet, shop.white)
    groups += shop.hung("+x", 8.0, (-2.9, -0.9, 1.2, 3.0), [(1.2, 0.9), (1.4, 1.2), (1.0, 1.2), (1.1, 0.9)])
    groups += shop.hung("+y", 4.0, (1.5, 3.6, 5.8), [(1.2, 0.9), (1.4, 1.1), (1.0, 1.3)])
    groups += shop.hung("-y", -4.0, (1.2, 3.2, 6.2), [(1.3, 1.0), (0.9, 1.2), (1.4, 1.0)])
    groups.append(placed(bookcase(shop.wood, shop.books(), 1.8, 2.0), (8.0, 2.0, 0), np.pi))
    groups += _middle(shop)
    actors = shop.walkers(
        [
            Path([(1.9, -2.6), (2.0, 2.8)], 1.2, 0.0),  # before the furniture
            Path([(6.0, 2.9), (5.6, -2.9)], 1.1, 0.2),  # behind it
            Path([(4.6, -3.0), (5.0, -0.9), (2.4, -1.9)], 1.0, 0.1),
            Path([(3.0, 1.5), (2.2, 3.2), (6.8, 3.2)], 1.4, LEAVES_S),  # stands at the table first
            Path([(4.6, -1.1), (6.4, -2.8), (7.2, 0.0)], 1.3, LEAVES_S),
        ]
    )
    actors.append(_carried(armchair(shop.red_cloth, shop.dark_wood), (2.7, -1.5), (3.4, 2.7)))
    lamps = [(1.0, 0.0, 3.0, 0.7, 3.0), (5.5, 0.5, 3.0, 0.7, 3.0)]
    return Scene(name, shop.palette.packed(), np.array(lamps), groups, actors)


def _middle(shop: Shop) -> list[Group]:
    """What stands in the middle of the room, with floor all around it."""
    laid = [
        *table(shop.wood, 1.8, 0.9, 0.75),
        box(shop.red_cloth, (0, 0, 0.76), (0.5, 1.2, 0.02)),
        box(shop.marble, (0, 0.4, 0.87), (0.25, 0.25, 0.2)),
        box(shop.clay, (0.1, -0.5, 0.9), (0.15, 0.15, 0.26)),
    ]
    return [
        placed(laid, (3.8, 0.2, 0)),
        placed(armchair(shop.blue_cloth, shop.wood), (4.9, 0.6, 0), np.pi),
        placed(bench(shop.wood, shop.metal, 1.5), (2.9, 0.1, 0)),
        placed(statue(shop.bronze, shop.stone, 1), (4.2, -2.3, 0), np.pi),
        placed(column(shop.marble, 3.2, 0.16), (4.4, 2.2, 0)),
        placed(plant(shop.clay, shop.leaf), (5.6, -1.7, 0)),
    ]


def _carried(group: Group, start: tuple[float, float], end: tuple[float, float]) -> Actor:
    """Furniture that is carried from one place to another, once, and stays there."""

    def at(time: float) -> Group:
        share = min(max((time - CARRIED_S[0]) / (CARRIED_S[1] - CARRIED_S[0]), 0.0), 1.0)
        x, y = (a + share * (b - a) for a, b in zip(start, end, strict=True))
        return placed(group, (x, y, 0.0), 0.6 + 2.0 * share)

    return at
