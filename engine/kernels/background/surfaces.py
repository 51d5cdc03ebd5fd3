"""The surfaces of the PBS for kernels: one mesh as arrays, or all of them through a table of addresses."""

from __future__ import annotations

from typing import NamedTuple

from ...support.array_types import F32, I32

__all__ = [
    "CAMERA",
    "CAPTURE",
    "LATE",
    "MARKS",
    "MARKS_SIZE",
    "POINTS",
    "SURFACE_SIZE",
    "TRIANGLES",
    "UV",
    "WORDS",
    "Triangles",
]

# A table of surfaces is int64 [geometries, SURFACE_SIZE]: addresses of a surface's triangles, uv and points, its
# reference camera, the capture of its colours, and whether it is a late layer (`background.late_layers`; 0 or 1).
TRIANGLES, UV, POINTS, CAMERA, CAPTURE, LATE = range(6)
SURFACE_SIZE = 6
# A table of marks is int64 [geometries, MARKS_SIZE]: the address of a surface's marks (uint64), and the number of words
# from one triangle's marks to the next one's. Ray callbacks read it (`embree_callbacks.mark_and_pass`).
MARKS, WORDS = range(2)
MARKS_SIZE = 2


class Triangles(NamedTuple):
    """A mesh as kernels take it."""

    points: F32  # [n, 3], metres, relative to the scene origin
    uv: F32  # [n, 2], in the picture that the mesh stems from
    triangles: I32  # [m, 3]
