"""Which views build the S-PBS, and which of their pixels (section 3.3.2)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .. import threads as _threads  # noqa: F401 (the threading layer, before the first parallel kernel)
from ..frame import View
from ..kernels.coverage import keep_farther
from .maximum_depth import coding_row

__all__ = ["choose_views", "farther_pixels"]

# Views are warped as a grid of about this many samples a side into as many cells, not pixel by pixel: the order
# of the views asks for the share of a picture that is covered, not for its outline.
_SAMPLES = 128
_CELLS = 64


def choose_views(views: Sequence[View], count: int) -> list[int]:
    """Indices of up to `count` views that overlap little, the first view first.

    Next is always the view whose picture the chosen ones, warped into it, cover least.
    """
    chosen: list[int] = []
    covered = np.zeros((len(views), _CELLS, _CELLS), bool)
    for _ in range(min(count, len(views))):
        share = covered.mean(axis=(1, 2))
        share[chosen] = np.inf
        chosen.append(int(np.argmin(share)))
        points = _sample_points(views[chosen[-1]])
        for i, view in enumerate(views):
            if i not in chosen:
                _cover(view, points, covered[i])
    return chosen


def _sample_points(view: View) -> npt.NDArray[np.float64]:  # [n, 3]
    """World points of a grid of the view's valid pixels."""
    h, w = view.codes.shape
    rows = np.arange(0, h, max(1, math.ceil(h / _SAMPLES)))
    columns = np.arange(0, w, max(1, math.ceil(w / _SAMPLES)))
    depth = view.camera.depth.depth(view.codes[np.ix_(rows, columns)])
    v, u = np.meshgrid(rows + 0.5, columns + 0.5, indexing="ij")
    valid = np.isfinite(depth)
    return view.camera.unproject(np.stack([u, v], axis=-1)[valid], depth[valid])


def _cover(view: View, points: npt.NDArray[np.float64], cells: npt.NDArray[np.bool_]) -> None:
    """Sets the cells [n, n] of a view's picture that points of the world fall into."""
    uv, depth = view.camera.project(points)
    with np.errstate(invalid="ignore"):
        at = np.floor(uv / (view.camera.width, view.camera.height) * cells.shape[0])
        inside = (depth > 0) & np.all((at >= 0) & (at < cells.shape[0]), axis=-1)
    columns, rows = at[inside].astype(np.int64).T
    cells[rows, columns] = True


def farther_pixels(
    view: View, earlier: Sequence[View], tolerance_m: float, origin: npt.ArrayLike = (0.0, 0.0, 0.0)
) -> npt.NDArray[np.uint8]:  # [h, w]
    """1 where the view shows a surface that no earlier view shows, nor anything about as far or farther there."""
    keep = np.ones(view.codes.shape, np.uint8)
    for other in earlier:
        keep_farther(
            view.codes, view.camera.packed(origin), coding_row(view.camera),
            other.codes, other.camera.packed(origin), coding_row(other.camera), tolerance_m, keep,
        )  # fmt: skip
    return keep
