"""Lengths that the background model compares with; they follow from the scene."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..depth import DepthCoding
from ..frame import View
from ..settings import Settings

__all__ = ["Tolerances", "scene_tolerances"]

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


@dataclass(frozen=True, slots=True)
class Tolerances:
    """delta_m: of culling and filtering, metres along a ray; margin_m: the least nontrivial amount, metres."""

    delta_m: float
    margin_m: float

    def margin_disparity(self, coding: DepthCoding) -> float:
        """The least nontrivial amount in a camera's disparities, 1/m."""
        return _MARGIN_STEPS * coding.step


def scene_tolerances(views: Sequence[View], settings: Settings) -> Tolerances:
    """Tolerances from the depths of the first frame; `settings.delta_m` is taken as it is."""
    delta = settings.delta_m
    if delta is None:
        delta = _automatic_delta(views)
    return Tolerances(delta, _MARGIN_SHARE * delta)


def _automatic_delta(views: Sequence[View]) -> float:
    medians, steps = [], []
    for view in views:
        stride = max(1, math.isqrt(view.codes.size // 16384))
        depth = view.camera.depth.depth(view.codes[::stride, ::stride])
        depth = depth[np.isfinite(depth)]
        if depth.size:
            medians.append(float(np.median(depth)))
            steps.append(float(np.percentile(depth, 95)) ** 2 * view.camera.depth.step)
    if not medians:
        raise ValueError("first frame: no view has a valid depth: expected at least one")
    return max(_DELTA_SHARE * float(np.median(medians)), _DELTA_STEPS * float(np.median(steps)))
