"""Atlases: pictures with the colours of surfaces that stem from an earlier model, not from a camera of this rig."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..kernels.base.memory import address_of
from ..support.array_types import U16

__all__ = ["Atlas"]

_NO_EDGE = 1 << 16  # no two codes differ by more


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """A picture like that of a capture, for surfaces that have no capture; it never changes.

    y uint16 [h, w], cb and cr uint16 [(h + 1) // 2, (w + 1) // 2]: 10 bits, in the model's common tone. codes uint16
    [h, w]: depth codes, between which a step of more than `edge` separates colours; empty: nothing does. wraps: the
    first and the last column are neighbours. scattered: surfaces that meet in space may lie anywhere in the picture;
    False: it is the picture of a camera, in which they are neighbours too.
    """

    y: U16
    cb: U16
    cr: U16
    codes: U16
    edge: int
    wraps: bool
    scattered: bool

    @classmethod
    def of_parts(cls, y: U16, cb: U16, cr: U16) -> Atlas:
        """An atlas in which parts of surfaces lie side by side."""
        y, cb, cr = (np.ascontiguousarray(plane, np.uint16) for plane in (y, cb, cr))
        return cls(y, cb, cr, np.empty((0, 0), np.uint16), 0, wraps=False, scattered=True)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.y.shape[1], self.y.shape[0]

    @property
    def memory(self) -> int:
        """Bytes of the planes."""
        return sum(plane.nbytes for plane in (self.y, self.cb, self.cr, self.codes))

    def table_row(self) -> list[int]:
        """The atlas as `kernels.background.captures` reads it."""
        codes, edge = (self.codes, self.edge) if self.codes.size else (self.y, _NO_EDGE)
        addresses = [address_of(plane) for plane in (self.y, self.cb, self.cr, codes)]
        return [*addresses, *self.size, int(self.wraps), edge, 0, int(self.scattered)]
