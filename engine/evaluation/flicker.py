"""Flicker: how much a picture changes from frame to frame where the truth keeps still.

A head that keeps still looks at a scene of which most keeps still too. What changes there all the same is the
renderer's own doing: depth errors that move surfaces, other views chosen, holes filled otherwise.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..io.recording import Recording
from ..pipeline.engine import Engine
from ..settings import Settings

__all__ = ["Flicker", "FlickerMeter", "Steadiness", "measure_flicker", "watch_flicker"]

STILL = 4.0  # codes of 10 bits: what changes by no more keeps still
REACH_PX = 3  # how far a pixel has to be from what moves: renderers may be off by two pixels, and interpolate
ROUNDING = 0.5  # codes of 10 bits: the least change that a truth is taken to have, as rounding alone makes it

Luma = npt.NDArray[np.integer] | npt.NDArray[np.floating]
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Steadiness:
    """Mean absolute change of luma from a frame to the next, in codes of 10 bits, over the pixels that count.

    share: of all pixels in all pairs of frames, how many counted; where none did the changes are 0.
    """

    share: float
    rendered: float
    truth: float

    @property
    def ratio(self) -> float:
        """The rendered pictures' change over the truth's, which is taken to be at least ROUNDING."""
        return self.rendered / max(self.truth, ROUNDING)


@dataclass(frozen=True, slots=True)
class Flicker:
    """Steadiness of the whole picture, and of what was a hole in either frame of a pair."""

    whole: Steadiness
    holes: Steadiness


class FlickerMeter:
    """Takes frames one by one and keeps nothing but sums and the frame before."""

    def __init__(self, bits: int = 10) -> None:
        self._scale = 2.0 ** (10 - bits)
        self._seen = 0
        self._sums = np.zeros((2, 3))  # whole and holes: pixels, change of the rendered, change of the truth
        self._before: tuple[Luma, Luma, Bools] | None = None

    def add(self, rendered: Luma, truth: Luma, holes: Bools | None = None) -> None:
        """The next frame: luma [h, w] in codes, its truth, and what only filling coloured (by default nothing).

        Of a pair of frames those pixels count that are farther than REACH_PX, along rows and columns, from any
        where the truth changed by more than STILL. Raises ValueError if the sizes differ.
        """
        shape = self._before[0].shape if self._before is not None else truth.shape
        holes = np.zeros(shape, np.bool_) if holes is None else holes
        for name, plane in (("rendered", rendered), ("truth", truth), ("holes", holes)):
            if plane.shape != shape:
                raise ValueError(f"{name}: {plane.shape}: expected the size of the others, {shape}")
        if self._before is not None:
            old_rendered, old_truth, old_holes = self._before
            changes = np.stack([self._change(old_rendered, rendered), self._change(old_truth, truth)])
            counts = ~_grown(changes[1] > STILL)
            self._seen += counts.size
            for k, mask in enumerate((counts, counts & (holes | old_holes))):
                self._sums[k] += np.count_nonzero(mask), *changes[:, mask].sum(axis=1)
        self._before = rendered, truth, holes

    def result(self) -> Flicker:
        """The flicker so far; raises ValueError for fewer than two frames."""
        if not self._seen:
            raise ValueError("frames: fewer than two: expected at least one pair to compare")
        whole, holes = (
            Steadiness(count / self._seen, rendered / max(count, 1.0), truth / max(count, 1.0))
            for count, rendered, truth in self._sums.tolist()
        )
        return Flicker(whole, holes)

    def _change(self, before: Luma, now: Luma) -> npt.NDArray[np.float64]:
        change: npt.NDArray[np.float64] = self._scale * np.abs(now.astype(np.float64) - before)
        return change


def measure_flicker(
    rendered: Iterable[Luma], truth: Iterable[Luma], holes: Iterable[Bools] | None = None, *, bits: int = 10
) -> Flicker:
    """Flicker of frames that are read in step, as `FlickerMeter.add` takes them; `bits` are those of the codes.

    Raises ValueError for fewer than two frames, or if their sizes or numbers differ.
    """
    meter = FlickerMeter(bits)
    if holes is None:
        for picture, true in zip(rendered, truth, strict=True):
            meter.add(picture, true)
    else:
        for picture, true, mask in zip(rendered, truth, holes, strict=True):
            meter.add(picture, true, mask)
    return meter.result()


def watch_flicker(
    sequence: Recording, camera: str, frames: int, settings: Settings, sources: Iterable[str] | None = None
) -> Flicker:
    """Play at most `frames` frames for a head that keeps still at a virtual camera with ground truth.

    `sources` are the views given, by default all. Raises ValueError for a moving camera, or where there is no ground
    truth or no pair of frames.
    """
    if sequence.poses(camera) is not None:
        raise ValueError(f"camera: {camera!r}: moves: expected one that stands still")
    names = tuple(sources or sequence.source_names)
    target, meter = sequence.camera(camera), FlickerMeter()
    engine = Engine([sequence.camera(name) for name in names], settings, f_vin=sequence.fps)
    for index in range(min(frames, sequence.frame_count)):
        engine.update(sequence.frame(index, names), {camera: target})
        picture = engine.render_camera(target, camera)
        meter.add(picture.texture.y, sequence.texture(camera, index).y, picture.holes())
    return meter.result()


def _grown(mask: Bools) -> Bools:
    """The mask [h, w], and what is within REACH_PX of it along rows and columns."""
    for axis in (0, 1):
        padded = np.pad(mask, [(REACH_PX, REACH_PX) if a == axis else (0, 0) for a in (0, 1)])
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * REACH_PX + 1, axis=axis)
        mask = np.asarray(windows.any(axis=-1))
    return mask
