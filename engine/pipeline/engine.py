"""The synchronous core: video frames in at the back end, pictures out at the front end (paper Fig. 3)."""

from __future__ import annotations

import dataclasses
import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from ..background.exposure import Exposure, to_common, to_picture
from ..background.model import BackgroundModel, UpdateReport
from ..background.pbi import enlarged, imaginary_camera, uncovered_cells
from ..geometry.prepared_view import PreparedView, ViewTable, pixels_per_radian
from ..geometry.scene_scale import Scene
from ..geometry.triangulation import Triangulator
from ..io.mesh_files import ColouredMesh
from ..rendering.antialiasing import smooth_outlines
from ..rendering.canvas import Canvas
from ..rendering.filling import fill, rise_per_pixel
from ..rendering.hole_settling import Settler
from ..rendering.target import Target
from ..rig.camera import Camera
from ..rig.frame import Frame
from ..rig.selection import select_views, view_shares
from ..rig.viewer import PictureReport, RenderedPicture, StereoPicture, StereoView
from ..settings import Settings
from ..support.runtime import set_thread_count, thread_count
from ..support.stages import Stages, timed

__all__ = ["BackEndReport", "Engine", "Viewer"]

Viewer = StereoView | Camera
V = TypeVar("V", StereoView, Camera, StereoView | Camera)

_STEREO_VIEWERS = 4  # stereo pairs that are rendered at the same time
_NEAR = 0.02  # of the depth range's near end: nearer to the eye nothing is drawn
# What so many of the drawn views cover, also from eyes that move by so much, metres, besides their own speed, needs no
# background. The first ones: they are still drawn when the head has moved on a little.
_STEADY_VIEWS, _SWAY = 3, 0.02


@dataclass(slots=True)
class BackEndReport:
    """What one video frame cost: milliseconds by stage, rays and triangles, and the background model's own report."""

    frame_index: int
    stages: Stages
    background: UpdateReport | None
    pbi_rays: int = 0
    triangles: int = 0  # of the views that are drawn


@dataclass(frozen=True, slots=True)
class _FrontBuffer:
    """All that rendering reads; replaced as a whole when the next frame is ready."""

    frame: Frame
    scene: Scene
    views: tuple[PreparedView, ...]
    present: ViewTable
    tones: npt.NDArray[np.float64] | None  # of the views (`Exposure.tones`)
    settings: Settings  # of the picture that is rendered from it
    backdrops: Mapping[str, PreparedView] = field(default_factory=dict)  # by viewer


class Engine:
    """Renders a rig's video for moving viewers and models the scene's background meanwhile.

    `update` is called by one back-end thread; `render` and `render_camera` may run in other threads at the same
    time and always see the newest finished frame. Raises ValueError for frames that do not fit the rig.
    """

    def __init__(
        self, cameras: Sequence[Camera], settings: Settings | None = None, *, f_vin: float = 30.0
    ) -> None:
        self.cameras = tuple(cameras)
        if not self.cameras:
            raise ValueError("cameras: none: expected at least one source camera")
        for camera in self.cameras:
            if min(camera.width, camera.height) < 4:
                size = f"{camera.width} x {camera.height}"
                raise ValueError(f"camera {camera.name}: {size} pixels: expected at least 4 x 4")
        self.settings = settings or Settings()
        self.f_vin = f_vin
        self._scene: Scene | None = None
        self._model: BackgroundModel | None = None
        self._exposure: Exposure | None = None
        self._triangulators = [Triangulator() for _ in self.cameras]
        self._front: _FrontBuffer | None = None
        self._canvases: dict[tuple[int, int], list[Canvas]] = {}
        self._canvas_lock = threading.Lock()
        self._settler = Settler()
        self._second_eye = ThreadPoolExecutor(_STEREO_VIEWERS, "farside-second-eye")

    def retune(self, settings: Settings) -> None:
        """Render from the next picture on with other settings, from any thread; nothing is built anew.

        Raises ValueError where one differs that is not among `settings.PER_PICTURE`. Views that are drawn only now are
        triangulated with the next picture, and from the next frame on in the back end.
        """
        settings.fixed_as_in(self.settings)
        self.settings = settings

    @property
    def frame_index(self) -> int | None:
        """Index of the frame that is rendered now; None before the first."""
        front = self._front
        return front.frame.index if front else None

    @property
    def tones(self) -> npt.NDArray[np.float64] | None:
        """The tones [n, 4, 4] of the present views (`Exposure.tones`); None where they are not followed."""
        front = self._front
        return front.tones if front else None

    @property
    def model(self) -> BackgroundModel | None:
        """The background model, for the thread that updates; None before the first frame, or if there is none."""
        return self._model

    def update(
        self,
        frame: Frame,
        viewers: Mapping[str, Viewer] | None = None,
        speeds: Mapping[str, float] | None = None,
    ) -> BackEndReport:
        """Take a frame: update the background model, render each viewer's PBI, then swap the buffers.

        `viewers` may change meanwhile: what the next pictures draw is made for where the heads are by then. `speeds`
        are the viewers' head speeds in m/s, for the PBI's margin.
        """
        self._check(frame)
        settings, stages, viewers = self.settings, Stages(), viewers or {}
        if self._scene is None:
            self._scene = Scene.of([view.camera for view in frame.views], settings, frame)
        scene = self._scene
        views = tuple(
            PreparedView(
                view, scene.triangulation(view.camera, settings), scene.origin, settings.completion, triangulator
            )
            for view, triangulator in zip(frame.views, self._triangulators, strict=True)
        )
        present = ViewTable(views)
        report = None
        with timed(stages, "exposure"):
            tones = self._follow_exposure(frame, present, scene)
        with timed(stages, "background"):
            if settings.background:
                if self._model is None:
                    self._model = BackgroundModel(self.cameras, settings, scene)
                report = self._model.update(frame, None if tones is None else to_common(tones))
        with timed(stages, "pbi"):
            backdrops, pbi_rays = {}, 0
            for name, viewer in viewers.items():
                if self._model is not None:
                    speed, scaled = (speeds or {}).get(name, 0.0), _scaled(viewer, settings)
                    backdrops[name], rays = self._backdrop(scaled, speed, scene, views, present)
                    _ = backdrops[name].mesh().spheres
                    pbi_rays += rays
        with timed(stages, "triangulate"):
            for viewer in viewers.values():
                self._make_ready(_scaled(viewer, settings), views, scene, settings)
        self._front = _FrontBuffer(frame, scene, views, present, tones, settings, backdrops)
        return BackEndReport(frame.index, stages, report, pbi_rays, sum(view.triangle_count for view in views))

    def _make_ready(
        self, viewer: Viewer, views: Sequence[PreparedView], scene: Scene, settings: Settings
    ) -> None:
        """Make all that a viewer's pictures draw: otherwise the first one would, and come late."""
        chosen = [views[k] for k in self._select(viewer, views, scene, settings)]
        for view in chosen:
            for part in (*view.parts, "rims") if settings.rims else view.parts:
                _ = view.mesh(part).spheres
        table = ViewTable(chosen, drawn=len(chosen))
        if settings.prefilter:
            table.at(pixels_per_radian(self._target(viewer, scene)))

    def render(self, view: StereoView, viewer: str | None = None) -> StereoPicture:
        """Render both eyes from the newest frame; `viewer` names whose PBI is the backdrop."""
        front = self._newest()
        view = _scaled(view, front.settings)
        left, right = view.eyes(front.scene.coding)
        stages = Stages()
        with timed(stages, "select"):
            chosen, tones = self._select(view, front.views, front.scene, front.settings), self._tones(view, front)
        # An eye a thread: two pictures side by side cost less than one after the other on all threads.
        threads = thread_count()
        jobs = [(max(1, threads // 2), eye, front, chosen, tones, viewer) for eye in (left, right)]
        other = self._second_eye.submit(self._render_with, *jobs[1]) if threads > 1 else None
        try:
            first = self._render_with(*jobs[0])
        finally:
            set_thread_count(threads)
            wait([other] if other else [])
        second = other.result() if other else self._render_with(*jobs[1])
        first.report.stages.add("select", stages["select"], stages.cpu["select"])
        return StereoPicture(first, second, front.frame.index)

    def _render_with(
        self, threads: int, camera: Camera, front: _FrontBuffer, chosen: Sequence[int],
        tones: npt.NDArray[np.float64] | None, viewer: str | None,
    ) -> RenderedPicture:  # fmt: skip
        set_thread_count(threads)
        return self._render_eye(camera, front, chosen, tones, viewer)

    def render_camera(self, camera: Camera, viewer: str | None = None) -> RenderedPicture:
        """Render one virtual camera of any projection from the newest frame."""
        front = self._newest()
        camera = _scaled(camera, front.settings)
        chosen = self._select(camera, front.views, front.scene, front.settings)
        tones = self._tones(camera, front)
        return self._render_eye(camera, front, chosen, tones, viewer)

    def mesh(self) -> ColouredMesh:
        """The background model as it is now; may be called from any thread."""
        if self._model is None:
            raise ValueError("mesh: there is no background model yet: no frame was received")
        return self._model.mesh()

    def status(self) -> dict[str, Any]:
        """Figures for people and monitors: the frame shown and the model's size."""
        counts = self._model.counts() if self._model is not None else {}
        return {"frame_index": self.frame_index, "cameras": len(self.cameras), "background": counts}

    def close(self) -> None:
        """End the threads."""
        self._second_eye.shutdown()

    def _newest(self) -> _FrontBuffer:
        """What the next picture is rendered from, and how."""
        if self._front is None:
            raise ValueError("frame: none was received yet")
        return dataclasses.replace(self._front, settings=self.settings)

    def _check(self, frame: Frame) -> None:
        names = tuple(view.camera.name for view in frame.views)
        expected = tuple(camera.name for camera in self.cameras)
        if names != expected:
            raise ValueError(f"frame {frame.index}: views {names}: expected {expected}")
        for view, camera in zip(frame.views, self.cameras, strict=True):
            if (view.camera.projection, view.camera.depth) != (camera.projection, camera.depth):
                raise ValueError(
                    f"frame {frame.index}: view {camera.name}: projection or depth coding "
                    f"{view.camera.projection}: expected the announced {camera.projection}"
                )

    def _follow_exposure(self, frame: Frame, present: ViewTable, scene: Scene) -> npt.NDArray[np.float64] | None:
        """The views' tones [n, 4, 4]; None where they are not followed."""
        if self.settings.exposure_s == 0.0 or len(self.cameras) == 1:
            return None
        if self._exposure is None:
            self._exposure = Exposure(len(self.cameras), self.settings.exposure_s, scene.depths[:2])
        model = self._model.images(frame) if self._model is not None else ()
        self._exposure.update(present, 1.0 / self.f_vin, *model)
        return self._exposure.tones

    def _tones(self, viewer: Viewer, front: _FrontBuffer) -> npt.NDArray[np.float64] | None:
        """What brings the colours of each view, and of the model, to a picture's tone [n + 1, TONE_SIZE]."""
        if front.tones is None:
            return None
        target = self._target(viewer, front.scene)
        cameras = [prepared.view.camera for prepared in front.views]
        return to_picture(front.tones, view_shares(target, cameras, front.scene.depths_for(target)))

    def _backdrop(
        self, viewer: Viewer, speed: float, scene: Scene, views: Sequence[PreparedView], present: ViewTable
    ) -> tuple[PreparedView, int]:
        """A viewer's PBI, and the rays that it took."""
        assert self._model is not None
        settings, moves = self.settings, speed / self.f_vin + _SWAY
        scale, margin = settings.pbi_scale, settings.pbi_margin_rad
        if isinstance(viewer, Camera):
            camera = enlarged(viewer, scene.coding, scale, margin)
        else:
            camera = imaginary_camera(viewer, speed, self.f_vin, scene.coding, scale, margin)
            moves += 0.5 * viewer.ipd
        camera = dataclasses.replace(camera, depth=scene.coding_at(camera.pose.position))
        behind = math.dist(camera.pose.position, viewer.pose.position)
        chosen = [views[k] for k in self._select(viewer, views, scene, settings)[:_STEADY_VIEWS]]
        wanted = uncovered_cells(camera, chosen, behind + moves, scene.origin)
        standing = settings.backdrop == "standing"
        # What lies between the imaginary camera and the head is not seen.
        near = behind + _NEAR * scene.coding.near
        image = self._model.render_pbi(camera, present if standing else None, near=near, wanted=wanted)
        return PreparedView(image.view, scene.triangulation(camera, settings), scene.origin), image.rays

    def _select(self, viewer: Viewer, views: Sequence[PreparedView], scene: Scene, settings: Settings) -> list[int]:
        cameras = [prepared.view.camera for prepared in views]
        target = self._target(viewer, scene)
        return select_views(target, cameras, settings.n_render, scene.depths_for(target))

    @staticmethod
    def _target(viewer: Viewer, scene: Scene) -> Camera:
        """One camera for all of a viewer's pictures."""
        return viewer if isinstance(viewer, Camera) else Camera("head", viewer.left, viewer.pose, scene.coding)

    def _render_eye(
        self, camera: Camera, front: _FrontBuffer, chosen: Sequence[int],
        tones: npt.NDArray[np.float64] | None, viewer: str | None,
    ) -> RenderedPicture:  # fmt: skip
        views = [front.views[k] for k in chosen]
        backdrop = front.backdrops.get(viewer) if viewer is not None else None
        report = PictureReport(tuple(prepared.view.camera.name for prepared in views))
        target = Target(camera, front.scene.origin)
        near = _NEAR * front.scene.coding.near
        with self._canvas(camera) as canvas:
            with timed(report.stages, "warp"):
                canvas.clear()
                shrink = front.scene.disparity_shrink(camera)
                report.warped = self._draw_views(canvas, views, target, near, front.settings, shrink)
                holes = canvas.holes()
                report.holes_warped = report.holes_backdrop = holes.fraction
            with timed(report.stages, "backdrop"):
                if backdrop is not None:
                    report.warped += self._draw_backdrop(canvas, backdrop, front, chosen, target)
                    holes = canvas.holes()
                    report.holes_backdrop = holes.fraction
                    views += [backdrop, *front.views]
            with timed(report.stages, "shade"):
                fills = front.settings.fill != "none" and report.holes_backdrop < 1
                if not fills:
                    canvas.grey()
                if views:
                    every = [*chosen, -1, *range(len(front.views))][: len(views)]
                    table = ViewTable(views, None if tones is None else tones[every], drawn=len(chosen))
                    self._shade(canvas, target, table, len(chosen), front.settings)
            with timed(report.stages, "antialias"):
                if front.settings.antialias == "samples" and views:
                    self._smooth_silhouettes(canvas, camera, front, chosen, backdrop, table)
            with timed(report.stages, "fill"):
                report.holes_filled = report.holes_backdrop
                if fills and report.holes_backdrop > 0:
                    rise = self._rise(camera, [front.views[k] for k in chosen], report.holes_backdrop)
                    structured = front.settings.fill == "structure"
                    places = fill(canvas.disparity, canvas.planes, rise, holes, structured=structured)
                    if viewer is not None and front.settings.settles:
                        # Both eyes of a viewer have their own picture.
                        of = f"{viewer} {camera.name}"
                        self._settler.settle(of, camera, front.scene.depths[0], places, canvas.planes)
                    report.holes_filled = 0.0
                texture = canvas.texture()
            with timed(report.stages, "antialias"):
                if front.settings.antialias == "morphological":
                    edge = front.scene.triangulation(camera, self.settings).edge
                    texture = smooth_outlines(texture, canvas.disparity, edge)
            return RenderedPicture(camera, texture, canvas.disparity, canvas.winner, report)

    @staticmethod
    def _draw_views(
        canvas: Canvas, views: Sequence[PreparedView], target: Target, near: float, settings: Settings, shrink: float
    ) -> int:
        """Draw views in order of worth; returns the number of triangles. `shrink`: see `Scene.disparity_shrink`."""
        warped = 0
        for number, prepared in enumerate(views):
            margin = (2 * prepared.options.tolerance + prepared.view.camera.depth.step) * shrink
            warped += canvas.draw(prepared.mesh(), target, number, near, margin)
        # Depth that was not measured may be anywhere: it goes only where no view has measured a surface. So does the
        # half pixel round everything that is known less well.
        warped += canvas.draw_holes("doubtful", views, target, near)
        if settings.rims:
            warped += canvas.draw_holes("rims", views, target, near)
        return warped

    def _draw_backdrop(
        self, canvas: Canvas, backdrop: PreparedView, front: _FrontBuffer, chosen: Sequence[int], target: Target
    ) -> int:
        """Lay a viewer's backdrop behind the chosen views; returns the number of triangles."""
        assert self._model is not None
        near, delta = _NEAR * front.scene.coding.near, self._model.tolerances.delta
        # Section 3.4.2: moved backwards by delta.
        push = delta if front.settings.backdrop_m is None else (front.settings.backdrop_m, 0.0)
        holes_only = not front.settings.overdraw
        return canvas.draw_backdrop(backdrop, front.present, chosen, target, near, push, delta, holes_only=holes_only)

    def _smooth_silhouettes(
        self, canvas: Canvas, camera: Camera, front: _FrontBuffer, chosen: Sequence[int],
        backdrop: PreparedView | None, table: ViewTable,
    ) -> None:  # fmt: skip
        """Draw pixels at silhouettes again, at twice the size, and average."""
        step = front.scene.triangulation(camera, self.settings).edge
        double = dataclasses.replace(camera, projection=camera.projection.scaled(2.0))
        target, near = Target(double, front.scene.origin), _NEAR * front.scene.coding.near
        with self._canvas(double) as fine:
            fine.clear(canvas.silhouettes(step))
            shrink = front.scene.disparity_shrink(camera)
            self._draw_views(fine, [front.views[k] for k in chosen], target, near, front.settings, shrink)
            if backdrop is not None:
                self._draw_backdrop(fine, backdrop, front, chosen, target)
            self._shade(fine, target, table, len(chosen), front.settings)
            canvas.average(fine)

    @staticmethod
    def _shade(canvas: Canvas, target: Target, table: ViewTable, n_views: int, s: Settings) -> None:
        canvas.shade(target, table, n_views, s.blend, cubic=s.cubic, prefilter=s.prefilter)

    def _rise(self, camera: Camera, views: Sequence[PreparedView], holes: float) -> float:
        """What `fill` needs to tell what is hidden; holes that the views have themselves are hidden by nothing."""
        invalid = float(np.mean([prepared.invalid_share for prepared in views] or [0.0]))
        return rise_per_pixel(camera, [prepared.view.camera for prepared in views]) / max(1.0 - invalid / holes, 1e-6)

    @contextmanager
    def _canvas(self, camera: Camera) -> Iterator[Canvas]:
        """A canvas of the camera's size that no other thread uses."""
        size = (camera.width, camera.height)
        with self._canvas_lock:
            free = self._canvases.setdefault(size, [])
            canvas = free.pop() if free else None
        canvas = canvas or Canvas(*size)
        try:
            yield canvas
        finally:
            with self._canvas_lock:
                free.append(canvas)


def _scaled(viewer: V, settings: Settings) -> V:
    """A viewer with the size of pictures that is rendered."""
    if settings.output_scale == 1.0:
        return viewer
    if isinstance(viewer, StereoView):
        return viewer.scaled(settings.output_scale)
    return dataclasses.replace(viewer, projection=viewer.projection.scaled(settings.output_scale))
