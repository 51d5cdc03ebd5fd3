"""Operations of `lanes` by NumPy, if nothing is compiled; addresses are looked up in `live_arrays` and checked."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ...support.array_types import B1, U8
from .live_arrays import bytes_at

__all__ = [
    "bits_of",
    "bytes_from",
    "codes_there",
    "cuts",
    "differ",
    "lowest",
    "mark",
    "move",
    "ones",
    "side_errors",
    "square_errors",
]

LANES = 64
_CODES = npt.NDArray[np.int64]  # of codes, wide enough for their sums


def _load(address: int) -> _CODES:
    return bytes_at(address, 0, 2, LANES).view(np.uint16).astype(np.int64)


def _store(address: int, codes: npt.NDArray[Any]) -> None:
    bytes_at(address, 0, 2, LANES).view(np.uint16)[:] = codes


def _word(truths: B1) -> int:
    """Truths as the bits of a word."""
    word: int = np.packbits(truths, bitorder="little").view(np.int64)[0]  # a NumPy number: shifts wrap round
    return word


def _truths(word: int) -> B1:
    """The bits of a word."""
    one: U8 = np.array([int(word) & 0xFFFFFFFFFFFFFFFF], np.uint64).view(np.uint8)
    return np.unpackbits(one, bitorder="little").astype(bool)


def ones(word: int) -> int:
    """The number of set bits of a word."""
    return (int(word) & 0xFFFFFFFFFFFFFFFF).bit_count()


def lowest(word: int) -> int:
    """The number of the lowest set bit of a word that is not 0."""
    return (int(word) & -int(word)).bit_length() - 1


def bits_of(address: int, mask: int) -> int:
    """A word: which of 64 bytes have a bit of the mask."""
    return _word((bytes_at(address, 0, 1, LANES) & np.uint8(mask)) != 0)


def bytes_from(a: int, b: int, c: int, d: int, e: int, target: int) -> None:
    """Write 64 bytes at `target`; their lowest five bits are those of five words."""
    out = np.zeros(LANES, np.uint8)
    for k, word in enumerate((a, b, c, d, e)):
        out |= _truths(word).astype(np.uint8) << np.uint8(k)
    bytes_at(target, 0, 1, LANES)[:] = out


def codes_there(address: int) -> int:
    """A word: which of 64 codes are not 0."""
    return _word(_load(address) != 0)


def differ(a: int, b: int) -> int:
    """A word: which of 64 pairs of codes differ."""
    return _word(_load(a) != _load(b))


def move(source: int, target: int) -> None:
    """Copy 64 codes."""
    _store(target, _load(source))


def mark(word: int, target: int) -> None:
    """Write 64 codes at `target`: 65535 where a word's bit is set, else 0."""
    _store(target, np.where(_truths(word), 65535, 0))


def cuts(before: int, a: int, b: int, after: int, edge: int, odd: int, has_invalid: bool) -> int:
    """A word: where no surface joins pixels a and b, the middle two of four in line; see `lanes_llvm`."""
    p, q, r, s = (_load(address) for address in (before, a, b, after))
    edge, odd = int(edge) & 65535, int(odd)

    def is_invalid(codes: _CODES) -> B1:
        return (codes == 0) & bool(has_invalid)

    slope = np.minimum(np.where(is_invalid(p), 0, abs(q - p)), np.where(is_invalid(s), 0, abs(s - r)))
    half = (slope >> 1) + (slope & odd)
    step = np.maximum(abs(r - q) - slope, 0)
    return _word((np.maximum(step - edge, 0) > half) | is_invalid(q) | is_invalid(r))


def _deviation(code: _CODES, a: _CODES, b: _CODES) -> _CODES:
    """Twice the distance of codes from the means of two others, at most 65535."""
    above = np.minimum(np.maximum(code - a, 0) + np.maximum(code - b, 0), 65535)
    below = np.minimum(np.maximum(a - code, 0) + np.maximum(b - code, 0), 65535)
    return abs(above - below)


def side_errors(
    code: int, a: int, b: int, least: int, above: int, below: int, reach: int, limit: int, out: int
) -> int:
    """Write the errors of the middles of sides to `out`; returns which exceed `limit`: see `lanes_llvm`."""
    children = np.max([_load(row + offset) for row in (above, below) for offset in (-reach, reach)], axis=0)
    error = np.minimum(_deviation(_load(code), _load(a), _load(b)) + children, 65535) | _load(least)
    _store(out, error)
    return _word(error > limit)


def square_errors(
    code: int, reach_down: int, reach: int, falling: int, least: int, side: int, lanes: int, limit: int, out: int
) -> int:
    """Write the errors of the middles of squares to `out`; returns which exceed `limit`: see `lanes_llvm`."""

    def around(place: int, down: int, right: int) -> _CODES:
        return _load(place + down * reach_down + right * reach)

    falls = _truths(falling)
    left = np.where(falls, around(code, -1, -1), around(code, 1, -1))
    right = np.where(falls, around(code, 1, 1), around(code, -1, 1))
    children = np.max([around(side, -1, 0), around(side, 1, 0), around(side, 0, -1), around(side, 0, 1)], axis=0)
    error = np.minimum(_deviation(_load(code), left, right) + children, 65535) | _load(least)
    error = np.where(_truths(lanes), error, 0)
    _store(out, error)
    return _word(error > limit)
