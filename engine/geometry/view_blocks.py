"""The blocks of a view's triangulation: their cuts, their splits and their meshes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..kernels.base.lanes import LANES
from ..kernels.geometry import changes as change_kernels
from ..kernels.geometry import cuts as cut_kernels
from ..kernels.geometry import splits as split_kernels
from ..kernels.geometry import triangulate as kernels
from ..kernels.geometry.records import BlockArrays, DepthMap, MeshArrays
from ..rig.camera import Camera, Perspective
from .half_pixels import half_pixel_rays
from .mesh import Mesh

__all__ = [
    "Blocks",
    "TriangulationOptions",
    "block_grid",
    "check",
    "flags_of",
    "join",
    "mark_cuts",
    "mesh_of",
    "split",
    "tiling",
]

_BLOCK = split_kernels.BLOCK

# The error bound is at least this: codes are rounded, at both ends of a triangle's side.
_ROUNDING_CODES = 1.0


@dataclass(frozen=True, slots=True)
class TriangulationOptions:
    """Bounds of a triangulation; disparities in 1/m.

    tolerance: largest distance between a pixel's disparity and its triangle; 0: two triangles per pixel.
    edge: disparity step between neighbouring pixels that is a depth edge, unless the slope on one side explains it.
    max_block: longest leg of a triangle in pixels, a power of two up to 32.
    extend_edges: pixels at depth edges keep their full square; otherwise the surface ends at their centres.
    """

    tolerance: float
    edge: float
    max_block: int = 32
    extend_edges: bool = False

    def __post_init__(self) -> None:
        for name in ("tolerance", "edge"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name}: {getattr(self, name)!r}: expected a disparity of at least 0")
        if not 1 <= self.max_block <= _BLOCK or self.max_block & (self.max_block - 1):
            raise ValueError(f"max_block: {self.max_block!r}: expected a power of two up to {_BLOCK}")


def block_grid(camera: Camera) -> tuple[int, int]:
    """Rows and columns of a view's blocks."""
    return math.ceil((camera.height - 1) / _BLOCK), math.ceil((camera.width - (not camera.wraps)) / _BLOCK)


class Blocks:
    """Splits [rows, columns, WORDS] of a view's blocks, and the blocks' states [rows, columns]."""

    def __init__(self, camera: Camera, like: Blocks | None = None) -> None:
        rows, columns = block_grid(camera)
        self.splits = np.empty((rows, columns, split_kernels.WORDS), np.int64)
        self.states = np.empty((rows, columns), np.uint8)
        if like is not None:
            self.splits[:], self.states[:] = like.splits, like.states


def flags_of(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    options: TriangulationOptions,
    keep: npt.NDArray[np.uint8] | None,
    made: npt.NDArray[np.uint8],
) -> npt.NDArray[np.uint8]:  # [h, w]
    """Flags of the pixels of the blocks with made != 0, and of the pixels round them; undefined elsewhere."""
    shape = camera.height, camera.width
    check("codes", codes, shape, np.uint16)
    if keep is not None:
        check("keep", keep, shape, np.uint8)
    flags, wanted = np.empty(shape, np.uint8), np.empty(tiling(*shape), np.uint8)
    change_kernels.changed_flags(made, wanted)
    mark_cuts(camera, codes, options, keep, wanted, flags)
    return flags


def mark_cuts(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    options: TriangulationOptions,
    keep: npt.NDArray[np.uint8] | None,
    wanted: npt.NDArray[np.uint8],
    flags: npt.NDArray[np.uint8],
) -> None:
    """Find the flags [h, w] of the `wanted` tiles (`tiling`); the other flags stay."""
    mask, coding = np.zeros((1, 1), np.uint8) if keep is None else keep, camera.depth
    edge = options.edge / coding.step
    cut_kernels.mark_broken(codes, mask, keep is not None, coding.has_invalid, edge, camera.wraps, wanted, flags)


def split(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    flags: npt.NDArray[np.uint8],
    options: TriangulationOptions,
    changed: npt.NDArray[np.uint8],
    blocks: Blocks,
) -> None:
    """Find the splits that changed blocks need by themselves."""
    # The bound is for twice the distances, which are whole numbers; the distance of two codes is below 65535.
    tolerance = math.floor(min(2 * max(options.tolerance / camera.depth.step, _ROUNDING_CODES), 65534))
    largest = options.max_block if options.tolerance > 0 else 1
    split_kernels.split_blocks(
        codes, flags, tolerance, largest, camera.wraps, changed, blocks.splits, blocks.states
    )


def join(camera: Camera, splits: npt.NDArray[np.int64]) -> None:
    """Give blocks the splits that their neighbours need on the sides that they share."""
    seam = camera.width - (splits.shape[1] - 1) * _BLOCK if camera.wraps else 0
    split_kernels.join_blocks(splits, seam)


def mesh_of(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    flags: npt.NDArray[np.uint8],
    blocks: Blocks,
    remade: npt.NDArray[np.uint8],
    origin: npt.ArrayLike,
    parts: int,
    before: Mesh | None = None,
    *,
    uv: bool = True,
) -> Mesh:
    """Make the triangles of the blocks with remade != 0; the others are copied from `before`. Without `uv`, they have
    no places in the picture: only colouring needs these."""
    states = blocks.states
    if before is None:
        nothing = np.empty((0, 3), np.float32), np.empty((0, 2), np.float32), np.empty((0, 3), np.int32)
        before = Mesh(*nothing, np.zeros((states.size + 1, 2), np.int64))
    used = np.empty((*states.shape, split_kernels.SIDE), np.int64)
    depth, arrays = DepthMap(codes, flags, camera.wraps), BlockArrays(blocks.splits, states, remade, used)
    counts = np.diff(before.starts, axis=0) if before.block_starts is not None else np.zeros((states.size, 2), np.int64)
    kernels.count_triangles(depth, arrays, parts, counts)
    starts = np.zeros((states.size + 1, 2), np.int64)
    np.cumsum(counts, axis=0, out=starts[1:])
    (points, triangles), projection = starts[-1].tolist(), camera.projection
    mesh = MeshArrays(
        np.empty((points, 3), np.float32), np.empty((points if uv else 0, 2), np.float32),
        np.empty((triangles, 3), np.int32),
    )  # fmt: skip
    mirrored = isinstance(projection, Perspective) and projection.fx * projection.fy < 0
    kernels.emit_triangles(
        depth, arrays, parts, starts, camera.depth.packed(), half_pixel_rays(camera, origin), 2 if mirrored else 1,
        mesh, before.starts, MeshArrays(before.points, before.uv, before.triangles),
    )  # fmt: skip
    made = Mesh(*mesh, starts)
    made.take_spheres(before, remade.ravel())
    return made


def tiling(h: int, w: int) -> tuple[int, int]:
    """Tiles of 64 x 64 pixels, as `kernels.geometry.cuts` takes them."""
    return math.ceil(h / LANES), math.ceil(w / LANES)


def check(name: str, array: npt.NDArray[Any], shape: tuple[int, int], dtype: type) -> None:
    """Raise ValueError unless an array has this shape and type and is C-contiguous."""
    if array.shape != shape or array.dtype != dtype:
        raise ValueError(f"{name}: {array.dtype} {array.shape}: expected {dtype.__name__} {shape}")
    if not array.flags.c_contiguous:  # kernels read rows by address
        raise ValueError(f"{name}: strides {array.strides}: expected a C-contiguous array")
