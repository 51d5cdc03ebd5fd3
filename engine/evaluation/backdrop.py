"""What the backdrop shows: the model's farthest surfaces, or the nearest that stand, against a twin's ground truth."""

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

__all__ = ["VIEWS", "BackdropSample", "PbiCost", "compare_backdrops", "pbi_costs"]

VIEWS = (2, 3, 5)  # that are warped before the backdrop
_PEAK = 1023.0
_REPEATS = 3

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class BackdropSample:
    """One virtual camera at one frame, from some views, in one mode.

    psnr_y, iv_psnr: of the picture, dB. squares, pixels: summed squared luma error, and number, of the pixels that no
    warped view drew, in any mode. too_far, too_near: pixels of the backdrop that are off what is there, by more than
    delta.
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
    """A PBI at the size of a camera's picture, one thread: rays cast, and the least processor time in seconds."""

    camera: str
    mode: str
    rays: int
    seconds: float


def compare_backdrops(
    twin: Twin, cameras: Sequence[Camera], frames: int, every: int, quality: str
) -> Iterator[BackdropSample]:
    """Play a twin's frames in both modes side by side; yields samples in every `every`-th frame."""
    engines = {mode: Engine(twin.sources, Settings.preset(quality, backdrop=mode), f_vin=FPS) for mode in BACKDROPS}
    for index in range(frames):
        frame, viewers = twin_frame(twin, index), {c.name: c for c in cameras} if index % every == 0 else {}
        for engine in engines.values():
            # Where fewer views are drawn, more of the backdrop is needed.
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
        far, near = _wrong(picture, truth, model)
        yield BackdropSample(
            camera.name, index, views, mode, psnr(truth.texture, picture.texture)[0],
            iv_psnr(truth.texture, picture.texture), float(np.sum(error[undrawn] ** 2)), int(undrawn.sum()),
            int(far.sum()), int(near.sum()),
        )  # fmt: skip


def _wrong(picture: RenderedPicture, truth: View, model: BackgroundModel) -> tuple[Bools, Bools]:
    """Pixels of the backdrop behind the farthest of what is there round them, and before the nearest; [h, w] each."""
    there = truth.camera.depth.depth(truth.codes)
    h, w = there.shape
    padded = np.pad(there, 1, mode="edge")
    around = [padded[y : y + h, x : x + w] for y, x in product(range(3), range(3))]
    backdrop = (picture.winner == len(picture.report.views)) & ~picture.holes()
    depth = model.tolerances.before_delta(1.0 / np.where(backdrop, picture.disparity, np.nan))  # it was pushed back
    delta = model.tolerances.delta_at(there)
    return depth > np.max(around, axis=0) + delta, depth < np.min(around, axis=0) - delta


def pbi_costs(frames: Sequence[Frame], cameras: Sequence[Camera], quality: str) -> Iterator[PbiCost]:
    """What a PBI costs in each mode after some frames: the same model and cameras, in turn, on one thread."""
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
