"""The scene that a twin shows: solids that stand still, actors, materials and lamps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..kernels.synth.solids import END, FIRST, Solids
from ..support.array_types import F64
from .lamps import Dimming
from .parts import Group, pack
from .people import Actor

__all__ = ["Scene"]


@dataclass(frozen=True, eq=False)
class Scene:
    """Groups of solids that stand still, lit by lamps, and actors, which are functions of time. Without `dimming` the
    lamps do not change."""

    name: str
    materials: F64  # [k, MATERIAL_SIZE]
    lamps: F64  # [l, 5]: position, strength, reach
    static: Sequence[Group]
    actors: Sequence[Actor]
    dimming: Dimming | None = None

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

    def lit(self, time: float) -> F64:  # [l, LAMP_SIZE]
        """The lamps at `time` in seconds, as the ray tracer reads them."""
        shares = np.ones((len(self.lamps), 3)) if self.dimming is None else self.dimming.shares(time)
        return np.concatenate([self.lamps, shares], axis=1)
