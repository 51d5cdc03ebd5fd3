"""The paper's experiment with a moving reference camera (section 4.2): Fig. 12b and 13."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..io.recording import Recording
from ..rig.frame import Texture
from ..rig.viewer import RenderedPicture
from ..settings import Settings
from .experiments import QUALITIES, farthest_camera
from .moving import Moment, play_rig
from .paper import warm_up

__all__ = ["MovingExperiment", "play_moving"]

_FIRST = 5  # frames until the first picture: "just after the 4th and 249th frames" (Fig. 13)


@dataclass(slots=True)
class MovingExperiment:
    """A rig with a moving camera, played without and with it in one quality. camera: the virtual camera of the
    pictures; moments: all frames, with pictures of the first sampled frame and of the last; truths: of these frames;
    picture_ms: milliseconds of the pictures of sampled frames, without the moving camera and with it."""

    recording: str
    quality: str
    camera: str
    moments: list[Moment] = field(default_factory=list)
    truths: dict[int, Texture] = field(default_factory=dict)
    picture_ms: list[tuple[float, float]] = field(default_factory=list)

    def note(self, moment: Moment, truth: Texture | None) -> None:
        """Adds the next frame. truth: that of its pictures; None: its pictures are not kept."""
        for one, other in moment.pictures.values():
            self.picture_ms.append((_milliseconds(one), _milliseconds(other)))
        if truth is None:
            moment = replace(moment, pictures={}, plain={})
        else:
            self.truths[moment.frame] = truth
        self.moments.append(moment)

    def row(self) -> dict[str, float | int | str]:
        """The figures of the run: holes are fractions of the pixels of the last frame's picture, without the model,
        without the moving camera and with it; times are medians, update times without the first frame; triangles are
        those of the last frame (`Moment`)."""
        last = self.moments[-1]
        updates = [moment.update_ms for moment in self.moments[1:] or self.moments]
        without, with_it = np.median(updates, axis=0).tolist()
        shown_without, shown_with_it = np.median(self.picture_ms, axis=0).tolist()
        return {
            "recording": self.recording, "quality": self.quality, "camera": self.camera, "frames": len(self.moments),
            "holes_plain": float(last.plain[self.camera].holes().mean()),
            "holes_fixed": last.holes[self.camera][0], "holes_moving": last.holes[self.camera][1],
            "picture_fixed_ms": shown_without, "picture_moving_ms": shown_with_it,
            "update_fixed_ms": without, "update_moving_ms": with_it,
            "exposed": last.exposed, "p_pbs": last.p_pbs[1],
        }  # fmt: skip


def play_moving(
    recording: Recording, cameras: Sequence[str], frames: int, qualities: Sequence[str] = QUALITIES,
    progress: Callable[[], None] = lambda: None,
) -> list[MovingExperiment]:  # fmt: skip
    """Play `frames` frames of a rig with a moving camera in all qualities side by side, with the paper's numbers of
    views.

    Of the `cameras`, virtual ones with ground truth, the one farthest from the rig is rendered. `progress` is called
    after each frame. Raises ValueError as `play_rig` does, and for no cameras.
    """
    shown, count = farthest_camera(recording, cameras), min(frames, recording.frame_count)
    camera, played, runs = recording.camera(shown), list[MovingExperiment](), list[Iterator[Moment]]()
    copies = itertools.tee(recording.frames(0, count), len(qualities))
    for quality, read in zip(qualities, copies, strict=True):
        # "two views were selected for rendering", "four fixed cameras for initially building the S-PBS", "one reference
        # view was selected ... for the P-PBS update" (section 4.2)
        settings = Settings.preset(quality, n_render=2, n_init=4, n_update=1)
        warm_up(recording, shown, settings)
        played.append(MovingExperiment(recording.name, quality, shown))
        runs.append(play_rig(recording, [camera], count, _FIRST, settings, read))
    for moments in zip(*runs, strict=True):
        pictured = bool(moments[0].pictures) and (not played[0].truths or moments[0].frame == count - 1)
        truth = recording.texture(shown, moments[0].frame) if pictured else None
        for experiment, moment in zip(played, moments, strict=True):
            experiment.note(moment, truth)
        progress()
    return played


def _milliseconds(picture: RenderedPicture) -> float:
    return sum(picture.report.stages.values())
