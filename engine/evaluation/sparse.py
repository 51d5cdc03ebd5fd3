"""The benefit of completing sparse depth.

A sequence with ground truth gets holes in its depth like those of a time-of-flight sensor.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..geometry.completion import complete
from ..io.recording import Recording
from ..pipeline.engine import Engine
from ..rig.frame import Frame, View
from ..settings import Settings
from .metrics import iv_psnr, psnr

__all__ = ["MODES", "SparseSample", "compare_sparse", "completion_cost", "punched"]

# Whole depth; depth with holes; depth with holes that are completed.
MODES = ("whole", "holes", "completed")

_EDGE_SHARE = 0.05  # step of disparity between neighbours, as a share, at which a sensor finds no depth
_GRAZING = 0.02  # change of disparity from pixel to pixel, as a share, above which too little light comes back
_DARK = 200  # luma code below which too little light comes back
_RANDOM = 0.05  # share of the pixels that lose their depth at random
_CRACK = 0.12  # share of rows and columns that fall between a coarser sensor's samples


@dataclass(frozen=True, slots=True)
class SparseSample:
    """One virtual camera at one frame in one mode; figures in dB."""

    camera: str
    frame: int
    mode: str
    psnr_y: float
    iv_psnr: float


def compare_sparse(
    sequence: Recording, cameras: Sequence[str], frames: Sequence[int], quality: str, views: int = 5, seed: int = 1
) -> Iterator[SparseSample]:
    """Render virtual cameras from depth in all modes; each frame is rendered on its own, without earlier frames.

    `cameras` have ground truth, `frames` are indices, `views` is n_render, and `seed` draws the holes.
    """
    for index in frames:
        whole = sequence.frame(index)
        holes = Frame(index, tuple(punched(view, seed + k) for k, view in enumerate(whole.views)))
        for mode in MODES:
            frame = whole if mode == "whole" else holes
            settings = Settings.preset(quality, n_render=views, completion=mode == "completed")
            engine = Engine([view.camera for view in frame.views], settings, f_vin=sequence.fps)
            targets = {name: sequence.camera(name) for name in cameras}
            engine.update(frame, targets)
            for name, camera in targets.items():
                picture, truth = engine.render_camera(camera, name).texture, sequence.texture(name, index)
                yield SparseSample(name, index, mode, psnr(truth, picture)[0], iv_psnr(truth, picture))


def completion_cost(view: View, runs: int = 5) -> float:
    """CPU milliseconds per megapixel that completing a view takes, the least of `runs` runs."""
    costs = []
    for _ in range(runs + 1):  # the first compiles
        start = time.process_time()
        complete(view, math.inf)
        costs.append(time.process_time() - start)
    return 1e3 * min(costs[1:]) / (view.codes.size / 1e6)


def punched(view: View, seed: int) -> View:
    """The view without depth where a time-of-flight sensor finds none; `seed` draws the random parts.

    Depth is missing at edges, on dark surfaces and on those seen at a grazing angle, in blobs (gloss, glass), in cracks
    between the samples of a coarser sensor, and in scattered pixels.
    """
    rng = np.random.default_rng(seed)
    disparity = view.camera.depth.disparity(view.codes)
    lost = _steep(disparity, _EDGE_SHARE) | (_slope(disparity) > _GRAZING) | (view.texture.y < _DARK)
    lost |= _blobs(rng, *view.codes.shape) | _cracks(rng, *view.codes.shape)
    lost |= rng.random(view.codes.shape) < _RANDOM
    codes = np.where(lost | ~np.isfinite(disparity), 0, np.maximum(view.codes, 1)).astype(np.uint16)
    camera = dataclasses.replace(view.camera, depth=dataclasses.replace(view.camera.depth, has_invalid=True))
    return View(camera, view.texture, codes)


def _steep(disparity: npt.NDArray[np.float64], share: float) -> npt.NDArray[np.bool_]:
    """Mask of the pixels within two of a step between neighbours of more than `share`."""
    steps = np.zeros(disparity.shape, bool)
    for axis in (0, 1):
        other = np.roll(disparity, 1, axis)
        steps |= np.abs(disparity - other) > share * np.maximum(disparity, other)
    near = steps.copy()
    for dy in range(-2, 3):
        for dx in range(-2, 3):
            near |= np.roll(steps, (dy, dx), (0, 1))
    return near


def _slope(disparity: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Change of disparity per pixel, as a share of the disparity."""
    down, right = np.gradient(disparity)
    slope: npt.NDArray[np.float64] = np.hypot(down, right) / disparity
    return slope


def _blobs(rng: np.random.Generator, height: int, width: int) -> npt.NDArray[np.bool_]:
    """Mask of a dozen ellipses with diameters up to a tenth of the picture's width."""
    y, x = np.mgrid[:height, :width]
    lost = np.zeros((height, width), bool)
    for _ in range(12):
        v, u, a, b = rng.random(4) * (height, width, 0.05 * width, 0.05 * width) + (0, 0, 2, 2)
        lost |= ((y - v) / b) ** 2 + ((x - u) / a) ** 2 < 1
    return lost


def _cracks(rng: np.random.Generator, height: int, width: int) -> npt.NDArray[np.bool_]:
    """Mask of the thin lines of a grid that is slightly turned and bent."""
    y, x = np.mgrid[:height, :width] / width
    bend = 0.02 * np.sin(6.0 * x + 6.0 * rng.random()) * np.cos(5.0 * y)
    cells = width * _CRACK
    lines: npt.NDArray[np.bool_] = (((0.2 * x + y + bend) * cells % 1.0) < _CRACK) | (
        ((x - 0.15 * y + bend) * cells % 1.0) < _CRACK
    )
    return lines
