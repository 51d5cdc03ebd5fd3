"""Flicker: how much a picture changes from frame to frame where the truth keeps still.

When the head keeps still, most of what it sees keeps still too. Any change there is caused by the renderer: by depth
errors that move surfaces, by another choice of views, by holes that are filled differently.
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

STILL = 4.0  # 10-bit codes: a pixel that changes by at most this keeps still
REACH_PX = 3  # least distance of a pixel from anything that moves: renderers may be off by two pixels, and interpolate
ROUNDING = 0.5  # 10-bit codes: the least change assumed for the truth, because rounding alone causes as much

Luma = npt.NDArray[np.integer] | npt.NDArray[np.floating]
Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Steadiness:
    """Mean absolute change of luma from one frame to the next, in 10-bit codes, over the pixels that count.

    share: the fraction of all pixels in all pairs of frames that counted. If none did, the changes are 0.
    """

    share: float
    rendered: float
    truth: float

    @property
    def ratio(self) -> float:
        """The rendered pictures' change divided by the truth's, which counts as at least ROUNDING."""
        return self.rendered / max(self.truth, ROUNDING)


@dataclass(frozen=True, slots=True)
class Flicker:
    """Steadiness of the whole picture, and of the pixels that were a hole in either frame of a pair."""

    whole: Steadiness
    holes: Steadiness


class FlickerMeter:
    """Takes frames one by one, and keeps only sums and the previous frame. `bits`: of the luma codes."""

    def __init__(self, bits: int = 10) -> None:
        self._scale = 2.0 ** (10 - bits)
        self._seen = 0
        self._sums = np.zeros((2, 3))  # whole and holes: pixels, change of the rendered, change of the truth
        self._before: tuple[Luma, Luma, Bools] | None = None

    def add(self, rendered: Luma, truth: Luma, holes: Bools | None = None) -> None:
        """Take the next frame: its luma [h, w] in codes, the truth's, and a mask of holes (by default none).

        Holes are the pixels that only filling coloured. In a pair of frames a pixel counts if it is farther than
        REACH_PX, along rows and columns, from every pixel where the truth changed by more than STILL. Raises ValueError
        if the sizes differ.
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
    """Flicker of a sequence of frames; arguments as in `FlickerMeter.add`, one item per frame; `bits`: of the codes.

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
    """Play at most `frames` frames for a head that keeps still at the virtual camera `camera`, and measure its flicker.

    `sources` names the source views to render from, by default all. Raises ValueError for a moving camera, for one
    without ground truth, or for fewer than two frames.
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
    """The mask [h, w] grown by REACH_PX along rows and columns."""
    for axis in (0, 1):
        padded = np.pad(mask, [(REACH_PX, REACH_PX) if a == axis else (0, 0) for a in (0, 1)])
        windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * REACH_PX + 1, axis=axis)
        mask = np.asarray(windows.any(axis=-1))
    return mask
