"""The benefit of prefiltering in pictures that are coarser than the views.

Eyes in the middle of a twin's cameras are compared with its ground truth.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..geometry.minification import Level, halved
from ..geometry.prepared_view import pixels_per_radian
from ..geometry.scene_scale import Scene
from ..geometry.triangulation import depth_cuts
from ..pipeline.engine import Engine
from ..rig.camera import Camera, Perspective
from ..rig.frame import Frame, View
from ..settings import Settings
from ..synth import make_twin, render_view, twin_frame
from .metrics import iv_psnr, psnr, ssim

__all__ = ["RATIOS", "MinifiedRow", "halving_cost", "measure_minified"]

RATIOS = (1.5, 1.75, 2.0, 3.0, 4.0)
_FOV = math.radians(75.0)
_SAMPLES = 5  # 5 x 5 samples per pixel: a truth that does not alias
_REPEATS = 5


@dataclass(frozen=True, slots=True)
class MinifiedRow:
    """(PSNR-Y in dB, IV-PSNR in dB, SSIM) of a picture, without (off) and with (on) prefiltering.

    ratio: pixels of a view for one pixel of the picture, in each direction. width: of the picture, pixels.
    """

    ratio: float
    width: int
    off: tuple[float, float, float]
    on: tuple[float, float, float]


def measure_minified(name: str, scale: float, quality: str, views: int) -> Iterator[MinifiedRow]:
    """Render eyes in the middle of the first `views` cameras of the twin `name`, from its first frame in these views.

    Yields a row per ratio in RATIOS. `scale` is the size of the twin's pictures, `quality` a preset.
    """
    twin = make_twin(name, scale)
    frame = twin_frame(twin, 0, twin.source_names[:views])
    cameras = [view.camera for view in frame.views]
    engines = []
    for prefilter in (False, True):
        engine = Engine(cameras, Settings.preset(quality, background=False, prefilter=prefilter))
        engine.update(frame)
        engines.append(engine)
    x, y, z = (float(c) for c in np.mean([camera.pose.position for camera in cameras], axis=0))
    pose = replace(cameras[0].pose, position=(x, y, z))
    for ratio in RATIOS:
        eye = Camera("eye", _eye(cameras[0], ratio), pose, cameras[0].depth)
        truth = render_view(twin.scene, eye, 0.0, samples=_SAMPLES).texture
        pictures = [engine.render_camera(eye).texture for engine in engines]
        off, on = ((psnr(truth, picture)[0], iv_psnr(truth, picture), ssim(truth, picture)) for picture in pictures)
        yield MinifiedRow(ratio, eye.width, off, on)


def _eye(camera: Camera, ratio: float) -> Perspective:
    """An eye with one pixel for `ratio` pixels of a camera; with its field of view if the camera is perspective."""
    if isinstance(camera.projection, Perspective):
        return camera.projection.scaled(1.0 / ratio)
    width = 2 * round(math.tan(0.5 * _FOV) * pixels_per_radian(camera) / ratio)
    return Perspective.from_fov(width, width, _FOV)


def halving_cost(view: View) -> float:
    """Milliseconds of CPU time per megapixel of a view that halving it takes, the least of several."""
    options = Scene.of([view.camera], Settings(), Frame(0, (view,))).triangulation(view.camera, Settings())
    texture = view.texture
    cuts = depth_cuts(view.camera, view.codes, options)
    level = Level(view.camera, view.codes, texture.y, texture.cb, texture.cr, cuts)
    halved(level, options)  # compiles
    spent = []
    for _ in range(_REPEATS):
        start = time.process_time()
        halved(level, options)
        spent.append(time.process_time() - start)
    return 1e3 * min(spent) / (1e-6 * view.codes.size)
