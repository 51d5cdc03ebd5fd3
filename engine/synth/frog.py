"""A table top seen from a row of cameras at the origin that look along x."""

from __future__ import annotations

import numpy as np

from ..kernels.synth import patterns as p
from .furniture import room, vase
from .parts import box, cylinder, ellipsoid, placed, turn
from .people import Path, ball, frog
from .scene import Scene
from .shop import Shop

__all__ = ["make"]


def make(name: str, rng: np.random.Generator) -> Scene:
    """The scene called `name`; `rng` draws its materials and its people."""
    shop = Shop(rng)
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
