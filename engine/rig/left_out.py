"""Views that are left out of a frame because they show nothing, and the count of all views that are left out."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .depth import DepthCoding
from .frame import Fault, Frame

__all__ = ["LeftOut", "Shown", "empty_views", "without_empty_views"]

_BLACK = Fault("black", "the picture is black, but another view's is not")
_NO_DEPTH = Fault("no depth", "no pixel has depth")
_BLACK_LUMA = 64 / 1024  # of the range of codes: the darkest code of limited range

Plane = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


class Shown(NamedTuple):
    """What a view shows: its luma [h, w] of `bits` bits, its depth codes [h, w], and their coding."""

    luma: Plane
    bits: int
    codes: Plane
    coding: DepthCoding


def empty_views(views: Sequence[Shown | None]) -> list[Fault | None]:
    """For each view of a frame why it shows nothing; None if it shows something. A view that is None is left out
    already.

    A view shows nothing if no pixel has depth, or if its picture is black and another view's is not. If all pictures
    are black, it is dark: then they are pictures. A depth coding without a code for "no depth" cannot say that there is
    no depth. There, a black picture whose codes are all 0 has none.
    """
    dark = [view is not None and _none_above(view.luma, _BLACK_LUMA * (1 << view.bits)) for view in views]
    without = [view is not None and _has_no_depth(view, black) for view, black in zip(views, dark, strict=True)]
    seen = [view is not None and not no_depth for view, no_depth in zip(views, without, strict=True)]
    bright = any(there and not black for there, black in zip(seen, dark, strict=True))
    return [
        _NO_DEPTH if no_depth else _BLACK if black and bright else None
        for no_depth, black in zip(without, dark, strict=True)
    ]


def without_empty_views(frame: Frame) -> Frame:
    """The frame, in which views that show nothing (`empty_views`) are left out; the same object if there are none."""
    shown = [
        Shown(view.texture.y, 10, view.codes, view.camera.depth) if view.there else None for view in frame.views
    ]
    faults = empty_views(shown)
    if not any(faults):
        return frame
    views = zip(frame.views, faults, strict=True)
    return dataclasses.replace(
        frame, views=tuple(dataclasses.replace(view, fault=fault or view.fault) for view, fault in views)
    )


def _has_no_depth(view: Shown, black: bool) -> bool:
    return (black or view.coding.has_invalid) and _none_above(view.codes, 0)


def _none_above(plane: Plane, limit: float) -> bool:
    """Whether no sample is above a limit; most often one row answers."""
    return bool(plane[len(plane) // 2].max() <= limit and plane.max() <= limit)


class LeftOut:
    """How often views were left out, by camera and reason."""

    def __init__(self) -> None:
        self._counts: dict[str, Counter[str]] = {}

    def add(self, faults: Mapping[str, Fault]) -> dict[str, Fault]:
        """Count the views that are left out of a frame (`Frame.faults`); returns those with a camera and a reason that
        were not counted before."""
        new = {}
        for camera, fault in faults.items():
            counts = self._counts.setdefault(camera, Counter())
            if not counts[fault.reason]:
                new[camera] = fault
            counts[fault.reason] += 1
        return new

    def counts(self) -> dict[str, dict[str, int]]:
        """The numbers of views, by camera and reason."""
        return {camera: dict(counts) for camera, counts in self._counts.items()}

    def __str__(self) -> str:
        """The same for people; "" if there were none."""
        cameras = [
            f"{camera} {', '.join(f'{count}x ({reason})' for reason, count in counts.items())}"
            for camera, counts in self._counts.items()
        ]
        return "; ".join(cameras)
