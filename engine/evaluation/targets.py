"""Target speeds and measured speeds, on a twin as large as the paper's sequence.

Variants that are compared are timed in turns in one process, so that other load of the machine affects all equally.
Times are wall-clock medians with one thread per core. A first pass, which compiles kernels that are not compiled yet,
is not counted. Frames of the twin are made between the measurements.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry.prepared_view import PreparedView
from ..geometry.scene_scale import Scene
from ..pipeline.engine import Engine
from ..rig.camera import Camera, Perspective, Pose
from ..rig.frame import Frame
from ..rig.viewer import StereoView
from ..settings import Settings
from ..synth import Twin, twin_frame
from .ghosts import inside_cameras
from .metrics import iv_psnr

__all__ = ["Target", "head_pose", "loss_targets", "one_eye_targets", "pair_targets", "update_targets", "warp_all"]

_VIEWER = "viewer"
Advance = Callable[[], None]


@dataclass(frozen=True, slots=True)
class Target:
    """One figure: what was measured, its value and unit, and the wanted value (None: the figure only informs)."""

    what: str
    value: float
    unit: str
    wanted: float | None = None
    at_least: bool = False  # `wanted` is the least value; otherwise the largest

    @property
    def met(self) -> bool | None:
        """Whether the value is as wanted; None if no value is wanted."""
        if self.wanted is None:
            return None
        return self.value >= self.wanted if self.at_least else self.value <= self.wanted


def head_pose(home: np.ndarray, seconds: float) -> Pose:
    """Pose at a time in seconds of a head that turns slowly and sways by a decimetre around `home` [3], metres."""
    turn = 2 * math.pi * seconds / 8.0
    position = np.add(home, (0.0, 0.1 * math.sin(turn), 0.0))
    return Pose.from_euler(position, 0.4 * math.sin(turn), 0.1 * math.sin(2 * turn), 0.0)


def warp_all(views: int, quality: str) -> Settings:
    """A preset that warps all `views` views and keeps no model: the model's savings are measured against it."""
    return Settings.preset(quality, n_render=views, background=False)


# A picture of one eye


def one_eye_targets(twin: Twin, repeats: int, advance: Advance) -> Iterator[Target]:
    """One square eye from the five nearest views of a twin with the preset `balanced`; triangulation is included.

    The views are the half-spheres of the twin, then perspective views from the same places. "from nothing": each view
    is triangulated as a whole, as after a cut. "in a video": triangles that did not change are kept from the previous
    frame. `advance` is called after each measurement.
    """
    size = twin.sources[0].height
    home = np.mean([camera.pose.position for camera in twin.sources], axis=0)
    eye = Camera("eye", Perspective.from_fov(size, size, math.pi / 2), head_pose(home, 1.0), twin.sources[0].depth)
    settings = Settings.preset("balanced", background=False)
    spheres = [twin_frame(twin, index) for index in range(2)]
    square = Perspective.from_fov(size, size, math.radians(100))
    cameras = [dataclasses.replace(camera, projection=square) for camera in twin.sources]
    flat = [Frame(index, tuple(twin.truth(camera, index) for camera in cameras)) for index in range(2)]
    for kind, frames in (("equirectangular", spheres), ("perspective", flat)):
        engine = Engine([view.camera for view in frames[0].views], settings)
        whole, video = [], []
        for k in range(2 * repeats + 2):
            start = time.perf_counter()
            engine.update(frames[k % 2], {_VIEWER: eye})
            picture = engine.render_camera(eye, _VIEWER)
            spent = time.perf_counter() - start
            anew = _triangulate_anew(frames[k % 2], picture.report.views, settings)
            start = time.perf_counter()
            engine.render_camera(eye, _VIEWER)
            if k >= 2:
                video.append(spent)
                whole.append(anew + time.perf_counter() - start)
            advance()
        name = f"one eye {size}x{size}, five {kind} views of {size}x{size}, balanced, triangulated"
        yield Target(f"{name} from nothing", 1e3 * float(np.median(whole)), "ms", 20.0)
        yield Target(f"{name} in a video (the whole update)", 1e3 * float(np.median(video)), "ms")


def _triangulate_anew(frame: Frame, names: Sequence[str], settings: Settings) -> float:
    """Seconds that making the meshes of the named views of a frame takes."""
    scene = Scene.of([view.camera for view in frame.views], settings, frame)
    start = time.perf_counter()
    for view in (view for view in frame.views if view.camera.name in names):
        options = scene.triangulation(view.camera, settings)
        PreparedView(view, options, scene.origin, settings.completion).mesh()
    return time.perf_counter() - start


# Initialisation and updates


def update_targets(
    twin: Twin, engines: Mapping[str, Engine], frames: Sequence[int], repeats: int, advance: Advance
) -> Iterator[Target]:
    """Initialisation of the S-PBS from the first of the `frames` of a twin, then updates with all of them, no viewer.

    All engines (by preset) play the frames; the times are those of `balanced`.
    """
    first, balanced = twin_frame(twin, frames[0]), engines["balanced"]
    n_init, n_update = balanced.settings.n_init, balanced.settings.n_update
    initial = [
        Engine(balanced.cameras, balanced.settings).update(first).stages["background"] for _ in range(repeats)
    ]
    yield Target(f"S-PBS initialisation, n_init = {n_init}", float(np.median(initial)), "ms", 1270.0)
    background, exposure = [], []
    for number, index in enumerate(frames):
        frame = first if number == 0 else twin_frame(twin, index)
        stages = {quality: engine.update(frame).stages for quality, engine in engines.items()}["balanced"]
        if number > 1:  # the second may compile
            background.append(stages["background"])
            exposure.append(stages["exposure"])
        advance()
    update = f"background update a frame, n_update = {n_update}"
    yield Target(f"{update}, median", float(np.median(background)), "ms", 33.0)
    yield Target(f"{update}, p99 of {len(background)}", float(np.percentile(background, 99)), "ms", 60.0)
    yield Target("following the exposure of all views, a frame, median", float(np.median(exposure)), "ms")


# Stereo pairs


def pair_targets(
    frame: Frame, engines: Mapping[str, Engine], size: tuple[int, int], repeats: int, advance: Advance
) -> Iterator[Target]:
    """Stereo pairs of `size` (width, height of an eye) by engines (by preset) that have played up to `frame`.

    Each engine is compared with one that warps all views with the same preset (`warp_all`).
    """
    home = np.mean([view.camera.pose.position for view in frame.views], axis=0)
    view = StereoView.symmetric(head_pose(home, 0.0), *size, math.radians(90))
    count, wanted = len(frame.views), {"fast": 30.0, "balanced": 60.0}
    plain = {quality: Engine(engine.cameras, warp_all(count, quality)) for quality, engine in engines.items()}
    every = {f"{quality}, model": engine for quality, engine in engines.items()}
    every |= {f"{quality}, all views": engine for quality, engine in plain.items()}
    spent: dict[str, list[float]] = {name: [] for name in every}
    holes: dict[str, list[float]] = {name: [] for name in every}
    back_end = {}
    for name, engine in every.items():
        back_end[name] = engine.update(frame, {_VIEWER: view}).stages
        engine.render(view, _VIEWER)  # triangulates what is not ready, and compiles
    for k in range(repeats):
        moved = view.moved(head_pose(home, 8.0 * k / repeats))
        for name, engine in every.items():
            engine.render(moved, _VIEWER)  # makes meshes of newly selected views; their time belongs to the frame
            start = time.perf_counter()
            picture = engine.render(moved, _VIEWER)
            spent[name].append(1e3 * (time.perf_counter() - start))
            holes[name].append(100 * picture.holes)
        advance()
    eyes = f"stereo pair 2 x {size[0]}x{size[1]} from five of {count} views"
    for quality in engines:
        few, all_views = f"{quality}, model", f"{quality}, all views"
        yield Target(f"{eyes}, {quality}", float(np.median(spent[few])), "ms", wanted.get(quality))
        yield Target(f"the same, all {count} views warped, {quality}", float(np.median(spent[all_views])), "ms")
        ratio = float(np.median(np.divide(spent[all_views], spent[few])))
        yield Target(f"times faster than warping all {count}, {quality}", ratio, "x", 5.0, at_least=True)
        all_holes = float(np.mean(holes[all_views]))
        yield Target(f"holes before filling, {quality}", float(np.mean(holes[few])), "%", all_holes)
        yield Target(f"PBI for one viewer, {quality}", back_end[few]["pbi"], "ms")
        yield Target(f"triangulation of a frame for one viewer, {quality}", back_end[few]["triangulate"], "ms")


# Loss


def loss_targets(twin: Twin, frame: int, advance: Advance) -> Iterator[Target]:
    """Mean IV-PSNR of the presets without a model, over the virtual cameras inside the rig, in one frame of a twin."""
    source = twin_frame(twin, frame)
    variants = {
        "fast": Settings.preset("fast", background=False),
        "balanced": Settings.preset("balanced", background=False),
        "best": Settings.preset("best", background=False),
        "best --tolerance 0": Settings.preset("best", background=False, tolerance_px=0.0),
    }
    loss, truths = {}, [(camera, twin.truth(camera, frame).texture) for camera in inside_cameras(twin)]
    for name, settings in variants.items():
        engine = Engine([view.camera for view in source.views], settings)
        engine.update(source)
        values = []
        for camera, truth in truths:
            values.append(iv_psnr(truth, engine.render_camera(camera).texture))
            advance()
        loss[name] = float(np.mean(values))
        yield Target(f"IV-PSNR, five views, {name}", loss[name], "dB")
    yield Target("loss of balanced to best", loss["best"] - loss["balanced"], "dB", 0.3)
    exact = loss["best --tolerance 0"] - loss["best"]
    yield Target("loss of best to a mesh of two triangles a pixel", exact, "dB", 0.1)
