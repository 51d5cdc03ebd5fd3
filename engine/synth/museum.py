"""A hall of paintings and statues; the cameras stand in its middle."""

from __future__ import annotations

import math

import numpy as np

from ..kernels.synth import patterns as p
from .furniture import bench, column, picture, plant, room, statue, table, vase
from .lamps import Dimming, Fade
from .parts import Group, box, placed
from .people import Actor, Path, carton
from .scene import Scene
from .shop import Shop

__all__ = ["make"]

# The lamp at one end goes out, but for a glow; then the one at the other end gets warmer.
_DIMMING = Dimming(4, (Fade(0, 2.0, 3.0, (0.1, 0.1, 0.1)), Fade(1, 3.0, 2.0, (1.0, 0.7, 0.3))))


def make(name: str, rng: np.random.Generator) -> Scene:
    """The scene called `name`: in museum-lamps the light changes. `rng` draws its materials and its people."""
    shop = Shop(rng)
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
    groups += _exhibits(shop)
    actors = _visitors(shop)
    lamps = [(-4, 0, 4.2, 0.55, 4.0), (4, 0, 4.2, 0.55, 4.0), (0, 4, 4.2, 0.3, 3.0), (0, -4, 4.2, 0.3, 3.0)]
    dimming = _DIMMING if name == "museum-lamps" else None
    return Scene(name, shop.palette.packed(), np.array(lamps), groups, actors, dimming)


def _exhibits(shop: Shop) -> list[Group]:
    """Statues, benches, plants and glass cases."""
    groups: list[Group] = []
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
    return groups



def _visitors(shop: Shop) -> list[Actor]:
    """People who stand and look, people who walk by, and a carton that is pulled through the hall."""
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
    return actors

