"""The nontrivial amount (section 3.3.3): a surface must be farther by this to count as another surface."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...support.array_types import U16
from ..base.jit import inlined, serial

__all__ = ["Margins", "Rules", "farther_than", "margins_of", "perhaps_farther", "prepare_limits"]


class Rules(NamedTuple):
    """The rules by which codes of a maximum depth image are compared.

    A code of `lowest` or more is a depth. A depth is farther than a code if it exceeds both margins, metres and 1/m.
    by_code [65536] is the limit of every code: new - lowest < limit, in wrapping 16-bit arithmetic, means "valid and
    farther". As a fast approximation, with codes counted from the smallest valid one, a farther code differs from
    `code` by at least least + (max(code - bend, 0) >> shift). `edge`: the step between neighbouring codes that is a
    depth edge.
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
    """The rules for `perhaps_farther`."""
    return np.uint16(rules.lowest), np.uint16(rules.least), np.uint16(rules.bend), np.uint16(rules.shift)


@inlined
def farther_than(
    code: int, offset: float, step: float, has_invalid: bool, margin_m: float, margin_disparity: float
) -> float:
    """The limit below which a code is farther than `code` by a nontrivial amount: it exceeds both margins."""
    if has_invalid and code == 0:
        return math.inf
    disparity = offset + step * code
    limit = min(disparity / (1.0 + margin_m * disparity), disparity - margin_disparity)
    return (limit - offset) / step


@inlined
def _limit(code: int, rules: Rules) -> int:
    """A code's entry in `by_code`."""
    limit = farther_than(
        code, rules.offset, rules.step, rules.lowest > 0, rules.margin_m, rules.margin_disparity
    ) - rules.lowest
    return math.ceil(min(max(limit, 0.0), 65535.0))


@serial
def prepare_limits(rules: Rules) -> tuple[int, int, int]:
    """Fills by_code, the limit of every code, from the other rules, and returns least, bend and shift."""
    by_code = rules.by_code
    lowest, least = rules.lowest, 65535
    for code in range(65536):
        by_code[code] = _limit(code, rules)
        if code >= lowest and by_code[code] > 0:
            least = min(least, code - lowest - by_code[code] + 1)
    # The tangent where the margin in metres, which grows with the square of the disparity, is four times `least`.
    slope = 4.0 * math.sqrt(rules.margin_m * rules.step * least)
    shift, bend = round(-math.log2(min(max(slope, 2.0**-15), 1.0))), 0
    for code in range(lowest, 65536):
        if by_code[code] > 0:
            more = code - lowest - by_code[code] + 1 - least
            bend = max(bend, code - lowest - (((more + 1) << shift) - 1))
    return least, bend, shift


@inlined
def perhaps_farther(new: np.uint16, code: np.uint16, margins: Margins) -> np.uint16:
    """0 if a new code cannot be farther than another, by a lower bound of the margins (see `prepare_limits`).

    It uses no table and 16 bits, so that it is vectorised. Invalid codes wrap round to the largest: an invalid new code
    is never farther; if the old code is invalid, every valid new code is.
    """
    lowest, least, bend, shift = margins
    shifted, known = np.uint16(new - lowest), np.uint16(code - lowest)
    beyond = np.uint16(np.uint16(max(known, bend) - bend) >> (shift & 15))  # the mask tells LLVM that 16 bits do
    margin = np.uint16(beyond + least)
    nearest = np.uint16(min(shifted, np.uint16(~margin)) + margin)  # saturates
    return np.uint16((nearest <= known) & (shifted != np.uint16(65535)))
