"""Records what is compiled for a use: `python -m farside.engine.compiling.recorder USE FOLDER OUT.json`.

For "synth" the twins are made in the folder; for a quality, a live engine and the renderer of files take them from
there. A process of its own, with an empty folder for kernels, compiles all that is needed, and nothing else.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

__all__ = ["Compiled", "recorded"]

_SCALE, _FRAMES = 0.125, 3
_KERNELS = f"{__package__.removesuffix('.compiling')}.kernels."
_TWINS = ("museum", "painter")  # spherical and perspective cameras


@dataclass(slots=True)
class Compiled:
    """A kernel that was compiled: where it is, its types, and its CPU seconds without those of its callees."""

    module: str
    name: str
    types: str
    own_s: float


@contextmanager
def recorded() -> Iterator[list[Compiled]]:
    """Kernels that are compiled while the block runs, those that are called before those that call them."""
    from numba.core import event

    from .signatures import to_text

    found: list[Compiled] = []
    open_: list[list[float]] = []

    class Listener(event.Listener):  # type: ignore[misc] # numba is untyped
        def on_start(self, event: Any) -> None:
            open_.append([time.thread_time(), 0.0])

        def on_end(self, event: Any) -> None:
            started, inner = open_.pop()
            whole = time.thread_time() - started
            function = event.data["dispatcher"].py_func
            ours = function.__module__.startswith(_KERNELS)
            if open_:
                open_[-1][1] += whole if ours else inner  # what Numba compiles of its own counts for our kernel
            if ours:
                found.append(
                    Compiled(
                        function.__module__.removeprefix(_KERNELS), function.__name__, to_text(event.data["args"]),
                        whole - inner,
                    )
                )  # fmt: skip

    with event.install_listener("numba:compile", Listener()):
        yield found


def _rehearse(use: str, folder: Path) -> None:
    """Do what needs all kernels of a use."""
    if use == "synth":
        from ..synth import write_twin

        for name in _TWINS:
            write_twin(name, folder / name, _SCALE, _FRAMES)
        return
    if use == "effects":
        _add_effects()
        return
    if use == "seed":
        _judge_seed()
        return
    if use == "beyond":
        _go_beyond()
        return
    from ..io.recording import open_recording

    if use == "picture":
        _show_one(open_recording(folder / _TWINS[0]))
        return
    for name in _TWINS:
        _play(open_recording(folder / name), use)
        _walk(open_recording(folder / name), use)


def _show_one(recording: Any) -> None:
    """A live engine's first pictures, before there is a model."""
    from ..pipeline.engine import Engine
    from ..settings import Settings

    cameras = [recording.camera(name) for name in recording.source_names]
    engine = Engine(cameras, Settings.preset("balanced"), f_vin=recording.fps, modelling=False)
    for index in range(2):
        engine.update(recording.frame(index, recording.source_names), {"head": _head(cameras)})
        engine.render_encoded(_head(cameras), "head", "jpeg")


def _head(cameras: Sequence[Any]) -> Any:
    from ..rig.viewer import StereoView, home_pose

    return StereoView.symmetric(home_pose(cameras), 128, 144, math.radians(90))


def _play(recording: Any, quality: str) -> None:
    """A live engine, then the renderer of files, on a recording."""
    from ..pipeline.engine import Engine
    from ..settings import Settings

    cameras = [recording.camera(name) for name in recording.source_names]
    engine = Engine(cameras, Settings.preset(quality), f_vin=recording.fps)
    head = _head(cameras)
    for index in range(_FRAMES):
        engine.update(recording.frame(index, recording.source_names), {"head": head})
        engine.render_encoded(head, "head", "jpeg")
    for colours in ("texture", "vertex"):
        engine.export("glb", colours)
    _ask(engine, cameras)
    for name in recording.truth_names[:2]:
        engine.render_camera(recording.camera(name), "head")


def _ask(engine: Any, cameras: Sequence[Any]) -> None:
    """One question of each kind about the model."""
    queries, places = engine.model.queries, [camera.pose.position for camera in cameras]
    ahead = [(1.0, 0.0, 0.0)] * len(places)
    queries.cast_rays(places, ahead)
    queries.are_free(places, ahead)
    queries.closest_points(places)
    queries.overlaps(places, 1.0, listed=1)


def _add_effects() -> None:
    """Throw a picture onto another one, and draw a mesh; the rest, such as the model, is a quality's."""
    import numpy as np

    from ..background.seed_files import seed_of_parts
    from ..io.glb_scene import GlbPart
    from ..kernels.rendering.added_mesh import ColouredTriangles
    from ..kernels.rendering.projector import ProjectedPicture
    from ..rendering.effects import Effects, levels_of_rgba, levels_of_texture
    from ..rendering.target import Target
    from ..rendering.warping import Canvas
    from ..rig.camera import Camera, Perspective, Pose
    from ..rig.depth import DepthCoding
    from ..rig.texture import from_rgb

    camera, origin = Camera("eye", Perspective.from_fov(16, 16, 1.0), Pose(), DepthCoding(0.1, 10.0)), np.zeros(3)
    levels_of_texture(from_rgb(np.zeros((16, 16, 3), np.uint8)))
    picture, codes = levels_of_rgba(np.zeros((16, 16, 4), np.uint8)), np.ones((16, 16), np.uint16)
    thrown = ProjectedPicture(*picture, camera.packed(), codes, 0.1, 0.1, (0.1, 0.1), 1.0, False)
    corners, triangles = np.eye(3), np.array([[0, 1, 2]], np.int32)
    (part,) = seed_of_parts([GlbPart(corners, triangles, np.ones((3, 3), np.float32))]).parts
    mesh = ColouredTriangles(corners, triangles, part.uv, part.atlas.y, part.atlas.cb, part.atlas.cr)
    canvas = Canvas(16, 16)
    canvas.add_effects(Effects((thrown,), (mesh,)), Target(camera, origin), 0.1, 1, (0.1, 0.1))


def _judge_seed() -> None:
    """Look at the triangles of a seed with a picture; the rest, such as the model, is a quality's."""
    import numpy as np

    from ..background.seeding import judged
    from ..geometry.mesh import Mesh
    from ..rig.camera import Camera, Perspective, Pose
    from ..rig.depth import DepthCoding
    from ..rig.texture import from_rgb

    from_rgb(np.zeros((16, 16, 3), np.uint8))
    camera = Camera("eye", Perspective.from_fov(16, 16, 1.0), Pose(), DepthCoding(0.1, 10.0))
    mesh = Mesh(np.eye(3, dtype=np.float32), np.zeros((3, 2), np.float32), np.array([[0, 1, 2]], np.int32))
    judged(mesh, np.empty((0, 0)), np.empty(0, np.int64), camera.packed()[None], (0.1, 0.0))


def _go_beyond() -> None:
    """A model past the paper's limits; the rest is a quality's."""
    from ..background.model import BackgroundModel
    from ..geometry.scene_scale import Scene
    from ..settings import Settings
    from .small_room import small_room

    frames, settings = list(small_room()), Settings(light_s=0.2, cull_stale=True, middle_layers=4)
    cameras = [view.camera for view in frames[0].views]
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, frames[0]))
    for frame in frames:
        model.update(frame, elapsed_s=1 / 30)


def _walk(recording: Any, quality: str) -> None:
    """A live engine on one camera of a recording, as if it moved."""
    from ..pipeline.engine import Engine
    from ..rig.frame import Frame
    from ..settings import Settings

    (view,) = recording.frame(0, recording.source_names[:1]).views
    engine = Engine([view.camera], Settings.preset(quality), f_vin=recording.fps)
    for index in range(2 * _FRAMES):
        camera = replace(view.camera, pose=view.camera.pose.translated((0.0, 0.2 * index, 0.0)))
        engine.update(Frame(index, (replace(view, camera=camera),)))


def main() -> None:
    """Write what was compiled, in order, and modules that compile when they are imported."""
    use, folder, out = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
    with recorded() as found:
        _rehearse(use, folder)
    from numba.core.ccallback import CFunc

    modules = [
        name.removeprefix(_KERNELS)
        for name, module in sys.modules.items()
        if name.startswith(_KERNELS) and any(isinstance(each, CFunc) for each in vars(module).values())
    ]
    out.write_text(json.dumps({"kernels": [asdict(each) for each in found], "modules": modules}), "utf-8")


if __name__ == "__main__":
    main()
