"""What a nontrivial amount is: by how much a surface must be farther to be another one (section 3.3.3)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...support.array_types import U16
from ..base.jit import inlined, serial

__all__ = ["Margins", "Rules", "farther_than", "margins_of", "perhaps_farther", "prepare_limits"]


class Rules(NamedTuple):
    """What a maximum depth image's codes are compared by.

    A code that is `lowest` or more is a depth. What is farther than a code exceeds both margins, metres and 1/m;
    by_code [65536] is every code's limit: new - lowest < limit, in wrapping 16-bit arithmetic, says "valid and
    farther". Roughly, what is farther than a code, less the smallest valid one, differs from it by least +
    (max(code - bend, 0) >> shift) codes or more. `edge`: the step between neighbouring codes that is a depth edge.
    """

    offset: float  # of the depth coding: disparity, 1/m
    step: float
    lowest: int  # 0 or 1
    margin_m: float
    margin_disparity: float
    edge: int
    least: int
    bend: int
    shift: int
    by_code: U16


Margins = tuple[np.uint16, np.uint16, np.uint16, np.uint16]  # lowest, least, bend, shift


@inlined
def margins_of(rules: Rules) -> Margins:
    """What `perhaps_farther` compares by."""
    return np.uint16(rules.lowest), np.uint16(rules.least), np.uint16(rules.bend), np.uint16(rules.shift)


@inlined
def farther_than(
    code: int, offset: float, step: float, has_invalid: bool, margin_m: float, margin_disparity: float
) -> float:
    """The code below which a surface is farther than `code` by a nontrivial amount: both margins are exceeded."""
    if has_invalid and code == 0:
        return math.inf
    disparity = offset + step * code
    limit = min(disparity / (1.0 + margin_m * disparity), disparity - margin_disparity)
    return (limit - offset) / step


@inlined
def _limit(code: int, rules: Rules) -> int:
    """A code's row in `by_code`."""
    limit = farther_than(
        code, rules.offset, rules.step, rules.lowest > 0, rules.margin_m, rules.margin_disparity
    ) - rules.lowest
    return math.ceil(min(max(limit, 0.0), 65535.0))


@serial
def prepare_limits(rules: Rules) -> tuple[int, int, int]:
    """Fills by_code, every code's limit, and returns least, bend and shift; the other rules are read."""
    by_code = rules.by_code
    lowest, least = rules.lowest, 65535
    for code in range(65536):
        by_code[code] = _limit(code, rules)
        if code >= lowest and by_code[code] > 0:
            least = min(least, code - lowest - by_code[code] + 1)
    # The tangent where the margin in metres, a square of the disparity, is four times the least.
    slope = 4.0 * math.sqrt(rules.margin_m * rules.step * least)
    shift, bend = round(-math.log2(min(max(slope, 2.0**-15), 1.0))), 0
    for code in range(lowest, 65536):
        if by_code[code] > 0:
            more = code - lowest - by_code[code] + 1 - least
            bend = max(bend, code - lowest - (((more + 1) << shift) - 1))
    return least, bend, shift


@inlined
def perhaps_farther(new: np.uint16, code: np.uint16, margins: Margins) -> np.uint16:
    """0 where a new code is not farther than another, by what margins are at least (see `prepare_limits`).

    Without a table and in 16 bits, so that it is vectorised. Invalid codes wrap to the largest: as a new one that is
    never farther; where nothing was seen before anything is.
    """
    lowest, least, bend, shift = margins
    shifted, known = np.uint16(new - lowest), np.uint16(code - lowest)
    beyond = np.uint16(np.uint16(max(known, bend) - bend) >> (shift & 15))  # the mask tells that 16 bits are enough
    margin = np.uint16(beyond + least)
    nearest = np.uint16(min(shifted, np.uint16(~margin)) + margin)  # saturates
    return np.uint16((nearest <= known) & (shifted != np.uint16(65535)))
