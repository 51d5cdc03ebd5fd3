"""The back end (paper Fig. 3), once per video frame: update the current reference views, update the PBS, render PBIs.

Its result is the back buffer, which is swapped to the front when it is complete and never changes after that.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..background.exposure import Exposure, to_common
from ..background.model import BackgroundModel, UpdateReport
from ..background.pbi import enlarged, imaginary_camera, uncovered_cells
from ..background.saved_model import SavedModel, check_rig
from ..background.seed import Seed
from ..background.state import CameraState
from ..geometry.prepared_view import PreparedView, ViewTable
from ..geometry.scene_scale import Scene
from ..geometry.triangulator import Triangulator
from ..rendering.renderer import FrameContent, PreparedFrame, Renderer
from ..rig.camera import Camera
from ..rig.frame import Fault, Frame
from ..rig.left_out import without_empty_views
from ..settings import Settings
from ..support.array_types import F64
from ..support.stages import Stages, timed
from .front_buffer import FrontBuffer
from .moving_views import MovingViews
from .viewpoint import Look, Viewer, head_camera, scaled, selected

__all__ = ["BackEnd", "BackEndReport"]

_NEAR = 0.02  # share of the depth range's near end; the PBI shows nothing nearer to the head
# The PBI casts no rays where the first _STEADY_VIEWS selected views already cover the picture, even if the eye moves
# _SWAY metres farther than its speed predicts. Only the first views count, because they are still selected when the
# head has moved a little.
_STEADY_VIEWS, _SWAY = 3, 0.02


@dataclass(slots=True)
class BackEndReport:
    """The cost of one video frame: milliseconds per stage, rays and triangles, and the background model's report; and
    which views were left out of it."""

    frame_index: int
    stages: Stages
    background: UpdateReport | None
    pbi_rays: int = 0
    triangles: int = 0  # of the views that are drawn
    left_out: Mapping[str, Fault] = field(default_factory=dict)  # why views were left out, by camera


class BackEnd:
    """Keeps the state between frames: the scene's scale, the background model, the views' tones. For one thread.

    f_vin: video frames per second. While `modelling` is False, neither the background nor the exposure of the views is
    followed, whatever the settings say; they stay as they are. seed: an earlier model, which a new model begins with.
    """

    def __init__(
        self, cameras: Sequence[Camera], renderer: Renderer, f_vin: float, modelling: bool = True,
        seed: Seed | None = None,
    ) -> None:  # fmt: skip
        self.f_vin, self.modelling = f_vin, modelling
        self._seed, self._newest = seed, 0
        self.model: BackgroundModel | None = None
        self._cameras, self._renderer = tuple(cameras), renderer
        self._scene: Scene | None = None
        self._begun = False  # whether a frame has shown anything
        self._exposure: Exposure | None = None
        self._moving = MovingViews()
        self._triangulators = [Triangulator() for _ in self._cameras]
        self._placed = list(self._cameras)  # each camera where it was seen last

    def resume(self, saved: SavedModel, settings: Settings) -> None:
        """Continues with a saved model, before the first frame. Raises ValueError if it is of other cameras or was
        built with other settings."""
        saved = saved.adapted(self._cameras, settings)
        self.model, self._newest = BackgroundModel.from_state(saved.model), saved.frame
        self._scene = scene = saved.model.scene.scene()
        if saved.exposure is not None and settings.exposure_s > 0.0:
            self._exposure = Exposure(len(self._cameras), settings.exposure_s, scene.depths[:2])
            self._exposure.put_back(saved.exposure)
        self._placed = [camera.camera() for camera in saved.placed]
        seen = set(range(len(self._placed))) - set(saved.model.unseen)
        self._moving.put_back({c: self._placed[c].pose for c in seen}, saved.moving)

    def check_rig(self, cameras: Sequence[Camera]) -> None:
        """Raises ValueError if a source's cameras are not the ones of this back end (`saved_model.check_rig`); those
        that have moved may be anywhere. Any thread may call this."""
        check_rig(tuple(map(CameraState.of, self._cameras)), self._moving.moving, cameras)

    def state(self) -> SavedModel | None:
        """The model and what it needs to be continued, as copies, for the thread that updates; None: no model."""
        if self.model is None:
            return None
        return SavedModel.of(
            self._cameras, self._newest, self.model, self._exposure, self._placed, self._moving.moving
        )  # fmt: skip

    def update(
        self, frame: Frame, look: Look, speeds: Mapping[str, float], settings: Settings
    ) -> tuple[FrontBuffer | None, BackEndReport]:
        """The back buffer of a frame, complete. If all of its views are left out, it leaves no trace: None, or as long
        as no frame has shown anything a back buffer of nothing.

        `look` is called twice: first for the poses for which the PBIs are rendered; then, at the end, for the poses for
        which the data of the next pictures are made ready. speeds: of the heads, m/s, by viewer. Raises ValueError, and
        changes nothing, for a frame that does not fit the rig.
        """
        self._check(frame)
        stages, frame = Stages(), self._placed_in(without_empty_views(frame))
        if not frame.there:
            return self._nothing(frame, settings), BackEndReport(frame.index, stages, None, left_out=frame.faults)
        if self._scene is None:
            self._scene = Scene.of([view.camera for view in frame.views], settings, frame)
        scene, self._begun = self._scene, True
        self._moving.note(frame)
        views = self._reference_views(frame, scene, settings)
        drawn = self._moving.drawn(moving=settings.draw_moving)
        content = FrameContent(scene, views, ViewTable(views), {}, None, drawn)
        with timed(stages, "exposure"):
            tones = self._follow_exposure(frame, content.present, scene, settings)
        with timed(stages, "background"):
            report = self._update_model(frame, tones, content, settings)
        with timed(stages, "pbi"):
            pbis, rays = self._make_pbis(look(), speeds, content, settings)
            delta = None if self.model is None else self.model.tolerances.delta
            content = dataclasses.replace(content, pbis=pbis, delta=delta)
            prepared = self._renderer.prepare(content)
        with timed(stages, "triangulate"):
            self._warm(prepared, look(), content, settings)
        back = FrontBuffer(frame.index, content, prepared, tones, settings)
        triangles = sum(view.triangle_count for view in views)
        return back, BackEndReport(frame.index, stages, report, rays, triangles, frame.faults)

    def _nothing(self, frame: Frame, settings: Settings) -> FrontBuffer | None:
        """What to show after a frame of which all views are left out: None, which is what was shown before, or pictures
        of nothing. The scene's scale and the model wait for the first frame with depth."""
        if self._begun:
            return None
        scene = self._scene or Scene.unseen([view.camera for view in frame.views], settings)
        views = self._reference_views(frame, scene, settings)
        content = FrameContent(scene, views, ViewTable(views), {}, None, ())
        return FrontBuffer(frame.index, content, self._renderer.prepare(content), None, settings)

    def _check(self, frame: Frame) -> None:
        names = tuple(view.camera.name for view in frame.views)
        expected = tuple(camera.name for camera in self._cameras)
        if names != expected:
            raise ValueError(f"frame {frame.index}: views {names}: expected {expected}")
        for view, camera in zip(frame.views, self._cameras, strict=True):
            if (view.camera.projection, view.camera.depth) != (camera.projection, camera.depth):
                raise ValueError(
                    f"frame {frame.index}: view {camera.name}: projection or depth coding "
                    f"{view.camera.projection}: expected the announced {camera.projection}"
                )

    def _placed_in(self, frame: Frame) -> Frame:
        """The frame, in which each camera that is left out is where it was seen last."""
        for c in frame.there:
            self._placed[c] = frame.views[c].camera
        if not frame.faults:
            return frame
        pairs = zip(frame.views, self._placed, strict=True)
        views = tuple(dataclasses.replace(view, camera=camera) for view, camera in pairs)
        return dataclasses.replace(frame, views=views)

    def _reference_views(self, frame: Frame, scene: Scene, settings: Settings) -> tuple[PreparedView, ...]:
        """The current reference views; their meshes are made when they are first used. Viewers are where cameras stand
        still, if any do."""
        afar = self._moving.some_stand
        return tuple(
            PreparedView(
                view, scene.triangulation(view.camera, settings, afar=afar), scene.origin, settings.completion,
                triangulator,
            )
            for view, triangulator in zip(frame.views, self._triangulators, strict=True)
        )

    def _follow_exposure(self, frame: Frame, present: ViewTable, scene: Scene, settings: Settings) -> F64 | None:
        """The views' tones [n, 4, 4]; None if exposure is not followed."""
        if settings.exposure_s == 0.0 or len(self._cameras) == 1:
            return None
        if not self.modelling:
            return None if self._exposure is None else self._exposure.tones
        if self._exposure is None:
            self._exposure = Exposure(len(self._cameras), settings.exposure_s, scene.depths[:2])
        model = self.model.images(frame) if self.model is not None else ()
        self._exposure.update(present, 1.0 / self.f_vin, *model)
        return self._exposure.tones

    def _update_model(
        self, frame: Frame, tones: F64 | None, content: FrameContent, settings: Settings
    ) -> UpdateReport | None:
        """Update the PBS (section 3.3); None if no background model is wanted now."""
        if not (settings.background and self.modelling):
            return None
        if self.model is None:
            self.model = BackgroundModel(self._cameras, settings, content.scene, seed=self._seed)
        common = None if tones is None else to_common(tones)
        report = self.model.update(frame, common, 1.0 / self.f_vin, content.present)
        self._newest = frame.index
        return report

    def _make_pbis(
        self, viewers: Mapping[str, Viewer], speeds: Mapping[str, float], content: FrameContent, settings: Settings
    ) -> tuple[dict[str, PreparedView], int]:
        """Each viewer's PBI (section 3.4.1), and the number of rays for all; no PBI without a background model."""
        pbis: dict[str, PreparedView] = {}
        model, total = self.model, 0
        if model is None:
            return pbis, total
        for name, viewer in viewers.items():
            speed = speeds.get(name, 0.0)
            pbis[name], rays = self._make_pbi(model, scaled(viewer, settings), speed, content, settings)
            total += rays
        return pbis, total

    def _make_pbi(
        self, model: BackgroundModel, viewer: Viewer, speed: float, content: FrameContent, settings: Settings
    ) -> tuple[PreparedView, int]:
        """A viewer's PBI, and the number of rays for it; `speed` of the head in m/s."""
        scene, moves = content.scene, speed / self.f_vin + _SWAY
        scale, margin = settings.pbi_scale, settings.pbi_margin_rad
        if isinstance(viewer, Camera):
            camera = enlarged(viewer, scene.coding, scale, margin)
        else:
            camera = imaginary_camera(viewer, speed, self.f_vin, scene.coding, scale, margin)
            moves += 0.5 * viewer.ipd
        camera = dataclasses.replace(camera, depth=scene.coding_at(camera.pose.position))
        behind = math.dist(camera.pose.position, viewer.pose.position)
        steady = [content.views[k] for k in self._selected(viewer, content, settings)[:_STEADY_VIEWS]]
        wanted = uncovered_cells(camera, steady, behind + moves, scene.origin)
        present = content.present if settings.backdrop == "standing" else None
        # Surfaces between the imaginary camera and the head must not be seen.
        near = behind + _NEAR * scene.coding.near
        image = model.render_pbi(camera, present, near=near, wanted=wanted)
        return PreparedView(image.view, scene.triangulation(camera, settings), scene.origin), image.rays

    def _warm(
        self, prepared: PreparedFrame, viewers: Mapping[str, Viewer], content: FrameContent, settings: Settings
    ) -> None:
        """Make ready the data of each viewer's pictures; otherwise the first picture would, and would be late."""
        for viewer in viewers.values():
            small = scaled(viewer, settings)
            target = head_camera(small, content.scene)
            prepared.warm(target, self._selected(small, content, settings), settings)

    @staticmethod
    def _selected(viewer: Viewer, content: FrameContent, settings: Settings) -> list[int]:
        return selected(viewer, [view.view.camera for view in content.views], content.drawn, content.scene, settings)
