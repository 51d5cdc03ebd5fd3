"""Exposure and white balance of a rig's views, estimated where they overlap and removed where they are blended.

It starts from known methods: gain compensation by least squares over all overlaps with a prior to identity (Brown and
Lowe, IJCV 74(1), 2007), gains and offsets for each channel (Xiong and Pulli, IEEE Trans. Consumer Electronics 56(4),
2010), and iteratively reweighted least squares with Geman's and McClure's weights against samples that do not match.
These are the differences here:

- Views are compared where a pixel of one view, back-projected by its depth, is seen by the other view at the same depth
  and away from depth edges; it is not enough that pictures overlap.
- A view's *tone* is affine in 10-bit Y'CbCr. Luma has a gain and an offset about black. Each chroma has a gain about
  grey, an offset, and a *tint*, which is a share of the luma. Gains of R', G', B' (white balance; and exposure, which
  is a power of the gain in gamma-coded video) have exactly this effect on chroma; the offsets approximate the other
  effects of a tone curve.
- Overlaps tell which tones differ, not which tone is right. A picture is rendered in the mean tone of the views round
  its camera, weighted by their nearness (`rig.selection.view_shares`), so it changes smoothly as the head moves.
- The background model keeps colours in a *common tone*. Where the cameras see the model's surfaces again, the
  comparison tells how that tone drifts, so surfaces of the past follow when the light or all exposures change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..geometry.prepared_view import ViewTable
from ..kernels.background.exposure import gather_samples, weigh_samples
from ..kernels.background.tone_solver import solve_tones
from ..kernels.base.tone import (
    CB_FROM_Y,
    CB_GAIN,
    CB_OFFSET,
    CR_FROM_Y,
    CR_GAIN,
    CR_OFFSET,
    TONE_SIZE,
    Y_GAIN,
    Y_OFFSET,
)
from ..rig.camera import Camera
from ..rig.selection import likely_views, select_views
from ..support.array_types import F64
from .state import CameraState, ExposureState

__all__ = ["LIKELY", "Exposure", "packed", "to_common", "to_picture"]

IntArray = npt.NDArray[np.int64]

_NEIGHBOURS = 4  # views that each view is compared with
LIKELY = 48  # views that the neighbours are chosen from
_SAMPLES = 9000  # pixels compared, all pairs together
_LEAST, _MOST = 64, 640  # pixels compared per pair
_TURNS = 3  # number of frames in which each pair is sampled once
_FIRST_ROUNDS, _ROUNDS = 12, 1  # rounds of reweighting, in the first frame and in later ones
# Standard deviations of gain, offset (codes) and tint that are expected without evidence.
_EXPECTED = np.array([0.2, 12.0, 0.08])
_KEPT = 0.9  # share of the last tone that is expected: without evidence it fades to identity in tens of time constants
_MODEL_WEIGHT = 0.02  # low: the model tells how light changes with time, overlaps tell how views differ
_NEUTRAL = np.array([1.0, 0.0, 0.0])
_CENTRE = np.array([64.0, 512.0, 512.0])  # black and grey
_NONE = np.empty((0, 4), np.int64)


@dataclass(frozen=True, slots=True)
class _Overlap:
    """Surfaces that both of a pair see: pairs [p, 2] of views (then of views and the model's images), samples
    [p, s, 2, 3], and the number of samples of each pair, counts [p]."""

    pairs: IntArray
    samples: npt.NDArray[np.float32]
    counts: IntArray

    @classmethod
    def empty(cls, pairs: IntArray, size: int) -> _Overlap:
        return cls(pairs, np.zeros((len(pairs), size, 2, 3), np.float32), np.zeros(len(pairs), np.int64))


class Exposure:
    """Follows the tones of a rig's views. `update` is called by one thread; `tones` is replaced, never written to.

    follow_s: the time constant, seconds, with which tones are followed; depths: typical depths of the scene, metres.
    """

    def __init__(self, camera_count: int, follow_s: float, depths: Sequence[float]) -> None:
        self._follow_s, self._depths = follow_s, depths
        self._state = np.tile(_NEUTRAL, (camera_count, 3, 1))  # [n, channel, (gain, offset, tint)]
        self._started = False
        self._cameras: list[Camera | None] = [None] * camera_count
        self._neighbours: list[list[int]] = [[]] * camera_count
        self._overlap = _Overlap.empty(np.empty((0, 2), np.int64), 0)
        self._turn = 0
        self.tones = _matrices(self._state)  # [n, 4, 4]: view from common, of (Y', Cb, Cr, 1) about black and grey

    def update(self, views: ViewTable, elapsed_s: float, known: Sequence[int] = (), model: IntArray = _NONE) -> None:
        """Compare the views of a frame, `elapsed_s` seconds after the last one. Views that are
        left out are not compared, and keep their tones.

        known: indices [k] of views whose camera has a maximum depth image; model: addresses [k, 4] of these images'
        planes.
        """
        self._gather(views, known, model)
        expected = _NEUTRAL + _KEPT * (self._state - _NEUTRAL)
        found = self._state
        for _ in range(_ROUNDS if self._started else _FIRST_ROUNDS):
            found = _solve(self._overlap, found, expected)
        share = 1.0 - math.exp(-elapsed_s / self._follow_s) if self._started else 1.0
        change = share * (found - self._state)
        change[~_there(views)] = 0.0
        self._state = self._state + change
        self._started = True
        self.tones = _matrices(self._state)

    def state(self) -> ExposureState:
        """All its data, as copies."""
        cameras = tuple(None if camera is None else CameraState.of(camera) for camera in self._cameras)
        overlap = self._overlap
        return ExposureState(
            self._state.copy(), self._started, self._turn, cameras,
            tuple(tuple(map(int, near)) for near in self._neighbours), overlap.pairs.copy(), overlap.samples.copy(),
            overlap.counts.copy(),
        )  # fmt: skip

    def put_back(self, state: ExposureState) -> None:
        """Continues from a state."""
        self._state, self._started, self._turn = state.tones.copy(), state.started, state.turn
        self._cameras = [None if camera is None else camera.camera() for camera in state.cameras]
        self._neighbours = [list(near) for near in state.neighbours]
        self._overlap = _Overlap(state.pairs.copy(), state.samples.copy(), state.counts.copy())
        self.tones = _matrices(self._state)

    def _gather(self, views: ViewTable, known: Sequence[int], model: IntArray) -> None:
        """Renew the samples of the pairs whose turn it is, or of all pairs if they have changed."""
        self._find_neighbours([prepared.view.camera for prepared in views.views])
        pairs = [(a, b) for a, near in enumerate(self._neighbours) for b in near]
        pairs += [(a, len(views.views) + k) for k, a in enumerate(known)]
        each = min(max(_SAMPLES // max(len(pairs), 1), _LEAST), _MOST)
        columns = round(math.sqrt(each * 4 / 3))
        rows = each // columns
        index = np.array(pairs, np.int64).reshape(-1, 2)
        self._turn = (self._turn + 1) % _TURNS
        due = np.arange(self._turn, len(pairs), _TURNS)
        if not np.array_equal(index, self._overlap.pairs):
            self._overlap, due = _Overlap.empty(index, columns * rows), np.arange(len(pairs))
        there = _there(views)
        if not there.all():  # the other pairs keep their samples of earlier frames
            due = due[np.concatenate([there, there[list(known)]])[index[due]].all(axis=1)]
        table = np.concatenate([views.rows, views.rows[list(known)]])
        addresses = np.concatenate([views.addresses[:, :4], model])
        gather_samples(
            table, addresses, index, due, columns, rows, self._overlap.samples, self._overlap.counts
        )  # fmt: skip

    def _find_neighbours(self, cameras: Sequence[Camera]) -> None:
        """Find, for each camera that has moved, the other cameras that see most of its view."""
        moved = [k for k, camera in enumerate(cameras) if camera != self._cameras[k]]
        packed = np.stack([camera.packed() for camera in cameras]) if moved else np.empty((0, 0))
        for k in moved:
            self._cameras[k] = camera = cameras[k]
            others = list(range(len(cameras)))
            if len(cameras) > LIKELY + 1:
                others = likely_views(camera, packed, LIKELY + 1, self._depths)  # the camera itself is among them
            others = [i for i in others if i != k]
            if len(others) > _NEIGHBOURS:
                chosen = select_views(camera, [cameras[i] for i in others], _NEIGHBOURS, self._depths)
                others = [others[i] for i in chosen]
            self._neighbours[k] = others


def _there(views: ViewTable) -> npt.NDArray[np.bool_]:  # [n]
    """Which views are not left out of their frame."""
    return np.array([prepared.view.there for prepared in views.views])


def _solve(overlap: _Overlap, state: F64, expected: F64) -> F64:
    """One round of reweighting: the least-squares tones [n, 3, 3], with weights from the present tones `state`."""
    count, pairs = len(state), len(overlap.pairs)
    nodes = np.minimum(overlap.pairs, count)  # the whole model is one more node
    tones = np.concatenate([state, _NEUTRAL[None].repeat(3, 0)[None]])  # the model's own tone is the common one
    information, evidence = np.empty((pairs, 3, 3, 3)), np.empty((pairs, 3, 3))
    weigh_samples(overlap.samples, overlap.counts, nodes, tones, information, evidence)
    weights = np.where(nodes[:, 1] == count, _MODEL_WEIGHT, 1.0)
    off: F64 = expected - _NEUTRAL
    solve_tones(information, evidence, nodes, weights, 1.0 / _EXPECTED**2, off)
    off += _NEUTRAL
    return off


def _matrices(state: F64) -> F64:  # [n, 3, 3] -> [n, 4, 4]
    """Tones as affine maps of (Y', Cb, Cr, 1) about black and grey."""
    out = np.zeros((len(state), 4, 4))
    out[:, [0, 1, 2], [0, 1, 2]] = state[:, :, 0]
    out[:, 1:3, 0] = state[:, 1:, 2]
    out[:, :3, 3] = state[:, :, 1]
    out[:, 3, 3] = 1.0
    return out


def to_common(tones: F64) -> F64:  # [n, 4, 4] -> [n, TONE_SIZE]
    """The packed tones that convert each view's colours to the common tone."""
    return packed(np.asarray(np.linalg.inv(tones), np.float64))


def to_picture(tones: F64, shares: F64) -> F64:  # [n, 4, 4], [n] -> [n + 1, TONE_SIZE]
    """The packed tones that convert the colours of each view, and last of the model, to the mean tone of the views,
    weighted by `shares` (their sum is 1)."""
    mean = np.einsum("n,nij->ij", shares, tones)
    to_mean: F64 = mean @ np.concatenate([np.linalg.inv(tones), np.eye(4)[None]])
    return packed(to_mean)


def packed(matrices: F64) -> F64:  # [n, 4, 4] -> [n, TONE_SIZE]
    """Affine maps about black and grey as maps of codes, for `kernels.base.tone`."""
    out = np.empty((len(matrices), TONE_SIZE))
    offset = matrices[:, :3, 3] + _CENTRE - matrices[:, :3, :3] @ _CENTRE
    out[:, Y_GAIN], out[:, Y_OFFSET] = matrices[:, 0, 0], offset[:, 0]
    for k, (gain, from_y, off) in enumerate(((CB_GAIN, CB_FROM_Y, CB_OFFSET), (CR_GAIN, CR_FROM_Y, CR_OFFSET)), 1):
        out[:, gain], out[:, from_y], out[:, off] = matrices[:, k, k], matrices[:, k, 0], offset[:, k]
    return out
