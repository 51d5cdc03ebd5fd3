"""What depth codes seem to mean: the reading of them with which neighbouring views show the same luma."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..rig.camera import Camera
from ..rig.depth import DepthCoding
from .yuv import RawVideo

__all__ = ["StillView", "doubt_coding"]

_SAMPLES = 64  # rows and columns of pixels that are compared
_PAIRS = 8  # views that are compared with their neighbour, at most
_ENOUGH = 500  # pixels that both views show
_BETTER, _WORSE = 0.5, 8.0  # another reading halves the difference, and lessens it by this many 10-bit codes

F64 = npt.NDArray[np.float64]
Reading = Callable[[F64, DepthCoding], F64]  # codes as shares of the largest one -> depth in metres


def _defined(share: F64, coding: DepthCoding) -> F64:
    return 1.0 / (1.0 / coding.far + share * (1.0 / coding.near - 1.0 / coding.far))


_OTHERS: dict[str, Reading] = {  # as other programs write depth
    "millimetres": lambda share, coding: share * coding.max_code / 1000.0,
    "linear in depth, the largest the farthest": lambda share, coding: coding.near + share * (coding.far - coding.near),
    "linear in depth, the largest the nearest": lambda share, coding: coding.far - share * (coding.far - coding.near),
    "linear in disparity, the largest the farthest": lambda share, coding: _defined(1.0 - share, coding),
}


@dataclass(frozen=True, slots=True)
class StillView:
    """A camera that does not move, and its files, each of at least one frame."""

    camera: Camera
    texture: RawVideo
    depth: RawVideo


def doubt_coding(views: Sequence[StillView]) -> list[str]:
    """A warning if another reading of depth codes makes the first pictures of neighbouring views agree much better.

    There is none where views are too few, or show too little of the same.
    """
    pairs = [(view, _neighbour(view, views)) for view in views[:: -(-len(views) // _PAIRS)]] if len(views) > 1 else []
    defined = _difference(pairs, _defined)
    others = {name: _difference(pairs, reading) for name, reading in _OTHERS.items()}
    name = min(others, key=lambda name: others[name])
    if not np.isfinite(defined) or others[name] >= min(_BETTER * defined, defined - _WORSE):
        return []
    said = f"views differ by {defined:.0f} codes of luma, but by {others[name]:.0f} if depth codes are {name}"
    return [f"depth: {said}: expected codes linear in disparity, the largest the nearest"]


def _neighbour(view: StillView, views: Sequence[StillView]) -> StillView:
    """The nearest of the other views that looks in a similar direction."""
    forward = view.camera.pose.rotation()[:, 0]

    def apart(other: StillView) -> float:
        distance = np.linalg.norm(np.subtract(other.camera.pose.position, view.camera.pose.position))
        return float(distance * (2.0 - forward @ other.camera.pose.rotation()[:, 0]))

    return min((other for other in views if other is not view), key=apart)


def _difference(pairs: Sequence[tuple[StillView, StillView]], reading: Reading) -> float:
    """The median difference of luma between views and what their neighbours show there, 10-bit codes.

    It is infinite where they show too little of the same.
    """
    found = [_differences(view, other, reading) for view, other in pairs]
    together = np.concatenate([np.empty(0), *found])
    return float(np.median(together)) if len(together) >= _ENOUGH else np.inf


def _differences(view: StillView, other: StillView, reading: Reading) -> F64:
    camera, neighbour = view.camera, other.camera
    v, u = np.meshgrid(_spread(camera.height), _spread(camera.width), indexing="ij")
    codes = view.depth.plane(0, 0)[v, u].astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = reading(codes / camera.depth.max_code, camera.depth)
        uv, there = neighbour.project(camera.unproject(np.stack([u + 0.5, v + 0.5], axis=-1), depth))
    inside = (there > 0) & np.isfinite(uv).all(axis=-1) & ((codes > 0) | (not camera.depth.has_invalid))
    inside &= (uv >= 0).all(axis=-1) & (uv[..., 0] < neighbour.width) & (uv[..., 1] < neighbour.height)
    columns, rows = uv[inside].astype(np.int64).T
    here, seen = _luma(view, v[inside], u[inside]), _luma(other, rows, columns)
    return np.abs(here - seen)


def _spread(size: int) -> npt.NDArray[np.int64]:
    return np.linspace(0, size - 1, min(size, _SAMPLES)).astype(np.int64)


def _luma(view: StillView, rows: npt.NDArray[np.int64], columns: npt.NDArray[np.int64]) -> F64:
    """Luma of some pixels, as 10-bit codes."""
    luma = view.texture.plane(0, 0)[rows, columns].astype(np.float64)
    return luma * 2.0 ** (10 - view.texture.format.bits)
