"""Stale foreground: what a present view sees past leaves the model at once, without a farther surface in its place.

Foreground culling removes a triangle when every camera knows a surface behind it (section 3.3.2). Where nothing farther
is ever modelled, because it is infinitely far or a camera never has depth there, someone who has left would stay for
ever. Here a triangle goes as soon as a view in its camera's turn sees past the whole of it, or the view that it stems
from has neither its depth nor its colour any more. It stays if a view of the same frame shows a part of it: then the
views contradict each other, and one of them is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ..geometry.prepared_view import PreparedView, ViewTable
from ..kernels.background.picture import Picture
from ..kernels.background.stale import find_gone, find_seen_past, find_shown
from ..kernels.base.tolerance import Delta
from ..support.array_types import F64, I64
from .capture import Capture
from .pbs import ProbableBackgroundSurface, Surface

__all__ = ["Look", "flag_stale"]

# Triangles that a view looks at in its camera's turn, so that the cost of a turn is bounded: those that stem from its
# picture, of each part of the PBS, and those of any camera, each of which has to be projected.
_OWN, _LOOKED_AT = 1 << 16, 1 << 10


class Look(NamedTuple):
    """A camera's turn: its view, the tone that converts it to the model's common tone (packed), and its capture from
    the same pose."""

    view: PreparedView
    tone: F64
    capture: Capture


def flag_stale(
    pbs: ProbableBackgroundSurface, look: Look, present: Callable[[], ViewTable], delta: Delta, turn: int,
    cameras: int,
) -> int:  # fmt: skip
    """Flags triangles as invalid that a camera's view shows to have gone, and of which no view of the frame shows a
    part; returns their number.

    The view looks at the triangles that stem from its picture, where each has its place: at all of them, or if they are
    very many at the next part of them in each round. Of all triangles it looks at a few, in each turn at the next ones:
    they count where their own camera sees nothing, or has moved. present:
    makes the table of all views of the frame, which is needed only if a triangle may go. turn: how many views have
    looked before; cameras: of the rig.
    """
    flagged = 0
    found = *_gone(pbs, look, delta, turn // cameras), *_seen_past(pbs, look.view, delta, turn, cameras)
    for surface, which in found:
        table, shown = present(), np.empty(len(which), np.uint8)
        codes = np.ascontiguousarray(table.addresses[:, 0])
        find_shown(table.rows, codes, surface.packed, which, delta, shown)
        goes = which[(shown == 0) & (surface.invalid[which] == 0)]
        with pbs.lock:
            surface.invalid[goes] = 1
        flagged += len(goes)
    return flagged


def _seen_past(
    pbs: ProbableBackgroundSurface, view: PreparedView, delta: Delta, turn: int, cameras: int
) -> Iterator[tuple[Surface, I64]]:
    """The triangles past which a view sees in the part of the model that is looked at, by surface."""
    row, codes = view.table_row, view.addresses(measured=True)[0]
    for surface, first, end in _part(pbs, turn, cameras):
        past = np.empty(end - first, np.uint8)
        if find_seen_past(row, codes, surface.packed, surface.invalid, delta, first, past):
            yield surface, first + np.flatnonzero(past)


def _gone(
    pbs: ProbableBackgroundSurface, look: Look, delta: Delta, number: int
) -> Iterator[tuple[Surface, I64]]:
    """The triangles of a camera's current capture that have gone from its view, by surface; number: of the round."""
    view, image = look.view.view, look.capture.image
    row, codes = look.view.table_row, look.view.addresses(measured=True)[0]
    new, known = (Picture(p.codes, p.texture.y, p.texture.cb, p.texture.cr) for p in (view, image))
    for part in (pbs.static, pbs.progressive):
        if (surface := part.get(look.capture.number)) is not None:
            mesh, invalid = surface.packed, surface.invalid
            first = number % max(1, -(-len(invalid) // _OWN)) * _OWN
            gone = np.empty(min(_OWN, len(invalid) - first), np.uint8)
            if find_gone(row, codes, new, known, look.tone, mesh, invalid, delta, first, gone):
                yield surface, first + np.flatnonzero(gone)


def _part(pbs: ProbableBackgroundSurface, turn: int, cameras: int) -> Iterator[tuple[Surface, int, int]]:
    """The surfaces, with the numbers of their first triangle and of the one after the last, of the part of the model
    that is looked at in a turn. Parts follow each other over and over, and each camera comes to look at all of them."""
    surfaces = list(pbs.surfaces())
    ends = np.cumsum([len(surface.invalid) for surface in surfaces], dtype=np.int64)
    parts = max(1, -(-int(ends[-1]) // _LOOKED_AT)) if surfaces else 1
    begin = (turn + turn // math.lcm(parts, cameras)) % parts * _LOOKED_AT
    for surface, end in zip(surfaces, ends.tolist(), strict=True):
        start = end - len(surface.invalid)
        first, last = max(begin, start), min(begin + _LOOKED_AT, end)
        if first < last:
            yield surface, first - start, last - start
