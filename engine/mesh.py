"""Triangle meshes of views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

__all__ = ["Mesh"]


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles back-projected from one view (paper Fig. 4), wound alike as the view sees them.

    points float32 [n, 3] relative to the scene origin, metres; uv float32 [n, 2], the source picture's
    coordinates (pixel centres at +0.5); triangles int32 [m, 3].
    """

    points: npt.NDArray[np.float32]
    uv: npt.NDArray[np.float32]
    triangles: npt.NDArray[np.int32]
