"""Triangle meshes of views, bounded in error (paper Fig. 4; the bound is ours)."""

from __future__ import annotations

import math
import threading
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

__all__ = ["TriangulationOptions", "Triangulator", "depth_cuts", "triangulate"]

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


def depth_cuts(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    options: TriangulationOptions,
    keep: npt.NDArray[np.uint8] | None = None,
) -> npt.NDArray[np.uint8]:
    """Flags [h, w]: where a view's surface is cut (`kernels.geometry.cuts`); arguments and errors of `triangulate`."""
    return _cuts(camera, codes, options, keep, np.ones(_block_grid(camera), np.uint8))


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

    With `rims`, the mesh is only the parts of the squares of pixels at depth edges that the surface does not cover.
    `cuts` is the result of `depth_cuts` for the same arguments, if known.

    With `keep` (uint8 [h, w]), only triangles with at least one kept pixel are made (section 3.3.3), and no merged
    triangle spans kept and other pixels. Points are relative to `origin`, metres. Raises ValueError for arrays of
    another shape or type, or that are not C-contiguous.
    """
    blocks = _Blocks(camera)
    made = np.ones_like(blocks.states)
    if keep is not None and cuts is None:  # few pixels may be kept: make only their blocks
        _check("keep", keep, (camera.height, camera.width), np.uint8)
        change_kernels.kept_blocks(keep, camera.wraps, made)
        blocks.splits[made == 0] = 0
    if cuts is not None:
        _check("codes", codes, (camera.height, camera.width), np.uint16)
        _check("cuts", cuts, (camera.height, camera.width), np.uint8)
    flags = _cuts(camera, codes, options, keep, made) if cuts is None else cuts
    if rims:  # finding rims needs no splits
        split_kernels.find_mixed(flags, blocks.states)
        return _mesh(camera, codes, flags, blocks, made, origin, kernels.RIMS)
    _split(camera, codes, flags, options, made, blocks)
    _join(camera, blocks.splits)
    parts = kernels.BOTH if options.extend_edges else kernels.SURFACE
    return _mesh(camera, codes, flags, blocks, made, origin, parts)


class Triangulator:
    """Triangulates the views of one camera, frame after frame, with the result of `triangulate`. It reuses blocks of
    pixels if neither they nor their surroundings have changed since the last frame.

    Threads may share it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._key: tuple[Camera, TriangulationOptions, tuple[float, ...]] | None = None  # of all fields below
        self._codes = np.empty((0, 0), np.uint16)  # of the last frame
        self._flags = np.empty((0, 0), np.uint8)
        self._wanted: _Blocks  # splits that each block needs by itself, before neighbours are joined
        self._blocks: _Blocks
        self._mesh: Mesh

    def triangulate(
        self,
        camera: Camera,
        codes: npt.NDArray[np.uint16],
        options: TriangulationOptions,
        origin: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> tuple[Mesh, npt.NDArray[np.uint8]]:
        """The mesh of depth codes [h, w], and their flags [h, w] (see `depth_cuts`); later calls change neither.

        Raises ValueError for codes of another shape or type, or that are not C-contiguous.
        """
        _check("codes", codes, (camera.height, camera.width), np.uint16)
        place = np.asarray(origin, np.float64)
        key = camera, options, (float(place[0]), float(place[1]), float(place[2]))
        with self._lock:
            known, self._key = self._key == key, None  # nothing is known if this fails
            if not known:
                self._codes, self._flags = np.empty_like(codes), np.empty(codes.shape, np.uint8)
                self._wanted = _Blocks(camera)
            changed = self._changes(camera, codes, known)
            if known and not changed.any():
                self._key = key
                return self._mesh, self._flags
            flags = self._flags.copy()
            wanted = np.empty(_tiling(*codes.shape), np.uint8)
            change_kernels.changed_flags(changed, wanted)
            _mark_cuts(camera, codes, options, None, wanted, flags)
            _split(camera, codes, flags, options, changed, self._wanted)
            blocks = _Blocks(camera, self._wanted)
            _join(camera, blocks.splits)
            remade = changed
            if known:
                remade = np.empty_like(changed)
                change_kernels.remade_blocks(changed, blocks.splits, self._blocks.splits, remade)
            parts = kernels.BOTH if options.extend_edges else kernels.SURFACE
            mesh = _mesh(camera, codes, flags, blocks, remade, place, parts, self._mesh if known else None)
            self._flags, self._blocks, self._mesh, self._key = flags, blocks, mesh, key
            return mesh, flags

    def _changes(
        self, camera: Camera, codes: npt.NDArray[np.uint16], known: bool
    ) -> npt.NDArray[np.uint8]:  # [rows, columns]
        """Which blocks have changed since the last frame; keeps this frame as the last one."""
        changed = np.ones_like(self._wanted.states)
        h, w, wraps = camera.height, camera.width, camera.wraps
        if not known:
            self._codes[:] = codes
            return changed
        tiles = np.empty((math.ceil(h / _BLOCK), 3, math.ceil(w / _BLOCK)), np.uint8)
        change_kernels.note_changes(codes, self._codes, tiles)
        if not (wraps and 0 < w % _BLOCK < 3):  # else a block's surroundings reach beyond its neighbours
            change_kernels.changed_blocks(tiles, wraps, changed)
        return changed


def _block_grid(camera: Camera) -> tuple[int, int]:
    """Rows and columns of a view's blocks."""
    return math.ceil((camera.height - 1) / _BLOCK), math.ceil((camera.width - (not camera.wraps)) / _BLOCK)


class _Blocks:
    """Splits [rows, columns, WORDS] of a view's blocks, and the blocks' states [rows, columns]."""

    def __init__(self, camera: Camera, like: _Blocks | None = None) -> None:
        rows, columns = _block_grid(camera)
        self.splits = np.empty((rows, columns, split_kernels.WORDS), np.int64)
        self.states = np.empty((rows, columns), np.uint8)
        if like is not None:
            self.splits[:], self.states[:] = like.splits, like.states


def _cuts(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    options: TriangulationOptions,
    keep: npt.NDArray[np.uint8] | None,
    made: npt.NDArray[np.uint8],
) -> npt.NDArray[np.uint8]:  # [h, w]
    """Flags of the pixels of the blocks with made != 0, and of the pixels round them; undefined elsewhere."""
    shape = camera.height, camera.width
    _check("codes", codes, shape, np.uint16)
    if keep is not None:
        _check("keep", keep, shape, np.uint8)
    flags, wanted = np.empty(shape, np.uint8), np.empty(_tiling(*shape), np.uint8)
    change_kernels.changed_flags(made, wanted)
    _mark_cuts(camera, codes, options, keep, wanted, flags)
    return flags


def _mark_cuts(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    options: TriangulationOptions,
    keep: npt.NDArray[np.uint8] | None,
    wanted: npt.NDArray[np.uint8],
    flags: npt.NDArray[np.uint8],
) -> None:
    mask, coding = np.zeros((1, 1), np.uint8) if keep is None else keep, camera.depth
    edge = options.edge / coding.step
    cut_kernels.mark_broken(codes, mask, keep is not None, coding.has_invalid, edge, camera.wraps, wanted, flags)


def _split(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    flags: npt.NDArray[np.uint8],
    options: TriangulationOptions,
    changed: npt.NDArray[np.uint8],
    blocks: _Blocks,
) -> None:
    """Find the splits that changed blocks need by themselves."""
    # The bound is for twice the distances, which are whole numbers; the distance of two codes is below 65535.
    tolerance = math.floor(min(2 * max(options.tolerance / camera.depth.step, _ROUNDING_CODES), 65534))
    largest = options.max_block if options.tolerance > 0 else 1
    split_kernels.split_blocks(
        codes, flags, tolerance, largest, camera.wraps, changed, blocks.splits, blocks.states
    )


def _join(camera: Camera, splits: npt.NDArray[np.int64]) -> None:
    seam = camera.width - (splits.shape[1] - 1) * _BLOCK if camera.wraps else 0
    split_kernels.join_blocks(splits, seam)


def _mesh(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    flags: npt.NDArray[np.uint8],
    blocks: _Blocks,
    remade: npt.NDArray[np.uint8],
    origin: npt.ArrayLike,
    parts: int,
    before: Mesh | None = None,
) -> Mesh:
    """Make the triangles of the blocks with remade != 0; the others are copied from `before`."""
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
        np.empty((points, 3), np.float32), np.empty((points, 2), np.float32), np.empty((triangles, 3), np.int32)
    )
    mirrored = isinstance(projection, Perspective) and projection.fx * projection.fy < 0
    kernels.emit_triangles(
        depth, arrays, parts, starts, camera.depth.packed(), half_pixel_rays(camera, origin), 2 if mirrored else 1,
        mesh, before.starts, MeshArrays(before.points, before.uv, before.triangles),
    )  # fmt: skip
    return Mesh(*mesh, starts)


def _tiling(h: int, w: int) -> tuple[int, int]:
    """Tiles of 64 x 64 pixels, as `kernels.geometry.cuts` takes them."""
    return math.ceil(h / LANES), math.ceil(w / LANES)


def _check(name: str, array: npt.NDArray[Any], shape: tuple[int, int], dtype: type) -> None:
    if array.shape != shape or array.dtype != dtype:
        raise ValueError(f"{name}: {array.dtype} {array.shape}: expected {dtype.__name__} {shape}")
    if not array.flags.c_contiguous:  # kernels read rows by address
        raise ValueError(f"{name}: strides {array.strides}: expected a C-contiguous array")
