"""A background model in a file: written as a whole, read with every field checked, continued bit for bit."""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..io.records import from_plain
from ..io.saved_file import About, check_settings, read_saved, write_saved
from ..rig.camera import Camera
from ..settings import Settings
from .exposure import Exposure
from .model import BackgroundModel
from .state import CameraState, ExposureState, ModelState
from .state_check import check_exposure, check_model, check_placed

__all__ = ["SavedModel", "check_rig"]


@dataclass(frozen=True, slots=True)
class SavedModel:
    """A model, and what it needs to be continued.

    rig: the reference cameras as their source announced them; placed: each where it was seen last; moving: those that
    have moved in any frame; frame: index of the newest frame; exposure: of `exposure.Exposure`, None if the views'
    tones were not followed.
    """

    rig: tuple[CameraState, ...]
    placed: tuple[CameraState, ...]
    moving: tuple[int, ...]
    frame: int
    model: ModelState
    exposure: ExposureState | None

    @classmethod
    def of(
        cls, rig: Sequence[Camera], frame: int, model: BackgroundModel, exposure: Exposure | None,
        placed: Sequence[Camera] | None = None, moving: Sequence[int] = (),
    ) -> SavedModel:  # fmt: skip
        """The state of a model, as copies; called between two updates by the thread that updates. placed: None: where
        they were announced."""
        cameras, now = (tuple(map(CameraState.of, where)) for where in (rig, rig if placed is None else placed))
        exposed = None if exposure is None else exposure.state()
        return cls(cameras, now, tuple(moving), frame, model.state(), exposed)

    def write(self, path: Path) -> int:
        """Writes the file; returns the number of bytes. Raises OSError: then a file of that name stays as it was."""
        return write_saved(path, self.about(), self)

    @classmethod
    def read(cls, path: Path) -> SavedModel:
        """Reads a file. Raises OSError, and ValueError, which names the file, the field, its value and what was
        expected, for a file that is damaged or not a saved model of this version."""
        _, plain, arrays = read_saved(path)
        try:
            saved = from_plain(cls, plain, arrays, "state")
            check_model(saved.model, saved.rig)
            check_placed(saved.placed, saved.moving, saved.rig)
            if saved.exposure is not None:
                check_exposure(saved.exposure, len(saved.rig))
        except (ValueError, TypeError, OverflowError) as error:
            raise ValueError(f"{path}: {error}") from error
        return saved

    def about(self) -> About:
        """What it is of."""
        parts = self.model.surfaces
        valid = [len(part.invalid) - int(np.count_nonzero(part.invalid)) for part in parts]
        seeds = {item.number for item in self.model.atlases}
        pairs = list(zip(parts, valid, strict=True))
        return About(
            saved=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"), frame=self.frame,
            cameras=tuple((c.name, int(c.lens[0]), int(c.lens[1])) for c in self.rig),  # type: ignore[arg-type]
            s_pbs=sum(len(part.invalid) for part in parts if part.static),
            s_pbs_valid=sum(count for part, count in pairs if part.static),
            p_pbs=sum(count for part, count in pairs if not part.static),
            seeded=sum(count for part, count in pairs if part.capture in seeds),
            pictures=len(self.model.captures) + len(self.model.remains) + len(seeds), settings=self.model.settings,
        )  # fmt: skip

    def adapted(self, cameras: Sequence[Camera], settings: Settings) -> SavedModel:
        """It, to be continued with these cameras and settings; raises ValueError if its own are others, as far as they
        matter (`settings.MODELLING`)."""
        check_rig(self.rig, self.moving, cameras)
        check_settings(self.about(), settings)
        return dataclasses.replace(self, model=self.model.with_settings(settings))


def check_rig(rig: Sequence[CameraState], moving: Collection[int], cameras: Sequence[Camera]) -> None:
    """Raises ValueError, which names the camera and the field, if a source's cameras are not those of a rig; those that
    move (their numbers) may be anywhere."""
    names, expected = [camera.name for camera in cameras], [camera.name for camera in rig]
    if names != expected:
        raise ValueError(f"cameras: {_few(expected)}: expected those of the source, {_few(names)}")
    for c, (camera, built_with) in enumerate(zip(cameras, rig, strict=True)):
        now = CameraState.of(camera)
        for field in dataclasses.fields(CameraState):
            was, wanted = getattr(built_with, field.name), getattr(now, field.name)
            free = c in moving and field.name in ("position", "orientation")
            if was != wanted and not free:
                raise ValueError(f"camera {camera.name}: {field.name}: {was}: expected {wanted}, as the source has it")


def _few(names: Sequence[str]) -> str:
    """Names, not more than a line of them."""
    shown = ", ".join(names[:8])
    return f"{shown} and {len(names) - 8} more" if len(names) > 8 else shown
