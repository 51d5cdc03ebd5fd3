"""The plots of the repeated experiments: Fig. 11 and 12b of the paper, as SVG."""

from __future__ import annotations

from collections.abc import Iterator

from farside.engine.evaluation.experiments import FixedExperiment
from farside.engine.evaluation.moving_experiment import MovingExperiment
from farside.engine.evaluation.published import UPDATE_LIMIT_MS

from .svg import Limit, Series, bars, lines

__all__ = ["cost_plots", "moving_plots"]

_UPDATE = Limit("1/30 s (Fig. 11b)", UPDATE_LIMIT_MS)
_HEADSET = Limit("12.5 ms: the headset's 80 Hz (Fig. 11c)", 12.5)
# The pairs of columns of Fig. 11c.
_COLUMNS = (("A", "B", "five views"), ("C", "D", "five views, model"), ("E", "F", "three views, model"))


def cost_plots(experiment: FixedExperiment) -> Iterator[str]:
    """Fig. 11 of a recording: (a) for each quality, (b) and (c)."""
    name = experiment.recording
    for quality in experiment.qualities:
        costs = [cost for cost in experiment.costs if cost.quality == quality]
        frames = [cost.frame for cost in costs]
        yield lines(
            f"(a) {name}, {quality}: triangles", "frame", "triangles",
            [
                Series("newly exposed, accumulated", [cost.exposed for cost in costs], frames),
                Series("P-PBS after culling", [cost.p_pbs for cost in costs], frames),
            ],
        )  # fmt: skip
    later = [cost for cost in experiment.costs if cost.frame > 0 or experiment.frames == 1]
    yield lines(
        f"(b) {name}: update of the PBS", "frame", "ms",
        [
            Series(
                quality, [cost.update_ms for cost in later if cost.quality == quality],
                [cost.frame for cost in later if cost.quality == quality],
            )
            for quality in experiment.qualities
        ],
        [_UPDATE],
    )  # fmt: skip
    letters = [letter for one, two, _way in _COLUMNS for letter in (one, two)]
    yield bars(
        f"(c) {name}: a stereo pair", "ms", letters,
        [Series(quality, _columns(experiment, quality)) for quality in experiment.qualities], [_HEADSET],
    )  # fmt: skip


def _columns(experiment: FixedExperiment, quality: str) -> list[float]:
    rows = [experiment.summary(quality, way) for _one, _two, way in _COLUMNS]
    return [value for row in rows for value in (row.warped_ms, row.filled_ms)]


def moving_plots(experiment: MovingExperiment) -> Iterator[str]:
    """Fig. 12b, the update time, and holes, of a run with a moving camera."""
    moments, name = experiment.moments, f"{experiment.recording}, {experiment.quality}"
    frames = [moment.frame for moment in moments]
    yield lines(
        f"{name}: triangles", "frame", "triangles",
        [
            Series("newly exposed, accumulated", [moment.exposed for moment in moments], frames),
            Series("P-PBS after culling", [moment.p_pbs[1] for moment in moments], frames),
            Series("P-PBS, fixed cameras", [moment.p_pbs[0] for moment in moments], frames),
        ],
    )  # fmt: skip
    later = moments[1:] or moments
    kinds = ((1, "with the moving camera"), (0, "fixed cameras"))
    yield lines(
        f"{name}: update of the PBS", "frame", "ms",
        [
            Series(kind, [moment.update_ms[k] for moment in later], [moment.frame for moment in later])
            for k, kind in kinds
        ],
        [_UPDATE],
    )  # fmt: skip
    sampled, camera = [moment for moment in moments if moment.holes], experiment.camera
    yield lines(
        f"{name}: holes of {camera}", "frame", "% of pixels",
        [
            Series(
                kind, [100 * moment.holes[camera][k] for moment in sampled], [moment.frame for moment in sampled]
            )
            for k, kind in kinds
        ],
    )  # fmt: skip
