"""Light that changes, as a maximum depth image follows it (the paper leaves this to future work, section 5).

Colours of surfaces that the camera sees now approach those of its view. Surfaces that it does not see change as visible
ones round them have changed: the picture is divided into cells, and the colours that the view shows in a cell are
compared with those that the image had. A change of light is a gain of luma and chroma, and a *tint*, which is a share
of the luma, for each chroma: gains of R', G', B' have exactly this effect.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..kernels.background import light as kernels
from ..kernels.background.light import CELL, CHANGE_SIZE, GAIN, SUMS_SIZE, Cells
from ..kernels.background.maximum_depth import PHASES
from ..kernels.background.nontrivial import Rules
from ..kernels.background.picture import Picture
from ..support.array_types import B1, F64, U8

__all__ = ["FollowedLight", "LightState", "cells_of"]

_LEAST = 8  # quads of a cell that must be seen, of the 32 or 64 that are compared in a round
_DARK = 8.0  # codes above black: what is darker tells nothing of light
# A cell becomes active when the mean of luma or of a chroma differs by _BEGINS codes, and is so for _ROUNDS more rounds
# after it has differed by _LASTS. Noise does not make it active, so with steady light no colour changes.
_BEGINS, _LASTS, _ROUNDS = 3.0, 1.0, 6
# Light has changed, and not the picture on a screen, if what is seen and what was known differ little when the gain is
# removed: by a share of the mean luma, or of their difference before (both root mean square).
_ROUGH, _UNEXPLAINED = 0.1, 0.5
# Changes wait until they are this large somewhere, because each is rounded once: a gain, and two tints.
_NOTABLE = np.array([0.015, 0.006, 0.006])
_PART = 0.25  # of a notable change: cells with less keep waiting
_NEUTRAL = np.array([1.0, 0.0, 0.0])


@dataclass(frozen=True, slots=True)
class LightState:
    """The fields of `FollowedLight`, for cells [rows, columns]: sums float64 [..., SUMS_SIZE]; active uint8; waiting
    and change float64 [..., CHANGE_SIZE]; known bool; due; number."""

    sums: F64
    active: U8
    waiting: F64
    known: B1
    change: F64
    due: bool
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
        self._waiting = np.tile(_NEUTRAL, (*cells, 1))  # what has changed, and is not yet applied to hidden surfaces
        self._known = np.zeros(cells, bool)  # where that was seen
        self._change = np.tile(_NEUTRAL, (*cells, 1))  # what is applied to them in this round, if `_due`
        self._due = False
        self._busy = False  # whether any cell is active, or changes are due

    def follow(
        self, new: Picture, known: Picture, flags: U8, rules: Rules, tone: F64, share: float, total: float
    ) -> None:
        """Takes a view; arguments as in `kernels.background.light`. `total`: the share by which visible colours
        approach the view's in a round, by this and by fusion."""
        number = self._number
        self._number += 1
        if number % PHASES == 0:
            self._begin_round(total)
        look = number // PHASES % PHASES
        if not self._busy and number % PHASES != look:
            return
        cells = Cells(self._active, self._due, self._change, self._sums)
        kernels.follow_light(new, known, flags, rules, tone, number, look, share, cells)

    def state(self) -> LightState:
        """All its data, as copies."""
        return LightState(
            self._sums.copy(), self._active.copy(), self._waiting.copy(), self._known.copy(), self._change.copy(),
            self._due, self._number,
        )  # fmt: skip

    @classmethod
    def from_state(cls, state: LightState) -> FollowedLight:
        """It, with this state; arrays are copied."""
        light = cls((0, 0), state.number)
        light._sums, light._active, light._waiting = state.sums.copy(), state.active.copy(), state.waiting.copy()
        light._known, light._change, light._due = state.known.copy(), state.change.copy(), state.due
        light._busy = state.due or bool(state.active.any())
        return light

    def _begin_round(self, share: float) -> None:
        """Adds what was seen in the last round to what waits, and applies that in this round if it is notable."""
        sums, was_active = self._sums, self._active > 0
        self._due = False
        count, apart = sums[..., kernels.COUNT], _difference(sums)
        begins = (count >= _LEAST) & (apart >= np.where(was_active, _LASTS, _BEGINS))
        self._active = np.where(begins, np.uint8(_ROUNDS), self._active - was_active)
        if was_active.any():
            step, seen = _step(sums, share)
            step[~was_active] = _NEUTRAL  # nothing has followed there
            after = _after(self._waiting, step)
            self._waiting[seen] = after[seen]
            self._known |= seen
            self._apply_notable()
        self._busy = self._due or bool(self._active.any())
        sums[:] = 0.0

    def _apply_notable(self) -> None:
        """Applies what waits in this round, if it is notable anywhere."""
        size = np.max(np.abs(self._waiting - _NEUTRAL) / _NOTABLE, axis=-1)
        self._due = bool((size >= 1.0).any())
        if self._due:
            small = size[..., None] < _PART
            self._change = _spread(np.where(small, _NEUTRAL, self._waiting), self._known)
            self._waiting = np.where(small, self._waiting, _NEUTRAL)
            self._known[:] = False


def cells_of(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Rows and columns of the cells of a picture [h, w]."""
    return tuple(-(-size // CELL) for size in shape)


def _difference(sums: F64) -> F64:
    """By how much the means of what is seen and what was known differ, codes [rows, columns]: luma, or a chroma."""
    seen = sums[..., [kernels.SEEN, kernels.SEEN_BLUE, kernels.SEEN_RED]]
    known = sums[..., [kernels.KNOWN, kernels.KNOWN_BLUE, kernels.KNOWN_RED]]
    most: F64 = np.abs(seen - known).max(axis=-1) / np.maximum(sums[..., kernels.COUNT], 1.0)
    return most


def _step(sums: F64, share: float) -> tuple[F64, B1]:
    """The changes [rows, columns, CHANGE_SIZE] of visible colours in a round, and where there is evidence of light."""
    count = np.maximum(sums[..., kernels.COUNT], 1.0)
    seen, known = sums[..., kernels.SEEN] / count, sums[..., kernels.KNOWN] / count
    there = (sums[..., kernels.COUNT] >= _LEAST) & (known > _DARK) & (seen > 0.0)
    gain = seen / np.maximum(known, _DARK)
    rest, apart = (
        sums[..., kernels.SEEN_SQUARED] - 2.0 * g * sums[..., kernels.BOTH] + g * g * sums[..., kernels.KNOWN_SQUARED]
        for g in (gain, 1.0)
    )
    there &= rest <= np.maximum(_ROUGH**2 * count * np.maximum(seen, known) ** 2, _UNEXPLAINED**2 * apart)
    step = np.empty((*gain.shape, CHANGE_SIZE))
    step[..., GAIN] = 1.0 + share * (gain - 1.0)
    for k, new, old in (
        (kernels.BLUE, kernels.SEEN_BLUE, kernels.KNOWN_BLUE), (kernels.RED, kernels.SEEN_RED, kernels.KNOWN_RED)
    ):  # fmt: skip
        step[..., k] = share * (sums[..., new] - gain * sums[..., old]) / (count * np.maximum(known, _DARK))
    return step, there


def _after(first: F64, second: F64) -> F64:
    """One change after another [..., CHANGE_SIZE] as one."""
    both = second[..., GAIN, None] * first
    both[..., 1:] += second[..., 1:] * first[..., GAIN, None]
    return both


def _spread(change: F64, known: B1) -> F64:
    """Changes of cells [rows, columns, CHANGE_SIZE]; one that is not known is the mean of those next to it, ring by
    ring from the known ones on."""
    total = np.where(known[..., None], change, 0.0)
    full = known.copy()
    while not full.all():
        near, count = _summed(total), _summed(full[..., None].astype(np.float64))
        ring = ~full & (count[..., 0] > 0.0)
        if not ring.any():
            return np.tile(_NEUTRAL, (*known.shape, 1))
        total[ring] = near[ring] / count[ring]
        full |= ring
    return total


def _summed(values: F64) -> F64:
    """Sums [rows, columns, k] over the 3x3 cells round each cell."""
    rows, columns = values.shape[:2]
    padded = np.pad(values, ((1, 1), (1, 1), (0, 0)))
    total = np.zeros_like(values)
    for y, x in np.ndindex(3, 3):
        total += padded[y : y + rows, x : x + columns]
    return total
