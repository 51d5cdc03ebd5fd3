"""Ghosts and holes of the background model over a twin's frames, against its ground truth.

A ghost is a pixel where the model shows something that is neither there now nor part of the background: it is nearer
than both by more than delta plus the tolerance of the model's meshes. A person who has stood in one place all the time
is no ghost, because nothing distinguishes them from the background.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..background.model import BackgroundModel
from ..pipeline.engine import Engine
from ..rig.camera import Camera
from ..rig.frame import View
from ..settings import Settings
from ..synth import FPS, Twin, render_view, twin_frame

__all__ = ["GhostSample", "ghost_pixels", "inside_cameras", "plot_ghosts", "watch_ghosts"]

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class GhostSample:
    """One virtual camera at one frame; all figures are fractions of its pixels.

    ghosts: see the module's docstring. standing: the model is nearer than the background, but not than what is there
    now. holes_model: the model has no surface. holes_warped, holes_backdrop: holes of the rendered picture before and
    after the backdrop.
    """

    camera: str
    frame: int
    ghosts: float
    standing: float
    holes_model: float
    holes_warped: float
    holes_backdrop: float


def inside_cameras(twin: Twin) -> list[Camera]:
    """The virtual cameras with ground truth that stand among the source cameras.

    "Among" means: at most 1.5 times as far from the rig's middle as its farthest camera.
    """
    positions = np.array([camera.pose.position for camera in twin.sources])
    middle = positions.mean(axis=0)
    reach = 1.5 * float(np.linalg.norm(positions - middle, axis=1).max())
    targets = [twin.camera(name) for name in twin.rig.target_names]
    return [camera for camera in targets if np.linalg.norm(camera.pose.position - middle) <= reach]


def watch_ghosts(
    twin: Twin, cameras: Sequence[Camera], frames: Sequence[int], every: int, settings: Settings
) -> Iterator[GhostSample]:
    """Play the frames with the given indices of a twin, rendered in memory.

    Yields a sample per camera in every `every`-th of these frames and in the last.
    """
    engine = Engine(twin.sources, settings, f_vin=FPS)
    still = {c.name: render_view(twin.scene, c, 0.0, samples=1, background_only=True) for c in cameras}
    for number, index in enumerate(frames):
        sampled = number % every == 0 or number == len(frames) - 1
        engine.update(twin_frame(twin, index), {c.name: c for c in cameras} if sampled else None)
        for camera in cameras if sampled else ():
            model = engine.model
            assert model is not None
            holes, nearer_than_background, nearer_than_all = ghost_pixels(
                model, still[camera.name], twin.truth(camera, index)
            )
            ghosts = nearer_than_background & nearer_than_all
            picture = engine.render_camera(camera, camera.name).report
            yield GhostSample(
                camera.name, index, float(ghosts.mean()), float((nearer_than_background & ~ghosts).mean()),
                float(holes.mean()), picture.holes_warped, picture.holes_backdrop,
            )  # fmt: skip


def ghost_pixels(
    model: BackgroundModel, background: View, now: View, share: float | None = None
) -> tuple[Bools, Bools, Bools]:
    """Masks [h, w] of where the model has a hole, is nearer than the background, and is nearer than the scene now.

    `background` and `now` are ground truth of one camera. "Nearer" is nearer than the pixel and its eight neighbours,
    as outlines may be off by a pixel, and by more than delta, or by more than `share` times the model's depth if given.
    """
    camera = background.camera
    coding = dataclasses.replace(camera.depth, has_invalid=True)
    found = model.render_pbi(dataclasses.replace(camera, depth=coding)).view
    depth = coding.depth(found.codes)

    def nearer_than(view: View) -> Bools:
        there = _nearest(camera.depth.depth(view.codes))
        slack = model.tolerances.delta_at(depth) if share is None else share * depth
        nearer: Bools = depth + slack < 1.0 / (1.0 / there + model.mesh_tolerance)
        return nearer

    return found.codes == 0, nearer_than(background), nearer_than(now)


def _nearest(depth: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """The least depth of each pixel and its eight neighbours; pixels without depth count as infinitely far."""
    h, w = depth.shape
    padded = np.pad(np.nan_to_num(depth, nan=np.inf), 1, mode="edge")
    shifted = [padded[y : y + h, x : x + w] for y, x in product(range(3), range(3))]
    nearest: npt.NDArray[np.float64] = np.min(shifted, axis=0)
    return nearest


def plot_ghosts(samples: Sequence[GhostSample], title: str, path: Path) -> None:
    """Plot the means over the cameras against the frame into a PNG at `path`.

    Raises ImportError without matplotlib (extra `plots`).
    """
    from matplotlib.figure import Figure

    frames = sorted({sample.frame for sample in samples})
    figure = Figure(figsize=(8, 6), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    curves = (
        (above, "holes_warped", "before the backdrop"),
        (above, "holes_backdrop", "after the backdrop"),
        (below, "ghosts", "ghosts"),
        (below, "standing", "people who have not moved on"),
    )
    for axes, name, label in curves:
        means = [100 * np.mean([getattr(s, name) for s in samples if s.frame == frame]) for frame in frames]
        axes.plot(frames, means, label=label)
    above.set(title=title, ylabel="holes, % of pixels", ylim=(0, None))
    below.set(xlabel="frame", ylabel="model too near, % of pixels", ylim=(0, None))
    for axes in (above, below):
        axes.legend()
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
