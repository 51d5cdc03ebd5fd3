"""Middle layers: surfaces between the foreground and the farthest background that stay in the model while they stand.

Foreground culling (section 3.3.2) keeps the farthest surfaces only. A table in the middle of a room goes when the
cameras together know the floor behind it; then where someone hides it, its place shows the floor. The paper names this
as a limitation (section 5). Here a triangle that culling would remove stays if no camera has ever seen past it. It has
the mark of no camera (`seeding`), so rays do not ask for it again. It goes when a view shows that it is not there any
more (`stale`).

If there are more of them than the budget allows, those go first that cover the fewest pixels of the picture that they
stem from: each triangle takes the same memory and time, and these show the least. Late layers (`late_layers`) share
the budget.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..geometry.prepared_view import ViewTable
from ..kernels.background.middle_layers import find_never_seen_past, measure_pixels
from ..kernels.base.tolerance import Delta
from ..rig.frame import View
from ..support.array_types import F32, I64
from .capture import Capture, Captures
from .new_triangles import NewTriangles
from .pbs import ProbableBackgroundSurface, Surface
from .reference_cameras import ReferenceCameras

__all__ = ["MiddleLayers"]


class MiddleLayers:
    """Keeps up to `budget` triangles as middle layers; with a budget of 0, none. Surfaces of an earlier model
    (`seeding`) are not among them."""

    def __init__(
        self, pbs: ProbableBackgroundSurface, captures: Captures, cameras: ReferenceCameras,
        new_triangles: NewTriangles, budget: int,
    ) -> None:  # fmt: skip
        self._pbs, self._captures, self._cameras, self.budget = pbs, captures, cameras, budget
        self._new_triangles = new_triangles
        self._word, self._bit = len(cameras) // 64, np.uint64(1 << (len(cameras) % 64))
        self._known: tuple[list[Capture], ViewTable] = [], ViewTable([])

    def keep(self, unmarked: Sequence[tuple[Surface, I64]], delta: Delta) -> list[tuple[Surface, I64]]:
        """Keeps those of the triangles without a mark, by surface, that no camera has ever seen past; returns the
        others."""
        if self.budget == 0 or not any(len(triangles) for _surface, triangles in unmarked):
            return list(unmarked)
        table = self._farthest()
        codes = np.ascontiguousarray(table.addresses[:, 0])
        left, kept = [], 0
        for surface, triangles in unmarked:
            never = np.zeros(len(triangles), np.uint8)
            if len(triangles) and surface.capture not in self._captures.atlases:
                find_never_seen_past(table.rows, codes, surface.packed, triangles, delta, never)
            surface.marks[triangles[never != 0], self._word] |= self._bit
            left.append((surface, triangles[never == 0]))
            kept += int(np.count_nonzero(never))
        return [*left, *self.beyond_budget()] if kept else left

    def _farthest(self) -> ViewTable:
        """The maximum depth images of the cameras that are where their current captures began, as views: they keep
        their addresses for life."""
        cameras = self._cameras.still()
        current = [self._captures.current[c] for c in cameras]
        if self._known[0] != current:
            images = [capture.image for capture in current]
            views = [View(image.camera, image.texture, image.codes) for image in images]
            prepared = [self._new_triangles.prepared(c, view) for c, view in zip(cameras, views, strict=True)]
            self._known = current, ViewTable(prepared)
        return self._known[1]

    def mark(self, surface: Surface) -> None:
        """Gives all triangles of a surface the mark of no camera."""
        surface.marks[:, self._word] |= self._bit

    def beyond_budget(self) -> list[tuple[Surface, I64]]:
        """Takes their mark from the smallest middle and late layers beyond the budget, and returns them, by surface."""
        held = [
            (surface, self._of(surface)) for surface in self._pbs.surfaces()
            if surface.capture not in self._captures.atlases
        ]  # fmt: skip
        beyond = sum(len(triangles) for _surface, triangles in held) - self.budget
        if beyond <= 0:
            return []
        sizes = [_pixels(surface, triangles) for surface, triangles in held]
        goes = np.zeros(sum(map(len, sizes)), bool)
        goes[np.argsort(np.concatenate(sizes), kind="stable")[:beyond]] = True
        ends = np.cumsum([len(size) for size in sizes])
        gone = []
        for (surface, triangles), part in zip(held, np.split(goes, ends[:-1]), strict=True):
            surface.marks[triangles[part], self._word] &= ~self._bit
            gone.append((surface, triangles[part]))
        return gone

    def _of(self, surface: Surface) -> I64:
        """The valid triangles of a surface whose only mark is that of no camera; of a late layer, all valid ones."""
        if surface.late:
            return np.flatnonzero(surface.invalid == 0)
        marks = surface.marks
        alone = (marks[:, self._word] == self._bit) & (np.count_nonzero(marks, axis=1) == 1)
        return np.flatnonzero(alone & (surface.invalid == 0))


def _pixels(surface: Surface, triangles: I64) -> F32:
    pixels = np.empty(len(triangles), np.float32)
    measure_pixels(surface.packed, triangles, pixels)
    return pixels
