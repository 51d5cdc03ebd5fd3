"""Viewers: poses in, stereo pictures out."""

from __future__ import annotations

from functools import partial

from farside.engine.live.engine import HeadPose, LiveViewer, Source
from farside.engine.live.governor import Rung
from farside.engine.rig.camera import Perspective, Pose
from farside.engine.rig.viewer import StereoPicture, StereoView, home_pose
from starlette.websockets import WebSocket

from .inbox import receive
from .pictures import encode_texture
from .protocol import (
    MAX_CONTROL_BYTES,
    CloseCode,
    PoseUpdate,
    ProtocolError,
    Scene,
    Stereo,
    ViewerHello,
    decode,
    encode,
    pose_from_wire,
    pose_to_wire,
    vector_from_wire,
)
from .service import Service, conversation, race, send

__all__ = ["serve_viewer"]


async def serve_viewer(socket: WebSocket, service: Service) -> None:
    """One viewer's connection, from hello to close."""
    async with conversation(socket):
        client, hello = await service.greet(socket, ViewerHello)
        if service.live.viewer_count >= service.settings.max_viewers:
            limit = service.settings.max_viewers
            raise ProtocolError(CloseCode.BUSY, "viewers", service.live.viewer_count, f"fewer than {limit}")
        with service.live.viewer(client, _view_of(hello)) as viewer:
            await service.welcome(socket, client)
            pictures = viewer.run(
                lambda wanted: partial(_finish, hello.encoding, service.rung, wanted.tag, viewer.dropped),
                socket.send_bytes,
                lambda source: send(socket, _scene(hello.axes, source)),
            )
            await race(pictures, _receive_poses(socket, viewer, hello.axes))


def _view_of(hello: ViewerHello) -> StereoView:
    left, right = (
        Perspective.from_tangents(hello.width, hello.height, *eye) for eye in (hello.left, hello.right)
    )
    return StereoView(Pose(), hello.ipd, left, right)


async def _receive_poses(socket: WebSocket, viewer: LiveViewer[PoseUpdate], axes: str) -> None:
    last = -1
    while True:
        update = decode(await receive(socket), PoseUpdate, limit=MAX_CONTROL_BYTES)
        if update.seq <= last:
            raise ProtocolError(CloseCode.ORDER, "seq", update.seq, f"more than {last}")
        last = update.seq
        velocity = None if update.velocity is None else vector_from_wire(axes, update.velocity)
        pose = pose_from_wire(axes, update.position, update.orientation)
        viewer.look(HeadPose(pose, update.time, update, velocity, update.seen))


def _finish(encoding: str, rung: Rung, pose: PoseUpdate, dropped: int, picture: StereoPicture) -> bytes:
    """The message of a picture; done where the picture is."""
    left, right = (
        encode_texture(eye.texture, encoding, rung.settings.jpeg_quality) for eye in (picture.left, picture.right)
    )
    height, width = picture.left.texture.y.shape
    return encode(
        Stereo(
            pose.seq,
            pose.time,
            pose.position,
            pose.orientation,
            picture.frame_index,
            width,
            height,
            left,
            right,
            picture.stages,
            picture.holes,
            dropped,
            rung.name,
        )
    )


def _scene(axes: str, source: Source) -> Scene:
    position, orientation = pose_to_wire(axes, home_pose(source.cameras))
    return Scene(source.name, source.fps, len(source.cameras), position, orientation)
