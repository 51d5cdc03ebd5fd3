"""Late layers: what is put into a room while the video plays stays in the model while it stands.

The model keeps the farthest surfaces (section 3.3.2), and `middle_layers` keeps nearer ones that no camera has ever
seen past. A chair that is carried to where the wall had been seen is neither. Here each reference camera that stands
still notes in its turns what it shows before the background that it knows (its maximum depth image). What it has shown
at the same depth in a round becomes a late layer: a surface of the P-PBS with the mark of no camera (`seeding`), whose
colours are in a capture of its own (`older_captures.condense`). Each camera has one such surface at most.

The cameras have seen past the place of a late layer before, so only present views tell whether it stands
(`kernels.background.standing`). A triangle goes as soon as a view in its camera's turn sees past one of its points:
people who were taken for furniture leave with the next views. A camera that moves gets no new late layers.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ..geometry.prepared_view import PreparedView
from ..kernels.background.late_layers import Before, Stood, clear_covered, note_standing, select_standing
from ..kernels.background.middle_layers import find_never_seen_past
from ..kernels.base.tolerance import Delta
from ..rig.depth import DepthCoding
from ..settings import Settings
from ..support.array_types import U8, U16
from .capture import Capture, Captures
from .culling import cull_unmarked
from .maximum_depth import MaximumDepthImage
from .middle_layers import MiddleLayers
from .new_triangles import NewTriangles
from .older_captures import condense
from .pbs import ProbableBackgroundSurface, Surface
from .reference_cameras import ReferenceCameras
from .stale import Look
from .state import LateState
from .tolerances import Tolerances

__all__ = ["LateLayers"]

# Frames for which something must stand, where rounds are shorter: people who walk before a camera cover a pixel for as
# long.
_FRAMES = 5
_FEW = 1e-3  # a share of the picture: fewer pixels that have come to stand wait for more
_LOOKED_AT = 1 << 13  # triangles at which a view looks in its camera's turn, so that the cost of a turn is bounded
_THIN = 0.5  # a share of valid triangles below which a late layer is condensed


class LateLayers:
    """Keeps late layers, together with the middle layers within their budget; none if that or `late_rounds` is 0."""

    def __init__(
        self, pbs: ProbableBackgroundSurface, captures: Captures, cameras: ReferenceCameras,
        new_triangles: NewTriangles, layers: MiddleLayers, settings: Settings,
    ) -> None:  # fmt: skip
        self._pbs, self._captures, self._cameras, self._new_triangles = pbs, captures, cameras, new_triangles
        self._layers, self._need = layers, _turns(settings, len(cameras)) if layers.budget else 0
        self._stood: dict[int, Stood] = {}  # by camera
        self._waiting: dict[int, int] = {}  # pixels of `_stood` that have come to stand since the last addition

    @property
    def memory(self) -> int:
        """Bytes of what the cameras have noted."""
        return sum(array.nbytes for stood in self._stood.values() for array in stood)

    def take_turn(self, look: Look, tolerances: Tolerances, turn: int) -> int:
        """A camera's turn: removes what its view sees past, and adds what has come to stand; returns the number of
        triangles removed. turn: the number of the camera's turn, by which it looks at the next part of many triangles.
        """
        if not self._need:
            return 0
        version, camera = self._pbs.version, look.capture.camera
        # In a round, cameras look at different parts: what most of them see past is gone after it.
        gone = self._remove(look.view, tolerances.delta, turn + camera)
        if camera in self._cameras.moving:
            self._stood.pop(camera, None)
            self._waiting.pop(camera, None)
        else:
            gone += self._add(look, tolerances)
        if self._pbs.version != version:
            self._pbs.commit()
        return gone

    def state(self) -> tuple[LateState, ...]:
        """What the cameras have noted, as copies."""
        return tuple(
            LateState(camera, stood.codes.copy(), stood.turns.copy(), self._waiting[camera])
            for camera, stood in self._stood.items()
        )  # fmt: skip

    def put_back(self, states: Sequence[LateState]) -> None:
        """Takes over what the cameras had noted; arrays are copied."""
        self._stood = {each.index: Stood(each.codes.copy(), each.turns.copy()) for each in states}
        self._waiting = {each.index: each.waiting for each in states}

    def _all(self) -> list[Surface]:
        """The late layers."""
        return [surface for surface in self._pbs.progressive.values() if surface.late]

    def _remove(self, view: PreparedView, delta: Delta, part: int) -> int:
        """Flags triangles past which a view sees, and tidies up; returns the number of these triangles. part: the
        number of the part at which it looks, if they are many; numbers begin again after the last part."""
        row, codes = view.table_row[None], np.array(view.addresses(measured=True)[:1])
        surfaces, gone = self._all(), 0
        step = max(1, -(-sum(len(surface.invalid) for surface in surfaces) // _LOOKED_AT))
        for surface in surfaces:
            which = np.ascontiguousarray(np.flatnonzero(surface.invalid == 0)[part % step :: step])
            never = np.empty(len(which), np.uint8)
            find_never_seen_past(row, codes, surface.packed, which, delta, never)
            gone += cull_unmarked(self._pbs, [(surface, which[never == 0])])
            self._tidy(surface)
        return gone

    def _tidy(self, surface: Surface) -> None:
        """Drops a late layer without valid triangles, and its capture; condenses one with few."""
        count, valid = len(surface.invalid), surface.valid_count
        if valid == 0:
            with self._pbs.lock:
                self._pbs.remove(surface.capture)
                self._captures.drop(surface.capture)
        elif valid < _THIN * count:
            self._condense([surface], surface.camera, surface.capture)

    def _add(self, look: Look, tolerances: Tolerances) -> int:
        """Notes what a view shows before known background, and adds what has come to stand. Returns the number of
        triangles that are removed instead, beyond the budget."""
        view, camera, image = look.view.view, look.capture.camera, look.capture.image
        stood = self._stood.get(camera)
        if stood is None:
            shape = tuple(-(-size // 2) for size in view.codes.shape)
            stood = self._stood[camera] = Stood(np.zeros(shape, np.uint16), np.zeros(shape, np.uint8))
            self._waiting[camera] = 0
        before = Before(image.rules, _beyond(view.camera.depth, tolerances.delta))
        self._waiting[camera] += int(note_standing(view.codes, image.codes, before, self._need, stood))
        if self._waiting[camera] < max(_FEW * stood.codes.size, 1.0):
            return 0
        self._waiting[camera] = 0
        keep = np.zeros(view.codes.shape, np.uint8)
        select_standing(view.codes, image.codes, before, image.edge, self._need, stood, keep)
        row, wraps = look.view.table_row, view.camera.wraps
        for surface in self._all():
            clear_covered(row, view.codes, surface.packed, surface.invalid, tolerances.delta, wraps, keep)
        if np.count_nonzero(keep) < _FEW * keep.size:
            return 0
        self._put(look, keep, tolerances)
        return cull_unmarked(self._pbs, self._layers.beyond_budget())

    def _put(self, look: Look, keep: U8, tolerances: Tolerances) -> None:
        """Adds the pixels of a view with keep [h, w] != 0 to its camera's late layer."""
        view, camera = look.view.view, look.capture.camera
        picture = MaximumDepthImage(view, tolerances, self._new_triangles.options[camera].edge, look.tone, refine=False)
        mesh = self._new_triangles.derive(camera, view.camera, picture.codes, keep)
        if not len(mesh.triangles):
            return
        capture = Capture(self._captures.free, camera, picture, look.capture.packed)
        self._captures.put(capture)  # until its parts are copied
        new = Surface.new(mesh, self._pbs.words, camera, capture.number)
        self._layers.mark(new)
        own = [surface for surface in self._all() if surface.camera == camera]
        number = own[0].capture if own else capture.number
        self._condense([*own, new], camera, number)
        if number != capture.number:
            self._captures.drop(capture.number)

    def _condense(self, surfaces: Sequence[Surface], camera: int, number: int) -> None:
        """Puts the valid triangles of surfaces, as one late layer under a number, in their place."""
        remains, surface = condense([each for each in surfaces if each.valid_count], self._captures, camera, number)
        with self._pbs.lock:
            self._captures.put(dataclasses.replace(remains, late=True))
            self._pbs.put(dataclasses.replace(surface, late=True), static=False)


def _turns(settings: Settings, cameras: int) -> int:
    """In how many successive turns a camera must show something at the same place; 0: nothing is noted."""
    if settings.late_rounds == 0:
        return 0
    frames = max(cameras / settings.n_update, 1.0) * settings.update_interval  # of a round
    return 1 + max(settings.late_rounds, math.ceil(_FRAMES / frames))


@lru_cache(maxsize=4)
def _beyond(coding: DepthCoding, delta: Delta) -> U16:
    """The limit of every code as in `Before.beyond`, [65536]."""
    packed = coding.packed()
    disparity = packed.offset + packed.step * np.arange(1 << 16)
    # delta at 1 / disparity, as in `kernels.base.tolerance`; farther than that is less than 1 / (1 / disparity + delta)
    with np.errstate(divide="ignore", invalid="ignore"):
        margin = np.maximum(delta[0], delta[1] / disparity**2)
        limit = (disparity / (1.0 + disparity * margin) - packed.offset) / packed.step - packed.least
    limits: U16 = np.ceil(np.clip(np.nan_to_num(limit), 0.0, 65535.0)).astype(np.uint16)
    return limits
