"""The two modes of the backdrop against a twin's ground truth: the model's farthest surfaces, or the nearest standing.

Settings.backdrop explains the modes.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import numpy.typing as npt

from ..background.model import BackgroundModel
from ..geometry.prepared_view import PreparedView, ViewTable
from ..geometry.scene_scale import Scene
from ..pipeline.engine import Engine
from ..rig.camera import Camera
from ..rig.frame import Frame, View
from ..rig.viewer import RenderedPicture
from ..settings import BACKDROPS, Settings
from ..support.runtime import set_thread_count, thread_count
from ..synth import FPS, Twin, twin_frame
from .metrics import iv_psnr, psnr

__all__ = ["VIEWS", "BackdropSample", "PbiCost", "compare_backdrops", "pbi_costs", "wrong_depth"]

VIEWS = (2, 3, 5)  # numbers of views that are warped in front of the backdrop
_PEAK = 1023.0
_REPEATS = 3

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class BackdropSample:
    """One virtual camera at one frame, from `views` views, in one mode.

    psnr_y, iv_psnr: of the whole picture, dB. squares, pixels: the summed squared luma error, and the number, of the
    pixels that no warped view drew in at least one mode. too_far, too_near: numbers of backdrop pixels whose depth
    differs from the truth by more than delta.
    """

    camera: str
    frame: int
    views: int
    mode: str
    psnr_y: float
    iv_psnr: float
    squares: float
    pixels: int
    too_far: int
    too_near: int


@dataclass(frozen=True, slots=True)
class PbiCost:
    """Cost of a PBI as large as a camera's picture, on one thread: rays cast, and the least CPU time in seconds."""

    camera: str
    mode: str
    rays: int
    seconds: float


def compare_backdrops(
    twin: Twin, cameras: Sequence[Camera], frames: int, every: int, quality: str
) -> Iterator[BackdropSample]:
    """Play `frames` frames of a twin in both modes side by side; yields samples in every `every`-th frame.

    `cameras` are virtual cameras, `quality` is a preset.
    """
    engines = {mode: Engine(twin.sources, Settings.preset(quality, backdrop=mode), f_vin=FPS) for mode in BACKDROPS}
    for index in range(frames):
        frame, viewers = twin_frame(twin, index), {c.name: c for c in cameras} if index % every == 0 else {}
        for engine in engines.values():
            # The fewer views are drawn, the more of the backdrop is needed: update for the least number.
            engine.retune(dataclasses.replace(engine.settings, n_render=min(VIEWS)))
            engine.update(frame, viewers)
        for camera, views in product(viewers.values(), VIEWS):
            yield from _samples(engines, camera, twin.truth(camera, index), index, views)


def _samples(
    engines: dict[str, Engine], camera: Camera, truth: View, index: int, views: int
) -> Iterator[BackdropSample]:
    pictures = {}
    for mode, engine in engines.items():
        engine.retune(dataclasses.replace(engine.settings, n_render=views))
        pictures[mode] = engine.render_camera(camera, camera.name)
    undrawn = np.any([picture.holes(warped=True) for picture in pictures.values()], axis=0)
    for mode, picture in pictures.items():
        error = picture.texture.y.astype(np.float64) - truth.texture.y
        model = engines[mode].model
        assert model is not None
        far, near = wrong_depth(picture, truth, model)
        yield BackdropSample(
            camera.name, index, views, mode, psnr(truth.texture, picture.texture)[0],
            iv_psnr(truth.texture, picture.texture), float(np.sum(error[undrawn] ** 2)), int(undrawn.sum()),
            int(far.sum()), int(near.sum()),
        )  # fmt: skip


def wrong_depth(picture: RenderedPicture, truth: View, model: BackgroundModel) -> tuple[Bools, Bools]:
    """Backdrop pixels behind the farthest true depth of the 3x3 pixels around them, and in front of the nearest.

    Both masks are [h, w]; the difference is more than delta.
    """
    there = truth.camera.depth.depth(truth.codes)
    h, w = there.shape
    padded = np.pad(there, 1, mode="edge")
    around = [padded[y : y + h, x : x + w] for y, x in product(range(3), range(3))]
    backdrop = (picture.winner == len(picture.report.views)) & ~picture.holes()
    depth = model.tolerances.before_delta(1.0 / np.where(backdrop, picture.disparity, np.nan))  # it was pushed back
    delta = model.tolerances.delta_at(there)
    return depth > np.max(around, axis=0) + delta, depth < np.min(around, axis=0) - delta


def pbi_costs(frames: Sequence[Frame], cameras: Sequence[Camera], quality: str) -> Iterator[PbiCost]:
    """The cost of a PBI in each mode after `frames`: one model, the same cameras, modes in turn, on one thread."""
    settings = Settings.preset(quality)
    sources = [view.camera for view in frames[0].views]
    scene = Scene.of(sources, settings, frames[0])
    model = BackgroundModel(sources, settings, scene)
    for frame in frames:
        model.update(frame)
    views = [PreparedView(v, scene.triangulation(v.camera, settings), scene.origin) for v in frames[-1].views]
    present = {"farthest": None, "standing": ViewTable(views)}
    threads = thread_count()
    set_thread_count(1)
    try:
        for camera in cameras:
            target = dataclasses.replace(camera, depth=scene.coding)
            best, rays = dict.fromkeys(BACKDROPS, math.inf), dict.fromkeys(BACKDROPS, 0)
            for _, mode in product(range(_REPEATS), BACKDROPS):
                start = time.process_time()
                rays[mode] = model.render_pbi(target, present[mode]).rays
                best[mode] = min(best[mode], time.process_time() - start)
            yield from (PbiCost(camera.name, mode, rays[mode], best[mode]) for mode in BACKDROPS)
    finally:
        set_thread_count(threads)
