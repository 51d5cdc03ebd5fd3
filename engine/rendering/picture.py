"""One picture, step by step: warp, backdrop, shade, antialias, fill (paper sections 3.4.2 and 3.4.3)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ..geometry.prepared_view import PreparedView, ViewTable
from ..kernels.base.tolerance import Delta
from ..rig.camera import Camera
from ..rig.viewer import PictureReport, RenderedPicture
from ..support.stages import timed
from .antialiasing import smooth_outlines
from .canvas_pool import CanvasPool
from .effects import Effects
from .filling import fill, rise_per_pixel
from .hole_settling import Settler
from .renderer import FrameContent, PictureTask
from .target import Target
from .tiles import HoleMap
from .warping import Canvas

__all__ = ["render_picture"]

_NEAR = 0.02  # share of the depth range's near end; nothing nearer to the eye is drawn
_MODEL = -1  # index of the background model's tone


def render_picture(
    content: FrameContent, task: PictureTask, camera: Camera, canvases: CanvasPool, settler: Settler
) -> RenderedPicture:
    """The picture of a virtual camera, drawn by the calling thread on a canvas of its own. `settler` keeps its filled
    holes steady."""
    drawing = _Drawing(content, task, camera)
    with canvases.canvas(camera.width, camera.height) as canvas:
        drawing.warp(canvas)
        drawing.lay_backdrop(canvas)
        drawing.shade(canvas, canvases)
        return drawing.finish(canvas, settler)


class _Drawing:
    """A picture that is being drawn, and the report of it."""

    def __init__(self, content: FrameContent, task: PictureTask, camera: Camera) -> None:
        self._content, self._task, self._camera = content, task, camera
        self._settings = task.settings
        self._chosen = [content.views[k] for k in task.chosen]
        self._pbi = content.pbis.get(task.viewer) if task.viewer is not None else None
        self._target = Target(camera, content.scene.origin)
        self._near = _NEAR * content.scene.coding.near
        self._holes: HoleMap
        self.report = PictureReport(tuple(prepared.view.camera.name for prepared in self._chosen))

    def warp(self, canvas: Canvas) -> None:
        """3D warping of the chosen reference views (section 3.4.2)."""
        with timed(self.report.stages, "warp"):
            canvas.clear()
            self.report.warped = self._draw_views(canvas, self._target)
            self._holes = canvas.holes()
            self.report.holes_warped = self.report.holes_backdrop = self._holes.fraction

    def lay_backdrop(self, canvas: Canvas) -> None:
        """Lays the viewer's PBI, if there is one, behind the warped views (section 3.4.2)."""
        with timed(self.report.stages, "backdrop"):
            if self._pbi is not None:
                self.report.warped += self._draw_backdrop(canvas, self._pbi, self._target)
                self._holes = canvas.holes()
                self.report.holes_backdrop = self._holes.fraction

    def shade(self, canvas: Canvas, canvases: CanvasPool) -> None:
        """Colours all drawn pixels; the others are grey if they will not be filled."""
        with timed(self.report.stages, "shade"):
            if not self._fills:
                canvas.grey()
            table = self._table()
            if table is not None:
                self._shade(canvas, self._target, table)
                if self._effects is not None and self._effects.meshes:  # they may stand before holes
                    self._holes = canvas.holes()
                    self.report.holes_backdrop = self._holes.fraction
        with timed(self.report.stages, "antialias"):
            if table is not None and self._settings.antialias == "samples":
                self._smooth_silhouettes(canvas, table, canvases)

    def finish(self, canvas: Canvas, settler: Settler) -> RenderedPicture:
        """Disocclusion filling (section 3.4.3) and the picture itself."""
        with timed(self.report.stages, "fill"):
            self.report.holes_filled = self.report.holes_backdrop
            if self._fills and self.report.holes_backdrop > 0:
                self._fill(canvas, settler)
                self.report.holes_filled = 0.0
            texture = canvas.texture()
        with timed(self.report.stages, "antialias"):
            if self._settings.antialias == "morphological":
                texture = smooth_outlines(texture, canvas.disparity, self._edge)
        return RenderedPicture(self._camera, texture, canvas.disparity, canvas.winner, self.report)

    @property
    def _fills(self) -> bool:
        return self._settings.fill != "none" and self.report.holes_backdrop < 1

    @property
    def _edge(self) -> float:
        """The disparity step at which the picture's surfaces are cut, 1/m."""
        return self._content.scene.triangulation(self._camera, self._settings).edge

    @property
    def _effects(self) -> Effects | None:
        """What else the picture shows; nothing where no surface was drawn."""
        return self._task.effects if self.report.holes_backdrop < 1 else None

    @property
    def _push(self) -> Delta | None:
        """How far the backdrop is moved backwards: by delta (section 3.4.2), if there is one."""
        return self._content.delta if self._settings.backdrop_m is None else (self._settings.backdrop_m, 0.0)

    def _table(self) -> ViewTable | None:
        """The sources of colours: the chosen views, then the PBI and all present views; None if there are none."""
        views, tones = list(self._chosen), list(self._task.chosen)
        if self._pbi is not None:
            views += [self._pbi, *self._content.views]
            tones += [_MODEL, *range(len(self._content.views))]
        if not views:
            return None
        return ViewTable(views, None if self._task.tones is None else self._task.tones[tones], drawn=len(self._chosen))

    def _draw_views(self, canvas: Canvas, target: Target) -> int:
        """Draw the chosen views, the most useful first; returns the number of triangles."""
        shrink, warped = self._content.scene.disparity_shrink(self._camera), 0
        for number, prepared in enumerate(self._chosen):
            margin = (2 * prepared.options.tolerance + prepared.view.camera.depth.step) * shrink
            warped += canvas.draw(prepared.mesh(), target, number, self._near, margin)
        # Completed depth may be wrong, so it is drawn only where no view has measured a surface. The same holds for
        # rims, the half pixel round surfaces.
        warped += canvas.draw_holes("doubtful", self._chosen, target, self._near)
        if self._settings.rims:
            warped += canvas.draw_holes("rims", self._chosen, target, self._near)
        return warped

    def _draw_backdrop(self, canvas: Canvas, pbi: PreparedView, target: Target) -> int:
        """Lay the backdrop behind the chosen views; returns the number of triangles."""
        delta, push = self._content.delta, self._push
        if delta is None or push is None:
            raise ValueError("delta: None: expected the background model's where there is a PBI")
        present = self._content.present if self._settings.ghost_test else None
        return canvas.draw_backdrop(
            pbi, present, self._task.chosen, target, self._near, push, delta,
            holes_only=not self._settings.overdraw,
        )  # fmt: skip

    def _shade(self, canvas: Canvas, target: Target, table: ViewTable) -> None:
        s = self._settings
        canvas.shade(target, table, len(self._chosen), s.blend, cubic=s.cubic, prefilter=s.prefilter)
        if self._effects is not None:
            canvas.add_effects(self._effects, target, self._near, len(self._chosen), self._push or (0.0, 0.0))

    def _smooth_silhouettes(self, canvas: Canvas, table: ViewTable, canvases: CanvasPool) -> None:
        """Draw pixels at silhouettes again, at twice the size, and average."""
        double = dataclasses.replace(self._camera, projection=self._camera.projection.scaled(2.0))
        target = Target(double, self._content.scene.origin)
        with canvases.canvas(double.width, double.height) as fine:
            fine.clear(canvas.silhouettes(self._edge))
            self._draw_views(fine, target)
            if self._pbi is not None:
                self._draw_backdrop(fine, self._pbi, target)
            self._shade(fine, target, table)
            canvas.average(fine)

    def _fill(self, canvas: Canvas, settler: Settler) -> None:
        rise = _rise(self._camera, self._chosen, self.report.holes_backdrop)
        structured = self._settings.fill == "structure"
        places = fill(canvas.disparity, canvas.planes, rise, self._holes, structured=structured)
        if self._task.viewer is not None and self._settings.settles:
            # Both eyes of a viewer have their own picture.
            key = f"{self._task.viewer} {self._camera.name}"
            settler.settle(key, self._camera, self._content.scene.depths[0], places, canvas.planes)


def _rise(camera: Camera, views: Sequence[PreparedView], holes: float) -> float:
    """The `rise` for `fill`. The share of holes that the views have themselves counts as hidden by nothing."""
    invalid = float(np.mean([prepared.invalid_share for prepared in views] or [0.0]))
    return rise_per_pixel(camera, [prepared.view.camera for prepared in views]) / max(1.0 - invalid / holes, 1e-6)
