"""Speed against accuracy: cost and benefit of each knob, one at a time around `balanced`, and over a grid.

A variant is `balanced` with something changed. All variants play the same frames side by side. Frames are skipped in
between, so that people move on. Pictures of later frames are compared with the truth, before encoding and as they
arrive. Pictures of a smaller scale are first enlarged to the truth's size, bilinearly, as a display does.

Times are CPU times on one thread, as ratios to the time of `balanced`, which is measured again next to each variant;
the median of several such ratios counts. The model's knobs are varied with one view per picture, so that much of the
picture depends on the model. Two expected knobs are missing: the reach of filling, which costs next to nothing, and a
separate size of the backdrop, which `pbi_scale` already sets.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from PIL import Image

from ..io.images import decode_jpeg, encode_jpeg
from ..io.recording import Recording
from ..pipeline.engine import Engine, Viewer
from ..rig.frame import Frame, Texture
from ..rig.viewer import RenderedPicture, StereoView
from ..settings import PER_PICTURE, Settings
from ..support.runtime import one_thread
from .metrics import erp_range, iv_psnr, psnr
from .stages import head_amid
from .trade_variants import Variant
from .twin_recording import TwinRecording, default_targets

__all__ = ["Plan", "Row", "step_count", "sweep"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Plan:
    """The amount of measuring; raises ValueError for a number below 1.

    frames: number of frames played, every `step`-th of the video. judged: number of later frames whose pictures are
    judged. rounds: how often each variant is timed.
    """

    frames: int = 12
    step: int = 4
    judged: int = 3
    rounds: int = 5

    def __post_init__(self) -> None:
        for name in ("frames", "step", "judged", "rounds"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: {getattr(self, name)!r}: expected at least 1")

    def indices(self, recording: Recording) -> list[int]:
        """The video frames that are played."""
        return list(range(0, min(self.frames * self.step, recording.frame_count), self.step))

    def is_judged(self, number: int, count: int) -> bool:
        """Whether pictures of frame `number` of `count` are judged: the last is, and others of the later half are."""
        return number in np.linspace(count - 1, count // 2, self.judged).round()


@dataclass(frozen=True, slots=True)
class Row:
    """Cost and benefit of a variant on a sequence or twin (`material`).

    iv_psnr, psnr_y: dB, before encoding. sent: IV-PSNR as it arrives. Ratios of CPU time to the base's: time (of
    rendering), total (with encoding), update (of the back end with a later frame), first (with the first frame).
    holes_warped, holes_backdrop: fractions of pixels before and after the backdrop. bytes, triangles: encoded size and
    triangles drawn, of a pair, or of all pictures of a sequence. rays: of model and PBI in a later frame.
    """

    material: str
    kind: str
    knob: str
    value: str
    iv_psnr: float
    psnr_y: float
    sent: float
    time: float
    total: float
    update: float
    first: float
    holes_warped: float
    holes_backdrop: float
    bytes: float
    triangles: float
    rays: float


def step_count(plan: Plan, recording: Recording) -> int:
    """The number of times that `sweep` calls `progress`."""
    return len(plan.indices(recording)) + plan.rounds


def sweep(
    recording: Recording, swept: Sequence[Variant], plan: Plan, progress: Callable[[], None] = lambda: None
) -> list[Row]:
    """Play a sequence or twin through all variants side by side; returns a row for each, in their order.

    Raises ValueError if no virtual camera has ground truth.
    """
    run = _Sweep(recording, swept, plan)
    indices = plan.indices(recording)
    with one_thread():
        run.warm_up(recording.frame(indices[0], recording.source_names))
        for number, index in enumerate(indices):
            run.play(recording.frame(index, recording.source_names))
            if plan.is_judged(number, len(indices)):
                run.judge(index)
            progress()
        for _ in range(plan.rounds):
            run.time()
            progress()
    return run.rows()


@dataclass(slots=True)
class _Figures:
    """Samples of a variant: figures of its pictures by name, and ratios of CPU times to the base's rendering."""

    pictures: list[dict[str, float]] = field(default_factory=list)
    rendering: list[float] = field(default_factory=list)
    encoding: list[float] = field(default_factory=list)  # of the variant
    base_encoding: list[float] = field(default_factory=list)


@dataclass(slots=True)
class _BackEnd:
    """An engine, the settings for its updates (`home`), and CPU seconds and rays of its updates."""

    engine: Engine
    home: Settings
    seconds: list[float] = field(default_factory=list)
    rays: list[int] = field(default_factory=list)


def _key(settings: Settings) -> Settings:
    """The settings that variants must share to share an engine: all that a frame's update reads.

    These include the size of pictures and the number of views.
    """
    plain = {name: getattr(Settings(), name) for name in PER_PICTURE if name not in ("output_scale", "n_render")}
    return dataclasses.replace(settings, **plain)


class _Sweep:
    """The engines and figures of all variants on a recording."""

    def __init__(self, recording: Recording, swept: Sequence[Variant], plan: Plan) -> None:
        self._recording, self._swept = recording, swept
        self._viewers, self._truths = _viewers(recording)
        cameras = [recording.camera(name) for name in recording.source_names]
        self._back_ends: dict[Settings, _BackEnd] = {}
        for settings in (s for variant in swept for s in (variant.base, variant.settings)):
            if _key(settings) not in self._back_ends:
                engine = Engine(cameras, settings, f_vin=recording.fps / plan.step)
                self._back_ends[_key(settings)] = _BackEnd(engine, settings)
        self._figures = [_Figures() for _ in swept]

    def warm_up(self, frame: Frame) -> None:
        """Compile or load the kernels of a first frame: otherwise the first engine would seem slow."""
        first = next(iter(self._back_ends.values()))
        Engine(first.engine.cameras, first.home, f_vin=first.engine.f_vin).update(frame, self._viewers)

    def play(self, frame: Frame) -> None:
        """Update all engines."""
        for back_end in self._back_ends.values():
            back_end.engine.retune(back_end.home)
            report, seconds = _timed(back_end.engine.update, frame, self._viewers)
            back_end.seconds.append(seconds)
            back_end.rays.append(report.pbi_rays + (report.background.rays if report.background else 0))

    def judge(self, index: int) -> None:
        """Compare all variants' pictures of the newest frame with the truth."""
        truths = self._truths(index)
        for variant, figures in zip(self._swept, self._figures, strict=True):
            pictures = self._render(variant.settings)
            figures.pictures += [
                _judged(picture, truth, variant.settings.jpeg_quality)
                for picture, truth in zip(pictures, truths, strict=True)
            ]

    def time(self) -> None:
        """Time each variant directly after its base."""
        for variant, figures in zip(self._swept, self._figures, strict=True):
            spent = []
            for settings in (variant.base, variant.settings):
                pictures, rendering = _timed(self._render, settings)
                _, encoding = _timed(_encode, pictures, settings.jpeg_quality)
                spent.append((rendering, encoding))
            (base, base_encoding), (own, encoding) = spent
            figures.rendering.append(own / base)
            figures.encoding.append(encoding / base)
            figures.base_encoding.append(base_encoding / base)

    def _render(self, settings: Settings) -> list[RenderedPicture]:
        engine = self._back_ends[_key(settings)].engine
        engine.retune(dataclasses.replace(settings, settles=False))  # holes would keep another variant's colours
        pictures: list[RenderedPicture] = []
        for name, viewer in self._viewers.items():
            if isinstance(viewer, StereoView):
                pair = engine.render(viewer, name)
                pictures += [pair.left, pair.right]
            else:
                pictures.append(engine.render_camera(viewer, name))
        return pictures

    def rows(self) -> list[Row]:
        """The figures of all variants."""
        return [self._row(variant, figures) for variant, figures in zip(self._swept, self._figures, strict=True)]

    def _row(self, variant: Variant, figures: _Figures) -> Row:
        own, base = (self._back_ends[_key(settings)] for settings in (variant.settings, variant.base))
        count = len(figures.pictures)
        mean = {name: float(np.mean([f[name] for f in figures.pictures])) for name in figures.pictures[0]}
        pictures = sum(2 if isinstance(viewer, StereoView) else 1 for viewer in self._viewers.values())
        assert count % pictures == 0
        rendering = float(np.median(figures.rendering))
        encoding, base_encoding = (float(np.median(e)) for e in (figures.encoding, figures.base_encoding))
        later = slice(2, None) if len(own.seconds) > 2 else slice(None)
        return Row(
            self._recording.name, variant.kind, variant.knob, variant.value,
            mean["iv_psnr"], mean["psnr_y"], mean["sent"],
            rendering, (rendering + encoding) / (1.0 + base_encoding),
            float(np.median(np.divide(own.seconds[later], base.seconds[later]))), own.seconds[0] / base.seconds[0],
            mean["holes_warped"], mean["holes_backdrop"], pictures * mean["bytes"], pictures * mean["triangles"],
            float(np.mean(own.rays[later])),
        )  # fmt: skip


def _encode(pictures: Sequence[RenderedPicture], quality: int) -> list[bytes]:
    return [encode_jpeg(picture.texture, quality) for picture in pictures]


def _timed(work: Callable[..., T], *arguments: object) -> tuple[T, float]:
    """The result of a call, and the CPU seconds that it takes."""
    start = time.process_time()
    result = work(*arguments)
    return result, time.process_time() - start


def _viewers(recording: Recording) -> tuple[dict[str, Viewer], Callable[[int], list[Texture]]]:
    """The viewers, and a function from a frame's index to the truths in the order of the pictures.

    A twin has one viewer: a head at the pose of its first virtual camera. In a sequence each virtual camera inside the
    rig is a viewer.
    """
    targets = default_targets(recording)
    if not isinstance(recording, TwinRecording):
        return {name: recording.camera(name) for name in targets}, lambda index: [
            recording.texture(name, index) for name in targets
        ]
    cameras = [recording.camera(name) for name in recording.source_names]
    head, twin = head_amid(cameras, recording.camera(targets[0]).pose), recording.twin
    eyes = head.eyes(cameras[0].depth)
    return {"head": head}, lambda index: [twin.truth(eye, index).texture for eye in eyes]


def _judged(picture: RenderedPicture, truth: Texture, quality: int) -> dict[str, float]:
    data, (h, w) = encode_jpeg(picture.texture, quality), picture.texture.y.shape
    shown, arrived = (_enlarged(texture, truth) for texture in (picture.texture, decode_jpeg(data, h, w)))
    erp = erp_range(picture.camera)
    return {
        "iv_psnr": iv_psnr(truth, shown, erp),
        "psnr_y": psnr(truth, shown)[0],
        "sent": iv_psnr(truth, arrived, erp),
        "holes_warped": picture.report.holes_warped,
        "holes_backdrop": picture.report.holes_backdrop,
        "bytes": float(len(data)),
        "triangles": float(picture.report.warped),
    }


def _enlarged(texture: Texture, like: Texture) -> Texture:
    """The texture at the size of `like`."""
    if texture.y.shape == like.y.shape:
        return texture
    return Texture(*(_resized(getattr(texture, n), getattr(like, n).shape) for n in ("y", "cb", "cr")))


def _resized(plane: npt.NDArray[np.uint16], shape: tuple[int, int]) -> npt.NDArray[np.uint16]:
    image = Image.fromarray(plane.astype(np.float32)).resize(shape[::-1], Image.Resampling.BILINEAR)
    return np.asarray(image).round().astype(np.uint16)
