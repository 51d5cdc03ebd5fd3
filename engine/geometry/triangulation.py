"""Triangle meshes of views, bounded in error (paper Fig. 4; the bound is ours)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..kernels.geometry import changes as change_kernels
from ..kernels.geometry import splits as split_kernels
from ..kernels.geometry import triangulate as kernels
from ..rig.camera import Camera
from .mesh import Mesh
from .view_blocks import Blocks, TriangulationOptions, block_grid, check, flags_of, join, mesh_of, split

__all__ = ["TriangulationOptions", "depth_cuts", "triangulate"]


def depth_cuts(
    camera: Camera,
    codes: npt.NDArray[np.uint16],
    options: TriangulationOptions,
    keep: npt.NDArray[np.uint8] | None = None,
) -> npt.NDArray[np.uint8]:
    """Flags [h, w]: where a view's surface is cut (`kernels.geometry.cuts`); arguments and errors of `triangulate`."""
    return flags_of(camera, codes, options, keep, np.ones(block_grid(camera), np.uint8))


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
    blocks = Blocks(camera)
    made = np.ones_like(blocks.states)
    if keep is not None and cuts is None:  # few pixels may be kept: make only their blocks
        check("keep", keep, (camera.height, camera.width), np.uint8)
        change_kernels.kept_blocks(keep, camera.wraps, made)
        blocks.splits[made == 0] = 0
    if cuts is not None:
        check("codes", codes, (camera.height, camera.width), np.uint16)
        check("cuts", cuts, (camera.height, camera.width), np.uint8)
    flags = flags_of(camera, codes, options, keep, made) if cuts is None else cuts
    if rims:  # finding rims needs no splits
        split_kernels.find_mixed(flags, blocks.states)
        return mesh_of(camera, codes, flags, blocks, made, origin, kernels.RIMS)
    split(camera, codes, flags, options, made, blocks)
    join(camera, blocks.splits)
    parts = kernels.BOTH if options.extend_edges else kernels.SURFACE
    return mesh_of(camera, codes, flags, blocks, made, origin, parts)
