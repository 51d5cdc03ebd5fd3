"""Tolerances with which the background model compares surfaces; they are derived from the scene."""

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


# delta as a share of the typical depth: two surfaces closer than this count as one. Calibration and estimation of depth
# have smaller errors. At 10 m it is the paper's 0.2 m.
_DELTA_SHARE = 0.02
# delta in steps s of the depth codes. Codes are off by up to s / 2 on each of two surfaces, together by s; the rest is
# safety. This is an error of disparity: if depths reach from people to hills, a single length would be too large to
# cull the people, or so small that it would cull the hills.
_DELTA_STEPS = 4.0
# The nontrivial amount of a maximum depth image, as a share of delta. It is much smaller than delta: when a foot leaves
# the floor, its rim, less than delta above the floor, must take the floor's colour. The rounding of codes must not look
# like a change, so the amount is more than _MARGIN_STEPS steps: at least two whole ones.
_MARGIN_SHARE = 0.05
_MARGIN_STEPS = 1.5
# Ratio of the standard deviation of two normal variates to the median of their absolute difference:
# 1 / (0.6745 sqrt(2)).
_DEVIATION_OF_MEDIAN = 1.0483
# delta in standard deviations of depth that flickers. The maximum over many frames and the first frame's triangles are
# off in opposite directions, by three to four deviations each. With a smaller delta, a little of every wall would be
# added to the P-PBS for ever.
_DELTA_DEVIATIONS = 8.0
# The nontrivial amount in standard deviations: a new frame must differ by more from the mean of many frames. With 3
# instead of 4, one pixel in a hundred would be replaced by an outlier every ten frames.
_MARGIN_DEVIATIONS = 4.0
_NOISE_FRAMES = (1, 2, 4, 8, 16, 32)  # frames after the first at which noise is measured


@dataclass(frozen=True, slots=True)
class Tolerances:
    """delta_m, delta_disparity: delta, of culling and filtering, is delta_m metres along a ray, or an error of
    disparity of delta_disparity (1/m) where that is more. margin_m: the least nontrivial amount, metres
    (`margin_disparity` is the same in a camera's disparities). depth_m: the median of the first frame's depths, metres.
    noise: the standard deviation of disparity between frames, 1/m.
    """

    delta_m: float
    margin_m: float
    noise: float = 0.0
    delta_disparity: float = 0.0
    depth_m: float = 0.0

    @property
    def delta(self) -> Delta:
        """delta as kernels take it: metres, and 1/m."""
        return float(self.delta_m), float(self.delta_disparity)

    def delta_at(self, depth_m: npt.NDArray[np.float64] | float) -> Any:
        """delta at a depth; both in metres."""
        return np.maximum(self.delta_m, self.delta_disparity * np.square(depth_m))

    def before_delta(self, depth_m: npt.NDArray[np.floating]) -> F64:
        """The depths d, metres, for which d plus delta at d is `depth_m`."""
        curved = 2.0 * depth_m / (1.0 + np.sqrt(1.0 + 4.0 * self.delta_disparity * depth_m))
        before: F64 = np.minimum(depth_m - self.delta_m, curved)
        return before

    def margin_disparity(self, coding: DepthCoding) -> float:
        """The least nontrivial amount in a camera's disparities, 1/m."""
        return max(_MARGIN_STEPS * coding.step, _MARGIN_DEVIATIONS * self.noise)


class FollowedTolerances:
    """The tolerances of a scene, derived from its first frames.

    first: samples of the first frame's disparities by reference camera; frames: the number of frames after the first.
    """

    def __init__(self, settings: Settings) -> None:
        self.now = Tolerances(0.0, 0.0)
        self.first: list[F64] = []
        self.frames = 0
        self._settings = settings

    def start(self, views: Sequence[View]) -> Tolerances:
        """The tolerances from the first frame; raises ValueError if it has no valid depth."""
        self.now = scene_tolerances(views, self._settings)
        self.first = [_sampled(view) for view in views]
        return self.now

    def follow(self, frame: Frame, fixed: Sequence[int]) -> bool:
        """Measures in later frames how much depth flickers, in the views of the cameras that have not moved (`fixed`).
        Returns whether the noise is greater than before."""
        self.frames += 1
        if self.frames not in _NOISE_FRAMES or not self._settings.refine:
            return False
        known, first = self.now, [self.first[c] for c in fixed]
        self.now = with_noise(known, first, [frame.views[c] for c in fixed], self._settings)
        return self.now.noise > known.noise

    def replace(self, camera: int, view: View) -> None:
        """Measures the flicker of a camera that has moved against its new view from now on."""
        self.first[camera] = sampled_disparity(view.camera, view.codes)


def scene_tolerances(views: Sequence[View], settings: Settings) -> Tolerances:
    """Tolerances from the depths of the first frame; tolerances in `settings` are taken as they are.

    Raises ValueError if no view has a valid depth.
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
    """Tolerances that also allow for the noise of depth: the difference of static surfaces between two frames.

    `first`: `sampled_disparity` of the views in the first frame. Estimated depth drifts as well, so a frame long after
    the first shows more of its noise than the second frame. Delta is derived only once, from the flicker between the
    first frames.
    """
    noise = []
    for old, view in zip(first, views, strict=True):
        difference = np.abs(sampled_disparity(view.camera, view.codes) - old)
        difference = difference[np.isfinite(difference)]
        if difference.size:
            # The median, as less than half of a picture moves.
            noise.append(_DEVIATION_OF_MEDIAN * float(np.median(difference, overwrite_input=True)))
    if not noise:
        return tolerances
    deviation = float(np.median(noise))
    delta, disparity = tolerances.delta_m, tolerances.delta_disparity
    if settings.delta_m is None and settings.delta_disparity is None and tolerances.noise == 0.0:
        disparity = max(disparity, _DELTA_DEVIATIONS * deviation)
        # Some noise is not the same at all disparities: near surfaces get no smaller delta than the median depth.
        delta = max(delta, disparity * tolerances.depth_m**2)
    return dataclasses.replace(
        tolerances, delta_m=delta, delta_disparity=disparity, noise=max(deviation, tolerances.noise)
    )


def sampled_disparity(camera: Camera, codes: U16) -> F64:
    """Disparities (1/m) of about 16384 of a view's pixels; nan where there is no depth."""
    stride = max(1, math.isqrt(codes.size // 16384))
    return camera.depth.disparity(codes[::stride, ::stride])


def _sampled(view: View) -> F64:
    """`sampled_disparity` of a view; nan if it is left out."""
    disparity = sampled_disparity(view.camera, view.codes)
    return disparity if view.there else np.full_like(disparity, np.nan)


def _median_depth(views: Sequence[View]) -> float:
    medians = []
    for view in views:
        disparity = _sampled(view)
        if np.isfinite(disparity).any():
            medians.append(1.0 / float(np.nanmedian(disparity)))
    if not medians:
        raise ValueError("first frame: no view has a valid depth: expected at least one")
    return float(np.median(medians))
