"""Depth at the extremes of its coding: ranges, bits, single codes, noise, surfaces seen at a grazing angle."""

from __future__ import annotations

import dataclasses
import math
from functools import partial
from typing import Any

import numpy as np

from ...pipeline.engine import Engine
from ...rig.camera import Camera, Perspective
from ...rig.depth import DepthCoding
from ...rig.frame import Frame, View
from ...settings import Settings
from .case import Case, Measured
from .pictures import Shot, against_truth, take
from .room import CODING, Room, rig, turned

__all__ = ["depth_cases"]

_FLAT = Perspective.from_fov(80, 60, 1.4)
_HOME = turned((0.05, 0.11, 0.02), 4, 2, -3)
_GRAZED = Room((((-7.0, -6.0, -0.165), (9.0, 6.0, 2.8)),))  # the floor is 14 mm below the lowest camera


def depth_cases() -> list[Case]:
    """Cases of depth codings, codes, noise and delta."""
    return [*_codings(), *_codes(), *_noises(), *_deltas()]


def _truth(coding: DepthCoding, room: Room | None = None, **options: Any) -> list[Measured]:
    target = Camera("target", _FLAT, _HOME, coding)
    shot = Shot(target, rig(coding=coding), room or Room(), **options)
    picture, _engine = take(shot)
    return against_truth(shot, picture)


def _codings() -> list[Case]:
    ranges = ((0.4, math.inf), (1e-2, math.inf), (1.5, 1.5e6), (1e-2, 1e4), (1e-3, 1e3))
    cases = [
        Case("depth range", f"{near:g} to {far:g} m", partial(_truth, DepthCoding(near, far, 16, has_invalid=invalid)))
        for near, far in ranges
        for invalid in ([True] if math.isfinite(far) else [False])
    ]
    cases += [Case("depth of", f"{bits} bits", partial(_truth, DepthCoding(0.4, 20.0, bits))) for bits in range(8, 17)]
    grazing = partial(_truth, DepthCoding(0.01, 40.0), _GRAZED)
    return [*cases, Case("surfaces", "floor 14 mm below a camera", grazing)]


def _codes() -> list[Case]:
    """Cases with one camera and the viewer in its place, so that the picture is the view."""
    codings = {
        "far 20 m": dataclasses.replace(CODING, has_invalid=False),
        "far infinite": DepthCoding(0.4, math.inf),
        "8 bits": DepthCoding(0.4, 20.0, 8),
    }
    cases = []
    for name, coding in codings.items():
        top = coding.max_code
        alternating = {
            "all 0": (0, 0),
            "all 1": (1, 1),
            "all the largest": (top, top),
            "0 and the largest by turns": (0, top),
            "1 more and less by turns": (top // 5, top // 5 + 1),
        }
        cases += [
            Case(f"depth codes, {name}", pattern, partial(_coded, coding, *codes))
            for pattern, codes in alternating.items()
        ]
    return [
        *cases,
        Case("depth codes", "none valid at first", partial(_coded, CODING, 9000, 9000, without=2)),
        Case("depth codes", "every second valid", partial(_coded, CODING, 0, 9000)),
    ]


def _coded(coding: DepthCoding, even: int, odd: int, without: int = 0) -> list[Measured]:
    """Errors of a view whose depth codes alternate between `even` and `odd` like the squares of a chess board.

    without: number of the first frames, which have no depth at all. Luma is compared with the view's own. Disparity
    must lie between the least and the largest of the view.
    """
    camera = rig((36, 24), coding=coding)[0]
    board = np.indices((camera.height, camera.width)).sum(axis=0) % 2
    view = View(camera, Room().view(camera).texture, np.where(board, odd, even).astype(np.uint16))
    viewer = dataclasses.replace(camera, name="target")
    engine = Engine([camera], Settings.preset("balanced", antialias="none"))  # every pixel may be an outline
    for index in range(3):
        shown = dataclasses.replace(view, codes=np.zeros_like(view.codes)) if index < without else view
        engine.update(Frame(index, (shown,)), {"viewer": viewer})
    picture = engine.render_camera(viewer, "viewer")
    inner = np.s_[1:-1, 1:-1]  # the surface ends in the middle of the outermost pixels
    luma = np.abs(picture.texture.y[inner].astype(np.float64) - view.texture.y[inner])
    q = coding.disparity(view.codes)
    outside = np.maximum(picture.disparity - np.nanmax(q), np.nanmin(q) - picture.disparity)[inner]
    rounding = 2.0**-20 * float(np.nanmax(q)) + coding.step
    return [
        Measured(float(luma.max()), 1.0, "codes"),
        Measured(max(float(outside.max()), 0.0), rounding, "1/m"),
    ]


def _noises() -> list[Case]:
    return [
        Case("depth wrong by up to", f"{100 * noise:g} %", partial(_truth, CODING, noise=noise))
        for noise in (0.001, 0.01, 0.03, 0.05)
    ]


def _deltas() -> list[Case]:
    return [
        Case("delta", f"{delta:g} m", partial(_truth, CODING, settings=Settings.preset("balanced", delta_m=delta)))
        for delta in (0.0, 1e-6, 50.0, 1e6)
    ]
