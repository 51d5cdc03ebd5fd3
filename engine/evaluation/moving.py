"""Reference cameras that move (paper section 4.2): what a moving camera adds to fixed ones, and a hand-held one alone.

A twin with a moving camera is played with that camera, which only updates the model, and without it (Fig. 12b and 13).
A recording of one moving camera is played to its end with some frames held out. From their poses the end is then
rendered: a viewer there sees what the newest frame does not show, and the frame that was held out is the truth.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from ..io.recording import Recording
from ..pipeline.engine import Engine
from ..rig.camera import Camera
from ..rig.frame import Frame, Texture
from ..rig.texture import to_rgb
from ..rig.viewer import RenderedPicture
from ..settings import Settings
from .exposed import ExposedTriangles
from .hole_tint import tinted

__all__ = ["Moment", "WalkSample", "is_walk", "moving_names", "play_rig", "play_walk", "side_by_side"]

T = TypeVar("T")

_PEAK = 1023.0


@dataclass(frozen=True, slots=True)
class Moment:
    """A frame of a rig with a moving camera, played without it (first of each pair) and with it.

    update_ms, update_cpu_ms: wall and CPU time of the model's update. In the moving camera's turn, asked: pixels that
    its capture before does not show, of which rays tell whether they are farther than the PBS; added: triangles of
    those that are. culled: triangles that were culled; p_pbs: valid ones of the P-PBS. captures: those that are kept.
    holes: fractions of pixels before filling, by virtual camera; empty in frames that are not sampled. pictures: the
    same. exposed: triangles that the P-PBS with the moving camera would have if nothing had been culled from it. plain:
    the pictures of the same drawn views without the model.
    """

    frame: int
    update_ms: tuple[float, float]
    update_cpu_ms: tuple[float, float]
    asked: int
    added: int
    culled: int
    p_pbs: tuple[int, int]
    captures: int
    holes: dict[str, tuple[float, float]]
    pictures: dict[str, tuple[RenderedPicture, RenderedPicture]]
    exposed: int
    plain: dict[str, RenderedPicture]


@dataclass(frozen=True, slots=True)
class WalkSample:
    """The end of a walk, seen from the pose of a frame that was held out.

    unseen: fraction of pixels that the newest frame does not show; holes: those that the model does not show either.
    psnr_filled, psnr_modelled: PSNR-Y, dB, of the unseen pixels without and with the model. pictures: the truth, and
    both pictures.
    """

    frame: int
    unseen: float
    holes: float
    psnr_filled: float
    psnr_modelled: float
    pictures: tuple[Texture, RenderedPicture, RenderedPicture]


def moving_names(recording: Recording) -> list[str]:
    """The source views that move."""
    return [name for name in recording.source_names if recording.poses(name) is not None]


def is_walk(recording: Recording) -> bool:
    """Whether all of a recording's source views move."""
    return len(moving_names(recording)) == len(recording.source_names)


def play_rig(
    recording: Recording, cameras: Sequence[Camera], frames: int, every: int, settings: Settings,
    read: Iterable[Frame] | None = None,
) -> Iterator[Moment]:  # fmt: skip
    """Play `frames` frames of a rig with moving cameras, without and with them, side by side; yields each frame.

    Every `every`-th frame, from frame every - 1 on, and the last are sampled: rendered for `cameras`. The views of
    moving cameras are not drawn. read: the frames, if they are read elsewhere. Raises ValueError for a rig without a
    moving camera, or without a fixed one.
    """
    moving, names = moving_names(recording), recording.source_names
    still = [k for k, name in enumerate(names) if name not in moving]
    if not moving or not still:
        raise ValueError(f"{recording.name}: moving views {moving}: expected some of {', '.join(names)}, not all")
    settings = replace(settings, draw_moving=False)
    rig = [recording.camera(name) for name in names]
    engines = [Engine(each, settings, f_vin=recording.fps) for each in ([rig[k] for k in still], rig)]
    exposed = ExposedTriangles()
    for frame in recording.frames(0, frames) if read is None else read:
        sampled = frame.index % every == every - 1 or frame.index == frames - 1
        viewers = {camera.name: camera for camera in cameras} if sampled else {}
        fixed = Frame(frame.index, tuple(frame.views[k] for k in still))
        reports = [engine.update(each, viewers) for engine, each in zip(engines, (fixed, frame), strict=True)]
        shown = {c.name: tuple(engine.render_camera(c, c.name) for engine in engines) for c in cameras if sampled}
        with_it = reports[1].background
        if with_it is None or engines[1].model is None:
            raise ValueError("background: False: expected settings with a background model")
        asked = with_it.candidates if set(with_it.group) & set(moving) else 0
        yield Moment(
            frame.index, _pair(report.stages["background"] for report in reports),
            _pair(report.stages.cpu["background"] for report in reports), asked, with_it.added, with_it.culled,
            _pair(engine.status()["background"]["p_pbs"] for engine in engines), len(engines[1].model.captures),
            {name: _pair(p.report.holes_backdrop for p in pictures) for name, pictures in shown.items()},
            {name: _pair(pictures) for name, pictures in shown.items()}, exposed.take(with_it),
            {c.name: engines[1].render_camera(c) for c in cameras if sampled},  # nobody's PBI: no backdrop
        )  # fmt: skip
    for engine in engines:
        engine.close()


def play_walk(recording: Recording, held_out: int, settings: Settings) -> Iterator[WalkSample]:
    """Play a recording of moving cameras but every `held_out`-th frame; then yield a sample for each of these frames.

    A frame that was held out is seen from the first of the source views. Raises ValueError for less than two frames.
    """
    name, count = recording.source_names[0], recording.frame_count
    left_out = range(held_out - 1, count, held_out)
    if count - len(left_out) < 2:
        raise ValueError(f"frames: {count}, {len(left_out)} of them held out: expected two or more that are played")
    rig = [recording.camera(each) for each in recording.source_names]
    plain = replace(settings, background=False)
    modelled, filled = (Engine(rig, each, f_vin=recording.fps) for each in (settings, plain))
    viewers = {str(index): recording.camera(name, index) for index in left_out}
    played = [index for index in range(count) if index not in left_out]
    for index in played:
        modelled.update(recording.frame(index), viewers if index == played[-1] else None)
    filled.update(recording.frame(played[-1]))
    for index in left_out:
        camera, truth = viewers[str(index)], recording.texture(name, index)
        without, with_it = filled.render_camera(camera), modelled.render_camera(camera, str(index))
        unseen = without.holes()
        errors = [_psnr(truth, picture.texture, unseen) for picture in (without, with_it)]
        holes = with_it.report.holes_backdrop
        yield WalkSample(index, float(unseen.mean()), holes, errors[0], errors[1], (truth, without, with_it))


def side_by_side(pictures: Sequence[RenderedPicture | Texture]) -> npt.NDArray[np.uint8]:  # [h, n w, 3]
    """R'G'B' pictures next to each other; holes are light blue."""
    parts = []
    for picture in pictures:
        if isinstance(picture, Texture):
            parts.append(to_rgb(picture))
        else:
            parts.append(tinted(picture))
    return np.concatenate(parts, axis=1)


def _psnr(truth: Texture, picture: Texture, where: npt.NDArray[np.bool_]) -> float:
    """PSNR-Y of some pixels, dB; infinite if they are equal, or if there are none."""
    error = (picture.y[where].astype(np.float64) - truth.y[where]) ** 2
    return 10 * math.log10(_PEAK**2 / float(error.mean())) if error.size and error.any() else math.inf


def _pair(values: Iterable[T]) -> tuple[T, T]:
    first, second = values
    return first, second
