"""The scenes of the twins, by name: furnished rooms and a street, with people who move in them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from . import doorway, frog, gymnasium, hijack, lounge, museum, painter, street
from .scene import Scene

__all__ = ["TWINS", "Scene", "check_twin", "make_scene"]

TWINS: dict[str, Callable[[str, np.random.Generator], Scene]] = {
    "museum": museum.make,
    "hijack": hijack.make,
    "painter": painter.make,
    "frog": frog.make,
    "gymnasium-a": gymnasium.make,
    "gymnasium-b": gymnasium.make,
    "doorway": doorway.make,
    "street": street.make,
    "museum-lamps": museum.make,
    "gymnasium-lamps": gymnasium.make,
    "lounge": lounge.make,
}


def check_twin(name: str) -> None:
    """Raise ValueError for names not in TWINS."""
    if name not in TWINS:
        raise ValueError(f"twin: {name!r}: expected one of {', '.join(TWINS)}")


def make_scene(name: str, seed: int = 0) -> Scene:
    """The scene of the twin `name`; `seed` draws its materials and people. Raises ValueError for names not in TWINS."""
    check_twin(name)
    return TWINS[name](name, np.random.default_rng(seed))
