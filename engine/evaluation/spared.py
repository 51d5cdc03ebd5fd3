"""Work and memory that scenes do not need and the engine therefore spares, compared with the full amounts."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..background.pbi import imaginary_camera
from ..kernels.rendering import spherical
from ..pipeline.engine import BackEndReport, Engine
from ..rig.camera import Perspective
from ..rig.frame import Frame
from ..rig.viewer import RenderedPicture
from ..settings import Settings
from ..support.runtime import one_thread
from ..synth import Twin, make_twin, twin_frame
from .stages import head_amid

__all__ = ["Spared", "spared_rows"]

_VIEWER = "head"
_WITHIN_M = 0.3  # declared radius of the ball that the head stays in
# Bytes of a camera's pixel if everything about it is stored: its code (2), the limit derived from that (2), 4:2:0
# colour (3), three flags (has changed, is in the P-PBS, has a provisional colour), and how many views were averaged.
_PIXEL = 2 + 2 + 3 + (1 + 1 + 1) + 1
_SETTLED = 3  # first frames of a run that are not counted: they compile kernels, and first turns cost more


@dataclass(frozen=True, slots=True)
class Spared:
    """Some work or memory in a scene: the full amount (`all`), the amount that is left, and the unit of both."""

    scene: str
    what: str
    all: float
    left: float
    unit: str

    @property
    def saved(self) -> float:
        """The share that is spared."""
        return 1.0 - self.left / self.all if self.all else 0.0


@dataclass(frozen=True, slots=True)
class _Run:
    """Frames played for one head.

    reports: those of the counted frames. picture: the last of the left eye. memory: bytes of the model after the first
    counted frame and after the last.
    """

    engine: Engine
    reports: list[BackEndReport]
    picture: RenderedPicture
    memory: tuple[int, int]

    def median(self, stage: str) -> float:
        """CPU milliseconds per frame of a stage, the median."""
        return float(np.median([report.stages.cpu[stage] for report in self.reports]))

    def change_test(self) -> float:
        """CPU milliseconds per frame that the search for changed pixels takes, the median."""
        found = [report.background.stages.cpu["maximum_depth"] for report in self.reports if report.background]
        return float(np.median(found))

    def mean_rays(self) -> float:
        """Rays of filter and culling per frame, the mean."""
        return float(np.mean([report.background.rays for report in self.reports if report.background]))


def spared_rows(
    names: Sequence[str], scale: float, frames: int, advance: Callable[[], None] = lambda: None
) -> Iterator[Spared]:
    """Rows of each twin in `names` at `scale`: while `frames` frames play, and while the first frame is repeated.

    `advance` is called after each frame. CPU times are those of one thread.
    """
    for name in names:
        twin = make_twin(name, scale)
        video = [twin_frame(twin, index) for index in range(frames)]
        still = [_again(video[0], index) for index in range(frames)]
        with one_thread():
            before = len(spherical.draw_bands.signatures)
            moving, static = _play(twin, video, advance), _play(twin, still, advance)
            flat = isinstance(twin.sources[0].projection, Perspective)
            loaded = len(spherical.draw_bands.signatures) - before
        yield from _static_rows(name, moving, static)
        yield from _drawing_rows(name, twin, moving)
        if flat:
            yield Spared(name, "spherical drawing kernels that were loaded", 1, loaded, "")
        yield from _memory_rows(name, twin, moving, static, frames)
        yield from _space_rows(name, twin, video[0])


def _again(frame: Frame, index: int) -> Frame:
    """A frame with the same contents in other memory, so that only a comparison can show that it is the same."""
    views = (dataclasses.replace(view, codes=view.codes.copy()) for view in frame.views)
    return dataclasses.replace(frame, index=index, views=tuple(views))


def _play(twin: Twin, frames: Sequence[Frame], advance: Callable[[], None]) -> _Run:
    engine, head, reports, sizes = Engine(twin.sources, Settings.preset("balanced")), head_amid(twin.sources), [], []
    for frame in frames:
        reports.append(engine.update(frame, {_VIEWER: head}))
        picture = engine.render(head, _VIEWER).left
        assert engine.model is not None
        sizes.append(sum(engine.model.memory.values()))
        advance()
    return _Run(engine, reports[_SETTLED:], picture, (sizes[_SETTLED], sizes[-1]))


def _static_rows(name: str, moving: _Run, static: _Run) -> Iterator[Spared]:
    """The cost of a frame in which nothing has moved."""
    still = f"{name}, still"
    update = static.median("background")
    yield Spared(still, "the model's update, CPU", moving.median("background"), update, "ms")
    yield Spared(still, "of it, besides looking for changes", update, update - static.change_test(), "ms")
    yield Spared(still, "rays for the model a frame", moving.mean_rays(), static.mean_rays(), "")
    p_pbs = [run.engine.status()["background"]["p_pbs"] for run in (moving, static)]
    yield Spared(still, "triangles of the P-PBS at the end", p_pbs[0], p_pbs[1], "")
    again = moving.median("triangulate"), static.median("triangulate")
    yield Spared(still, "triangulating what is drawn, CPU", *again, "ms")


def _drawing_rows(name: str, twin: Twin, run: _Run) -> Iterator[Spared]:
    """The parts of the views and of the model that a picture does not need."""
    report, last = run.picture.report, run.reports[-1]
    yield Spared(name, "views that are triangulated to be drawn", len(twin.sources), len(report.views), "")
    yield Spared(name, "triangles of these views, of one eye", last.triangles, report.warped, "")
    settings, coding = run.engine.settings, run.picture.camera.depth
    image = imaginary_camera(
        head_amid(twin.sources), 0.0, run.engine.f_vin, coding, settings.pbi_scale, settings.pbi_margin_rad
    )
    yield Spared(name, "rays for one head's background", image.width * image.height, last.pbi_rays, "")


def _memory_rows(name: str, twin: Twin, moving: _Run, static: _Run, frames: int) -> Iterator[Spared]:
    """The model's memory, compared with all depth that was ever seen, and its growth."""
    pixels = sum(camera.width * camera.height for camera in twin.sources)
    seen = 2.0 * pixels * frames / 1e6
    yield Spared(name, f"memory, of the depth of {frames} frames", seen, moving.memory[1] / 1e6, "MB")
    for kind, run in (("", moving), (", still", static)):
        model = run.engine.model
        assert model is not None
        depth = "noisy" if model.tolerances.noise else "clean"
        images = model.memory["images"]
        yield Spared(name + kind, f"memory of a camera's pixel, {depth} depth", _PIXEL, images / pixels, "B")
        first, last = run.memory
        each = (seen / frames) * (frames - 1 - _SETTLED)
        what = f"growth from frame {_SETTLED} on, of the depth since"
        yield Spared(name + kind, what, each, max(last - first, 0) / 1e6, "MB")


def _space_rows(name: str, twin: Twin, first: Frame) -> Iterator[Spared]:
    """The size of the first frame's model, compared with its size when heads stay near one place."""
    x, y, z = head_amid(twin.sources).pose.position
    found = []
    for space in (None, (x, y, z, _WITHIN_M)):
        engine = Engine(twin.sources, Settings.preset("balanced", viewing_space=space))
        report = engine.update(first).background
        assert report is not None
        assert engine.model is not None
        found.append((report.s_pbs_valid, engine.model.memory["surfaces"] / 1e6))
    heads = f"{name}, heads within {_WITHIN_M:g} m"
    yield Spared(heads, "triangles of the S-PBS", found[0][0], found[1][0], "")
    yield Spared(heads, "memory of its surfaces", found[0][1], found[1][1], "MB")
