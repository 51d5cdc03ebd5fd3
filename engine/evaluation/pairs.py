"""Stereo pairs per second while the background model is updated: the load of a live service without its network."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..pipeline.engine import Engine
from ..rig.frame import Frame
from ..rig.viewer import StereoView
from ..settings import Settings
from ..support.runtime import set_thread_count, thread_count
from .targets import head_pose

__all__ = ["PairRate", "measure_pairs"]

_VIEWER = "viewer"


@dataclass(slots=True)
class PairRate:
    """Result of a run: pairs and updates per second, and medians of a pair's stages (sums of both eyes), ms."""

    pairs: float
    updates: float
    stages: dict[str, float] = field(default_factory=dict)


def measure_pairs(
    frames: Sequence[Frame], quality: str, f_vin: float, seconds: float, size: tuple[int, int] = (640, 720)
) -> PairRate:
    """Render for a slowly turning head for `seconds`, while a back-end thread takes `f_vin` frames per second.

    `size` is the width and height of an eye's picture. As in the live service, the back end leaves one core to the
    rendering. With f_vin 0 there are no updates after the first two frames.
    """
    engine = Engine([view.camera for view in frames[0].views], Settings.preset(quality), f_vin=f_vin or 1.0)
    home = np.mean([view.camera.pose.position for view in frames[0].views], axis=0)
    view = StereoView.symmetric(head_pose(home, 0.0), *size, math.radians(90))
    for frame in frames[:2]:  # compiles kernels that are not compiled yet, and builds the S-PBS
        engine.update(frame, {_VIEWER: view})
        engine.render(view, _VIEWER)
    stop, updated = threading.Event(), [0]

    def update() -> None:
        set_thread_count(max(1, thread_count() - 1))
        while not stop.wait(1.0 / f_vin):
            engine.update(frames[(2 + updated[0]) % len(frames)], {_VIEWER: view})
            updated[0] += 1

    back_end = threading.Thread(target=update)
    if f_vin > 0:
        back_end.start()
    start, stages = time.perf_counter(), []
    while (elapsed := time.perf_counter() - start) < seconds:
        stages.append(engine.render(view.moved(head_pose(home, elapsed)), _VIEWER).stages)
    rate = PairRate(len(stages) / elapsed, updated[0] / elapsed)
    rate.stages = {name: float(np.median([row[name] for row in stages])) for name in stages[0]}
    stop.set()
    if f_vin > 0:
        back_end.join()
    return rate

