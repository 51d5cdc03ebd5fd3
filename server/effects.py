"""3D effects over HTTP: what there is, adding and moving, pictures and meshes, removal; and wishes of viewers."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any, NoReturn

from farside.engine.io.effect_files import MOST_BYTES, read_mesh, read_picture
from farside.engine.live.scene_effects import SceneEffects
from farside.engine.rig.effects import AddedMesh, Effect, Projector
from fastapi import APIRouter, HTTPException, Request

from .body import read_body
from .effect_messages import EffectRemoval, EffectUpdate
from .fields import CloseCode, ProtocolError, Reader
from .protocol import AXES, MAX_CONTROL_BYTES, pose_from_wire, pose_to_wire
from .service import Service

__all__ = ["EffectWishes", "effect_of", "effect_router"]

_READERS: dict[str, tuple[type[Effect], Callable[[bytes], Any]]] = {
    "picture": (Projector, read_picture),
    "mesh": (AddedMesh, read_mesh),
}


def effect_of(update: EffectUpdate, axes: str) -> Effect:
    """The effect that a client describes in its `axes`."""
    pose = pose_from_wire(axes, update.position, update.orientation)
    if update.kind == "mesh":
        return AddedMesh(pose, update.scale)
    return Projector(pose, update.fov, update.strength, update.blend, update.camera)


class EffectWishes:
    """What a viewer wants of the effects. Of wishes for the same effect the newest counts: a hand that moves one sends
    more of them than the engine takes, and its head must not wait for them."""

    def __init__(self, effects: SceneEffects) -> None:
        self._effects = effects
        self._waiting: dict[str, Effect | None] = {}  # by name; None: remove it
        self._one = asyncio.Event()

    def note(self, update: EffectUpdate | EffectRemoval, axes: str) -> None:
        """A wish in the viewer's `axes`."""
        self._waiting[update.name] = effect_of(update, axes) if isinstance(update, EffectUpdate) else None
        self._one.set()

    async def fulfil(self) -> NoReturn:
        """Put and remove what is wished; raises ProtocolError for an effect that the engine does not take."""
        while True:
            await self._one.wait()
            self._one.clear()
            while self._waiting:
                name = next(iter(self._waiting))
                effect = self._waiting.pop(name)
                if effect is None:
                    await self._effects.remove(name)
                    continue
                try:
                    await self._effects.put(name, effect)
                except ValueError as error:
                    said, _, expected = str(error).rpartition(": expected ")
                    field, _, value = said.partition(": ")
                    raise ProtocolError(CloseCode.VALUE, field, value, expected) from error


def _described(name: str, effect: Effect) -> dict[str, Any]:
    """An effect as `EffectUpdate` describes it, in OMAF's axes."""
    position, orientation = pose_to_wire("omaf", effect.pose)
    if isinstance(effect, AddedMesh):
        update = EffectUpdate(name, "mesh", position, orientation, scale=effect.scale)
    else:
        update = EffectUpdate(
            name, "projector", position, orientation, effect.fov_rad, effect.strength, effect.blend, effect.camera
        )
    return {key: value for key, value in update._fields().items() if key != "name"}


async def _asked(request: Request, name: str) -> Effect:
    """The effect that a request's JSON describes; HTTPException 400 for what it does not describe rightly."""
    try:
        fields = json.loads(await read_body(request, MAX_CONTROL_BYTES))
    except (RecursionError, ValueError) as error:
        raise HTTPException(400, f"body: {error}: expected JSON") from error
    try:
        reader = Reader({**fields, "name": name} if isinstance(fields, dict) else fields)
        axes = reader.choice("axes", AXES) if reader.has("axes") else "omaf"
        return effect_of(EffectUpdate._read(reader), axes)
    except ProtocolError as error:
        raise HTTPException(400, str(error)) from error


def effect_router(service: Callable[[], Service]) -> APIRouter:
    """The routes under /effects; the application checks who asks."""
    router = APIRouter(prefix="/effects")
    reading = asyncio.Lock()  # of one file at a time: while it is decoded, a picture takes hundreds of megabytes

    @router.get("")
    async def effects() -> dict[str, Any]:
        held = service().live.effects
        found = {name: (held.get(name), held.has_content(name)) for name in held.names}
        described = {name: (_described(name, effect), has) for name, (effect, has) in found.items() if effect}
        return {"effects": {name: {**fields, "has_content": has} for name, (fields, has) in described.items()}}

    @router.put("/{name}")
    async def put(name: str, request: Request) -> dict[str, Any]:
        effect = await _asked(request, name)
        await _put(service(), name, effect, None)
        return _described(name, effect)

    @router.put("/{name}/{what}")
    async def put_content(name: str, what: str, request: Request) -> dict[str, Any]:
        if what not in _READERS:
            raise HTTPException(404, f"{what}: expected picture or mesh")
        _taking(service(), name, what)
        data = await read_body(request, MOST_BYTES)
        try:
            async with reading:
                content = await asyncio.to_thread(_READERS[what][1], data)
        except ValueError as error:
            raise HTTPException(400, str(error)) from error
        effect = _taking(service(), name, what)  # it may be another one by now
        await _put(service(), name, effect, content)
        return _described(name, effect)

    @router.delete("/{name}", status_code=204)
    async def remove(name: str) -> None:
        _known(service(), name)
        await service().live.effects.remove(name)

    return router


def _known(service: Service, name: str) -> Effect:
    """The effect of a name; HTTPException 404 if there is none."""
    effect = service.live.effects.get(name)
    if effect is None:
        raise HTTPException(404, f"effect: {name}: expected one of {', '.join(service.live.effects.names) or 'none'}")
    return effect


def _taking(service: Service, name: str, what: str) -> Effect:
    """The effect of a name, which takes pictures or meshes (`what`); HTTPException 404 if there is none, 409 if it does
    not take them."""
    effect = _known(service, name)
    if not isinstance(effect, _READERS[what][0]):
        kinds = _described(name, effect)["kind"], "projector" if what == "picture" else "mesh"
        raise HTTPException(409, f"{what}: for a {kinds[0]}: expected it for a {kinds[1]}")
    if isinstance(effect, Projector) and effect.camera:
        raise HTTPException(409, f"picture: for a projector of camera {effect.camera}: expected none")
    return effect


async def _put(service: Service, name: str, effect: Effect, content: Any) -> None:
    try:
        await service.live.effects.put(name, effect, content)
    except ValueError as error:
        raise HTTPException(400, str(error)) from error
