"""From a background model to its state and back (`state.ModelState`)."""

from __future__ import annotations

import dataclasses

from ..rig.frame import Texture
from ..settings import Settings
from .capture import Capture, Remains
from .maximum_depth import MaximumDepthImage
from .parts import ModelParts
from .state import (
    VERSION,
    CameraState,
    CaptureState,
    ModelState,
    NumberedAtlas,
    RemainsState,
    SceneState,
    SurfaceState,
    settings_state,
)
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
        captures=tuple(_capture_state(each) for each in model._captures if isinstance(each, Capture)),
        remains=tuple(_remains_state(each) for each in model._captures if isinstance(each, Remains)),
        atlases=tuple(NumberedAtlas(number, atlas) for number, atlas in model._captures.atlases.items()),
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
        moving=tuple(sorted(rig.moving)),
        unseen=tuple(sorted(rig.unseen)),
        next=rig.next,
        waited=model._waited,
        geometry=pbs.version,
        cast=tuple(model._culling.cast_version),
        looks=tuple(model._culling.looks),
        changed=model._culling.changed.cells.copy(),
        late=model._late.state(),
    )


def settings_of(state: ModelState) -> Settings:
    """The settings of a model with this state."""
    return Settings(**dict(state.settings))  # type: ignore[arg-type]


def put_back(model: ModelParts, state: ModelState) -> None:
    """Puts a state into a model that has taken no frame yet and has the same cameras, settings and scene."""
    pbs, rig, followed = model._pbs, model._rig, model._tolerances
    rig.place([camera.camera() for camera in state.cameras])
    rig.moved, rig.moving, rig.unseen = set(state.moved), set(state.moving), set(state.unseen)
    rig.next, model._waited = state.next, state.waited
    _put_captures(model, state)
    late = {remains.capture for remains in state.remains if remains.late}
    for surface in state.surfaces:
        pbs.put(surface.surface(late=surface.capture in late), static=surface.static)
    pbs.commit()
    pbs.version = state.geometry
    followed.now = Tolerances(**dict(state.tolerances))
    followed.first, followed.frames = [samples.copy() for samples in state.first], state.frames
    model._p_pbs.rounds = list(state.rounds)
    model._culling.cast_version, model._culling.looks = list(state.cast), list(state.looks)
    model._culling.changed.cells[:] = state.changed
    model._late.put_back(state.late)


def _put_captures(model: ModelParts, state: ModelState) -> None:
    """Captures, what is left of older ones, and atlases get the numbers that they had."""
    captures = {each.capture: _capture(each, model) for each in state.captures}
    for capture in captures.values():
        model._captures.put(capture)
    for remains in state.remains:
        model._captures.put(_remains(remains))
    for item in state.atlases:
        model._captures.put_atlas(item.number, item.atlas)
    model._captures.current = [captures[number] for number in state.current]


def _capture_state(capture: Capture) -> CaptureState:
    image = capture.image
    camera = CameraState.of(image.camera)
    return CaptureState(capture=capture.number, index=capture.camera, camera=camera, **image.state())


def _capture(state: CaptureState, model: ModelParts) -> Capture:
    image = MaximumDepthImage.from_state(state.camera.camera(), state)
    return Capture(state.capture, state.index, image, image.camera.packed(model._origin))


def _remains_state(remains: Remains) -> RemainsState:
    texture = remains.texture
    y, cb, cr = (plane.copy() for plane in (texture.y, texture.cb, texture.cr))
    return RemainsState(
        remains.number, remains.camera, remains.codes.copy(), y, cb, cr, remains.edge, remains.reach,
        remains.late,
    )  # fmt: skip


def _remains(state: RemainsState) -> Remains:
    texture = Texture(state.y.copy(), state.cb.copy(), state.cr.copy())
    return Remains(state.capture, state.index, state.codes.copy(), texture, state.edge, state.reach, state.late)
