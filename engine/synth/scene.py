"""What a twin is a picture of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..kernels.synth.solids import END, FIRST, Solids
from ..support.array_types import F64
from .parts import Group, pack
from .people import Actor

__all__ = ["Scene"]


@dataclass(frozen=True, eq=False)
class Scene:
    """A static world, lit by fixed lamps, and actors that are functions of time."""

    name: str
    materials: F64  # [k, MATERIAL_SIZE]
    lamps: F64  # [l, LAMP_SIZE]: position, strength, reach
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
