"""The renderer on this machine's CPU: kernels on all cores, one thread per eye."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TypeVar

from ..geometry.prepared_view import ViewTable, pixels_per_radian
from ..rig.camera import Camera
from ..rig.viewer import RenderedPicture
from ..settings import Settings
from ..support.runtime import set_thread_count, thread_count
from .canvas_pool import CanvasPool
from .hole_settling import Settler
from .picture import render_picture
from .renderer import FrameContent, PictureTask

__all__ = ["CpuFrame", "CpuRenderer"]

T = TypeVar("T")
_STEREO_VIEWERS = 4  # stereo pairs that are rendered at the same time


class CpuRenderer:
    """Draws with the kernels (`rendering.renderer.Renderer`); any number of threads may ask for pictures.

    canvas_bytes: limit of the memory for canvases that are not in use (`canvas_pool`).
    """

    def __init__(self, canvas_bytes: int = 1 << 30) -> None:
        self.canvases = CanvasPool(canvas_bytes)
        self.settler = Settler()
        self.other_eyes = ThreadPoolExecutor(_STEREO_VIEWERS, "farside-second-eye")

    def prepare(self, content: FrameContent) -> CpuFrame:
        """The prepared frame. The meshes of PBIs are made now, those of the views when they are first used."""
        for pbi in content.pbis.values():
            pbi.warm(("surface",))
        return CpuFrame(self, content)

    @property
    def idle_bytes(self) -> int:
        """Bytes of the canvases that nobody draws on."""
        return self.canvases.idle_bytes

    def close(self) -> None:
        """End the threads."""
        self.other_eyes.shutdown()


class CpuFrame:
    """A frame for drawing on the CPU (`rendering.renderer.PreparedFrame`)."""

    def __init__(self, renderer: CpuRenderer, content: FrameContent) -> None:
        self._renderer, self._content = renderer, content

    def warm(self, target: Camera, chosen: Sequence[int], settings: Settings) -> None:
        """Make the meshes of the chosen views and, with the setting `prefilter`, their reduced sizes for `target`."""
        views = [self._content.views[k] for k in chosen]
        for view in views:
            view.warm((*view.parts, "rims") if settings.rims else view.parts)
        table = ViewTable(views, drawn=len(views))  # makes the cuts of their surfaces
        table.warm(pixels_per_radian(target) if settings.prefilter else None)

    def render(self, task: PictureTask, finish: Callable[[RenderedPicture], T]) -> list[T]:
        """The finished pictures, each drawn in a thread of its own.

        Two pictures at the same time, each on half of the cores, take less time than one after the other on all cores.
        """
        threads, (first, *rest) = thread_count(), task.targets
        share = max(1, threads // len(task.targets))
        if not rest or threads == 1:
            return [self._picture(camera, task, finish) for camera in task.targets]
        others = [self._renderer.other_eyes.submit(self._picture_on, share, eye, task, finish) for eye in rest]
        try:
            done = self._picture_on(share, first, task, finish)
        finally:
            set_thread_count(threads)
            wait(others)
        return [done, *(other.result() for other in others)]

    def _picture_on(
        self, threads: int, camera: Camera, task: PictureTask, finish: Callable[[RenderedPicture], T]
    ) -> T:
        set_thread_count(threads)
        return self._picture(camera, task, finish)

    def _picture(self, camera: Camera, task: PictureTask, finish: Callable[[RenderedPicture], T]) -> T:
        renderer = self._renderer
        return finish(render_picture(self._content, task, camera, renderer.canvases, renderer.settler))
