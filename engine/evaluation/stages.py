"""The cost of each stage of the first frame, of a later one and of a stereo pair: wall time, CPU time and work.

The back end has all threads, and nothing else runs meanwhile, so its CPU time is that of the process. A pair is
rendered on all threads for its wall time, and again on one thread, where a stage's CPU time is its own. The first run
in a process takes longer than the second, because it compiles kernels or loads compiled ones; the difference is
reported as well.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np

from ..background.model import UpdateReport
from ..io.images import encode_jpeg
from ..io.recording import Recording
from ..pipeline.engine import BackEndReport, Engine
from ..rig.camera import Camera, Perspective, Pose
from ..rig.frame import Frame
from ..rig.viewer import StereoPicture, StereoView, home_pose
from ..settings import Settings
from ..support.runtime import one_thread
from ..support.stages import Stages, timed

__all__ = ["PHASES", "StageReport", "StageRow", "head_amid", "measure_stages"]

PHASES = ("first frame", "later frame", "pair")
_VIEWER = "head"
_FULL = 2048  # width of the paper's views, for which an eye has 1280x1440 pixels
_REPEATS = 3  # pairs that are rendered on one thread


@dataclass(frozen=True, slots=True)
class StageRow:
    """A stage of a phase.

    times: how often it took place. wall_ms, cpu_ms: medians over these times. share: its part of the phase's CPU time
    over all frames. work: what it worked on, counts by unit. A stage with a colon is part of the stage named before the
    colon. "other" is all time outside the stages. "ingest" is the reading of a frame and is not part of the total.
    """

    phase: str
    stage: str
    times: int
    wall_ms: float
    cpu_ms: float
    share: float
    work: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class StageReport:
    """All rows, width and height of an eye's picture, and the seconds that compiling or loading kernels took."""

    rows: list[StageRow]
    size: tuple[int, int]
    compile_s: float

    def row(self, phase: str, stage: str) -> StageRow:
        """The row of a stage in a phase; raises KeyError if there is none."""
        for row in self.rows:
            if (row.phase, row.stage) == (phase, stage):
                return row
        raise KeyError((phase, stage))

    def as_dict(self) -> dict[str, object]:
        """The report as plain dictionaries and lists, for JSON."""
        return asdict(self)


def head_amid(cameras: Sequence[Camera], pose: Pose | None = None) -> StereoView:
    """A head in the middle of a rig, or at `pose`.

    Its eyes have the projection of the first camera if that is perspective. For spherical cameras they have 90 degrees
    and 1280x1440 pixels if views are 2048 pixels wide, and proportionally fewer pixels for smaller views.
    """
    pose, projection = pose or home_pose(cameras), cameras[0].projection
    if isinstance(projection, Perspective):
        return StereoView(pose, 0.063, projection, projection)
    scale = projection.width / _FULL
    return StereoView.symmetric(pose, 2 * round(640 * scale), 2 * round(720 * scale), math.radians(90))


def measure_stages(
    recording: Recording, settings: Settings, frames: int, progress: Callable[[], None] = lambda: None
) -> StageReport:
    """Play `frames` frames and render pairs from each; calls `progress` once before the first frame and after each."""
    cameras = [recording.camera(name) for name in recording.source_names]
    head, names = head_amid(cameras), recording.source_names
    unready = _Run(Engine(cameras, settings, f_vin=recording.fps), head)
    few = min(2, frames)
    for index in range(few):
        unready.take(recording.frame(index, names))
    progress()
    run = _Run(Engine(cameras, settings, f_vin=recording.fps), head)
    for index in range(frames):
        with timed(whole := Stages(), "ingest"):
            frame = recording.frame(index, names)
        run.add(index, whole, {"ingest": {"bytes": _size(frame)}})
        run.take(frame)
        progress()
    compiling = sum(unready.spent_s[:few]) - sum(run.spent_s[:few])
    return StageReport(run.rows(), (head.left.width, head.left.height), max(0.0, compiling))


def _size(frame: Frame) -> int:
    textures = [view.texture for view in frame.views]
    planes = [plane for texture in textures for plane in (texture.y, texture.cb, texture.cr)]
    return sum(array.nbytes for array in (*planes, *(view.codes for view in frame.views)))


class _Run:
    """An engine, and times and work of its frames and pairs."""

    def __init__(self, engine: Engine, head: StereoView) -> None:
        self.engine, self.head = engine, head
        self.spent_s: list[float] = []  # seconds for each frame and its pairs
        self._samples: dict[tuple[str, str], list[tuple[float, float, Mapping[str, float]]]] = {}

    def take(self, frame: Frame) -> None:
        """Update the engine with a frame, and render pairs from it."""
        started = time.perf_counter()
        with timed(whole := Stages(), "total"):
            report = self.engine.update(frame, {_VIEWER: self.head})
        self.add(frame.index, _with_rest(report.stages, whole), _frame_work(report))
        if report.background is not None:
            stages = Stages()
            for name, wall in report.background.stages.items():
                stages.add(f"background: {name}", wall, report.background.stages.cpu[name])
            self.add(frame.index, stages, _model_work(report.background))
        self._render()
        self.spent_s.append(time.perf_counter() - started)

    def _render(self) -> None:
        """Render and encode a pair on all threads, then _REPEATS pairs on one thread, of which the fastest counts."""
        wall, _ = self._pair()
        with one_thread():  # CPU times then do not depend on the machine's load
            own, work = min((self._pair() for _ in range(_REPEATS)), key=lambda pair: pair[0].cpu["total"])
        both = Stages()
        for name in wall:
            both.add(name, wall[name], own.cpu[name])
        self._add("pair", both, work)

    def _pair(self) -> tuple[Stages, dict[str, dict[str, float]]]:
        """Stages of a pair as sums of both eyes, and the work of each stage."""
        stages = Stages()
        with timed(whole := Stages(), "total"):
            pair = self.engine.render(self.head, _VIEWER)
            with timed(stages, "encode"):
                quality = self.engine.settings.jpeg_quality
                data = [encode_jpeg(eye.texture, quality) for eye in (pair.left, pair.right)]
        for eye in (pair.left, pair.right):
            for name, wall in eye.report.stages.items():
                stages.add(name, wall, eye.report.stages.cpu[name])
        return _with_rest(stages, whole), _pair_work(pair) | {"encode": {"bytes": sum(map(len, data))}}

    def add(self, index: int, stages: Stages, work: Mapping[str, Mapping[str, float]]) -> None:
        """Add the stages of frame `index` and their work to its phase."""
        self._add(PHASES[min(index, 1)], stages, work)

    def _add(self, phase: str, stages: Stages, work: Mapping[str, Mapping[str, float]]) -> None:
        for name, wall in stages.items():
            sample = (wall, stages.cpu[name], work.get(name, {}))
            self._samples.setdefault((phase, name), []).append(sample)

    def rows(self) -> list[StageRow]:
        """Rows with medians over the frames, in the order of the phases; each phase ends with its total."""
        rows = []
        for phase in PHASES:
            names = sorted((name for p, name in self._samples if p == phase), key=_order)
            if names:
                total = sum(cpu for _, cpu, _ in self._samples[phase, "total"])
                rows += [_row(phase, name, self._samples[phase, name], total) for name in names]
        return rows


def _with_rest(stages: Stages, whole: Stages) -> Stages:
    """The stages with two more: the total of the whole, and "other", the part of it outside the stages."""
    wall, cpu = sum(stages.values()), sum(stages.cpu.values())
    stages.add("other", max(0.0, whole["total"] - wall), max(0.0, whole.cpu["total"] - cpu))
    stages.add("total", whole["total"], whole.cpu["total"])
    return stages


# In the order of the work.
_STAGES = (
    "ingest", "exposure", "background", "background: maximum_depth", "background: filter", "background: triangulate",
    "background: commit", "background: culling", "pbi", "triangulate", "select", "warp", "backdrop", "shade",
    "antialias", "fill", "encode", "other", "total",
)  # fmt: skip


def _order(name: str) -> int:
    return _STAGES.index(name) if name in _STAGES else len(_STAGES) - 2


def _row(phase: str, name: str, samples: Sequence[tuple[float, float, Mapping[str, float]]], total: float) -> StageRow:
    wall, cpu = (float(np.median([sample[k] for sample in samples])) for k in (0, 1))
    share = sum(sample[1] for sample in samples) / total if total > 0 else 0.0
    work = {key: float(np.median([sample[2][key] for sample in samples])) for key in samples[0][2]}
    return StageRow(phase, name, len(samples), wall, cpu, share, work)


def _frame_work(report: BackEndReport) -> dict[str, dict[str, float]]:
    return {"pbi": {"rays": report.pbi_rays}, "triangulate": {"triangles": report.triangles}}


def _model_work(model: UpdateReport) -> dict[str, dict[str, float]]:
    return {
        "background: maximum_depth": {"pixels": model.updated},
        "background: filter": {"pixels": model.candidates},
        "background: triangulate": {"triangles": model.p_pbs or model.s_pbs},
        "background: commit": {"triangles": model.s_pbs + model.p_pbs},
        "background: culling": {"rays": model.rays},
    }


def _pair_work(pair: StereoPicture) -> dict[str, dict[str, float]]:
    eyes = (pair.left, pair.right)
    pixels = sum(eye.disparity.size for eye in eyes)
    return {
        "warp": {"triangles": sum(eye.report.warped for eye in eyes)},
        "shade": {"pixels": pixels},
        "backdrop": {"pixels": sum(eye.report.holes_warped * eye.disparity.size for eye in eyes)},
        "fill": {"pixels": sum(eye.report.holes_backdrop * eye.disparity.size for eye in eyes)},
    }
