"""From a background model to its state and back (`state.ModelState`)."""

from __future__ import annotations

import dataclasses

from ..settings import Settings
from .capture import Capture
from .maximum_depth import MaximumDepthImage
from .parts import ModelParts
from .state import VERSION, CameraState, CaptureState, ModelState, SceneState, SurfaceState, settings_state
from .tolerances import Tolerances

__all__ = ["put_back", "settings_of", "state_of"]


def state_of(model: ModelParts) -> ModelState:
    """The whole state of a model, as copies; called between two updates by the thread that updates."""
    pbs, rig, followed = model._pbs, model._rig, model._tolerances
    static, progressive = pbs.static.values(), pbs.progressive.values()
    return ModelState(
        version=VERSION,
        settings=settings_state(model.settings),
        scene=SceneState.of(model._scene),
        cameras=tuple(CameraState.of(camera) for camera in rig.cameras),
        captures=tuple(_capture_state(capture) for capture in model._captures),
        current=tuple(capture.number for capture in model._captures.current),
        surfaces=(
            *(SurfaceState.of(surface, True) for surface in static),
            *(SurfaceState.of(surface, False) for surface in progressive),
        ),
        tolerances=tuple((f.name, getattr(followed.now, f.name)) for f in dataclasses.fields(Tolerances)),
        first=tuple(samples.copy() for samples in followed.first),
        frames=followed.frames,
        rounds=tuple(model._p_pbs.rounds),
        moved=tuple(sorted(rig.moved)),
        next=rig.next,
        waited=model._waited,
        geometry=pbs.version,
        cast=tuple(model._culling.cast_version),
        changed=model._culling.changed.cells.copy(),
    )


def settings_of(state: ModelState) -> Settings:
    """The settings of a model with this state."""
    return Settings(**dict(state.settings))  # type: ignore[arg-type]


def put_back(model: ModelParts, state: ModelState) -> None:
    """Puts a state into a model that has taken no frame yet and has the same cameras, settings and scene."""
    pbs, rig, followed = model._pbs, model._rig, model._tolerances
    rig.place([camera.camera() for camera in state.cameras])
    rig.moved, rig.next, model._waited = set(state.moved), state.next, state.waited
    for capture in state.captures:
        image = MaximumDepthImage.from_state(capture.camera.camera(), capture)
        model._captures.add(capture.index, image, image.camera.packed(model._origin))
    model._captures.current = [model._captures[number] for number in state.current]
    for surface in state.surfaces:
        pbs.put(surface.surface(), static=surface.static)
    pbs.commit()
    pbs.version = state.geometry
    followed.now = Tolerances(**dict(state.tolerances))
    followed.first, followed.frames = [samples.copy() for samples in state.first], state.frames
    model._p_pbs.rounds = list(state.rounds)
    model._culling.cast_version = list(state.cast)
    model._culling.changed.cells[:] = state.changed


def _capture_state(capture: Capture) -> CaptureState:
    image = capture.image
    return CaptureState(index=capture.camera, camera=CameraState.of(image.camera), **image.state())
