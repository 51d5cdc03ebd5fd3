"""What is rendered and judged: sequences on disk that have ground truth, and twins made in memory."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

import numpy as np

from ..background.model import BackgroundModel
from ..io.tmiv import Sequence as TmivSequence
from ..io.tmiv import open_sequence
from ..io.tmiv_json import TmivError, find_json
from ..rig.camera import Camera
from ..rig.frame import Frame, Texture, View
from ..synth import FPS, TWINS, Twin, make_twin, render_view, twin_frame
from .background import inside_rig
from .ghosts import ghost_pixels, inside_cameras
from .silhouettes import fine_camera, judge_silhouettes

__all__ = ["Material", "TwinMaterial", "default_targets", "find_sequences", "open_material"]


class Material(Protocol):
    """What can be rendered and judged: an opened sequence with ground truth, or a twin."""

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def fps(self) -> float: ...  # noqa: D102
    @property
    def frame_count(self) -> int: ...  # noqa: D102
    @property
    def source_names(self) -> tuple[str, ...]: ...  # noqa: D102
    def camera(self, name: str, frame: int = 0) -> Camera: ...  # noqa: D102
    def frame(self, index: int, names: Iterable[str] | None = None) -> Frame: ...  # noqa: D102
    def texture(self, name: str, frame: int) -> Texture: ...  # noqa: D102


@dataclass
class TwinMaterial:
    """A twin, made frame by frame in memory."""

    twin: Twin
    fps: float = FPS
    _fine: dict[tuple[str, int], View] = field(default_factory=dict)  # of the latest frame
    _still: dict[str, View] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The twin's name."""
        return self.twin.name

    @property
    def frame_count(self) -> int:
        """As many as the real sequence has."""
        return self.twin.rig.frame_count

    @property
    def source_names(self) -> tuple[str, ...]:
        """The reference cameras."""
        return self.twin.source_names

    def camera(self, name: str, frame: int = 0) -> Camera:
        """A camera with its pose in a frame."""
        return self.twin.camera(name, frame)

    def frame(self, index: int, names: Iterable[str] | None = None) -> Frame:
        """All source views, or those named."""
        return twin_frame(self.twin, index, None if names is None else tuple(names))

    def texture(self, name: str, frame: int) -> Texture:
        """A camera's ground truth."""
        return self.twin.truth(self.camera(name), frame).texture

    def fine(self, name: str, frame: int) -> View:
        """Ground truth with 4x4 pixels for one, a sample each."""
        if (name, frame) not in self._fine:
            self._fine = {key: view for key, view in self._fine.items() if key[1] == frame}
            single = dataclasses.replace(self.twin, samples=1)
            self._fine[name, frame] = single.truth(fine_camera(self.camera(name)), frame)
        return self._fine[name, frame]

    def roughness(self, name: str, frame: int) -> float:
        """Roughness of the ground truth's own silhouettes, pixels: a twin's pictures have four samples a pixel."""
        truth = self.twin.truth(self.camera(name), frame)
        disparity = truth.camera.depth.disparity(truth.codes)
        return judge_silhouettes(self.fine(name, frame), truth.texture, disparity).roughness_px

    def ghosts(self, name: str, frame: int, model: BackgroundModel) -> float:
        """Fraction of pixels where the model shows what is neither there nor background."""
        camera = self.camera(name)
        if name not in self._still:
            self._still[name] = render_view(self.twin.scene, camera, 0.0, samples=1, background_only=True)
        _holes, nearer, nearer_than_now = ghost_pixels(model, self._still[name], self.twin.truth(camera, frame))
        return float(np.mean(nearer & nearer_than_now))


def find_sequences(paths: Sequence[Path]) -> list[TmivSequence]:
    """The sequences in the given folders: each is one, or holds some. ValueError where there is none."""
    found = []
    for path in paths:
        folders = [path] if _is_sequence(path) else sorted(p for p in path.glob("*/") if _is_sequence(p))
        if not folders:
            raise ValueError(f"{path}: expected a TMIV sequence, or a folder of sequences")
        found += [open_sequence(folder) for folder in folders]
    return found


def open_material(name: str, scale: float) -> Material:
    """A sequence by its folder, or a twin by its name; ValueError for neither."""
    if name in TWINS:
        return TwinMaterial(make_twin(name, scale))
    if not Path(name).is_dir():
        raise ValueError(f"sequence: {name!r}: expected a folder, or a twin: {', '.join(TWINS)}")
    return open_sequence(Path(name))


def _is_sequence(path: Path) -> bool:
    try:
        find_json(path)
    except TmivError:
        return False
    return True


def default_targets(material: Material) -> list[str]:
    """The virtual cameras inside the rig that have ground truth; ValueError where there is none."""
    if isinstance(material, TwinMaterial):
        names = [camera.name for camera in inside_cameras(material.twin)]
    else:
        assert isinstance(material, TmivSequence)
        names = inside_rig(material)
    if not names:
        raise ValueError(f"{material.name}: no virtual camera with ground truth stands inside the rig")
    return names
