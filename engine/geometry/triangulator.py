"""Triangle meshes of one camera's views, frame after frame: blocks in which nothing has changed are kept."""

from __future__ import annotations

import math
import threading

import numpy as np
import numpy.typing as npt

from ..kernels.geometry import changes as change_kernels
from ..kernels.geometry import splits as split_kernels
from ..kernels.geometry import triangulate as kernels
from ..rig.camera import Camera
from .mesh import Mesh
from .view_blocks import Blocks, TriangulationOptions, check, join, mark_cuts, mesh_of, split, tiling

__all__ = ["Triangulator"]

_BLOCK = split_kernels.BLOCK


class Triangulator:
    """Triangulates the views of one camera, frame after frame, with the result of `triangulate`, but for `uv`, which
    drawing does not need. It reuses blocks of pixels if neither they nor their surroundings have changed since the last
    frame.

    Threads may share it.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._key: tuple[Camera, TriangulationOptions, tuple[float, ...]] | None = None  # of all fields below
        self._codes = np.empty((0, 0), np.uint16)  # of the last frame
        self._flags = np.empty((0, 0), np.uint8)
        self._wanted: Blocks  # splits that each block needs by itself, before neighbours are joined
        self._blocks: Blocks
        self._mesh: Mesh
        self._rims: Mesh | None = None
        self._since_rims: npt.NDArray[np.uint8]  # blocks that have changed since the rims were made

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
        check("codes", codes, (camera.height, camera.width), np.uint16)
        place = np.asarray(origin, np.float64)
        key = camera, options, (float(place[0]), float(place[1]), float(place[2]))
        with self._lock:
            known, self._key = self._key == key, None  # nothing is known if this fails
            if not known:
                self._codes, self._flags = np.empty_like(codes), np.empty(codes.shape, np.uint8)
                self._wanted, self._rims = Blocks(camera), None
            changed = self._changes(camera, codes, known)
            if known and not changed.any():
                self._key = key
                return self._mesh, self._flags
            flags = self._flags.copy()
            wanted = np.empty(tiling(*codes.shape), np.uint8)
            change_kernels.changed_flags(changed, wanted)
            mark_cuts(camera, codes, options, None, wanted, flags)
            split(camera, codes, flags, options, changed, self._wanted)
            blocks = Blocks(camera, self._wanted)
            join(camera, blocks.splits)
            remade = changed
            if known:
                remade = np.empty_like(changed)
                change_kernels.remade_blocks(changed, blocks.splits, self._blocks.splits, remade)
            parts = kernels.BOTH if options.extend_edges else kernels.SURFACE
            before = self._mesh if known else None
            mesh = mesh_of(camera, codes, flags, blocks, remade, place, parts, before, uv=False)
            self._flags, self._blocks, self._mesh, self._key = flags, blocks, mesh, key
            if self._rims is not None:
                self._since_rims |= changed
            return mesh, flags

    def rims(self, flags: npt.NDArray[np.uint8]) -> Mesh | None:
        """The rims (see `triangulate`) of the view whose flags `triangulate` has returned; None where that was not the
        last one."""
        with self._lock:
            if self._key is None or flags is not self._flags:
                return None
            (camera, _, origin), before = self._key, self._rims
            remade = np.ones_like(self._blocks.states) if before is None else self._since_rims
            if before is None or remade.any():
                self._rims = mesh_of(
                    camera, self._codes, flags, self._blocks, remade, origin, kernels.RIMS, before, uv=False
                )
                self._since_rims = np.zeros_like(remade)
            return self._rims

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
