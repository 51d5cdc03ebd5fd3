"""A gymnasium where people run about; the cameras stand around its middle."""

from __future__ import annotations

import math

import numpy as np

from ..kernels.synth import patterns as p
from .furniture import bench, column, room
from .lamps import Dimming, Fade
from .parts import Group, box, capsule, cylinder, placed, turn
from .people import Actor, Path, ball
from .scene import Scene
from .shop import Shop

__all__ = ["make"]

# The lamps at one end are dimmed one after the other; then those at the other end get warmer.
_DIMMING = Dimming(
    4,
    (
        Fade(0, 2.0, 2.0, (0.1, 0.1, 0.1)),
        Fade(1, 2.5, 2.5, (0.3, 0.3, 0.3)),
        Fade(2, 3.0, 2.0, (1.0, 0.7, 0.3)),
        Fade(3, 3.0, 2.0, (1.0, 0.8, 0.5)),
    ),
)


def make(name: str, rng: np.random.Generator) -> Scene:
    """The scene called `name`: in gymnasium-b the runner is faster, in gymnasium-lamps the light changes. `rng` draws
    its materials and its people."""
    shop = Shop(rng)
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
    groups += _apparatus(shop)
    runner_speed = 5.5 if name == "gymnasium-b" else 2.6
    actors = _players(shop, runner_speed)
    toy = add(p.STRIPES, (0.75, 0.3, 0.06), (0.12, 0.08, 0.06), 0.11, 0.4)
    actors.append(ball(toy, 0.13, Path([(2.2, 0.6), (1.6, -2.8), (-2.6, -1.2)], 2.5, 0.2), bounce=0.9))
    lamps = [(x, y, 7.0, 0.42, 5.0) for x in (-6, 6) for y in (-3.5, 3.5)]
    dimming = _DIMMING if name == "gymnasium-lamps" else None
    return Scene(name, shop.palette.packed(), np.array(lamps), groups, actors, dimming)


def _apparatus(shop: Shop) -> list[Group]:
    """Baskets, vaults, mats, benches and bars."""
    add, groups = shop.palette.add, []
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
    return groups



def _players(shop: Shop, runner_speed: float) -> list[Actor]:
    """Runners and spectators; `runner_speed` is that of the first runner, m/s."""
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
    return actors

