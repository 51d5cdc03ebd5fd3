"""Actors: people who walk or stand, a frog puppet, rolling balls, a carton on a trolley."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..support.array_types import F64
from .parts import Group, box, capsule, ellipsoid, placed, turn

__all__ = ["Actor", "Clothes", "Path", "ball", "carton", "frog", "person", "stander", "walker"]

Actor = Callable[[float], Group]  # time in seconds -> the solids at that time


@dataclass(frozen=True)
class Clothes:
    """Materials of a person."""

    skin: int
    hair: int
    top: int
    legs: int
    shoes: int


@dataclass(frozen=True)
class Path:
    """A walk to and fro along a polyline on the floor.

    points: corners (x, y), metres. speed: metres a second. start: seconds until the walk begins.
    """

    points: Sequence[tuple[float, float]]
    speed: float
    start: float = 0.0

    def at(self, time: float) -> tuple[F64, float, float]:
        """Position [2] in metres, heading in radians, and distance walked so far in metres, at `time` in seconds."""
        points = np.asarray(self.points, np.float64)
        lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
        walked = max(0.0, time - self.start) * self.speed
        total = float(lengths.sum())
        back = walked % (2 * total) > total
        along = min(walked % (2 * total), 2 * total - walked % (2 * total))
        ends = np.cumsum(lengths)
        leg = min(int(np.searchsorted(ends, along)), len(lengths) - 1)
        share = (along - (ends[leg] - lengths[leg])) / lengths[leg]
        step = points[leg + 1] - points[leg]
        heading = math.atan2(step[1], step[0]) + (math.pi if back else 0.0)
        return points[leg] + share * step, heading, walked


def person(clothes: Clothes, height: float, phase: float, stride: float, lean: float, wave: float) -> Group:
    """Someone at the origin who faces x.

    `phase` (radians) and `stride` (radians of swing; 0 for standing) pose the legs. `lean` (metres at the shoulders)
    bends the body forward, and `wave` (radians) lifts the left forearm.
    """
    h = height
    hip, shoulder = np.array([0.0, 0.0, 0.52 * h]), np.array([lean, 0.0, 0.80 * h])
    parts = [
        ellipsoid(clothes.top, 0.55 * shoulder + 0.45 * hip, (0.072 * h, 0.105 * h, 0.19 * h), turn(0, lean)),
        ellipsoid(clothes.legs, hip, (0.07 * h, 0.095 * h, 0.075 * h)),
        capsule(
            clothes.top,
            shoulder + _at(0, -0.085 * h, 0),
            shoulder + _at(0, 0.085 * h, 0),
            0.042 * h,
            (1, 0, 0),
        ),
        capsule(clothes.skin, shoulder, shoulder + _at(lean, 0, 0.08 * h), 0.03 * h),
        ellipsoid(
            clothes.skin,
            shoulder + _at(1.4 * lean + 0.008 * h, 0, 0.125 * h),
            (0.05 * h, 0.043 * h, 0.066 * h),
        ),
        ellipsoid(
            clothes.hair,
            shoulder + _at(1.4 * lean - 0.012 * h, 0, 0.142 * h),
            (0.052 * h, 0.05 * h, 0.06 * h),
        ),
    ]
    for side in (-1.0, 1.0):
        swing = side * stride * math.sin(phase)
        bend = stride * max(0.0, math.sin(phase * 1.0 + (0.5 if side > 0 else 0.5 + math.pi)) + 0.2)
        parts += _leg(clothes, h, hip + _at(0, side * 0.055 * h, 0), swing, bend)
        lift = wave if side > 0 else 0.15
        parts += _arm(
            clothes, h, shoulder + _at(0, side * 0.115 * h, 0), -0.8 * swing, lift + 0.6 * stride, side
        )
    return parts


def walker(clothes: Clothes, height: float, path: Path) -> Actor:
    """Someone who walks or runs along a path; at a higher speed with longer strides and leaning forward more."""

    def at(time: float) -> Group:
        position, heading, walked = path.at(time)
        going = time > path.start
        stride = min(0.85, 0.28 + 0.14 * path.speed) if going else 0.0
        step = 0.78 + 0.22 * path.speed  # metres a step: half the distance between two footfalls of one foot
        lean = 0.03 * path.speed if going else 0.0
        group = person(clothes, height, math.pi * walked / step, stride, lean, 0.2)
        bounce = 0.02 * abs(math.sin(math.pi * walked / step))
        return placed(group, (*position, bounce), heading)

    return at


def stander(
    clothes: Clothes, height: float, position: tuple[float, float], yaw: float, phase: float
) -> Actor:
    """Someone who stays in place, sways, turns a little and waves an arm; `phase` shifts these motions, radians."""

    def at(time: float) -> Group:
        sway = math.sin(1.3 * time + phase)
        group = person(
            clothes, height, phase, 0.06, 0.02 + 0.015 * sway, 0.9 + 0.6 * math.sin(2.1 * time + phase)
        )
        x, y = position
        return placed(group, (x + 0.02 * sway, y + 0.03 * math.sin(0.9 * time + phase), 0), yaw + 0.15 * sway)

    return at


def ball(material: int, radius: float, path: Path, bounce: float = 0.0, floor: float = 0.0) -> Actor:
    """A ball that rolls along a path and bounces up to `bounce` metres; `floor` is the height of the ground, metres."""

    def at(time: float) -> Group:
        position, heading, walked = path.at(time)
        up = bounce * abs(math.sin(2.2 * max(0.0, time - path.start)))
        rolled = turn(heading) @ turn(0, walked / radius)
        return [ellipsoid(material, (*position, floor + radius + up), (radius,) * 3, rolled)]

    return at


def carton(material: int, size: float, path: Path) -> Actor:
    """A box on a small trolley, pulled along a path."""

    def at(time: float) -> Group:
        position, heading, _ = path.at(time)
        parts = [
            box(material, (0, 0, 0.12 + 0.5 * size), (size, 0.8 * size, size)),
            box(material, (0, 0, 0.08), (1.1 * size, 0.9 * size, 0.06)),
        ]
        parts += [
            ellipsoid(material, (x, y, 0.05), (0.05, 0.03, 0.05))
            for x in (-0.4 * size, 0.4 * size)
            for y in (-0.35 * size, 0.35 * size)
        ]
        return placed(parts, (*position, 0), heading)

    return at


def frog(
    body: int, belly: int, eye: int, pupil: int, sleeve: int, skin: int, path: Path, table: float
) -> Actor:
    """A hand puppet, 0.2 m tall, on somebody's arm; it hops along a path on a table whose top is at height `table`."""

    def at(time: float) -> Group:
        (x, y), _, walked = path.at(time)
        hop = 0.05 * abs(math.sin(14.0 * walked))
        nod = 0.15 * math.sin(9.0 * walked)
        parts = [
            ellipsoid(body, (0, 0, 0.06), (0.055, 0.06, 0.065)),
            ellipsoid(belly, (-0.018, 0, 0.055), (0.045, 0.045, 0.05)),
            ellipsoid(body, (-0.01, 0, 0.14), (0.055, 0.065, 0.035), turn(0, nod)),
            ellipsoid(belly, (-0.02, 0, 0.125), (0.052, 0.055, 0.02), turn(0, nod)),
            capsule(sleeve, (0.03, 0.02, 0.09), (0.25, 0.11, 1.0), 0.035),
            capsule(skin, (0.02, 0.01, 0.07), (0.04, 0.025, 0.14), 0.028),
        ]
        for side in (-1.0, 1.0):
            parts += [
                ellipsoid(eye, (-0.025, 0.03 * side, 0.172), (0.018, 0.018, 0.018)),
                ellipsoid(pupil, (-0.038, 0.032 * side, 0.175), (0.008, 0.009, 0.009)),
                capsule(body, (-0.03, 0.05 * side, 0.09), (-0.06, 0.075 * side, 0.03 + hop), 0.011),
                capsule(body, (0.01, 0.05 * side, 0.03), (-0.03, 0.09 * side, 0.012), 0.015),
                ellipsoid(belly, (-0.055, 0.09 * side, 0.008), (0.03, 0.018, 0.008)),
            ]
        return placed(parts, (x, y, table + hop), 0.4 * math.sin(3.0 * walked))

    return at


def _at(x: float, y: float, z: float) -> F64:
    return np.array([x, y, z], np.float64)


def _leg(clothes: Clothes, h: float, hip: F64, swing: float, bend: float) -> Group:
    knee = hip + 0.245 * h * np.array([math.sin(swing), 0.0, -math.cos(swing)])
    shin = swing - bend
    ankle = knee + 0.235 * h * np.array([math.sin(shin), 0.0, -math.cos(shin)])
    return [
        capsule(clothes.legs, hip, knee, 0.047 * h),
        capsule(clothes.legs, knee, ankle, 0.034 * h),
        ellipsoid(clothes.shoes, ankle + _at(0.03 * h, 0, -0.012 * h), (0.075 * h, 0.028 * h, 0.028 * h)),
    ]


def _arm(clothes: Clothes, h: float, shoulder: F64, swing: float, lift: float, side: float) -> Group:
    elbow = shoulder + 0.17 * h * np.array([math.sin(swing), 0.12 * side, -math.cos(swing)])
    fore = swing + lift
    hand = elbow + 0.16 * h * np.array([math.sin(fore), 0.0, -math.cos(fore)])
    return [
        capsule(clothes.top, shoulder, elbow, 0.03 * h),
        capsule(clothes.top, elbow, hand, 0.024 * h),
        ellipsoid(clothes.skin, hand, (0.026 * h, 0.02 * h, 0.03 * h)),
    ]
