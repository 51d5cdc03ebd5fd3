"""A shop where a scene gets its materials, pictures, clothes and people."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..kernels.synth import patterns as p
from .furniture import picture
from .parts import Group, Palette, placed
from .people import Actor, Clothes, Path, stander, walker

__all__ = ["Shop"]


class Shop:
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
        """Material of a new painting."""
        return self.palette.add(p.PICTURE, (0.5, 0.5, 0.5), scale=0.1, rough=0.35)

    def colour(self, low: float = 0.05, high: float = 0.6) -> list[float]:
        """A random linear RGB colour with components from `low` to `high`."""
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
            top=add(int(rng.choice([p.STRIPES, p.CHECKER, p.NOISE])), self.colour(), self.colour(), 0.09, 0.5),
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
        """Someone at each spot (x, y, yaw): metres and radians."""
        return [
            stander(self.clothes(), self.height(), (x, y), yaw, float(self.rng.uniform(0, 6))) for x, y, yaw in spots
        ]

    def hung(self, wall: str, face: float, along: Sequence[float], sizes: Sequence[tuple[float, float]]) -> list[Group]:
        """Framed pictures in a row on a wall.

        wall: its axis and side, such as "+x". face: coordinate of its face on that axis, metres. along: coordinates of
        the pictures' middles on the other horizontal axis, metres. sizes: width and height of each, metres.
        """
        yaw = {"+x": math.pi, "-x": 0.0, "+y": -math.pi / 2, "-y": math.pi / 2}[wall]
        frames = [self.gold, self.dark_wood, self.metal]
        groups = []
        for k, (s, (width, height)) in enumerate(zip(along, sizes, strict=True)):
            position = (face, s, 1.75) if wall[1] == "x" else (s, face, 1.75)
            groups.append(placed(picture(self.image(), frames[k % 3], width, height), position, yaw))
        return groups
