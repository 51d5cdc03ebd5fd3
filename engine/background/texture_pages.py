"""Pages: the parts of captures' pictures that a mesh uses, side by side in few pictures, for exported textures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
import numpy.typing as npt

from ..io.coloured_meshes import TexturePage
from ..io.images import encode_rgb_jpeg
from ..kernels.background.texture_pages import copy_part
from .capture import Captures

__all__ = ["PAGE_SIDE", "Pages", "Part", "arrange", "paint"]

PAGE_SIDE = 4096  # texels; hardly any graphics card takes less
_CELL = 8  # parts begin at multiples of this, so that no block of a JPEG mixes two of them
_QUALITY = 95  # of the JPEG, without subsampled chroma


@dataclass(frozen=True, slots=True)
class Part:
    """A rectangle of a capture's picture, in pixels: its first column and row, width and height (multiples of _CELL).

    It may reach beyond the picture's borders.
    """

    capture: int
    left: int
    top: int
    width: int
    height: int

    @classmethod
    def holding(cls, capture: int, low: npt.NDArray[np.int64], high: npt.NDArray[np.int64]) -> Part:
        """The smallest part that holds the pixels from `low` to `high` (column and row), both included."""
        (left, top), (width, height) = low.tolist(), (-(-(high - low + 1) // _CELL) * _CELL).tolist()
        return cls(capture, left, top, width, height)


@dataclass(frozen=True, slots=True)
class Pages:
    """Where parts lie: for each part its page, column and row, int64 [n, 3]; each page's width and height, which are
    powers of two."""

    places: npt.NDArray[np.int64]
    sizes: tuple[tuple[int, int], ...]


def arrange(parts: Sequence[Part], side: int = PAGE_SIDE) -> Pages:
    """Places parts in rows of falling height in as few pages of at most `side` x `side` texels as that takes, and of
    these in the smallest and squarest. Raises ValueError for a part that is larger than that."""
    for part in parts:
        if max(part.width, part.height) > side:
            raise ValueError(f"part: {part}: expected at most {side} x {side} pixels")
    widest = max((part.width for part in parts), default=1)
    widths = [1 << k for k in range(_power(widest).bit_length() - 1, side.bit_length())]
    found = [_rows(parts, width, side) for width in widths]
    return min(found, key=_cost)


def paint(parts: Sequence[Part], pages: Pages, captures: Captures) -> list[TexturePage]:
    """The pages as pictures, with the colours that the captures have now."""
    painted = []
    order = np.argsort(pages.places[:, 0], kind="stable").tolist()
    for page, numbers in groupby(order, lambda number: int(pages.places[number, 0])):
        width, height = pages.sizes[page]
        rgb = np.full((height, width, 3), 128, np.uint8)
        for number in numbers:
            part, (_, x, y) = parts[number], pages.places[number].tolist()
            copy_part(
                captures.table[part.capture], part.left, part.top, rgb[y : y + part.height, x : x + part.width]
            )
        painted.append(TexturePage(encode_rgb_jpeg(rgb, _QUALITY), width, height))
    return painted


def _cost(pages: Pages) -> tuple[int, int, int]:
    """The number of pages, their texels, and the longest side."""
    texels = sum(width * height for width, height in pages.sizes)
    return len(pages.sizes), texels, max(map(max, pages.sizes), default=0)


def _power(size: int) -> int:
    """The smallest power of two that is at least `size`."""
    return 1 << math.ceil(math.log2(size))


def _rows(parts: Sequence[Part], width: int, side: int) -> Pages:
    """Pages of `width` texels, or less, and at most `side` rows."""
    places = np.empty((len(parts), 3), np.int64)
    sizes: list[tuple[int, int]] = []
    page, x, y, below, used = -1, 0, 0, side, 0  # `below`: where the next row of parts begins; `used`: columns
    for number in sorted(range(len(parts)), key=lambda k: (-parts[k].height, -parts[k].width)):
        part = parts[number]
        if page < 0 or x + part.width > width:  # the next row
            x, y, below = 0, below, below + part.height
            if below > side:  # the next page
                if page >= 0:
                    sizes.append((_power(used), _power(y)))
                page, y, below, used = page + 1, 0, part.height, 0
        places[number] = page, x, y
        x += part.width
        used = max(used, x)
    if page >= 0:
        sizes.append((_power(used), _power(below)))
    return Pages(places, tuple(sizes))
