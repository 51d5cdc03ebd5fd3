"""The kinds of hole filling side by side, compared with ground truth inside the holes only."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..io.recording import Recording
from ..pipeline.engine import Engine
from ..settings import Settings
from ..support.array_types import F64
from .peers import nearest_views

__all__ = ["KINDS", "HoleSample", "compare_fills", "similarity"]

KINDS = ("smooth", "structure")
_PEAK = 1023.0
_WINDOW = np.exp(-0.5 * (np.arange(-5, 6) / 1.5) ** 2)  # Gaussian window of structural similarity


@dataclass(frozen=True, slots=True)
class HoleSample:
    """The holes of one picture, filled in one way.

    share: fraction of the picture's pixels. error: mean squared error of luma, codes squared. ssim: mean similarity.
    """

    camera: str
    frame: int
    kind: str
    share: float
    error: float
    ssim: float

    @property
    def psnr_y(self) -> float:
        """PSNR of luma inside the holes, dB."""
        return 10 * math.log10(_PEAK**2 / max(self.error, 1e-6))


def compare_fills(
    sequence: Recording, cameras: Sequence[str], frames: Sequence[int], views: int, settings: Settings
) -> Iterator[HoleSample]:
    """Play the sequence up to the last of `frames`; yields a sample per frame, camera and kind if there are holes.

    Each camera, which must have ground truth, is rendered from the `views` source views nearest to it.
    """
    for name in cameras:
        sources = nearest_views(sequence, name, views)
        rig = [sequence.camera(source) for source in sources]
        engines = {
            kind: Engine(rig, replace(settings, n_render=views, fill=kind), f_vin=sequence.fps) for kind in KINDS
        }
        for index in range(max(frames) + 1):
            target, frame = sequence.camera(name, index), sequence.frame(index, sources)
            for kind, engine in engines.items():
                engine.update(frame, {name: target} if index in frames else None)
                if index in frames:
                    picture = engine.render_camera(target, name)
                    holes, truth = picture.holes(), sequence.texture(name, index).y
                    if holes.any():
                        error = np.mean((picture.texture.y[holes].astype(np.float64) - truth[holes]) ** 2)
                        alike = float(similarity(picture.texture.y, truth)[holes].mean())
                        yield HoleSample(name, index, kind, float(holes.mean()), float(error), alike)


def similarity(picture: npt.NDArray[np.uint16], other: npt.NDArray[np.uint16]) -> F64:
    """Structural similarity of 10-bit luma [h, w] around each pixel (Wang et al. 2004), mirrored at the borders."""
    a, b = picture.astype(np.float64), other.astype(np.float64)
    mean_a, mean_b = _blurred(a), _blurred(b)
    var_a, var_b = _blurred(a * a) - mean_a**2, _blurred(b * b) - mean_b**2
    both = _blurred(a * b) - mean_a * mean_b
    c1, c2 = (0.01 * _PEAK) ** 2, (0.03 * _PEAK) ** 2
    alike: F64 = (2 * mean_a * mean_b + c1) * (2 * both + c2)
    return alike / ((mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2))


def _blurred(plane: F64) -> F64:
    for axis in (0, 1):
        half = len(_WINDOW) // 2
        padded = np.pad(plane, [(half, half) if a == axis else (0, 0) for a in (0, 1)], mode="symmetric")
        plane = np.lib.stride_tricks.sliding_window_view(padded, len(_WINDOW), axis=axis) @ (_WINDOW / _WINDOW.sum())
    return plane
