"""Video and pictures with rates that differ by a factor of a hundred, for an engine that shows the newest frame."""

from __future__ import annotations

import dataclasses

import numpy as np

from ...pipeline.engine import Engine
from ...rig.camera import Camera, Perspective
from .case import Case, Measured
from .pictures import Shot, against_truth, take
from .room import CODING, Room, rig, turned

__all__ = ["rate_cases"]

_TIMES = 100
_STEP_M = 0.01  # distance that each box hanging in the room moves per frame


def rate_cases() -> list[Case]:
    """Cases with many frames per picture, and with many pictures per frame."""
    return [
        Case("frames a picture", f"{_TIMES}, in which all moves", _frames_a_picture),
        Case("pictures a frame", f"{_TIMES}, from a moving head", _pictures_a_frame),
    ]


def _target(turn: float = 0.0) -> Camera:
    """A head on its closed path, at the angle `turn` in radians."""
    place = (0.05 + 0.05 * np.cos(turn), 0.11 * np.cos(3.0 * turn), 0.02 + 0.05 * np.sin(turn))
    return Camera("target", Perspective.from_fov(80, 60, 1.4), turned(place, 4 * np.sin(turn), 2, -3), CODING)


def _frames_a_picture() -> list[Measured]:
    """A picture after the first frame and one after a hundred more, each against the room of its frame."""
    cameras, target = rig(), _target()
    engine = Engine(cameras)
    found: list[Measured] = []
    for index in range(_TIMES + 1):
        room = _later(index)
        engine.update(room.frame(cameras, index), {"viewer": target})
        if index in (0, _TIMES):
            shot = Shot(target, cameras, room, engine.settings)
            found += against_truth(shot, engine.render_camera(target, "viewer"))
    return found


def _later(index: int) -> Room:
    """The room `index` frames later: one box has moved to the left, the other to the right."""
    room = Room()
    boxes = np.array(room.boxes)
    boxes[1:, :, 1] += _STEP_M * index * np.array([[1.0], [-1.0]])
    return dataclasses.replace(room, boxes=boxes.tolist())


def _pictures_a_frame() -> list[Measured]:
    """A hundred pictures against the room; they must change neither the model nor a repetition of the first picture."""
    shot = Shot(_target(), rig(), frames=1)
    first, engine = take(shot)
    before = engine.status()
    found = []
    for turn in np.linspace(0.0, 2.0 * np.pi, _TIMES):
        there = dataclasses.replace(shot, target=_target(turn))
        found += against_truth(there, engine.render_camera(there.target, "viewer"))
    again = engine.render_camera(shot.target, "viewer")
    differing = np.count_nonzero(again.texture.y != first.texture.y) + (engine.status() != before)
    return [*found, Measured(int(differing), 0.0, "pixels, or the model")]
