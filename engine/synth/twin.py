"""Twins in memory and on disk: frames of the source cameras, and ground truth for any virtual camera."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..io.tmiv import SequenceWriter
from ..kernels.evaluation.depth_noise import perturb_codes
from ..kernels.synth.solids import Solids
from ..kernels.synth.trace import SceneArrays, TracedPicture, trace_picture
from ..rig.camera import Camera, Perspective
from ..rig.frame import Frame, Texture, View
from ..rig.selection import select_views
from ..rig.viewer import home_pose
from ..support.array_types import F64
from .rigs import Rig, twin_cameras
from .scenes import Scene, make_scene

__all__ = ["FPS", "Twin", "make_twin", "render_view", "twin_frame", "write_twin"]


FPS = 30.0
# Errors of estimated depth at strength 1: the distance by which edges wander, as a share of the picture's width, and
# the error of codes, as a share of their range.
EDGE_ERROR, CODE_ERROR = 0.0025, 0.006
_WIDE, _DEPTHS_M = Perspective.from_fov(64, 64, math.pi / 2), (1.5, 3.0, 6.0)  # of a viewer, and what is looked at


@dataclass(frozen=True, eq=False)
class Twin:
    """A scene and its rig. What stands still is rendered once for each camera, as long as the light stays, and kept."""

    name: str
    seed: int
    scene: Scene
    rig: Rig
    depth_noise: float
    samples: int = 2
    _static: dict[Camera, tuple[F64, View]] = field(default_factory=dict)  # with the light in which it was rendered
    _moments: dict[int, Solids] = field(default_factory=dict)  # the latest instant only

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """All cameras, including the virtual ones, with their poses in frame 0."""
        return self.rig.cameras

    @property
    def source_names(self) -> tuple[str, ...]:
        """Names of the reference cameras, in the order of a frame's views."""
        return self.rig.source_names

    @property
    def sources(self) -> tuple[Camera, ...]:
        """The reference cameras with their poses in frame 0."""
        return tuple(self.rig.camera(name) for name in self.source_names)

    def camera(self, name: str, index: int = 0) -> Camera:
        """The camera called `name` with its pose in frame `index`; raises ValueError for an unknown name."""
        return self.rig.camera(name, index / FPS)

    def truth(self, camera: Camera, index: int) -> View:
        """The view of a camera in frame `index`, without errors.

        The same as that of `render_view`, but faster for cameras that do not move: only the actors are traced again.
        """
        time = index / FPS
        lamps = self.scene.lit(time)
        if camera not in self._static or not np.array_equal(self._static[camera][0], lamps):
            still = render_view(self.scene, camera, time, samples=self.samples, background_only=True)
            self._static[camera] = lamps, still
        still = self._static[camera][1]
        texture = Texture(still.texture.y.copy(), still.texture.cb.copy(), still.texture.cr.copy())
        view = View(camera, texture, still.codes.copy())
        _trace(self.scene, view, self._packed(index), lamps, self.samples, first=len(self.scene.static))
        return view

    def view(self, name: str, index: int) -> View:
        """The view of the source camera `name` in frame `index`; its depth has errors of strength `depth_noise`."""
        camera = self.camera(name, index)
        if name in self.rig.moving:
            view = render_view(self.scene, camera, index / FPS, samples=self.samples)
        else:
            view = self.truth(camera, index)
        return self._with_errors(view, index) if self.depth_noise else view

    def _packed(self, index: int) -> Solids:
        packed = self._moments.get(index)
        if packed is None:
            packed = self.scene.packed(index / FPS)
            self._moments.clear()
            self._moments[index] = packed
        return packed

    def _with_errors(self, view: View, index: int) -> View:
        out, depth = np.empty_like(view.codes), view.camera.depth
        seed = zlib.crc32(f"{self.seed} {view.camera.name}".encode())
        shift, error = EDGE_ERROR * view.camera.width, CODE_ERROR * depth.max_code
        noise = self.depth_noise
        perturb_codes(view.codes, index, seed, noise * shift, noise * error, depth.max_code, out)
        return replace(view, codes=out)


def make_twin(name: str, scale: float = 1.0, seed: int = 0, depth_noise: float | None = None) -> Twin:
    """The twin called `name` (one of `scenes.TWINS`), with pictures `scale` times as wide and high.

    `depth_noise` is the strength of the errors of estimated depth; by default it is 1 for painter and frog and 0
    for the others. Raises ValueError for an unknown name, or a scale or strength out of range.
    """
    scene, rig = make_scene(name, seed), twin_cameras(name, scale)
    strength = rig.depth_noise if depth_noise is None else depth_noise
    if not 0.0 <= strength <= 100.0:
        raise ValueError(f"depth noise: {strength!r}: expected 0 to 100")
    return Twin(name, seed, scene, rig, strength)


def render_view(
    scene: Scene, camera: Camera, time: float, *, samples: int = 2, background_only: bool = False
) -> View:
    """Ground truth: the view of any camera at `time` in seconds; with `background_only`, of the scene without actors.

    A pixel's colour is the mean of samples x samples rays; its depth is that of its centre.
    """
    height, width = camera.height, camera.width
    half = ((height + 1) // 2, (width + 1) // 2)
    texture = Texture(*(np.zeros(shape, np.uint16) for shape in ((height, width), half, half)))
    view = View(camera, texture, np.zeros((height, width), np.uint16))
    solids = scene.background if background_only else scene.packed(time)
    _trace(scene, view, solids, scene.lit(time), samples, first=0)
    return view


def twin_frame(twin: Twin, index: int, names: Sequence[str] | None = None) -> Frame:
    """Frame `index` of a twin, rendered in memory: the source views `names` in that order, by default all."""
    return Frame(index, tuple(twin.view(name, index) for name in names or twin.source_names))


def write_twin(
    name: str,
    folder: Path | str,
    scale: float = 1.0,
    frames: int | None = None,
    seed: int = 0,
    depth_noise: float | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
    *,
    json_name: str | None = None,
    truth: bool = True,
) -> None:
    """Write a twin to a TMIV folder; the ground truth of its virtual cameras goes to the subfolder truth/.

    Without `truth` there are no virtual cameras.

    The views of a frame are written in the order of their use for a viewer in the middle of the rig: they can be read
    before the others are there.

    `frames` is the number of frames, by default that of the original. `progress` is called with the number of
    pictures done and the total. The JSON is called `json_name`.json, by default as the folder. Raises ValueError as
    `make_twin` does, and for a number of frames below 1.
    """
    twin = make_twin(name, scale, seed, depth_noise)
    count = twin.rig.frame_count if frames is None else frames
    if count < 1:
        raise ValueError(f"frames: {count!r}: expected at least 1")
    targets = twin.rig.target_names
    names = (*_most_useful_first(twin), *(targets if truth else ()))
    cameras = [camera for camera in twin.cameras if truth or camera.name not in targets]
    done, total = 0, count * len(names)
    progress(done, total)
    with SequenceWriter(
        folder, name, FPS, cameras, twin.source_names, json_name=json_name, frame_count=count
    ) as writer:
        for index in range(count):
            for camera in names:
                is_source = camera in twin.source_names
                view = twin.view(camera, index) if is_source else twin.truth(twin.camera(camera), index)
                writer.write(camera, view.texture, view.codes, view.camera.pose)
                done += 1
                progress(done, total)


def _most_useful_first(twin: Twin) -> tuple[str, ...]:
    """The source cameras in the order in which a viewer in the middle of the rig would choose them."""
    cameras = twin.sources
    middle = Camera("middle", _WIDE, home_pose(cameras), cameras[0].depth)
    chosen = [twin.source_names[k] for k in select_views(middle, cameras, len(cameras), _DEPTHS_M)]
    return (*chosen, *(name for name in twin.source_names if name not in chosen))


def _trace(
    scene: Scene,
    view: View,
    packed: Solids,
    lamps: F64,
    samples: int,
    first: int,
) -> None:
    picture = TracedPicture(view.texture.y, view.texture.cb, view.texture.cr, view.codes)
    arrays = SceneArrays(*packed, scene.materials, lamps)
    trace_picture(view.camera.packed(), view.camera.depth.packed(), arrays, first, samples, picture)
