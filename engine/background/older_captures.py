"""Older captures of reference cameras that move (section 4.2), and what is left of them.

A camera that moves begins a capture in each of its turns. The surfaces of an older one stay in the P-PBS until they are
culled, but most of its pictures is needed no more: only the parts under its surfaces remain. What is left of several
captures becomes one, with one surface, so that the number of surfaces does not grow with the length of the video, and
triangles that were culled take no memory. Both are bounded by the area that is left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..geometry.mesh import Mesh
from ..kernels.background import parts as kernels
from ..kernels.background.captures import EDGE
from ..rig.frame import Texture
from ..support.array_types import F32, I32, I64, U16
from .capture import Capture, Captures, Remains
from .pbs import ProbableBackgroundSurface, Surface

__all__ = ["OlderCaptures", "condense"]

_BLOCK = 32  # pixels: triangles of a capture share a part of its picture by blocks
_ROOM = 2  # pixels round the used ones: those that interpolation reads, of chroma too
_FEW = 4  # remains of one class of sizes are joined when they are more than this
_GROWTH = 4.0  # ratio of the sizes of two classes
_LARGE = 1 << 16  # triangles; larger remains are joined with no others
_THIN = 0.5  # a share of valid triangles below which remains are condensed again


class OlderCaptures:
    """Keeps what surfaces need of older captures, and drops the rest. Needs `pbs.commit` after each call."""

    def __init__(self, pbs: ProbableBackgroundSurface, captures: Captures) -> None:
        self._pbs, self._captures = pbs, captures

    def retire(self, capture: Capture) -> None:
        """Takes over a capture that is no longer its camera's current one. One with a part of the S-PBS is left as it
        is: there is one for each camera at most."""
        if capture.number not in self._pbs.static:
            self._join([capture.number], capture.camera)
        self._tidy(capture.camera)

    def _tidy(self, camera: int) -> None:
        """Condenses remains with few valid triangles, and joins those of about the same size."""
        classes: dict[int, list[int]] = {}
        own = [each for each in self._captures if isinstance(each, Remains) and each.camera == camera]
        for remains in [each for each in own if not each.late]:
            surface = self._pbs.progressive[remains.number]
            count, valid = len(surface.invalid), surface.valid_count
            if valid < _THIN * count:
                self._join([remains.number], camera)
            elif count < _LARGE:
                classes.setdefault(int(math.log(max(count, 1), _GROWTH)), []).append(remains.number)
        for _, numbers in sorted(classes.items()):
            if len(numbers) > _FEW:
                self._join(numbers, camera)

    def _join(self, numbers: Sequence[int], camera: int) -> None:
        """Puts one capture with one surface in place of several, or none if no triangle is left."""
        pbs, captures = self._pbs, self._captures
        surfaces = [pbs.progressive[number] for number in numbers if number in pbs.progressive]
        valid = [surface for surface in surfaces if surface.valid_count]
        made = condense(valid, captures, camera, min(numbers)) if valid else None
        with pbs.lock:
            for number in numbers:
                pbs.remove(number)
                captures.drop(number)
            if made is not None:
                remains, surface = made
                captures.put(remains)
                pbs.put(surface, static=False)


def condense(
    surfaces: Sequence[Surface], captures: Captures, camera: int, number: int
) -> tuple[Remains, Surface]:
    """The valid triangles of surfaces (at least one, of one reference camera) as one surface, and the parts of their
    captures' pictures as one picture, under a number. Points, marks and colours stay as they are."""
    triangles = [surface.mesh.triangles[surface.invalid == 0].astype(np.int64) for surface in surfaces]
    starts = np.cumsum([0, *(len(surface.mesh.points) for surface in surfaces)])
    corners = np.concatenate([t + start for t, start in zip(triangles, starts[:-1], strict=True)])
    points = np.concatenate([surface.mesh.points for surface in surfaces])
    uv = np.concatenate([surface.mesh.uv for surface in surfaces])
    parts, part = _parts(uv, corners, np.repeat(np.arange(len(surfaces)), [len(t) for t in triangles]))
    parts[:, kernels.SOURCE] = np.array([surface.capture for surface in surfaces])[parts[:, kernels.SOURCE]]
    width, height = _place(parts)
    order, numbers, used = _renumbered(corners, part, len(parts), len(points))
    shift = parts[:, [kernels.COLUMN, kernels.ROW]] - parts[:, [kernels.LEFT, kernels.TOP]]
    moved = (uv[used[:, 1]] + shift[used[:, 0]]).astype(np.float32)
    marks = np.concatenate([surface.marks[surface.invalid == 0] for surface in surfaces])
    made = Surface.new(Mesh(points[used[:, 1]], moved, numbers), marks.shape[1], camera, number)
    made.marks[:] = marks[order]
    texture, codes = _copied(parts, captures.table, width, height)
    edge = int(captures.table[surfaces[0].capture, EDGE])
    return Remains(number, camera, codes, texture, edge, 2 * _ROOM), made


def _parts(uv: F32, corners: I64, source: I64) -> tuple[I64, I64]:
    """The parts of pictures that triangles use, [n, PART_SIZE] without their new places, and the number [m] of each
    triangle's part. uv [vertices, 2]; corners [m, 3]; source [m]: number of the triangle's picture, from 0 on."""
    low, high = (np.floor(end(axis=0) / _BLOCK).astype(np.int64) for end in (uv.min, uv.max))
    size = high - low + 1
    blocks = np.empty(len(corners), np.int64)
    kernels.find_blocks(uv, corners, source, _BLOCK, low, size, blocks)
    there = np.bincount(blocks) > 0
    part = (np.cumsum(there) - 1)[blocks]
    found = np.flatnonzero(there)
    bounds = np.empty((len(found), 4), np.float32)
    kernels.bound_parts(uv, corners, part, bounds)
    begin = (np.floor(bounds[:, :2] - 0.5).astype(np.int64) - _ROOM) // 2 * 2
    end = -(-(np.ceil(bounds[:, 2:] - 0.5).astype(np.int64) + _ROOM + 1) // 2) * 2
    parts = np.zeros((len(found), kernels.PART_SIZE), np.int64)
    parts[:, kernels.SOURCE] = found // (size[0] * size[1])
    parts[:, [kernels.LEFT, kernels.TOP]] = begin
    parts[:, [kernels.WIDE, kernels.HIGH]] = end - begin
    return parts, part


def _renumbered(corners: I64, part: I64, parts: int, vertices: int) -> tuple[I64, I32, I64]:
    """Triangles part by part: their order [m], their corners [m, 3] in new numbers, and part and vertex [n, 2] of each
    new number. A vertex of triangles of several parts has a number in each of them."""
    starts = np.cumsum(np.bincount(part, minlength=parts)) - np.bincount(part, minlength=parts)
    order, numbers = np.empty(len(corners), np.int64), np.empty(corners.shape, np.int32)
    used = np.empty((corners.size, 2), np.int64)
    count = kernels.renumber(corners, part, starts, np.full(vertices, -1, np.int64), order, numbers, used)
    return order, numbers, used[:count]


def _place(parts: I64) -> tuple[int, int]:
    """Places parts in rows of falling height, in a picture about as wide as high; returns its width and height."""
    sizes = parts[:, [kernels.WIDE, kernels.HIGH]]
    side = max(int(math.sqrt(sizes.prod(axis=1).sum())), int(sizes[:, 0].max()))
    x = y = below = width = 0
    places = np.empty((len(parts), 2), np.int64)
    for k in np.argsort(-sizes[:, 1], kind="stable").tolist():
        wide, high = sizes[k].tolist()
        if x == 0 or x + wide > side:
            x, y, below = 0, below, below + high
        places[k] = x, y
        x += wide
        width = max(width, x)
    parts[:, [kernels.COLUMN, kernels.ROW]] = places
    return width, below


def _copied(parts: I64, table: I64, width: int, height: int) -> tuple[Texture, U16]:
    """The picture that is made of parts of captures' pictures (table: `Captures.table`), and its codes."""
    half = (height // 2, width // 2)
    y, cb, cr = (np.zeros(shape, np.uint16) for shape in ((height, width), half, half))
    codes = np.zeros((height, width), np.uint16)
    kernels.copy_parts(table, parts, codes, y, cb, cr)
    return Texture(y, cb, cr), codes
