"""Update of the P-PBS (section 3.3.3): a reference camera's turn.

The paper merges new triangles with those of the P-PBS into a temporary P-PBS, culls that, and compacts the rest.
There is no temporary P-PBS here. A camera's part of the P-PBS is derived anew as a whole from its maximum depth image
and the pixels that the triangle filter has accepted (KEPT), and inherits the marks of the triangles before. When
culling removes triangles, their pixels lose KEPT in the camera's next turn. So slivers of successive frames merge, and
the size of the P-PBS is bounded by the visible area, however long the video is.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from ..kernels.background.p_pbs import clear_culled, inherit_marks, paint_triangles
from ..settings import Settings
from ..support.array_types import B1, I32
from ..support.stages import timed
from .capture import Capture
from .changed_directions import ChangedDirections
from .maximum_depth import BLOCK
from .new_triangles import NewTriangles
from .newly_visible import newly_visible
from .pbs import ProbableBackgroundSurface, Surface
from .report import UpdateReport
from .tolerances import Tolerances
from .triangle_filter import filter_updated

__all__ = ["ProgressiveUpdate"]

# A share of the picture: fewer newly visible pixels do not make a capture that has to be kept.
_FEW = 2e-3


class ProgressiveUpdate:
    """Derives the parts of the P-PBS of `count` reference cameras. changed: receives the new geometry."""

    def __init__(
        self, pbs: ProbableBackgroundSurface, new_triangles: NewTriangles, changed: ChangedDirections,
        settings: Settings, count: int,
    ) -> None:  # fmt: skip
        self._pbs, self._new_triangles, self._changed = pbs, new_triangles, changed
        self._neighbours = settings.filter_neighbours
        self.rounds = [1] * count  # rounds of fusion at the last time that each camera's points were moved
        self._scratch: dict[tuple[int, ...], I32] = {}

    def take_turn(self, capture: Capture, tolerances: Tolerances, report: UpdateReport) -> None:
        """Filters the pixels updated since the camera's last turn, and derives its part of the P-PBS anew."""
        image, before = capture.image, self._pbs.progressive.get(capture.number)
        culled = before is not None and before.valid_count < len(before.invalid)
        # Twice the frames: noise has fallen by the square root of two.
        fused = tolerances.noise > 0 and image.rounds >= 2 * self.rounds[capture.camera]
        if not (image.pending.any() or culled or fused):
            return
        version = self._pbs.version
        with self._painted(capture, before) as numbers:
            with timed(report.stages, "filter"):
                if before is not None and culled:
                    clear_culled(before.packed, before.invalid, image.camera.wraps, numbers, image.flags)
                changed = filter_updated(self._pbs.tracer, capture, tolerances.delta, self._neighbours, report)
            if culled or changed.any():
                with timed(report.stages, "triangulate"):
                    self._derive(capture, before, numbers, changed)
        if fused:
            with timed(report.stages, "triangulate"):
                self.rounds[capture.camera] = image.rounds
                self._pbs.move(capture.number, lambda mesh: image.settled(mesh, capture.packed))
                self._changed.add_all()
        if self._pbs.version != version:
            with timed(report.stages, "commit"):  # before the next camera's rays
                self._pbs.commit()

    def begin(self, capture: Capture, before: Capture, tolerances: Tolerances, report: UpdateReport) -> None:
        """The first turn of a capture of a camera that has moved since its capture `before` (section 4.2): pixels that
        show what `before` did not are filtered by rays, and those farther than the PBS become the capture's part of the
        P-PBS. If they are few, they wait for the camera's next turn. Needs `pbs.commit` after."""
        image = capture.image
        self.rounds[capture.camera] = 1
        with timed(report.stages, "filter"):
            image.suggest(newly_visible(capture, before, tolerances.delta))
            filter_updated(self._pbs.tracer, capture, tolerances.delta, self._neighbours, report)
            kept = image.kept
            if np.count_nonzero(kept) < _FEW * kept.size:
                image.postpone()
                return
        with timed(report.stages, "triangulate"):
            mesh = self._new_triangles.derive(capture.camera, image.camera, image.codes, kept)
            surface = self._pbs.set_progressive(capture.number, capture.camera, mesh)
            self._changed.add(surface, np.arange(len(mesh.triangles)))
            report.added += len(mesh.triangles)

    @contextmanager
    def _painted(self, capture: Capture, before: Surface | None) -> Iterator[I32]:  # [h, w]
        """The number of the valid triangle, of a capture's part of the P-PBS, that covers each pixel; -1: none."""
        image = capture.image
        shape = image.codes.shape
        if shape not in self._scratch:
            self._scratch[shape] = np.full(shape, -1, np.int32)
        numbers = self._scratch[shape]
        if before is None:
            yield numbers
            return
        triangles = before.packed, before.invalid.copy(), image.camera.wraps
        paint_triangles(*triangles, False, numbers)
        try:
            yield numbers
        finally:
            paint_triangles(*triangles, True, numbers)  # erases: cheaper than clearing all pixels

    def _derive(self, capture: Capture, before: Surface | None, numbers: I32, changed: B1) -> None:
        """Makes new triangles of the kept pixels; outside the changed blocks they inherit the marks from before."""
        image = capture.image
        mesh = self._new_triangles.derive(capture.camera, image.camera, image.codes, image.kept)
        surface = self._pbs.set_progressive(capture.number, capture.camera, mesh)
        is_new = np.ones(len(mesh.triangles), bool)
        if before is not None:
            inherit_marks(surface.packed, numbers, before.marks, surface.marks, changed, BLOCK, is_new)
        self._changed.add(surface, np.flatnonzero(is_new))
