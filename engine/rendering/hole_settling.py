"""Keeps the filling of holes steady while the head is still. Otherwise it would crawl, because noisy depth moves a
hole's rim a little in every frame, and the filling continues from the rim."""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..geometry.prepared_view import pixels_per_radian
from ..rig.camera import Camera
from ..support.array_types import F32

__all__ = ["Settler"]

_STAYS = 0.85  # weight of a pixel's last colour in each picture
_CHANGE = 64.0  # codes: a colour that differs by less from the last one counts as the same, else as new
_SHIFT_PX = 0.5  # the head counts as still if near things moved by less in the picture
_VIEWERS = 32  # viewers whose holes are kept; those not seen for the longest time are forgotten


@dataclass(frozen=True, slots=True)
class _Holes:
    """A picture's hole pixels: their places int64 [n] in ascending order and their colours float32 [n, 3]."""

    camera: Camera
    places: npt.NDArray[np.int64]
    colours: F32


class Settler:
    """Remembers the filled holes of each viewer's last picture. Threads may use it at the same time for different
    viewers."""

    def __init__(self) -> None:
        self._last: OrderedDict[str, _Holes] = OrderedDict()

    def settle(
        self, viewer: str, camera: Camera, near: float, holes: npt.NDArray[np.int32], planes: tuple[F32, F32, F32]
    ) -> None:
        """Pull the colours of a filled picture's holes towards those in the viewer's last picture, in place.

        holes int32 [n, 2]: their rows and columns in reading order; planes [h, w]; near: distance of near things,
        metres, which gives the motion of the picture with the head. Nothing changes if the head has moved, nor in
        pixels whose colour is new.
        """
        places = holes[:, 0].astype(np.int64) * camera.width + holes[:, 1]
        flat = [plane.reshape(-1) for plane in planes]
        colours = np.stack([plane[places] for plane in flat], axis=1)
        last = self._last.pop(viewer, None)
        if last is not None and len(last.places) and len(places) and _is_still(last.camera, camera, near):
            index = np.minimum(np.searchsorted(last.places, places), len(last.places) - 1)
            before = last.colours[index]
            same = (last.places[index] == places) & (np.abs(before - colours).max(axis=1) < _CHANGE)
            colours[same] += _STAYS * (before[same] - colours[same])
            for plane, values in zip(flat, colours.T, strict=True):
                plane[places] = values
        self._last[viewer] = _Holes(camera, places, colours)
        while len(self._last) > _VIEWERS:
            self._last.popitem(last=False)


def _is_still(last: Camera, camera: Camera, near: float) -> bool:
    """Whether two pictures show things at the same places, within half a pixel."""
    if last.projection != camera.projection:
        return False
    moved = math.dist(last.pose.position, camera.pose.position) / near
    cosine = abs(float(np.dot(last.pose.orientation, camera.pose.orientation)))
    turned = 2.0 * math.acos(min(1.0, cosine))
    return (moved + turned) * pixels_per_radian(camera) < _SHIFT_PX
