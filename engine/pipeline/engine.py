"""The synchronous core: video frames in at the back end, pictures out at the front end (paper Fig. 3)."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Mapping, Sequence
from typing import Any

from ..background.model import BackgroundModel
from ..background.saved_model import SavedModel
from ..background.seed import Seed
from ..io.coloured_meshes import ColouredMesh, TexturedMesh
from ..io.effect_files import EffectContent
from ..io.mesh_files import colours_of, to_file
from ..rendering.cpu_renderer import CpuRenderer
from ..rendering.renderer import Renderer
from ..rig.camera import Camera
from ..rig.effects import Effect
from ..rig.frame import Frame
from ..rig.questions import NoModelError
from ..rig.viewer import EncodedPair, RenderedPicture, StereoPicture, StereoView
from ..settings import Settings
from ..support.array_types import F64
from ..support.stages import timed
from .back_end import BackEnd, BackEndReport
from .effects import SceneEffects
from .front_buffer import DoubleBuffer, FrontBuffer
from .front_end import render_camera, render_encoded, render_pair
from .viewpoint import Look, Viewer

__all__ = ["BackEndReport", "Engine", "Viewer"]


class Engine:
    """Renders a rig's video for moving viewers and models the scene's background meanwhile.

    `update` is called by one back-end thread; rendering methods may run in other threads at the same time and always
    show the newest finished frame (double buffering, `pipeline.front_buffer`). f_vin: video frames per second.
    `renderer` draws the pictures; None: on the CPU. `modelling` False: pictures show the present views only, until
    `begin_model`. saved: a model that is continued; seed: an earlier model of the same room, which a new model begins
    with. Raises ValueError for no cameras, for one of less than 4 x 4 pixels, and for a saved model of other cameras or
    with other settings.
    """

    def __init__(
        self, cameras: Sequence[Camera], settings: Settings | None = None, *, f_vin: float = 30.0,
        renderer: Renderer | None = None, modelling: bool = True, saved: SavedModel | None = None,
        seed: Seed | None = None,
    ) -> None:  # fmt: skip
        self.cameras = tuple(cameras)
        if not self.cameras:
            raise ValueError("cameras: none: expected at least one source camera")
        for camera in self.cameras:
            if min(camera.width, camera.height) < 4:
                size = f"{camera.width} x {camera.height}"
                raise ValueError(f"camera {camera.name}: {size} pixels: expected at least 4 x 4")
        self._renderer = renderer or CpuRenderer()
        self._back_end = BackEnd(self.cameras, self._renderer, f_vin, modelling, seed)
        self._buffers = DoubleBuffer(settings or Settings())
        self._effects = SceneEffects([camera.name for camera in self.cameras])
        self._modelling = threading.Lock()  # the model changes, or a shadow map of it is rendered
        if saved is not None:
            self._back_end.resume(saved, self.settings)

    @property
    def settings(self) -> Settings:
        """The settings of the next picture and of the model."""
        return self._buffers.settings

    @property
    def front(self) -> FrontBuffer | None:
        """The front buffer, from which the next picture is rendered; None before the first frame."""
        return self._buffers.front

    @property
    def f_vin(self) -> float:
        """Expected video frames per second: a PBI has to last for one frame."""
        return self._back_end.f_vin

    @f_vin.setter
    def f_vin(self, rate: float) -> None:
        self._back_end.f_vin = rate

    @property
    def frame_index(self) -> int | None:
        """Index of the frame that pictures show now; None before the first."""
        front = self.front
        return front.frame_index if front else None

    @property
    def tones(self) -> F64 | None:
        """The tones [n, 4, 4] of the present views (`Exposure.tones`); None if exposure is not followed."""
        front = self.front
        return front.tones if front else None

    @property
    def model(self) -> BackgroundModel | None:
        """The background model, for the thread that updates; None before the first frame, or if there is none."""
        return self._back_end.model

    def state(self) -> SavedModel | None:
        """The model and what it needs to be continued, as copies, for the thread that updates; None: no model."""
        return self._back_end.state()

    def check_rig(self, cameras: Sequence[Camera]) -> None:
        """Raises ValueError, which names the camera and the field, if a source with these cameras does not go on with
        the model: they are others, or one that has never moved is elsewhere. Any thread may call this."""
        self._back_end.check_rig(cameras)

    def retune(self, settings: Settings) -> None:
        """Use other settings from the next picture on; any thread may call this, and nothing is rebuilt.

        Raises ValueError if a setting differs that is not in `settings.PER_PICTURE`. If more views are drawn than
        before, the next picture has to triangulate them; from the next frame on the back end does it.
        """
        self._buffers.retune(settings)

    def begin_model(self) -> None:
        """Follow the background and the exposure of views from the next frame on; any thread may call this."""
        self._back_end.modelling = True

    def update(
        self, frame: Frame, viewers: Mapping[str, Viewer] | Look | None = None,
        speeds: Mapping[str, float] | None = None,
    ) -> BackEndReport:  # fmt: skip
        """Take a frame: update the reference views and the background model, render each viewer's PBI, swap buffers.

        viewers: where each viewer looks, by name, or a function that returns it, for heads that move meanwhile. speeds:
        of the heads, m/s, for the PBI's margin. Views that are left out (`rig.frame.View`, `rig.left_out`) leave no
        trace; if all are, nothing changes. Raises ValueError, and changes nothing, for a frame that does not fit the
        rig.
        """
        look = viewers if callable(viewers) else lambda: viewers or {}
        with self._modelling:
            back, report = self._back_end.update(frame, look, speeds or {}, self.settings)
            if back is not None:
                if self._effects:
                    with timed(report.stages, "effects"):
                        back = dataclasses.replace(back, effects=self._effects.follow(self.model, back.content))
                self._buffers.swap(back)
        return report

    def put_effect(self, name: str, effect: Effect, content: EffectContent | None = None) -> None:
        """Add a 3D effect (`rig.effects`), or change the one of that name; the next picture shows it.

        content: the picture of a projector, or the parts of a mesh (`io.effect_files`); None: it stays as it is, or
        comes later. Any thread may call this; it waits while a frame is taken. A picture is thrown onto the background
        model, so without one it is not seen. Raises ValueError, and changes nothing, for a camera that the rig does not
        have, and for a mesh whose picture is damaged.
        """
        with self._modelling:
            self._effects.put(name, effect, content)
            self._show_effects()

    def remove_effect(self, name: str) -> None:
        """Remove a 3D effect, if it is there; any thread may call this."""
        with self._modelling:
            self._effects.remove(name)
            self._show_effects()

    def _show_effects(self) -> None:
        if (front := self.front) is not None:
            effects = self._effects.shown(self.model, front.content) if self._effects else None
            self._buffers.show(effects)

    def render(self, view: StereoView, viewer: str | None = None) -> StereoPicture:
        """Render both eyes from the newest frame; `viewer`: the name of the viewer whose PBI is the backdrop.

        Raises ValueError before the first frame.
        """
        front = self._newest()
        left, right, selecting = render_pair(front, view, viewer, lambda picture: picture)
        left.report.stages.add("select", selecting["select"], selecting.cpu["select"])
        return StereoPicture(left, right, front.frame_index)

    def render_encoded(self, view: StereoView, viewer: str | None = None, encoding: str = "jpeg") -> EncodedPair:
        """As `render`, but both eyes as bytes: jpeg (of the settings' quality) or raw (`io.images.encode_picture`)."""
        return render_encoded(self._newest(), view, viewer, encoding)

    def render_camera(self, camera: Camera, viewer: str | None = None) -> RenderedPicture:
        """Render one virtual camera of any projection from the newest frame; ValueError before the first frame."""
        return render_camera(self._newest(), camera, viewer)

    def mesh(self) -> ColouredMesh:
        """The background model as it is now, with colours at its vertices; any thread may call this.

        Raises ValueError before the first frame.
        """
        return self._modelled().mesh()

    def textured_mesh(self) -> TexturedMesh:
        """As `mesh`, with colours in pictures at the resolution of the views."""
        return self._modelled().textured_mesh()

    def status(self) -> dict[str, Any]:
        """Figures for people and monitors: the frame shown and the model's size."""
        counts = self.model.counts() if self.model is not None else {}
        memory = self.model.memory if self.model is not None else {}
        memory = {"canvases": self._renderer.idle_bytes, **memory}
        return {
            "frame_index": self.frame_index, "cameras": len(self.cameras), "background": counts, "memory_bytes": memory,
        }  # fmt: skip

    def close(self) -> None:
        """End the threads."""
        self._renderer.close()

    def export(self, file_format: str = "glb", colours: str | None = None) -> bytes:
        """The background model as the bytes of a file: glb or ply, with colours in a texture or at the vertices.

        Defaults and axes are those of `io.mesh_files.colours_of` and `to_file`. Raises ValueError for other formats or
        colours, before the first frame, and for a model that the format cannot hold.
        """
        textured = colours_of(file_format, colours) == "texture"
        return to_file(self.textured_mesh() if textured else self.mesh(), file_format)

    def _modelled(self) -> BackgroundModel:
        if self.model is None:
            raise NoModelError("mesh: there is none before the first frame: expected one to be taken")
        return self.model

    def _newest(self) -> FrontBuffer:
        front = self.front
        if front is None:
            raise ValueError("frame: none was received yet")
        return front
