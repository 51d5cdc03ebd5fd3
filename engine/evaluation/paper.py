"""A preset against the published algorithm (`Settings.paper`), and the same preset without the background model."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from ..io.recording import Recording
from ..pipeline.engine import Engine
from ..rig.camera import Camera
from ..rig.frame import Texture
from ..rig.viewer import RenderedPicture
from ..settings import Settings
from .metrics import erp_range, iv_psnr, psnr

__all__ = ["PAPER_TWINS", "PaperRow", "compare_with_paper", "warm_up"]

PAPER_TWINS = ("museum", "hijack", "painter", "frog")  # twins of the sequences in Table 1
_MEANS = ("psnr_y", "iv_psnr", "holes_warped", "holes_backdrop", "drawn")  # over the judged frames


@dataclass(frozen=True, slots=True)
class PaperRow:
    """One virtual camera of a recording, rendered in one mode: means over the judged frames.

    psnr_y, iv_psnr: dB. holes_warped, holes_backdrop: fractions of pixels before and after the backdrop. drawn:
    triangles drawn per picture. The other figures are of the whole run, the same for all cameras. picture_s, update_s:
    median wall times of a picture and of a frame's update, seconds. first_s: the first frame's update. modelled:
    triangles of the model after the last frame. model_bytes: memory of its images, its surfaces and the ray tracer's
    hierarchies over them.
    """

    recording: str
    camera: str
    mode: str
    psnr_y: float
    iv_psnr: float
    holes_warped: float
    holes_backdrop: float
    drawn: float
    picture_s: float
    update_s: float
    first_s: float
    modelled: int
    model_bytes: int


@dataclass(slots=True)
class _Run:
    """An engine, its times in seconds, and the figures of its pictures by camera."""

    mode: str
    engine: Engine
    updates: list[float] = field(default_factory=list)
    pictures: list[float] = field(default_factory=list)
    figures: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)

    def judge(self, camera: Camera, truth: Texture) -> None:
        start = time.perf_counter()
        picture = self.engine.render_camera(camera, camera.name)
        self.pictures.append(time.perf_counter() - start)
        self.figures.setdefault(camera.name, []).append(_figures(picture, truth))

    def rows(self, recording: str) -> Iterator[PaperRow]:
        model = self.engine.model
        counts = model.counts() if model else {"s_pbs_valid": 0, "p_pbs": 0}
        for name, figures in self.figures.items():
            means = dict(zip(_MEANS, np.mean(figures, axis=0).tolist(), strict=True))
            yield PaperRow(
                recording, name, self.mode, **means,
                picture_s=float(np.median(self.pictures)),
                update_s=float(np.median(self.updates[1:] or self.updates)),
                first_s=self.updates[0],
                modelled=counts["s_pbs_valid"] + counts["p_pbs"],
                model_bytes=sum(model.memory.values()) if model else 0,
            )  # fmt: skip


def compare_with_paper(
    recording: Recording, cameras: Sequence[str], frames: int, every: int, quality: str = "balanced",
    progress: Callable[[], None] = lambda: None,
) -> list[PaperRow]:  # fmt: skip
    """Play `frames` frames side by side through the paper's algorithm and through a preset with and without the model.

    `cameras` are virtual cameras with ground truth, `quality` is the preset. Pictures are judged in the first frame, in
    every `every`-th and in the last. `progress` is called after each frame. Rows are sorted by camera, then by mode.
    Raises ValueError for an unknown preset, or a camera without ground truth.
    """
    rig = [recording.camera(name) for name in recording.source_names]
    settings = {
        "paper": Settings.preset("paper"),
        quality: Settings.preset(quality),
        f"{quality}, no model": Settings.preset(quality, background=False),
    }
    for own in settings.values():
        warm_up(recording, cameras[0], own)
    runs = [_Run(mode, Engine(rig, own, f_vin=recording.fps)) for mode, own in settings.items()]
    count = min(frames, recording.frame_count)
    for frame in recording.frames(0, count):
        targets = {name: recording.camera(name, frame.index) for name in cameras}
        judged = frame.index % every == 0 or frame.index == count - 1
        truths = {name: recording.texture(name, frame.index) for name in cameras} if judged else {}
        for run in runs:
            start = time.perf_counter()
            run.engine.update(frame, targets)
            run.updates.append(time.perf_counter() - start)
            for name, truth in truths.items():
                run.judge(targets[name], truth)
        progress()
    rows = [row for run in runs for row in run.rows(recording.name)]
    return sorted(rows, key=lambda row: list(cameras).index(row.camera))


def warm_up(recording: Recording, camera: str, settings: Settings) -> None:
    """Compile or load the kernels of a run, with a few views: otherwise the first run's first frame would seem slow."""
    names = recording.source_names[:3]
    engine, target = Engine([recording.camera(name) for name in names], settings), recording.camera(camera)
    for frame in recording.frames(0, min(2, recording.frame_count), names):
        engine.update(frame, {camera: target})
    engine.render_camera(target, camera)


def _figures(picture: RenderedPicture, truth: Texture) -> tuple[float, ...]:
    """The figures of a picture, in the order of _MEANS."""
    report, erp = picture.report, erp_range(picture.camera)
    return (
        psnr(truth, picture.texture)[0], iv_psnr(truth, picture.texture, erp),
        report.holes_warped, report.holes_backdrop, float(report.warped),
    )  # fmt: skip
