"""A street along x with hills at its end, 320 m away; the cameras stand across its middle."""

from __future__ import annotations

import math

import numpy as np

from ..kernels.synth import patterns as p
from .furniture import bench, plant, room
from .outdoors import car, driver, house, lamp_post, tree
from .parts import Group, box, cylinder, ellipsoid, placed
from .people import Path
from .scene import Scene
from .shop import Shop

__all__ = ["make"]


def make(name: str, rng: np.random.Generator) -> Scene:
    """The scene called `name`; `rng` draws its materials and its people."""
    shop = Shop(rng)
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
    groups += _houses(shop, glass)
    groups.append([box(shop.stone, (225, 24, 22), (9, 9, 44)), cylinder(shop.bronze, (225, 24, 44), 3.0, 9.0)])
    groups += _verges(shop, crown, paint)
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


def _houses(shop: Shop, glass: int) -> list[Group]:
    """Two rows of houses, with gaps for side streets."""
    add, groups = shop.palette.add, []
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
    return groups



def _verges(shop: Shop, crown: int, paint: int) -> list[Group]:
    """Trees, lamp posts, bollards, a bench and plants."""
    groups: list[Group] = []
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
    return groups

