"""The paper's experiments with fixed reference cameras (section 4.1): Tables 2 and 3, Fig. 9 to 11.

The frames of a recording are played in several qualities side by side. Each quality has an engine with the background
model and one without. From both, pictures are rendered in the `WAYS` that the paper compares.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..io.recording import Recording
from ..pipeline.engine import Engine
from ..rig.camera import Camera
from ..rig.frame import Frame, Texture
from ..rig.viewer import RenderedPicture, StereoView
from ..settings import Settings
from .exposed import ExposedTriangles
from .metrics import erp_range, iv_psnr, psnr
from .paper import warm_up
from .stages import head_amid

__all__ = [
    "QUALITIES", "WAYS", "FixedExperiment", "FrameCost", "Judged", "PairTimes", "Shown", "Summary", "Way",
    "farthest_camera", "play_fixed",
]  # fmt: skip

QUALITIES = ("paper", "fast", "balanced", "best")
_HEAD = "head"
_REPEATS = 2  # timed pairs of a way and a filling, in each judged frame
_SWAY_M = 0.005  # the head moves sideways from pair to pair: in front of a still one, filling could settle


@dataclass(frozen=True, slots=True)
class Way:
    """A way to render that the paper compares: the number of drawn views (None: all), and whether with the model."""

    name: str
    views: int | None
    model: bool


# Table 2 compares the first with the third; Fig. 11c shows the second (A, B), the third (C, D) and the last (E, F).
WAYS = (
    Way("all views", None, False),
    Way("five views", 5, False),
    Way("five views, model", 5, True),
    Way("three views, model", 3, True),
)


@dataclass(frozen=True, slots=True)
class Judged:
    """A picture of a virtual camera next to its truth. holes: fraction of pixels in which nothing was drawn; dB of the
    picture without and with filling."""

    quality: str
    way: str
    camera: str
    frame: int
    holes: float
    psnr_y: float
    iv_psnr: float
    psnr_y_filled: float
    iv_psnr_filled: float


@dataclass(frozen=True, slots=True)
class PairTimes:
    """Milliseconds of a stereo pair in a frame, medians of a few, without and with filling."""

    quality: str
    way: str
    frame: int
    warped_ms: float
    filled_ms: float


@dataclass(frozen=True, slots=True)
class FrameCost:
    """A frame's update of the PBS: milliseconds; triangles of the P-PBS, and those that it would have without culling
    (`ExposedTriangles`); valid triangles of the S-PBS."""

    quality: str
    frame: int
    update_ms: float
    exposed: int
    p_pbs: int
    s_pbs: int


@dataclass(frozen=True, slots=True)
class Shown:
    """A way's pictures of the camera `FixedExperiment.shown` in the last frame, without and with filling."""

    quality: str
    way: str
    warped: RenderedPicture
    filled: RenderedPicture


@dataclass(frozen=True, slots=True)
class Summary:
    """A row of Table 2: a quality and a way. Times are medians over the judged frames, milliseconds of a stereo pair;
    holes (fraction of pixels before filling) and dB are means over cameras and judged frames."""

    recording: str
    quality: str
    way: str
    warped_ms: float
    filled_ms: float
    holes: float
    psnr_y: float
    iv_psnr: float
    psnr_y_filled: float
    iv_psnr_filled: float


@dataclass(slots=True)
class FixedExperiment:
    """All that was measured on a recording. eye: width and height of an eye's picture, pixels; views: of the rig;
    frames: played; shown: the virtual camera of the pictures, with its truth in the last frame."""

    recording: str
    qualities: tuple[str, ...]
    eye: tuple[int, int]
    views: int
    frames: int
    cameras: tuple[str, ...]
    shown: str
    truth: Texture
    judged: list[Judged] = field(default_factory=list)
    times: list[PairTimes] = field(default_factory=list)
    costs: list[FrameCost] = field(default_factory=list)
    pictures: list[Shown] = field(default_factory=list)

    def summary(self, quality: str, way: str) -> Summary:
        """The row of a quality and a way; raises ValueError if they were not measured."""
        judged = [each for each in self.judged if (each.quality, each.way) == (quality, way)]
        times = [each for each in self.times if (each.quality, each.way) == (quality, way)]
        if not (judged and times):
            raise ValueError(f"{quality}, {way}: not measured: expected one of {', '.join(self.qualities)}")
        means = ("holes", "psnr_y", "iv_psnr", "psnr_y_filled", "iv_psnr_filled")
        return Summary(
            self.recording, quality, way,
            *(float(np.median([getattr(each, name) for each in times])) for name in ("warped_ms", "filled_ms")),
            *(float(np.mean([getattr(each, name) for each in judged])) for name in means),
        )  # fmt: skip

    def summaries(self) -> list[Summary]:
        """The rows of all qualities, each in all `WAYS`."""
        return [self.summary(quality, way.name) for quality in self.qualities for way in WAYS]


def farthest_camera(recording: Recording, cameras: Sequence[str]) -> str:
    """The one of the `cameras` that is farthest from the middle of the rig ("a rather large baseline", section 4.1).

    Raises ValueError if there are none.
    """
    if not cameras:
        raise ValueError(f"{recording.name}: no virtual camera with ground truth: expected at least one")
    positions = [recording.camera(name).pose.position for name in recording.source_names]
    middle = np.mean(positions, axis=0)
    return max(cameras, key=lambda name: float(np.linalg.norm(recording.camera(name).pose.position - middle)))


def play_fixed(
    recording: Recording, cameras: Sequence[str], frames: int, every: int, qualities: Sequence[str] = QUALITIES,
    progress: Callable[[], None] = lambda: None,
) -> FixedExperiment:  # fmt: skip
    """Play `frames` frames of a recording in all `qualities`; judge and time every `every`-th frame and the last.

    `cameras` are virtual cameras with ground truth. `progress` is called after each frame. Raises ValueError for an
    unknown quality, and if there is no camera or one without ground truth.
    """
    shown, count = farthest_camera(recording, cameras), min(frames, recording.frame_count)
    rig = [recording.camera(name) for name in recording.source_names]
    head = head_amid(rig, recording.camera(shown).pose)
    for quality in qualities:
        warm_up(recording, shown, Settings.preset(quality))
    engines = [_Engines(quality, rig, recording.fps) for quality in qualities]
    experiment = FixedExperiment(
        recording.name, tuple(qualities), (head.left.width, head.left.height), len(rig), count, tuple(cameras), shown,
        recording.texture(shown, count - 1),
    )  # fmt: skip
    for frame in recording.frames(0, count):
        judged = frame.index % every == 0 or frame.index == count - 1
        targets = {name: recording.camera(name, frame.index) for name in cameras} if judged else {}
        truths = {name: recording.texture(name, frame.index) for name in targets}
        for each in engines:
            experiment.costs.append(each.update(frame, head, targets))
            if judged:
                experiment.times += each.time_pairs(frame.index, head)
                experiment.judged += each.judge(frame.index, targets, truths)
        if frame.index == count - 1:
            experiment.pictures += [picture for each in engines for picture in each.show(targets[shown])]
        progress()
    for each in engines:
        each.close()
    return experiment


class _Engines:
    """The two engines of a quality: with the background model, and without, which only takes frames that are judged."""

    def __init__(self, quality: str, rig: Sequence[Camera], fps: float) -> None:
        self._quality, self._count, self._exposed = quality, len(rig), ExposedTriangles()
        plain = Settings.preset(quality, background=False, n_render=len(rig))
        self._engines = {
            True: Engine(rig, Settings.preset(quality), f_vin=fps), False: Engine(rig, plain, f_vin=fps)
        }  # fmt: skip
        self._settings = {model: engine.settings for model, engine in self._engines.items()}

    def update(self, frame: Frame, head: StereoView, targets: dict[str, Camera]) -> FrameCost:
        """Take a frame. `targets`: the cameras of a frame that is judged, by name."""
        model, plain = self._engines[True], self._engines[False]
        model.retune(self._settings[True])
        report = model.update(frame, {_HEAD: head, **targets})
        if targets:
            plain.retune(self._settings[False])
            plain.update(frame, {_HEAD: head})
        update = report.background
        if update is None:
            raise ValueError(f"{self._quality}: background: False: expected a quality with a background model")
        exposed = self._exposed.take(update)
        return FrameCost(
            self._quality, frame.index, report.stages["background"], exposed, update.p_pbs, update.s_pbs_valid
        )

    def time_pairs(self, frame: int, head: StereoView) -> Iterator[PairTimes]:
        """Time stereo pairs of each way. Meshes of views are made before: that is the back end's work, once a frame."""
        heads = [head.moved(head.pose.translated((0.0, k * _SWAY_M, 0.0))) for k in range(_REPEATS)]
        for way in WAYS:
            engine = self._tuned(way, filled=False)
            for each in heads:
                engine.render(each, _HEAD)
            spent = []
            for filled in (False, True):
                self._tuned(way, filled=filled)
                spent.append(float(np.median([_milliseconds(engine, each) for each in heads])))
            yield PairTimes(self._quality, way.name, frame, *spent)

    def judge(self, frame: int, targets: dict[str, Camera], truths: dict[str, Texture]) -> Iterator[Judged]:
        """Compare the pictures of each way with the truth."""
        for way in WAYS:
            for name, camera in targets.items():
                warped, filled = self._pictures(way, camera)
                truth, erp = truths[name], erp_range(camera)
                quality = [
                    value for picture in (warped, filled)
                    for value in (psnr(truth, picture.texture)[0], iv_psnr(truth, picture.texture, erp))
                ]  # fmt: skip
                yield Judged(self._quality, way.name, name, frame, float(warped.holes().mean()), *quality)

    def show(self, camera: Camera) -> Iterator[Shown]:
        """The pictures of a camera in each way."""
        for way in WAYS:
            yield Shown(self._quality, way.name, *self._pictures(way, camera))

    def close(self) -> None:
        for engine in self._engines.values():
            engine.close()

    def _pictures(self, way: Way, camera: Camera) -> tuple[RenderedPicture, RenderedPicture]:
        warped, filled = (self._tuned(way, filled=f).render_camera(camera, camera.name) for f in (False, True))
        return warped, filled

    def _tuned(self, way: Way, *, filled: bool) -> Engine:
        """The engine of a way; its next pictures are drawn in this way. Their filling never settles: the pictures
        before were drawn in another way."""
        engine, own = self._engines[way.model], self._settings[way.model]
        fill = own.fill if filled else "none"
        engine.retune(replace(own, n_render=way.views or self._count, fill=fill, settles=False))
        return engine


def _milliseconds(engine: Engine, head: StereoView) -> float:
    start = time.perf_counter()
    engine.render(head, _HEAD)
    return 1e3 * (time.perf_counter() - start)
