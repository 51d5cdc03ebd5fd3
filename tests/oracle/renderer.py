"""A simple renderer: every pixel against every triangle, the nearest texel's colour, holes stay grey."""

from __future__ import annotations

import dataclasses

import numpy as np
from farside.engine.rendering.renderer import FrameContent, PictureTask
from farside.engine.rig.frame import Texture
from farside.engine.rig.viewer import PictureReport, RenderedPicture

from .zbuffer import zbuffer

GREY = 512


@dataclasses.dataclass
class OracleRenderer:
    """Implements `rendering.renderer.Renderer` and remembers its calls."""

    asked: list = dataclasses.field(default_factory=list)
    idle_bytes: int = 0

    def prepare(self, content: FrameContent):
        self.asked.append(("prepare", tuple(content.pbis)))
        return OracleFrame(self, content)

    def close(self):
        self.asked.append(("close",))


class OracleFrame:
    """Implements `rendering.renderer.PreparedFrame`."""

    def __init__(self, renderer, content):
        self._renderer, self._content = renderer, content

    def warm(self, target, chosen, settings):
        self._renderer.asked.append(("warm", target.name, tuple(chosen)))

    def render(self, task: PictureTask, finish):
        self._renderer.asked.append(("render", tuple(target.name for target in task.targets), task.viewer, task.chosen))
        return [finish(self._picture(task, camera)) for camera in task.targets]

    def _picture(self, task, camera):
        views = [self._content.views[k] for k in task.chosen]
        report = PictureReport(tuple(prepared.view.camera.name for prepared in views))
        shape = camera.height, camera.width
        disparity, winner = np.zeros(shape), np.zeros(shape, np.uint8)
        planes = np.full((3, *shape), GREY)
        for number, prepared in enumerate(views):
            self._draw(camera, prepared, number, disparity, winner, planes, disparity < np.inf)
        report.holes_warped = float(np.mean(disparity <= 0))
        if task.viewer in self._content.pbis:
            self._draw(
                camera, self._content.pbis[task.viewer], len(views), disparity, winner, planes, disparity <= 0
            )
        report.holes_backdrop = report.holes_filled = float(np.mean(disparity <= 0))
        y, cb, cr = planes.astype(np.uint16)
        texture = Texture(y, cb[::2, ::2], cr[::2, ::2])
        return RenderedPicture(camera, texture, disparity.astype(np.float32), winner, report)

    def _draw(self, camera, prepared, number, disparity, winner, planes, where):
        """Draw a view's surface where it is nearer than what is drawn already, and where the mask `where` allows it."""
        mesh, view = prepared.mesh(), prepared.view
        if len(mesh.triangles) == 0:
            return
        found = zbuffer(camera, mesh.points + self._content.scene.origin, mesh.triangles).disparity
        nearer = where & (found > disparity)
        disparity[nearer], winner[nearer] = found[nearer], number
        v, u = np.nonzero(nearer)
        points = camera.unproject(np.stack([u, v], -1) + 0.5, 1.0 / found[nearer])
        pixel, _ = view.camera.project(points)
        column = np.clip(pixel[:, 0].astype(int), 0, view.camera.width - 1)
        row = np.clip(pixel[:, 1].astype(int), 0, view.camera.height - 1)
        texture = view.texture
        planes[0][nearer] = texture.y[row, column]
        planes[1][nearer], planes[2][nearer] = texture.cb[row // 2, column // 2], texture.cr[row // 2, column // 2]
