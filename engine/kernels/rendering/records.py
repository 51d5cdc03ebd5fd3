"""Records of arrays for the kernels of this room."""

from __future__ import annotations

from typing import NamedTuple

from ...support.array_types import F32, I32, I64, U8

__all__ = ["Bands", "DepthBuffer", "Planes", "Regions", "Rows", "VisibleBlocks"]

Rows = tuple[int, int]  # the first and the last of some rows of a picture


class DepthBuffer(NamedTuple):
    """The drawn surfaces of a picture [h, w]: disparity, 1/m, 0: nothing; and the number of the view that won."""

    disparity: F32
    winner: U8


class Planes(NamedTuple):
    """Colours of a picture [h, w], in 10-bit codes; chroma has the size of the luma."""

    luma: F32
    chroma_b: F32
    chroma_r: F32


class VisibleBlocks(NamedTuple):
    """The blocks of a mesh that a picture may show, in chunks.

    Chunk c has the visible blocks shares[c] to shares[c + 1] - 1.
    """

    starts: I64  # [blocks + 1, 2]: where each block's points and triangles begin
    visible: I64  # [n]: numbers of blocks
    shares: I64  # [chunks + 1]


class Regions(NamedTuple):
    """Where triangles may have an effect. Three more bytes can be read behind the last tile and the last point."""

    tiles: U8  # [rows, columns] of a picture: only triangles that touch a marked one are drawn; empty: all
    open_tiles: U8  # where a surface may show between others (`tiles.mark_open_tiles`); empty: everywhere
    nearer: U8  # [points]: see `blocks.place_points`


class Bands(NamedTuple):
    """Triangles sorted into bands of a picture's rows; a triangle over several bands is in each of them."""

    rows: int  # of a band
    counts: I64  # [chunks, bands]: numbers of triangles
    lists: I32  # [chunks, bands, capacity]: their numbers
