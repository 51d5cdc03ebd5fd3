"""Triangle meshes of views, bounded in error (paper Fig. 4; the bound is ours)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from . import threads as _threads  # noqa: F401 (Numba's threading layer, before the first parallel kernel)
from .camera import Camera, Equirectangular, Perspective
from .kernels import cuts as cut_kernels
from .kernels import splits as split_kernels
from .kernels import triangulate as kernels
from .mesh import Mesh

__all__ = ["TriangulationOptions", "depth_cuts", "triangulate"]

# A coarse code cannot be followed closer than to its own rounding, on both ends of a triangle's side.
_ROUNDING_CODES = 1.0


@dataclass(frozen=True, slots=True)
class TriangulationOptions:
    """Bounds of a triangulation; disparities in 1/m.

    tolerance: largest distance between a pixel's disparity and its triangle; 0 gives two triangles a quad.
    edge: disparity step between neighbouring pixels that is a depth edge unless the slope on a side explains it.
    max_block: longest leg of a triangle in pixels, a power of two up to 32.
    extend_edges: pixels at depth edges keep their full square instead of ending at their centre.
    """

    tolerance: float
    edge: float
    max_block: int = 32
    extend_edges: bool = False

    def __post_init__(self) -> None:
        for name in ("tolerance", "edge"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: {getattr(self, name)!r}: expected a disparity of at least 0")
        if not 1 <= self.max_block <= split_kernels.BLOCK or self.max_block & (self.max_block - 1):
            raise ValueError(f"max_block: {self.max_block!r}: expected a power of two up to {split_kernels.BLOCK}")


def depth_cuts(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    options: TriangulationOptions,
    keep: npt.NDArray[np.uint8] | None = None,
) -> npt.NDArray[np.uint8]:
    """Flags [h, w] of a view's pixels: where its surface is cut at depth edges, see `kernels.cuts`."""
    h, w = camera.height, camera.width
    _check("codes", codes, (h, w), np.uint16)
    if keep is not None:
        _check("keep", keep, (h, w), np.uint8)
    flags = np.empty((h, w), np.uint8)
    mask = np.zeros((1, 1), np.uint8) if keep is None else keep
    edge = options.edge / camera.depth.step
    cut_kernels.mark_broken(codes, mask, keep is not None, camera.depth.has_invalid, edge, _wraps(camera), flags)
    return flags


def triangulate(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    options: TriangulationOptions,
    *,
    origin: npt.ArrayLike = (0.0, 0.0, 0.0),
    keep: npt.NDArray[np.uint8] | None = None,
    rims: bool = False,
    cuts: npt.NDArray[np.uint8] | None = None,
) -> Mesh:
    """Triangulate a view's depth codes [h, w].

    With `rims` only what the surface leaves of the squares of pixels at depth edges is made. `cuts` is what
    `depth_cuts` gives for the same arguments, if it is known.

    Where `keep` (uint8 [h, w]) is given, only triangles with at least one kept pixel are made (section 3.3.3)
    and no merged triangle spans kept and other pixels. Points are relative to `origin`, metres. Raises ValueError
    for arrays of another shape or type.
    """
    wraps = _wraps(camera)
    flags = depth_cuts(camera, codes, options, keep) if cuts is None else cuts
    both = kernels.BOTH if options.extend_edges else kernels.SURFACE
    parts = kernels.RIMS if rims else both
    splits, states = _splits(camera, codes, flags, options)
    used = np.empty((*states.shape, split_kernels.SIDE), np.int64)
    counts = np.empty((states.size, 2), np.int64)
    kernels.count_triangles(flags, splits, states, wraps, parts, used, counts)
    starts = np.zeros((states.size + 1, 2), np.int64)
    np.cumsum(counts, axis=0, out=starts[1:])
    points = np.empty((starts[-1, 0], 3), np.float32)
    uv = np.empty((starts[-1, 0], 2), np.float32)
    triangles = np.empty((starts[-1, 1], 3), np.int32)
    coding = np.array([camera.depth.offset, camera.depth.step, camera.depth.min_code])
    packed = camera.packed(origin)
    kernels.emit_triangles(
        codes, flags, splits, states, wraps, parts, used, starts, coding, packed, *_directions(camera, packed),
        points, uv, triangles,
    )  # fmt: skip
    if isinstance(camera.projection, Perspective) and camera.projection.fx * camera.projection.fy < 0:
        triangles = np.ascontiguousarray(triangles[:, [0, 2, 1]])  # a mirrored picture winds the other way
    return Mesh(points, uv, triangles, starts)


def _splits(
    camera: Camera, codes: npt.NDArray[np.uint16], flags: npt.NDArray[np.uint8], options: TriangulationOptions
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.uint8]]:
    """Splits [rows, columns, WORDS] of the view's blocks and what is known of their pixels [rows, columns]."""
    h, w, wraps, block = camera.height, camera.width, _wraps(camera), split_kernels.BLOCK
    rows, columns = math.ceil((h - 1) / block), math.ceil((w - (not wraps)) / block)
    splits = np.empty((rows, columns, split_kernels.WORDS), np.int64)
    states = np.empty((rows, columns), np.uint8)
    # Of twice the distances, which are whole; those of a code from any other are below 65535.
    tolerance = math.floor(min(2 * max(options.tolerance / camera.depth.step, _ROUNDING_CODES), 65534))
    largest = options.max_block if options.tolerance > 0 else 1
    split_kernels.split_blocks(codes, flags, tolerance, largest, wraps, splits, states)
    if largest > 1:
        split_kernels.join_blocks(splits, w - (columns - 1) * block if wraps else 0)
    return splits, states


def _directions(
    camera: Camera, packed: npt.NDArray[np.float64]
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Directions of half pixels, across [2 w + 1, 2] and down [2 h - 1, 2] (see `kernels.emit_triangles`)."""
    u, v = 0.5 * np.arange(2 * camera.width + 1) + 0.5, 0.5 * np.arange(2 * camera.height - 1) + 0.5
    if isinstance(camera.projection, Perspective):
        across = np.stack([np.ones_like(u), (packed[5] - u) / packed[3]], axis=-1)
        return across, np.stack([np.ones_like(v), (packed[6] - v) / packed[4]], axis=-1)
    phi, theta = packed[3] - u * packed[4], packed[5] - v * packed[6]
    across, down = (np.stack([np.cos(angle), np.sin(angle)], axis=-1) for angle in (phi, theta))
    return across, down


def _wraps(camera: Camera) -> bool:
    return isinstance(camera.projection, Equirectangular) and camera.projection.wraps


def _check(name: str, array: npt.NDArray[Any], shape: tuple[int, int], dtype: type) -> None:
    if array.shape != shape or array.dtype != dtype:
        raise ValueError(f"{name}: {array.dtype} {array.shape}: expected {dtype.__name__} {shape}")
