"""Triangle meshes of views, bounded in error (paper Fig. 4; the bound is ours)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from . import threads as _threads  # noqa: F401 (Numba's threading layer, before the first parallel kernel)
from .camera import Camera, Equirectangular, Perspective
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
    max_block: longest leg of a triangle in pixels, a power of two.
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
        if self.max_block < 1 or self.max_block & (self.max_block - 1):
            raise ValueError(f"max_block: {self.max_block!r}: expected a power of two")


def depth_cuts(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    options: TriangulationOptions,
    keep: npt.NDArray[np.uint8] | None = None,
) -> npt.NDArray[np.uint8]:
    """Flags [h, w] of a view's pixels: where its surface is cut at depth edges, see `kernels.triangulate`."""
    h, w = camera.height, camera.width
    _check("codes", codes, (h, w), np.uint16)
    if keep is not None:
        _check("keep", keep, (h, w), np.uint8)
    flags = np.empty((h, w), np.uint8)
    mask = np.zeros((1, 1), np.uint8) if keep is None else keep
    edge = options.edge / camera.depth.step
    kernels.mark_broken(codes, mask, keep is not None, camera.depth.has_invalid, edge, _wraps(camera), flags)
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
    h, w = camera.height, camera.width
    coding, wraps = camera.depth, _wraps(camera)
    flags = depth_cuts(camera, codes, options, keep) if cuts is None else cuts
    block = max(options.max_block, 2)
    tolerance = max(options.tolerance / coding.step, _ROUNDING_CODES) if options.tolerance > 0 else -1.0
    rows, columns = math.ceil((h - 1) / block), math.ceil((w - (not wraps)) / block)
    error = np.zeros((rows * block + 1, columns * block + 1), np.float32)
    both = kernels.BOTH if options.extend_edges else kernels.SURFACE
    parts = kernels.RIMS if rims else both
    if tolerance > 0 and not rims:
        kernels.split_errors(codes, flags, block, wraps, error)
    counts = np.empty((rows * columns, 2), np.int64)
    kernels.count_block_triangles(flags, error, tolerance, block, wraps, parts, counts)
    starts = np.zeros((rows * columns + 1, 2), np.int64)
    np.cumsum(counts, axis=0, out=starts[1:])
    vertices = np.empty((starts[-1, 0], 6), np.int32)
    triangles = np.empty((starts[-1, 1], 3), np.int32)
    kernels.emit_block_triangles(
        flags, error, tolerance, block, wraps, parts, starts, vertices, triangles
    )
    points = np.empty((len(vertices), 3), np.float32)
    uv = np.empty((len(vertices), 2), np.float32)
    kernels.unproject_vertices(
        codes, camera.packed(origin), coding.offset, coding.step, coding.min_code, vertices, points, uv
    )
    if isinstance(camera.projection, Perspective) and camera.projection.fx * camera.projection.fy < 0:
        triangles = np.ascontiguousarray(triangles[:, [0, 2, 1]])  # a mirrored picture winds the other way
    return Mesh(points, uv, triangles, starts)


def _wraps(camera: Camera) -> bool:
    return isinstance(camera.projection, Equirectangular) and camera.projection.wraps


def _check(name: str, array: npt.NDArray[Any], shape: tuple[int, int], dtype: type) -> None:
    if array.shape != shape or array.dtype != dtype:
        raise ValueError(f"{name}: {array.dtype} {array.shape}: expected {dtype.__name__} {shape}")
