"""Light that changes, as a maximum depth image follows it (the paper leaves this to future work, section 5).

Colours of surfaces that the camera sees now approach those of its view. The picture is divided into cells, and colours
follow only where those that the view shows in a cell differ from those that the image has. What the camera does not see
keeps its colours until it is seen again: to change them as visible surfaces round them change was tried, and made the
luma of hidden surfaces worse in the twin museum-lamps, as lamps light people, walls and floors differently.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..kernels.background import light as kernels
from ..kernels.background.light import CELL, COUNT, SUMS_SIZE, Cells
from ..kernels.background.maximum_depth import PHASES
from ..kernels.background.nontrivial import Rules
from ..kernels.background.picture import Picture
from ..support.array_types import F64, U8

__all__ = ["FollowedLight", "LightState", "cells_of"]

_LEAST = 8  # quads of a cell that must be seen, of the 32 or 64 that are compared in a round
# A cell becomes active when the mean of luma or of a chroma differs by _BEGINS codes, and is so for _ROUNDS more rounds
# after it has differed by _LASTS. Noise does not make it active, so with steady light no colour changes.
_BEGINS, _LASTS, _ROUNDS = 3.0, 1.0, 6


@dataclass(frozen=True, slots=True)
class LightState:
    """The fields of `FollowedLight`, for cells [rows, columns]: sums float64 [..., SUMS_SIZE]; active uint8;
    number."""

    sums: F64
    active: U8
    number: int


class FollowedLight:
    """How light changes on the surfaces of a maximum depth image [h, w], by cells.

    A *round* is PHASES calls, which see all rows once. Cells that are not active are compared in one of these calls,
    another one in each round. number: of the calls so far; several images have different ones, so that their rounds do
    not begin together.
    """

    def __init__(self, shape: tuple[int, ...], number: int = 0) -> None:
        cells = cells_of(shape)
        self._number = number
        self._sums = np.zeros((*cells, SUMS_SIZE))  # of this round
        self._active = np.zeros(cells, np.uint8)  # rounds for which a cell is active
        self._busy = False  # whether any cell is active

    def follow(self, new: Picture, known: Picture, flags: U8, rules: Rules, tone: F64, share: float) -> None:
        """Takes a view; arguments as in `kernels.background.light`."""
        number = self._number
        self._number += 1
        if number % PHASES == 0:
            self._begin_round()
        look = number // PHASES % PHASES
        if self._busy or number % PHASES == look:
            cells = Cells(self._active, self._sums)
            kernels.follow_light(new, known, flags, rules, tone, number, look, share, cells)

    def state(self) -> LightState:
        """All its data, as copies."""
        return LightState(self._sums.copy(), self._active.copy(), self._number)

    @classmethod
    def from_state(cls, state: LightState) -> FollowedLight:
        """It, with this state; arrays are copied."""
        light = cls((0, 0), state.number)
        light._sums, light._active, light._busy = state.sums.copy(), state.active.copy(), bool(state.active.any())
        return light

    def _begin_round(self) -> None:
        """Finds the active cells from what was seen in the last round."""
        sums, was_active = self._sums, self._active > 0
        apart = np.abs(sums[..., COUNT + 1 :]).max(axis=-1) / np.maximum(sums[..., COUNT], 1.0)
        begins = (sums[..., COUNT] >= _LEAST) & (apart >= np.where(was_active, _LASTS, _BEGINS))
        self._active = np.where(begins, np.uint8(_ROUNDS), self._active - was_active)
        self._busy = bool(self._active.any())
        sums[:] = 0.0


def cells_of(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Rows and columns of the cells of a picture [h, w]."""
    return tuple(-(-size // CELL) for size in shape)
