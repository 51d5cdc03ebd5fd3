"""Lengths that the background model compares with; they follow from the scene."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..kernels.base.tolerance import Delta
from ..rig.camera import Camera
from ..rig.depth import DepthCoding
from ..rig.frame import Frame, View
from ..settings import Settings
from ..support.array_types import F64, U16

__all__ = ["FollowedTolerances", "Tolerances", "sampled_disparity", "scene_tolerances", "with_noise"]


# Two surfaces closer than this share of the typical depth are taken as one: calibration and estimation of depth are off
# by less. 0.2 m (the paper) at 10 m.
_DELTA_SHARE = 0.02
# Depth that is coded in steps of s is off by up to s / 2 on each of two surfaces; twice that is kept clear of. It is an
# error of disparity: where depths reach from people to hills, one length for all would cull nobody, or the hills.
_DELTA_STEPS = 4.0
# A maximum depth image follows changes much finer than delta: where someone's feet leave the floor, the rim that is
# less than delta above it has to take on the floor's colour. The rounding of codes must not look like a change:
# two whole steps at least.
_MARGIN_SHARE = 0.05
_MARGIN_STEPS = 1.5
# Of the absolute difference of two normal variates, to their common standard deviation: 1 / (0.6745 sqrt(2)).
_DEVIATION_OF_MEDIAN = 1.0483
# Depth that flickers: the maximum over many frames and the first frame's triangles stray to opposite sides, by three
# to four standard deviations each. Less than that would add a little of every wall to the P-PBS, for ever.
_DELTA_DEVIATIONS = 8.0
# Of a mean of many frames and one more only this much is a change: with 3, one pixel in a hundred would be replaced
# by a stray one every ten frames.
_MARGIN_DEVIATIONS = 4.0
_NOISE_FRAMES = (1, 2, 4, 8, 16, 32)  # after the first: when noise is measured


@dataclass(frozen=True, slots=True)
class Tolerances:
    """delta, of culling and filtering: delta_m metres along a ray, or an error of delta_disparity (1/m) where that is
    more. margin_m: the least nontrivial amount, metres; margin_disparity: the same in each camera's disparities.

    depth_m: the median of the first frame's depths; noise: the standard deviation of disparity between frames, 1/m.
    """

    delta_m: float
    margin_m: float
    noise: float = 0.0
    delta_disparity: float = 0.0
    depth_m: float = 0.0

    @property
    def delta(self) -> Delta:
        """delta as kernels take it."""
        return float(self.delta_m), float(self.delta_disparity)

    def delta_at(self, depth_m: npt.NDArray[np.float64] | float) -> Any:
        """delta at a depth, metres."""
        return np.maximum(self.delta_m, self.delta_disparity * np.square(depth_m))

    def before_delta(self, depth_m: npt.NDArray[np.floating]) -> F64:
        """Depths, metres, that are `depth_m` with their delta."""
        curved = 2.0 * depth_m / (1.0 + np.sqrt(1.0 + 4.0 * self.delta_disparity * depth_m))
        before: F64 = np.minimum(depth_m - self.delta_m, curved)
        return before

    def margin_disparity(self, coding: DepthCoding) -> float:
        """The least nontrivial amount in a camera's disparities, 1/m."""
        return max(_MARGIN_STEPS * coding.step, _MARGIN_DEVIATIONS * self.noise)


class FollowedTolerances:
    """The tolerances of a scene, which follow from its first frames.

    first: samples of the first frame's disparities by reference camera; frames: how many came after it.
    """

    def __init__(self, settings: Settings) -> None:
        self.now = Tolerances(0.0, 0.0)
        self.first: list[F64] = []
        self.frames = 0
        self._settings = settings

    def start(self, views: Sequence[View]) -> Tolerances:
        """Those of the first frame; raises ValueError where it has no valid depth."""
        self.now = scene_tolerances(views, self._settings)
        self.first = [sampled_disparity(view.camera, view.codes) for view in views]
        return self.now

    def follow(self, frame: Frame, fixed: Sequence[int]) -> bool:
        """Frames after the first tell how much depth flickers, as the cameras that have not moved see it; whether more
        noise is allowed for than before."""
        self.frames += 1
        if self.frames not in _NOISE_FRAMES or not self._settings.refine:
            return False
        known, first = self.now, [self.first[c] for c in fixed]
        self.now = with_noise(known, first, [frame.views[c] for c in fixed], self._settings)
        return self.now.noise > known.noise

    def replace(self, camera: int, view: View) -> None:
        """A camera stands elsewhere: its flicker is measured against what it sees there."""
        self.first[camera] = sampled_disparity(view.camera, view.codes)


def scene_tolerances(views: Sequence[View], settings: Settings) -> Tolerances:
    """Tolerances from the depths of the first frame; what `settings` say is taken as it is.

    Raises ValueError where no view has a valid depth.
    """
    depth, steps = _median_depth(views), [view.camera.depth.step for view in views]
    delta, disparity, margin = settings.delta_m, settings.delta_disparity, settings.margin_m
    if disparity is None:
        disparity = _DELTA_STEPS * float(np.median(steps)) if delta is None else 0.0
    if delta is None:
        delta = _DELTA_SHARE * depth
    if margin is None:
        margin = _MARGIN_SHARE * delta
    return Tolerances(delta, margin, delta_disparity=disparity, depth_m=depth)


def with_noise(
    tolerances: Tolerances, first: Sequence[F64], views: Sequence[View], settings: Settings
) -> Tolerances:
    """Tolerances that also allow for how much the depth of what stands still differs between two frames.

    `first`: `sampled_disparity` of the views in the first frame. Estimated depth drifts as well: a frame long after the
    first tells more of its noise than the second. Delta follows from the flicker between neighbouring frames alone.
    """
    noise = []
    for old, view in zip(first, views, strict=True):
        difference = np.abs(sampled_disparity(view.camera, view.codes) - old)
        difference = difference[np.isfinite(difference)]
        if difference.size:
            # The median: what moves is less than half of a picture.
            noise.append(_DEVIATION_OF_MEDIAN * float(np.median(difference)))
    if not noise:
        return tolerances
    deviation = float(np.median(noise))
    delta, disparity = tolerances.delta_m, tolerances.delta_disparity
    if settings.delta_m is None and settings.delta_disparity is None and tolerances.noise == 0.0:
        disparity = max(disparity, _DELTA_DEVIATIONS * deviation)
        # Not every noise is the same in all disparities: what is near has no less than the median depth.
        delta = max(delta, disparity * tolerances.depth_m**2)
    return dataclasses.replace(
        tolerances, delta_m=delta, delta_disparity=disparity, noise=max(deviation, tolerances.noise)
    )


def sampled_disparity(camera: Camera, codes: U16) -> F64:
    """Disparities of about 16384 of a view's pixels, nan where there is none."""
    stride = max(1, math.isqrt(codes.size // 16384))
    return camera.depth.disparity(codes[::stride, ::stride])


def _median_depth(views: Sequence[View]) -> float:
    medians = []
    for view in views:
        disparity = sampled_disparity(view.camera, view.codes)
        if np.isfinite(disparity).any():
            medians.append(1.0 / float(np.nanmedian(disparity)))
    if not medians:
        raise ValueError("first frame: no view has a valid depth: expected at least one")
    return float(np.median(medians))
