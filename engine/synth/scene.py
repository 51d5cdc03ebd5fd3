"""The scene that a twin shows: solids that stand still, actors, materials and lamps."""

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
    """Groups of solids that stand still, lit by fixed lamps, and actors, which are functions of time."""

    name: str
    materials: F64  # [k, MATERIAL_SIZE]
    lamps: F64  # [l, LAMP_SIZE]: position, strength, reach
    static: Sequence[Group]
    actors: Sequence[Actor]

    @cached_property
    def background(self) -> Solids:
        """The solids that stand still, packed for the ray tracer."""
        return pack(self.static)

    def packed(self, time: float) -> Solids:
        """All solids at `time` in seconds, packed for the ray tracer: the background first, then the actors."""
        parts, groups = self.background
        moving_parts, moving_groups = pack([actor(time) for actor in self.actors])
        moving_groups[:, [FIRST, END]] += len(parts)
        return Solids(np.concatenate([parts, moving_parts]), np.concatenate([groups, moving_groups]))
