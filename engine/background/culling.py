"""Foreground culling: a triangle is not background if no camera's rays from outside the scene find it (section 3.3.2,
Fig. 5).

There are two ways to cast these rays.

- By triangle, the default (`Settings.culling_stride` 0; `RayTracer.mark_by_triangle`): rays go through points of the
  triangles that have no mark yet. This asks the same question from the triangle's side, with far fewer rays. Here,
  surfaces within half of the complementary ray's delta do not count as being behind a triangle.
- By pixel, as in the paper (`culling_stride` 1; `RayTracer.mark_by_pixel`): two rays for each pixel of the reference
  cameras, each followed by a *complementary ray* (Fig. 6a) from delta / 2 before the closest hit to delta / 2 behind
  it, which marks every triangle that it meets. Rays by pixel miss some triangles that are smaller than a pixel, so
  triangles that are still without a mark then get rays by triangle; with `Settings.rays_by_triangle` False they get
  none, as in the paper.

Each camera owns one bit of every triangle's marks. In the camera's turn only this bit is renewed. With one group of
cameras per frame, a triangle therefore stays until every camera has had its turn without finding it. A flagged triangle
of the S-PBS stays flagged, as in the paper: rays no longer see it, so none can mark it again.

A camera that moves (section 4.2) casts rays from where it is in its turn, and its marks are not renewed: elsewhere it
may see something else behind a triangle, or not the triangle, while from the former place the triangle is background
as before. A mark from there holds until a view sees past the triangle (`forget_seen_past`): then what the triangle
showed has gone. The paper does not say so; but rays through a camera's pixels miss most triangles of the pictures that
it took from nearer by, so that culling would take away in the next turns what it had uncovered.

With `Settings.cull_stale`, a triangle also goes, whatever its marks, when a view shows that it is not there any more
(`stale`). With `Settings.middle_layers`, triangles without a mark stay that no camera has ever seen past
(`middle_layers`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ..geometry.prepared_view import PreparedView, ViewTable
from ..kernels.background.culling import list_unmarked
from ..kernels.background.seen_past import forget_seen_past
from ..kernels.base.tolerance import Delta
from ..settings import Settings
from ..support.array_types import F64, I64, U64
from .changed_directions import ChangedDirections
from .middle_layers import MiddleLayers
from .pbs import ProbableBackgroundSurface, Surface
from .reference_cameras import ReferenceCameras
from .report import UpdateReport
from .stale import Look, flag_stale

__all__ = [
    "ForegroundCulling", "Unmarked", "clear_marks", "cull_unmarked", "mark_missed", "mark_pixels",
]  # fmt: skip


_LOOKED_AT = 1 << 16  # triangles of which marks may be forgotten in a camera's turn, so that its cost is bounded


class Unmarked(NamedTuple):
    """The valid triangles of a surface that have no mark: their numbers int64 [n]."""

    surface: Surface
    triangles: I64


class ForegroundCulling:
    """Renews reference cameras' marks where geometry has changed, and flags triangles without any mark as invalid.

    The settings decide how rays are cast (see the module's docstring). changed: where geometry is new since each
    camera's last rays; cast_version: the PBS' version at each camera's last rays; looks: how often each camera has
    looked for triangles past which it sees.
    """

    def __init__(
        self, pbs: ProbableBackgroundSurface, cameras: ReferenceCameras, layers: MiddleLayers, settings: Settings
    ) -> None:
        self._pbs, self._cameras, self._layers = pbs, cameras, layers
        self._stride, self._by_triangle = settings.culling_stride, settings.rays_by_triangle
        self._stale = settings.cull_stale
        self.changed = ChangedDirections(cameras.packed)
        self.cast_version = [-1] * len(cameras)
        self.looks = [0] * len(cameras)

    def due(self, group: Sequence[int]) -> list[int]:
        """The cameras of a group whose rays may give another result than the last time."""
        return [c for c in group if self.cast_version[c] != self._pbs.version]

    def first_time(self, group: Sequence[int]) -> list[int]:
        """The cameras of a group that have cast no rays yet from where they are."""
        return [c for c in group if self.cast_version[c] < 0]

    def note_cast(self) -> None:
        """Notes that no camera's rays would give another result now."""
        self.cast_version = [self._pbs.version] * len(self._cameras)

    def cull(self, group: Sequence[int], delta: Delta, report: UpdateReport, *, share: bool = False) -> None:
        """Renews the marks of a group of cameras, then culls. With `share`, each camera is the first to look at a
        different part of the triangles, so that their marks, and later turns, are of equal size."""
        for c in group:
            self.cast_version[c] = self._pbs.version
            if c in self._cameras.moving:
                self.changed.cells[c] = 0.0  # its marks hold until a view sees past them
            else:
                self.changed.forget(c, list(self._pbs.surfaces()), delta)
            if self._stride:
                moves, packed = c in self._cameras.moving, self._cameras.packed[c]
                report.rays += mark_pixels(self._pbs, c, packed, self._stride, delta, moves=moves)
        unmarked: Sequence[tuple[Surface, I64]]
        if self._by_triangle:
            order = [*group, *self._cameras.asked_after(group)]
            rays, unmarked = mark_missed(self._pbs, order, self._cameras.packed, delta, share=share)
            report.rays += rays
        else:
            unmarked = _list_unmarked(self._pbs)
        report.culled += cull_unmarked(self._pbs, self._layers.keep(unmarked, delta))

    def forget_seen_past(self, camera: int, view: PreparedView, delta: Delta) -> int:
        """Removes the marks of cameras that move from triangles past which a camera's view sees; returns their number.

        If there are many triangles, it looks at a part of them, and at the next part in the camera's next turn. In a
        round, cameras look at different parts."""
        if not self._cameras.moving:
            return 0
        bits = _bits(self._pbs, sorted(self._cameras.moving))
        codes = view.addresses(measured=True)[0]
        surfaces, forgotten = list(self._pbs.surfaces()), 0
        step = max(1, -(-sum(len(surface.invalid) for surface in surfaces) // _LOOKED_AT))
        self.looks[camera] += 1
        for surface in surfaces:
            first = min((self.looks[camera] + camera) % step, len(surface.invalid))
            forgotten += forget_seen_past(
                view.table_row, codes, surface.packed, surface.invalid, delta, bits, first, step, surface.marks
            )
        return forgotten

    def cull_stale(self, camera: int, look: Look, present: Callable[[], ViewTable], delta: Delta) -> int:
        """A camera's turn, after `forget_seen_past`: culls stale foreground (`stale`), if the settings say so; returns
        the number of triangles. present: makes the table of all views of the frame."""
        if not self._stale:
            return 0
        if not self._cameras.moving:  # otherwise this look was counted before
            self.looks[camera] += 1
        return flag_stale(self._pbs, look, present, delta, sum(self.looks), len(self._cameras))


def mark_pixels(
    pbs: ProbableBackgroundSurface, camera: int, packed: F64, stride: int, delta: Delta, *, moves: bool = False
) -> int:
    """Renews a camera's marks by rays through its pixels, as in the paper; returns the number of rays.

    Two rays are cast for every stride-th pixel in both directions; each hit is followed by a complementary ray.
    `packed`: the camera, float64 [CAMERA_SIZE]. If it `moves`, its marks from other places stay.
    """
    if not moves:
        clear_marks(pbs, camera)
    return pbs.tracer.mark_by_pixel(camera, packed, stride, delta)


def clear_marks(pbs: ProbableBackgroundSurface, camera: int) -> None:
    """Removes a camera's marks from all triangles."""
    word, bit = camera // 64, np.uint64(1 << (camera % 64))
    for surface in pbs.surfaces():
        surface.marks[:, word] &= ~bit


def mark_missed(
    pbs: ProbableBackgroundSurface, cameras: Sequence[int], packed: F64, delta: Delta, *, share: bool = False
) -> tuple[int, list[Unmarked]]:
    """Casts rays through triangles without a mark: the first of the cameras that finds a triangle marks it. Returns the
    number of rays, and the triangles that are still without a mark.

    Rays go through points of the triangles, and only as far as there could be something behind them: an error-bounded
    mesh has triangles smaller than any stride, and far fewer triangles than pictures have pixels. A triangle gets one
    mark, so it is tested again only in that camera's next turn, not in every turn. `packed`: [all cameras,
    CAMERA_SIZE].
    """
    order, rays, left = np.array(cameras, np.int64), 0, []
    for surface, missed in _list_unmarked(pbs):
        if len(missed) and len(order):
            rays += pbs.tracer.mark_by_triangle(packed, order, surface, missed, delta, share=share)
            missed = missed[(surface.marks[missed] == 0).all(axis=1)]
        left.append(Unmarked(surface, missed))
    return rays, left


def cull_unmarked(pbs: ProbableBackgroundSurface, unmarked: Sequence[tuple[Surface, I64]] | None = None) -> int:
    """Flags the valid triangles without any mark as invalid; returns their number. `unmarked`: those triangles, if
    known."""
    known = _list_unmarked(pbs) if unmarked is None else unmarked
    with pbs.lock:
        for surface, triangles in known:
            surface.invalid[triangles] = 1
    return sum(len(triangles) for _surface, triangles in known)


def _bits(pbs: ProbableBackgroundSurface, cameras: Sequence[int]) -> U64:
    """The bits of cameras in a triangle's marks, [words]."""
    bits = np.zeros(pbs.words, np.uint64)
    for c in cameras:
        bits[c // 64] |= np.uint64(1 << (c % 64))
    return bits


def _list_unmarked(pbs: ProbableBackgroundSurface) -> list[Unmarked]:
    unmarked = []
    for surface in pbs.surfaces():
        numbers = np.empty(len(surface.invalid), np.int64)
        count = list_unmarked(surface.marks, surface.invalid, numbers)
        unmarked.append(Unmarked(surface, numbers[:count]))
    return unmarked
