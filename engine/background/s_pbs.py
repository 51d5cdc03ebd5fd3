"""Initialisation of the PBS: the S-PBS, from the views of the first frame (section 3.3.2).

Coverage selection chooses the views, and the farther-only test their pixels (`coverage`). These pixels become triangles
(`new_triangles`). Foreground culling follows (`culling`).
"""

from __future__ import annotations

from collections.abc import Sequence

from ..kernels.base.tolerance import Delta
from ..rig.frame import View
from ..support.array_types import F64
from .capture import Captures
from .coverage import Coverage, choose_views
from .new_triangles import NewTriangles
from .pbs import ProbableBackgroundSurface

__all__ = ["gather_triangles"]


def gather_triangles(
    pbs: ProbableBackgroundSurface, captures: Captures, views: Sequence[View], new_triangles: NewTriangles,
    n_init: int, delta: Delta, origin: F64,
) -> list[int]:  # fmt: skip
    """Puts into the S-PBS the triangles of up to n_init (n_rv^init) views that overlap little: of each view only the
    surfaces that no earlier one shows. Returns the views' indices; views that are left out are not among them.
    captures: of the same views; origin: the scene's, metres in the world. Needs `pbs.commit` after."""
    coverage = Coverage(delta, origin)
    there = [c for c, view in enumerate(views) if view.there]
    chosen = [there[k] for k in choose_views([views[c] for c in there], n_init)]
    for c in chosen:
        keep = coverage.keep_farther(views[c], new_triangles.options[c].edge)
        capture = captures.current[c]
        pbs.set_static(capture.number, c, new_triangles.derive(c, capture.image.camera, views[c].codes, keep))
    return chosen
