"""Triangle meshes of views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..kernels.rendering.blocks import bound_blocks
from ..support.lazy import lazy

__all__ = ["Mesh"]


@dataclass(frozen=True)
class Mesh:
    """Triangles back-projected from one view (paper Fig. 4); all have the same winding as seen from the view.

    points float32 [n, 3] relative to the scene origin, metres; uv float32 [n, 2], the source picture's coordinates
    (pixel centres at +0.5), or [0, 2] if the mesh is only drawn; triangles int32 [m, 3]. block_starts int64 [b + 1, 2]:
    where each block's points and triangles start; a block's triangles use its own points only. None: the mesh is one
    block.
    """

    points: npt.NDArray[np.float32]
    uv: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int32]
    block_starts: npt.NDArray[np.int64] | None = None

    @lazy
    def starts(self) -> npt.NDArray[np.int64]:  # [b + 1, 2]
        """`block_starts`, or the starts of a single block if that is None."""
        if self.block_starts is not None:
            return self.block_starts
        return np.array([[0, 0], [len(self.points), len(self.triangles)]], np.int64)

    @lazy
    def spheres(self) -> npt.NDArray[np.float32]:  # [b, 4]
        """Centre and radius, metres, of a sphere round each block's points; a negative radius for an empty block."""
        count = len(self.starts) - 1
        return self._bound(np.empty((count, 4), np.float32), np.ones(count, np.uint8))

    def take_spheres(self, before: Mesh, remade: npt.NDArray[np.uint8]) -> None:  # [b]
        """Take over the spheres that an earlier mesh has, if it has any, except for blocks that are `remade`."""
        known = before.__dict__.get("spheres")
        if known is not None:
            self.__dict__["spheres"] = self._bound(known.copy(), remade)

    def _bound(
        self, spheres: npt.NDArray[np.float32], which: npt.NDArray[np.uint8]
    ) -> npt.NDArray[np.float32]:  # [b, 4]
        bound_blocks(self.points, self.starts, which, spheres)
        return spheres

    def warm(self) -> None:
        """Compute now everything that is otherwise computed when the mesh is first drawn."""
        _ = self.spheres

    def only(self, which: npt.NDArray[np.bool_]) -> Mesh:  # [m]
        """The triangles of `which`, with the points that they use, in one block."""
        triangles = self.triangles[which]
        used = np.zeros(len(self.points), bool)
        used[triangles] = True
        numbers = np.cumsum(used, dtype=np.int32) - np.int32(1)
        return Mesh(self.points[used], self.uv[used], numbers[triangles])
