"""The renderer (paper section 3.4), as the pipeline knows it: two protocols that a backend implements.

The back end passes a frame to `Renderer.prepare`, and the front end asks the prepared frame for pictures. Threads,
canvases and all data in a device's memory belong to the renderer.
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
from .effects import Effects

__all__ = ["FrameContent", "PictureTask", "PreparedFrame", "Renderer"]

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class FrameContent:
    """All that pictures of one video frame are drawn from.

    views: the reference views, in the order of the rig's cameras; present: the same, as kernels read them. pbis: the
    probable background image of each viewer (section 3.4.1), by the viewer's name. delta: the culling tolerance
    (section 3.3.2), metres and 1/m, by which the backdrop is moved backwards; None if there is no background model.
    drawn: indices of the views that may be drawn.
    """

    scene: Scene
    views: tuple[PreparedView, ...]
    present: ViewTable
    pbis: Mapping[str, PreparedView]
    delta: Delta | None
    drawn: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class PictureTask:
    """Pictures of one viewer that are drawn from the same reference views.

    targets: the virtual cameras, one or both eyes. viewer: the name of the viewer whose PBI becomes the backdrop and
    whose filled holes are kept steady; None: neither is done. chosen: indices of the reference views that are warped,
    the most useful first. tones float64 [n + 1, TONE_SIZE]: the packed tones that convert the colours of each reference
    view, and last of the model, to the pictures' tone; None: no conversion. effects: what the pictures show besides
    the scene.
    """

    targets: tuple[Camera, ...]
    viewer: str | None
    chosen: tuple[int, ...]
    tones: F64 | None
    settings: Settings
    effects: Effects | None = None


class PreparedFrame(Protocol):
    """A frame that a renderer can draw; its memory is freed when the last reference to it is gone."""

    def warm(self, target: Camera, chosen: Sequence[int], settings: Settings) -> None:
        """Make now all data for pictures like `target` from the `chosen` views; otherwise the first one has to."""

    def render(self, task: PictureTask, finish: Callable[[RenderedPicture], T]) -> list[T]:
        """The result of `finish` for each target's picture, in the order of the targets; called by any thread.

        `finish` (for instance encoding) is called once for each picture, in threads of the renderer's choice, for
        several pictures at the same time. An exception that it raises is raised here.
        """


class Renderer(Protocol):
    """A backend that draws frames."""

    def prepare(self, content: FrameContent) -> PreparedFrame:
        """Prepare a frame with its PBIs; called by the back-end thread, while older frames are still drawn."""

    @property
    def idle_bytes(self) -> int:
        """Bytes that are kept for later pictures, while nothing is drawn with them."""

    def close(self) -> None:
        """End the threads; nothing can be drawn after this."""
