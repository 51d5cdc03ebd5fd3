"""The tolerances that are derived from a scene, compared with smaller and larger ones: which would have been the best?

A twin is played once, by one engine for each value of each tolerance. Its virtual cameras are rendered from few views,
so that much of a picture comes from the model.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..background.model import BackgroundModel
from ..geometry.scene_scale import Scene
from ..pipeline.engine import Engine
from ..rig.camera import Camera
from ..rig.frame import Frame, View
from ..settings import Settings
from ..synth import FPS, Twin, render_view, twin_frame
from .ghosts import ghost_pixels
from .metrics import iv_psnr
from .noise import uncovered_psnr

__all__ = ["FACTORS", "FRAMES", "SCENES", "Choice", "Outcome", "Row", "automatic_choices", "summarise", "sweep"]

SCENES = ("frog", "painter", "museum", "street")  # depths of 1 m, 5 m, 10 m and 300 m; the first two with noise
FACTORS = (0.125, 0.35, 1.0, 2.8, 8.0)
# Consecutive frames first, which show how much depth flickers; then steps in which people walk two metres.
FRAMES = (0, 1, 2, *range(6, 54, 6))
PAPER_DELTA_M = 0.2
_SAMPLED = 3  # pictures are judged in this number of last frames
_VIEWS = 2  # views that are warped
_GHOST_SHARE = 0.05  # a ghost is nearer than the scene by this share of its depth: the same for all values


@dataclass(frozen=True, slots=True)
class Choice:
    """An automatic tolerance.

    values: the settings that set the same tolerance explicitly, in their units. follows: what it is derived from.
    of_model: whether its effect is judged in pixels that had been hidden; otherwise in whole pictures.
    """

    name: str
    values: Mapping[str, float]
    follows: str
    of_model: bool


@dataclass(frozen=True, slots=True)
class Outcome:
    """Means over cameras and frames.

    iv_psnr: dB. hidden: PSNR of the pixels that the warped views leave open and the model shows, dB. holes, ghosts:
    fractions of the pixels, holes after the backdrop.
    """

    iv_psnr: float
    hidden: float
    holes: float
    ghosts: float


@dataclass(frozen=True, slots=True)
class Row:
    """The outcome of one value of a tolerance. label: its factor to the automatic value, or "paper"."""

    choice: Choice
    label: str
    values: Mapping[str, float]
    outcome: Outcome

    @property
    def figure(self) -> float:
        """The figure that the tolerance is judged by, dB."""
        return self.outcome.hidden if self.choice.of_model else self.outcome.iv_psnr


def automatic_choices(frames: Sequence[Frame], settings: Settings) -> list[Choice]:
    """The tolerances that are derived from the first two frames of a scene."""
    cameras = [view.camera for view in frames[0].views]
    scene = Scene.of(cameras, settings, frames[0])
    model = BackgroundModel(cameras, settings, scene)
    for frame in frames:
        model.update(frame)
    found = model.tolerances
    delta = {"delta_m": found.delta_m, "delta_disparity": found.delta_disparity}
    # Set by hand, the tolerance would be edge_px: the automatic one is converted into pixels.
    edges, by_hand = (scene.triangulation(cameras[0], s).edge for s in (settings, replace(settings, edge_px=1.0)))
    return [
        Choice("delta", delta, "median depth; codes and noise of depth", True),
        Choice("margin", {"margin_m": found.margin_m}, "delta", True),
        Choice("backdrop offset", {"backdrop_m": model.delta}, "delta at the median depth", True),
        Choice("depth edge", {"edge_px": edges / by_hand}, "rig size; median depth", False),
        Choice("triangulation", {"tolerance_px": settings.tolerance_px}, "rig size", False),
    ]


def sweep(
    twin: Twin, settings: Settings, frames: Sequence[int] = FRAMES, advance: Callable[[], None] = lambda: None
) -> list[Row]:
    """Play the given frames of a twin with every value of every tolerance; calls `advance` after each frame."""
    settings = replace(settings, n_render=_VIEWS, n_update=max(1, len(twin.sources) // 4))
    variants = list(_variants(automatic_choices([twin_frame(twin, index) for index in frames[:2]], settings)))
    engines = {"": _engine(twin, settings)}
    for choice, label, values in variants:
        if label != "1":
            engines[choice.name + label] = _engine(twin, replace(settings, **values))  # type: ignore[arg-type]
    cameras = [twin.camera(name) for name in twin.rig.target_names]
    still = {c: render_view(twin.scene, c, 0.0, samples=1, background_only=True) for c in cameras}
    found: dict[str, list[list[float]]] = {name: [] for name in engines}
    for played, index in enumerate(frames):
        frame, sampled = twin_frame(twin, index), played >= len(frames) - _SAMPLED
        for engine in engines.values():
            engine.update(frame, {c.name: c for c in cameras} if sampled else None)
        for camera in cameras if sampled else ():
            for name, figures in _judge(engines, camera, twin.truth(camera, index), still[camera]).items():
                found[name].append(figures)
        advance()
    outcomes = {name: Outcome(*(float(v) for v in np.nanmean(figures, axis=0))) for name, figures in found.items()}
    for engine in engines.values():
        engine.close()
    return [Row(c, label, values, outcomes["" if label == "1" else c.name + label]) for c, label, values in variants]


def summarise(rows: Sequence[Row]) -> list[tuple[Row, Row, float]]:
    """For each choice the row of the automatic value, that of the best value, and the difference in dB."""
    found = []
    for name in dict.fromkeys(row.choice.name for row in rows):
        own = [row for row in rows if row.choice.name == name]
        automatic, best = next(row for row in own if row.label == "1"), max(own, key=lambda row: row.figure)
        found.append((automatic, best, best.figure - automatic.figure))
    return found


def _engine(twin: Twin, settings: Settings) -> Engine:
    return Engine(twin.sources, settings, f_vin=FPS)


def _variants(choices: Sequence[Choice]) -> Iterator[tuple[Choice, str, dict[str, float]]]:
    for choice in choices:
        for factor in FACTORS:
            yield choice, f"{factor:g}", {name: factor * value for name, value in choice.values.items()}
        if choice.name == "delta":
            yield choice, "paper", {"delta_m": PAPER_DELTA_M}


def _judge(engines: Mapping[str, Engine], camera: Camera, truth: View, still: View) -> dict[str, list[float]]:
    """The figures of an `Outcome` for each engine. Hidden pixels are the same for all: the automatic engine's holes."""
    pictures = {name: engine.render_camera(camera, camera.name) for name, engine in engines.items()}
    hidden = pictures[""].holes(warped=True)
    found = {}
    for name, picture in pictures.items():
        model = engines[name].model
        assert model is not None
        _holes, nearer, nearer_than_now = ghost_pixels(model, still, truth, _GHOST_SHARE)
        found[name] = [
            iv_psnr(truth.texture, picture.texture),
            uncovered_psnr(truth.texture, picture.texture, hidden) if hidden.any() else math.nan,
            picture.report.holes_backdrop, float(np.mean(nearer & nearer_than_now)),
        ]  # fmt: skip
    return found
