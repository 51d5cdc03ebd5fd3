"""Lengths that the background model compares with; they follow from the scene."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..camera import Camera
from ..depth import DepthCoding
from ..frame import View
from ..settings import Settings

__all__ = ["Tolerances", "sampled_disparity", "scene_tolerances", "with_noise"]

U16 = npt.NDArray[np.uint16]
F64 = npt.NDArray[np.float64]

# Two surfaces closer than this share of the typical depth are taken as one: reprojection errors of calibrated
# rigs and of depth estimation grow with depth, and stay well below it. 0.2 m (the paper) at 10 m.
_DELTA_SHARE = 0.02
# Depth that is coded in steps of s is off by up to s / 2 on each of two surfaces; twice that is kept clear of.
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


@dataclass(frozen=True, slots=True)
class Tolerances:
    """delta_m: of culling and filtering, metres along a ray; margin_m: the least nontrivial amount, metres.

    noise: the standard deviation of disparity between frames, 1/m.
    """

    delta_m: float
    margin_m: float
    noise: float = 0.0

    def margin_disparity(self, coding: DepthCoding) -> float:
        """The least nontrivial amount in a camera's disparities, 1/m."""
        return max(_MARGIN_STEPS * coding.step, _MARGIN_DEVIATIONS * self.noise)


def scene_tolerances(views: Sequence[View], settings: Settings) -> Tolerances:
    """Tolerances from the depths of the first frame; `settings.delta_m` is taken as it is."""
    delta = settings.delta_m
    if delta is None:
        delta = _automatic_delta(views)
    return Tolerances(delta, _MARGIN_SHARE * delta)


def with_noise(
    tolerances: Tolerances, first: Sequence[F64], views: Sequence[View], settings: Settings
) -> Tolerances:
    """Tolerances that also allow for how much the depth of what stands still differs between two frames.

    `first`: `sampled_disparity` of the views in the first frame. Estimated depth drifts as well: a frame long after the
    first tells more of its noise than the second. Delta follows from the flicker between neighbouring frames alone.
    """
    noise, medians = [], []
    for old, view in zip(first, views, strict=True):
        difference = np.abs(sampled_disparity(view.camera, view.codes) - old)
        difference = difference[np.isfinite(difference)]
        if difference.size:
            # The median: what moves is less than half of a picture.
            noise.append(_DEVIATION_OF_MEDIAN * float(np.median(difference)))
            medians.append(1.0 / float(np.nanmedian(old)))
    if not noise:
        return tolerances
    deviation = float(np.median(noise))
    delta = tolerances.delta_m
    if settings.delta_m is None and tolerances.noise == 0.0:
        delta = max(delta, _DELTA_DEVIATIONS * deviation * float(np.median(medians)) ** 2)
    return dataclasses.replace(tolerances, delta_m=delta, noise=max(deviation, tolerances.noise))


def sampled_disparity(camera: Camera, codes: U16) -> F64:
    """Disparities of about 16384 of a view's pixels, nan where there is none."""
    stride = max(1, math.isqrt(codes.size // 16384))
    return camera.depth.disparity(codes[::stride, ::stride])


def _automatic_delta(views: Sequence[View]) -> float:
    medians, steps = [], []
    for view in views:
        depth = 1.0 / sampled_disparity(view.camera, view.codes)
        depth = depth[np.isfinite(depth)]
        if depth.size:
            medians.append(float(np.median(depth)))
            steps.append(float(np.percentile(depth, 95)) ** 2 * view.camera.depth.step)
    if not medians:
        raise ValueError("first frame: no view has a valid depth: expected at least one")
    return max(_DELTA_SHARE * float(np.median(medians)), _DELTA_STEPS * float(np.median(steps)))
