"""A view's planes, as kernels take them."""

from __future__ import annotations

from typing import NamedTuple

from ...support.array_types import U16

__all__ = ["Picture"]


class Picture(NamedTuple):
    """Depth codes and luma, uint16 [h, w], and chroma, uint16 [(h + 1) // 2, (w + 1) // 2]."""

    codes: U16
    y: U16
    cb: U16
    cr: U16
