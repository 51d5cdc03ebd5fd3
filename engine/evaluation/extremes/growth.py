"""The model does not grow while the scene is static, and one seed always gives the same picture."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np

from ...pipeline.engine import Engine
from ...rig.frame import Frame, View
from ...rig.viewer import RenderedPicture
from ...support.runtime import set_thread_count, thread_count
from ...synth import make_twin, twin_frame
from .case import Case, Measured
from .room import Room, rig

__all__ = ["growth_cases", "repeated_cases"]

# A pixel changes only if a frame differs from its mean over many frames by four deviations: at most the share _STRAY of
# the pixels ever does so by chance, and each of these has at most the eight triangles of its own square.
_STRAY, _TRIANGLES = 0.01, 8


def growth_cases(frames: int) -> list[Case]:
    """Cases with `frames` frames of a scene in which nothing moves, with and without noise in the depth."""
    return [
        Case("static scene", f"{frames} frames, depth noise {100 * noise:g} %", partial(_grown, frames, noise))
        for noise in (0.0, 0.003, 0.01, 0.05)
    ]


def repeated_cases() -> list[Case]:
    """Cases that render the same twice: on the same number of threads, and on another number."""
    return [
        Case("same seed", "again", partial(_again, None)),
        Case("same seed", "on 1 thread and on 2", partial(_again, 2)),
    ]


def _grown(frames: int, noise: float) -> list[Measured]:
    """The number of triangles of the P-PBS after `frames` frames, and the number that the S-PBS has lost.

    noise: standard deviation of the depth's noise, as a share of the disparity.
    """
    views = Room().frame(rig((48, 36))).views
    engine, rng = Engine([view.camera for view in views]), np.random.default_rng(0)
    counts: list[tuple[int, int]] = []
    for index in range(frames):
        shown = tuple(_noisy(view, noise, rng) for view in views) if noise else views
        report = engine.update(Frame(index, shown)).background
        assert report is not None
        counts.append((report.s_pbs_valid, report.p_pbs))
    (start, _none), (kept, added) = counts[0], counts[-1]
    pixels = sum(view.codes.size for view in views)
    bound = _STRAY * _TRIANGLES * pixels if noise else 0.0
    lost = _STRAY * start if noise else 0.0
    return [Measured(added, bound, "triangles"), Measured(start - kept, lost, "triangles")]


def _noisy(view: View, noise: float, rng: np.random.Generator) -> View:
    coding = view.camera.depth
    disparity = coding.disparity(view.codes) * (1.0 + noise * rng.standard_normal(view.codes.shape))
    return dataclasses.replace(view, codes=coding.codes(1.0 / np.maximum(disparity, 1e-9)))


def _again(threads: int | None) -> list[Measured]:
    """Differences between two runs from one seed.

    Without `threads` both runs use the usual number of threads, and differing values are counted. Otherwise the first
    uses one thread and the second `threads`, and the largest difference of luma is measured.
    """
    usual = thread_count()
    if threads is not None and usual < threads:
        return [Measured(0.0, 0.0, "no second thread")]
    try:
        set_thread_count(1 if threads else usual)
        one = _picture()
        set_thread_count(threads or usual)
        other = _picture()
    finally:
        set_thread_count(usual)
    luma = np.abs(one.texture.y.astype(np.int64) - other.texture.y)
    if threads is not None:
        return [Measured(int(luma.max()), 1.0, "codes")]
    differing = np.count_nonzero(luma) + np.count_nonzero(one.disparity != other.disparity)
    return [Measured(int(differing), 0.0, "values")]


def _picture() -> RenderedPicture:
    twin = make_twin("painter", scale=0.1, seed=3)
    viewer = twin.rig.camera("t0")
    engine = Engine(twin.sources)
    for index in range(3):
        engine.update(twin_frame(twin, index), {"viewer": viewer})
    return engine.render_camera(viewer, "viewer")
