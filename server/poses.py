"""Viewers: receives poses and wishes about effects, sends stereo pictures."""

from __future__ import annotations

from functools import partial
from typing import NoReturn

from farside.engine.io.images import split_planes
from farside.engine.live.core import Source
from farside.engine.live.viewer import HeadPose, LiveViewer
from farside.engine.rig.camera import Perspective, Pose
from farside.engine.rig.viewer import EncodedPair, StereoView, home_pose
from starlette.websockets import WebSocket

from .connection import connection_of
from .effects import EffectWishes
from .inbox import receive
from .protocol import (
    EFFECTS,
    MAX_CONTROL_BYTES,
    CloseCode,
    EffectRemoval,
    EffectUpdate,
    Picture,
    PoseUpdate,
    ProtocolError,
    Scene,
    Stereo,
    ViewerHello,
    agreed,
    decode,
    pose_from_wire,
    pose_to_wire,
    vector_from_wire,
)
from .service import Service, conversation, race, send

__all__ = ["serve_viewer"]

PING_S, PONG_S = 8.0, 15.0  # a viewer's network may be away for a moment


async def serve_viewer(socket: WebSocket, service: Service) -> None:
    """One viewer's connection, from hello to close."""
    if (connection := connection_of(socket)) is not None:  # one that is gone must not keep its place for long
        connection.expect_pongs(PING_S, PONG_S)
    async with conversation(socket):
        client, hello = await service.greet(socket, ViewerHello)
        if service.live.viewer_count >= service.settings.max_viewers:
            limit = service.settings.max_viewers
            raise ProtocolError(CloseCode.BUSY, "viewers", service.live.viewer_count, f"fewer than {limit}")
        with service.live.viewer(client, _view_of(hello)) as viewer:
            await service.welcome(socket, client, hello)
            pictures = viewer.run(
                hello.encoding,
                lambda wanted: partial(
                    _send_pair, socket, hello.encoding, wanted.tag, viewer.dropped, service.rung.name
                ),
                lambda source: send(socket, _scene(hello.axes, source)),
            )
            wishes = EffectWishes(service.live.effects) if EFFECTS in agreed(hello.features, hello.ROLE) else None
            others = (wishes.fulfil(),) if wishes is not None else ()
            await race(pictures, _receive(socket, viewer, hello.axes, wishes), *others)


def _view_of(hello: ViewerHello) -> StereoView:
    left, right = (
        Perspective.from_tangents(hello.width, hello.height, *eye) for eye in (hello.left, hello.right)
    )
    return StereoView(Pose(), hello.ipd, left, right)


async def _receive(
    socket: WebSocket, viewer: LiveViewer[PoseUpdate], axes: str, wishes: EffectWishes | None
) -> NoReturn:
    """Take poses and, where the feature is agreed, wishes about effects."""
    last = -1
    allowed = (PoseUpdate,) if wishes is None else (PoseUpdate, EffectUpdate, EffectRemoval)
    while True:
        update = decode(await receive(socket), *allowed, limit=MAX_CONTROL_BYTES)
        if not isinstance(update, PoseUpdate):
            assert wishes is not None
            assert isinstance(update, EffectUpdate | EffectRemoval)
            wishes.note(update, axes)
            continue
        if update.seq <= last:
            raise ProtocolError(CloseCode.ORDER, "seq", update.seq, f"more than {last}")
        last = update.seq
        velocity = None if update.velocity is None else vector_from_wire(axes, update.velocity)
        pose = pose_from_wire(axes, update.position, update.orientation)
        viewer.look(HeadPose(pose, update.time, update, velocity, update.seen))


async def _send_pair(
    socket: WebSocket, encoding: str, pose: PoseUpdate, dropped: int, rung: str, pair: EncodedPair
) -> None:
    """Send the stereo pair that was rendered for `pose`."""
    report = pair.report
    left, right = (_picture(eye, encoding, report.height, report.width) for eye in (pair.left, pair.right))
    message = Stereo(
        pose.seq,
        pose.time,
        pose.position,
        pose.orientation,
        report.frame_index,
        report.width,
        report.height,
        left,
        right,
        report.stages,
        report.holes,
        dropped,
        rung,
    )
    await send(socket, message)


def _picture(data: bytes, encoding: str, height: int, width: int) -> Picture:
    return Picture(encoding, (data,) if encoding == "jpeg" else tuple(split_planes(data, height, width)))


def _scene(axes: str, source: Source) -> Scene:
    position, orientation = pose_to_wire(axes, home_pose(source.cameras))
    return Scene(source.name, source.fps, len(source.cameras), position, orientation)
