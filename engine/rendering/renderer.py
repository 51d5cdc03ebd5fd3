"""What draws pictures (paper section 3.4), as the pipeline knows it: a backend stands behind two protocols.

The back end hands a frame to `Renderer.prepare`, and the front end asks the prepared frame for pictures. Threads,
canvases and whatever lies in a device's memory belong to the renderer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

from ..geometry.prepared_view import PreparedView, ViewTable
from ..geometry.scene_scale import Scene
from ..kernels.base.tolerance import Delta
from ..rig.camera import Camera
from ..rig.viewer import RenderedPicture
from ..settings import Settings
from ..support.array_types import F64

__all__ = ["FrameContent", "PictureTask", "PreparedFrame", "Renderer"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class FrameContent:
    """All that pictures of one video frame are drawn from.

    views: the reference views, in the order of the rig's cameras; present: the same, as kernels read them. pbis: the
    probable background image of each viewer (section 3.4.1), by the viewer's name. delta: the culling tolerance
    (section 3.3.2), metres and 1/m, by which the backdrop is moved backwards; None without a background model.
    """

    scene: Scene
    views: tuple[PreparedView, ...]
    present: ViewTable
    pbis: Mapping[str, PreparedView]
    delta: Delta | None


@dataclass(frozen=True, slots=True)
class PictureTask:
    """Pictures of one viewer that are drawn from the same reference views.

    targets: the virtual cameras, one or both eyes. viewer: whose PBI becomes the backdrop and whose filled holes
    settle; None: neither. chosen: indices of the reference views that are warped, the most useful first. tones float64
    [n + 1, TONE_SIZE]: what brings the colours of each reference view, and last of the model, to the pictures' tone;
    None: nothing does.
    """

    targets: tuple[Camera, ...]
    viewer: str | None
    chosen: tuple[int, ...]
    tones: F64 | None
    settings: Settings


class PreparedFrame(Protocol):
    """A frame that a renderer can draw; what it holds is freed when nobody has it any more."""

    def warm(self, target: Camera, chosen: Sequence[int], settings: Settings) -> None:
        """Make what pictures like `target` from the `chosen` views will draw; otherwise the first of them would."""

    def render(self, task: PictureTask, finish: Callable[[RenderedPicture], T]) -> list[T]:
        """What `finish` makes of each target's picture, in the order of the targets; called by any thread.

        `finish` (encoding, for instance) is called once for each picture, for several at the same time, in threads of
        the renderer's choice. What it raises is raised here.
        """


class Renderer(Protocol):
    """A backend that draws frames."""

    def prepare(self, content: FrameContent) -> PreparedFrame:
        """Take a frame, its PBIs included; called by the back-end thread, while older frames are still drawn."""

    def close(self) -> None:
        """End the threads; nothing is drawn any more."""
