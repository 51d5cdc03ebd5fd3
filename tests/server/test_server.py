"""The server over real sockets: which clients are accepted, what is refused, and that all others continue."""

from __future__ import annotations

import asyncio
import dataclasses
import io
import json
import re
import socket
import urllib.error
import urllib.request
from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import Any

import msgpack
import numpy as np
import pytest
import trimesh
from farside.clients.connection import Peer, RefusedError, base_url, connect, persist
from farside.engine.live.core import CoreLostError
from farside.engine.live.frame_memory import Planes, open_buffer
from farside.engine.live.timing import Activity, StallMonitor
from farside.engine.rig.camera import Pose
from farside.engine.rig.frame import Frame
from farside.engine.rig.viewer import home_pose
from farside.server import ingest, protocol
from farside.server.export import MEDIA_TYPES
from farside.server.pictures import decode_texture, encode_view
from farside.server.protocol import (
    BufferFree,
    CloseCode,
    FrameDone,
    PoseUpdate,
    Scene,
    SourceHello,
    Stereo,
    ViewData,
    ViewerHello,
    Welcome,
)
from support.clocks import Clock
from support.doubles import CAMERAS, Cores, FakeCore, a_view
from support.serving import run_within, running
from websockets.asyncio.client import connect as raw_connect
from websockets.exceptions import ConnectionClosed

HANG_S = 30.0
SOURCE = SourceHello("walls", 30.0, CAMERAS)
VIEWER = ViewerHello.symmetric(32, 24, 1.5)


run = partial(run_within, HANG_S)


def view(number: int, index: int, /, **changes: Any) -> ViewData:
    message = encode_view(a_view(CAMERAS[number]), index)
    fields = {name: getattr(message, name) for name in ViewData.__slots__}
    return ViewData(**(fields | changes))


async def send_frame(peer: Peer, frame: int) -> FrameDone:
    for camera in range(len(CAMERAS)):
        await peer.send(view(camera, frame))
    return await peer.receive(FrameDone)


def look(seq: int, x: float = 0.0) -> PoseUpdate:
    return PoseUpdate(seq, seq / 10, (x, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))


async def picture(peer: Peer, seq: int) -> Stereo:
    await peer.send(look(seq))
    while True:
        message = await peer.receive(Stereo, Scene)
        if isinstance(message, Stereo):
            return message


def fetch(url: str, **headers: str) -> bytes:
    with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=HANG_S) as answer:
        return answer.read()


def status(url: str) -> dict[str, Any]:
    return json.loads(fetch(f"{url}/status"))


# The server's purpose


def test_frames_in_pictures_out(url: str, cores: Cores) -> None:
    async def scenario() -> None:
        async with connect(url, VIEWER) as (viewer, welcome), connect(url, SOURCE) as (source, _):
            assert welcome.settings["n_render"] == 5
            assert await send_frame(source, 3) == FrameDone(3, "updated")
            scene = await viewer.receive(Scene)
            assert (scene.name, scene.cameras) == ("walls", 2)
            assert scene.position == pytest.approx((0.0, 0.05, 1.5))
            stereo = await picture(viewer, 11)
            assert (stereo.seq, stereo.time, stereo.frame) == (11, 1.1, 3)
            assert (stereo.position, stereo.orientation) == (look(11).position, look(11).orientation)
            assert {"warp", "total"} - set(stereo.stages) == {"total"}
            assert stereo.holes == 0.25
            for eye in (stereo.left, stereo.right):
                texture = decode_texture(eye, 24, 32)
                assert np.abs(texture.y.astype(int) - (64 + 8 * 3)).max() <= 4
        assert cores.made[0].rendered[0].left.width == 32

    run(scenario)


@pytest.mark.parametrize("held", [False, True])
def test_the_engine_of_other_cameras_is_closed_when_nothing_is_asked_of_it_any_more(
    url: str, cores: Cores, held: bool
) -> None:
    other = dataclasses.replace(SOURCE, cameras=CAMERAS[:1])

    async def scenario() -> None:
        async with connect(url, VIEWER) as (viewer, _):
            async with connect(url, SOURCE) as (source, _):
                await send_frame(source, 0)
                await picture(viewer, 0)
                if held:
                    cores.made[0].rendering.close()
                    await viewer.send(look(1))
                    await asyncio.to_thread(cores.made[0].rendering.entered.wait, HANG_S)
            for turn in range(3):
                await come_and_go(url, other if turn % 2 == 0 else SOURCE)
            if held:
                assert not cores.made[0].closed
                cores.made[0].rendering.open()
            while [core.closed for core in cores.made] != [True, True, True, False]:
                await asyncio.sleep(0.001)

    async def come_and_go(url: str, hello: SourceHello) -> None:
        while True:
            try:
                async with connect(url, hello) as (source, _):
                    for number in range(len(hello.cameras)):
                        await source.send(view(number, 0))
                    await source.receive(FrameDone)
                    return
            except RefusedError:  # the last one is not gone yet
                await asyncio.sleep(0.01)

    run(scenario)


def test_raw_pictures_are_exact(url: str) -> None:
    async def scenario() -> None:
        hello = ViewerHello.symmetric(31, 17, 1.5, encoding="raw")
        async with connect(url, SOURCE) as (source, _), connect(url, hello) as (viewer, _):
            await send_frame(source, 5)
            stereo = await picture(viewer, 0)
            assert (decode_texture(stereo.left, 17, 31).y == 64 + 8 * 5).all()

    run(scenario)


def test_openxr_poses_arrive_in_our_axes(url: str, cores: Cores) -> None:
    async def scenario() -> None:
        hello = ViewerHello.symmetric(32, 24, 1.5, axes="openxr")
        async with connect(url, SOURCE) as (source, _), connect(url, hello) as (viewer, _):
            await send_frame(source, 0)
            half = 0.5**0.5
            await viewer.send(PoseUpdate(0, 0.0, (1.0, 2.0, 3.0), (0.0, half, 0.0, half)))
            scene = await viewer.receive(Scene)
            assert scene.position == pytest.approx((-0.05, 1.5, 0.0))
            stereo = await viewer.receive(Stereo)
            assert stereo.position == (1.0, 2.0, 3.0)
            pose = cores.made[0].rendered[0].pose
            assert pose.position == (-3.0, -1.0, 2.0)
            assert pose.rotation() @ [1, 0, 0] == pytest.approx([0, 1, 0])

    run(scenario)


def test_asymmetric_eyes_reach_the_core(url: str, cores: Cores) -> None:
    async def scenario() -> None:
        hello = ViewerHello(40, 20, (1.0, 0.6, 0.5, 0.3), (0.6, 1.0, 0.5, 0.3), ipd=0.07)
        async with connect(url, SOURCE) as (source, _), connect(url, hello) as (viewer, _):
            await send_frame(source, 0)
            await picture(viewer, 0)
        left, right = cores.made[0].rendered[0].left, cores.made[0].rendered[0].right
        assert (left.fx, left.cx, left.cy) == pytest.approx((25.0, 25.0, 12.5))
        assert right.cx == pytest.approx(15.0)
        assert cores.made[0].rendered[0].ipd == 0.07

    run(scenario)


def test_a_source_leaves_and_comes_back_to_the_same_model(url: str, cores: Cores) -> None:
    async def scenario() -> None:
        for frames in ((0, 1), (0, 1, 2)):
            async with connect(url, SOURCE) as (source, _):
                for frame in frames:
                    await send_frame(source, frame)
            await settle(url)

    async def settle(url: str) -> None:
        while (await asyncio.to_thread(status, url))["source_connected"]:
            await asyncio.sleep(0.01)

    run(scenario)
    assert [core.updates for core in cores.made] == [[0, 1, 0, 1, 2]]


def test_a_moving_cameras_pose_reaches_the_core(url: str, cores: Cores) -> None:
    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, _):
            await source.send(view(1, 0, pose=Pose((5.0, 0.0, 0.0))))
            await source.send(view(0, 0, pose=None))
            assert (await source.receive(FrameDone)).outcome == "updated"

    poses: list[Any] = []
    original = FakeCore.update

    def update(self: FakeCore, frame: Any, *others: Any) -> Any:
        poses.extend(view.camera.pose.position for view in frame.views)
        return original(self, frame, *others)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FakeCore, "update", update)
        run(scenario)
    assert poses == [CAMERAS[0].pose.position, (5.0, 0.0, 0.0)]


# Over HTTP


TICK_MS = 3.0


def test_status_metrics_and_mesh(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    Clock(tick=1e-3 * TICK_MS).instead_of(monkeypatch, ingest)

    with pytest.raises(urllib.error.HTTPError) as caught:
        fetch(f"{url}/mesh.glb")
    assert caught.value.code == 409
    assert "before the first frame" in json.load(caught.value)["detail"]
    caught.value.close()

    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, _):
            await send_frame(source, 0)
            now = await asyncio.to_thread(status, url)
            assert now["source_connected"] is True
            assert now["frames"]["updated"] == 1
            assert now["event_loop"].keys() == StallMonitor(Activity()).summary().keys()
            # Each view's decoding reads the clock twice.
            assert now["stages_ms"]["ingest"] == {"p50": pytest.approx(TICK_MS), "p95": pytest.approx(TICK_MS)}

    run(scenario)
    glb = trimesh.load(io.BytesIO(fetch(f"{url}/mesh.glb")), file_type="glb", force="mesh")
    assert np.allclose(glb.bounds, [[-1, 0, -1], [0, 1, -1]])  # glTF's axes: forward is -z, left is -x
    ply = trimesh.load(io.BytesIO(fetch(f"{url}/mesh.ply")), file_type="ply")
    assert np.allclose(ply.bounds, [[1, 0, 0], [1, 1, 1]])
    for query, attribute in {"": "TEXCOORD_0", "?colours=texture": "TEXCOORD_0", "?colours=vertex": "COLOR_0"}.items():
        assert f'"{attribute}"'.encode() in fetch(f"{url}/mesh.glb{query}")
    for name, value, expected in (("glb", "sepia", "one of texture, vertex"), ("ply", "texture", "vertex for ply")):
        with pytest.raises(urllib.error.HTTPError, match="400") as caught:
            fetch(f"{url}/mesh.{name}?colours={value}")
        assert f"colours: '{value}': expected {expected}" in json.load(caught.value)["detail"]
        caught.value.close()
    metrics = fetch(f"{url}/metrics").decode()
    assert 'farside_frames_total{outcome="updated"} 1.0' in metrics
    assert f'farside_stage_ms{{quantile="0.95",stage="ingest"}} {TICK_MS}' in metrics
    for name in StallMonitor(Activity()).summary():
        assert f"\nfarside_{name} " in metrics
    for name, media in MEDIA_TYPES.items():
        with urllib.request.urlopen(f"{url}/mesh.{name}", timeout=HANG_S) as answer:
            assert answer.headers["Content-Type"] == media
            assert answer.headers["Content-Disposition"] == f'attachment; filename="background.{name}"'
    with pytest.raises(urllib.error.HTTPError, match="404") as caught:
        fetch(f"{url}/mesh.obj")
    caught.value.close()
    assert b"Farside" in fetch(f"{url}/")


# Which clients are accepted


def test_tokens() -> None:
    with running(FakeCore, token="sesame") as url:

        async def scenario() -> None:
            for hello in (VIEWER, SOURCE):
                with pytest.raises(RefusedError, match="token: none: expected the server's token"):
                    async with connect(url, hello):
                        pass
            named = SourceHello("walls", 30.0, CAMERAS, token="sesame")
            async with connect(url, named) as (source, _):
                await send_frame(source, 0)

        run(scenario)
        with pytest.raises(urllib.error.HTTPError, match="401") as caught:
            fetch(f"{url}/mesh.ply")
        caught.value.close()
        assert fetch(f"{url}/mesh.ply?token=sesame").startswith(b"ply")
        assert fetch(f"{url}/mesh.ply", Authorization="Bearer sesame").startswith(b"ply")


def test_one_source_at_a_time(url: str) -> None:
    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, _):
            with pytest.raises(RefusedError, match="source: source-1: expected no other source at a time"):
                async with connect(url, SourceHello("rival", 30.0, CAMERAS[:1])):
                    pass
            assert await send_frame(source, 0) == FrameDone(0, "updated")

    run(scenario)


def test_too_many_viewers() -> None:
    with running(FakeCore, max_viewers=1) as url:

        async def scenario() -> None:
            async with connect(url, VIEWER):
                with pytest.raises(RefusedError, match="viewers: 1: expected fewer than 1"):
                    async with connect(url, VIEWER):
                        pass

        run(scenario)


def test_who_says_nothing_is_sent_away() -> None:
    with running(FakeCore, hello_timeout_s=0.1) as url:

        async def scenario() -> None:
            async with raw_connect(base_url(url, "ws") + "/viewer") as socket:
                error = protocol.decode(await socket.recv(), protocol.Error)
                assert error.code == CloseCode.TIMEOUT
                with pytest.raises(ConnectionClosed) as caught:
                    await socket.recv()
                assert caught.value.rcvd.code == CloseCode.TIMEOUT

        run(scenario)


# Bad input: (role, messages after the greeting, close code, what the error says)

VIEWER_MAP = msgpack.unpackb(protocol.encode(VIEWER))
GOOD_POSE = msgpack.unpackb(protocol.encode(look(5)))
VIEW_MAP = msgpack.unpackb(protocol.encode(view(0, 0)))
SOURCE_MAP = msgpack.unpackb(protocol.encode(SOURCE))
RAW = {
    "view of another camera": (
        "source",
        [view(0, 0, camera="v7")],
        4404,
        "camera: v7: expected one of v0, v1",
    ),
    "the same view twice": (
        "source",
        [view(0, 0), view(0, 0)],
        4406,
        "camera: v0: expected one of v1 in frame 0",
    ),
    "a frame before the one that arrives": (
        "source",
        [view(0, 1), view(1, 0)],
        4406,
        "frame: 0: expected 1, which still lacks v1",
    ),
    "a buffer that is no number": (
        "source",
        [VIEW_MAP | {"buffer": "first"}],
        4400,
        "buffer: first: expected an integer",
    ),
    "a frame that is no number": ("source", [VIEW_MAP | {"frame": -1}], 4403, "frame: -1: expected an integer"),
    "a pose from a source": ("source", [look(0)], 4405, "type: pose: expected view here"),
    "a view from a viewer": ("viewer", [view(0, 0)], 4405, "type: view: expected pose here"),
    "a second hello": ("viewer", [VIEWER], 4405, "type: hello: expected pose here"),
    "poses out of order": ("viewer", [look(2), look(2)], 4406, "seq: 2: expected more than 2"),
    "a pose that is not a number": (
        "viewer",
        [GOOD_POSE | {"position": [0, float("nan"), 0]}],
        4403,
        "position: .*nan.*: expected 3 finite numbers",
    ),
    "an orientation of another length": (
        "viewer",
        [GOOD_POSE | {"orientation": [2, 0, 0, 0]}],
        4403,
        "orientation: .*: expected a unit quaternion",
    ),
    "no msgpack": ("viewer", [b"\xc1\xff"], 4400, "expected a msgpack map"),
    "cut short": ("viewer", [protocol.encode(look(1))[:-3]], 4400, "expected a msgpack map"),
    "text": ("viewer", ["hello"], 4400, "message: text: expected a binary message"),
    "a pose too long": (
        "viewer",
        [GOOD_POSE | {"more": bytes(1 << 17)}],
        4413,
        "bytes: expected at most 65536 bytes",
    ),
    "another version": ("none", [SOURCE_MAP | {"version": 9}], 4402, "version: 9: expected 2"),
    "the version before": ("none", [SOURCE_MAP | {"version": 1}], 4402, "version: 1: expected 2"),
    "a feature that the server lacks": (
        "none",
        [VIEWER_MAP | {"features": {"required": ["scenes"]}}],
        4410,
        "features.required: scenes: expected one of effects, queries",
    ),
    "a feature of the other role": (
        "none",
        [VIEWER_MAP | {"features": {"optional": ["scenes"], "required": ["missing_views"]}}],
        4410,
        "features.required: missing_views: expected one of effects, queries",
    ),
    "features that are no map": ("none", [VIEWER_MAP | {"features": ["scenes"]}], 4400, "features: .*: expected a map"),
    "a feature that is no text": (
        "none",
        [VIEWER_MAP | {"features": {"optional": [1]}}],
        4400,
        "features.optional: 1: expected strings of at most 100",
    ),
    "another role": ("none", [SOURCE], 4405, "role: source: expected the role of this address"),
    "no hello": ("none", [look(0)], 4405, "type: pose: expected hello here"),
}


def as_bytes(message: Any) -> bytes | str:
    if isinstance(message, bytes | str):
        return message
    return msgpack.packb(message) if isinstance(message, dict) else protocol.encode(message)


async def misbehave(url: str, role: str, messages: list[Any]) -> tuple[protocol.Error, int, str]:
    path = "/source" if role == "source" else "/viewer"
    async with raw_connect(base_url(url, "ws") + path, max_size=None) as socket:
        if role != "none":
            await socket.send(protocol.encode(SOURCE if role == "source" else VIEWER))
            protocol.decode(await socket.recv(), Welcome)
        for message in messages:
            await socket.send(as_bytes(message))
        while not isinstance(error := protocol.decode(await socket.recv()), protocol.Error):
            pass
        with pytest.raises(ConnectionClosed) as caught:
            await socket.recv()
        return error, caught.value.rcvd.code, caught.value.rcvd.reason


@pytest.mark.parametrize("case", RAW)
def test_bad_input_ends_its_own_connection_only(url: str, cores: Cores, case: str) -> None:
    role, messages, code, says = RAW[case]

    async def scenario() -> None:
        async with connect(url, VIEWER) as (viewer, _):
            async with connect(url, SOURCE) as (source, _):
                await send_frame(source, 1)
            await gone(url)
            error, closed_with, reason = await misbehave(url, role, messages)
            text = f"{error.field}: {error.value}: expected {error.expected}"
            assert (error.code, closed_with) == (code, code)
            assert re.search(says, text)
            assert text.startswith(reason[:100])
            assert (await picture(viewer, 1)).frame == 1  # the viewer continues
            await gone(url)
            async with connect(url, SOURCE) as (source, _):  # so does the next source, with the same model
                assert await send_frame(source, 2) == FrameDone(2, "updated")
        assert [core.updates for core in cores.made] == [[1, 2]]

    async def gone(url: str) -> None:
        while (await asyncio.to_thread(status, url))["source_connected"]:
            await asyncio.sleep(0.01)

    run(scenario)


def test_an_oversized_message_ends_its_connection_only() -> None:
    with running(FakeCore, max_message_bytes=1 << 16) as url:

        async def scenario() -> None:
            async with connect(url, VIEWER) as (viewer, welcome), connect(url, SOURCE) as (source, _):
                assert welcome.max_message == 1 << 16
                await send_frame(source, 0)
                await source.send_bytes(bytes((1 << 16) + 1))
                with pytest.raises(ConnectionError, match="code 1009"):
                    await source.receive(FrameDone)
                assert (await picture(viewer, 0)).frame == 0

        run(scenario)


def test_a_frame_that_the_core_refuses_ends_its_source_only(url: str, cores: Cores) -> None:
    async def scenario() -> None:
        async with connect(url, VIEWER) as (viewer, _), connect(url, SOURCE) as (source, _):
            await send_frame(source, 0)
            cores.made[0].bad_frames = {1}
            with pytest.raises(RefusedError, match="frame 1: frame: 1: expected a better one"):
                await send_frame(source, 1)
            assert (await picture(viewer, 0)).frame == 0

    run(scenario)


def test_a_renderer_that_breaks_is_told_to_its_viewer(url: str, cores: Cores) -> None:
    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, _), connect(url, VIEWER) as (viewer, _):
            await send_frame(source, 0)
            cores.made[0].fail_render = True
            with pytest.raises(ConnectionError, match=r"RuntimeError: the renderer broke.*code 4500"):
                await picture(viewer, 0)
            assert await send_frame(source, 1) == FrameDone(1, "updated")

    run(scenario)


def test_an_engine_that_is_lost_is_told_to_its_clients_and_replaced(url: str, cores: Cores) -> None:
    def lose(*asked: object) -> None:
        raise CoreLostError("the engine's process ended by SIGKILL")

    async def scenario() -> None:
        for ask in ("update", "picture"):
            async with connect(url, SOURCE) as (source, _), connect(url, VIEWER) as (viewer, _):
                await send_frame(source, 0)
                setattr(cores.made[-1], ask, lose)
                with pytest.raises(ConnectionError, match=r"CoreLostError: the engine's process ended by S.*code 4500"):
                    await (send_frame(source, 1) if ask == "update" else picture(viewer, 0))
                assert status(url)["engine"] == {"lost": "the engine's process ended by SIGKILL"}
                made = len(cores.made)
        async with connect(url, SOURCE) as (source, _), connect(url, VIEWER) as (viewer, _):
            assert len(cores.made) == made + 1
            await send_frame(source, 0)
            assert (await picture(viewer, 0)).frame == 0

    run(scenario)


# Flow control and shutdown


def test_a_source_that_ignores_its_credits_is_slowed_not_queued(url: str, cores: Cores) -> None:
    """At most three frames are in memory: one shown, one being taken, one waiting. None of them is lost."""

    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, welcome):
            await send_frame(source, 0)
            core = cores.made[0]
            core.updating.close()
            for frame in range(1, 9):
                for camera in (0, 1):
                    await source.send(view(camera, frame))
            await asyncio.to_thread(core.updating.entered.wait, HANG_S)
            core.updating.open()
            assert [await source.receive(FrameDone) for _ in range(8)] == [FrameDone(k, "updated") for k in range(1, 9)]
            assert core.updates == list(range(9))
            assert welcome.credits == 2

    run(scenario)


# Shared memory


SHARING = dataclasses.replace(SOURCE, shares=True)


def write(planes: dict[str, Planes], luma: int) -> None:
    for camera in CAMERAS:
        seen, place = a_view(camera, luma), planes[camera.name]
        for name in ("y", "cb", "cr"):
            getattr(place.texture, name)[:] = getattr(seen.texture, name)
        place.codes[:] = seen.codes


def opened(welcome: Welcome) -> list[dict[str, Planes]]:
    memory = welcome.memory
    assert memory is not None
    return [open_buffer(memory.process, file, memory.name, CAMERAS) for file in memory.files]


async def all_answers(source: Peer) -> None:
    while True:
        await source.receive(FrameDone, BufferFree)


def written(number: int, frame: int, buffer: int) -> ViewData:
    return view(number, frame, texture=None, depth=None, buffer=buffer)


def test_a_source_on_the_same_machine_writes_frames_into_the_servers_memory(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There are more frames than buffers; the core gets every frame unchanged."""
    lumas: list[set[int]] = []
    original = FakeCore.update

    def update(self: FakeCore, frame: Frame, *others: Any) -> Any:
        lumas.append({int(code) for seen in frame.views for code in seen.texture.y.flat})
        assert all((seen.codes == 20000).all() for seen in frame.views)
        return original(self, frame, *others)

    async def scenario() -> None:
        async with connect(url, SHARING) as (source, welcome):
            buffers = opened(welcome)
            assert len(buffers) == welcome.credits + 1
            free: list[int] = []
            for frame in range(2 * len(buffers)):
                while not free:
                    free.append((await source.receive(BufferFree)).number)
                buffer = free.pop()
                write(buffers[buffer], 100 + frame)
                for camera in (1, 0):
                    await source.send(written(camera, frame, buffer))
                while isinstance(message := await source.receive(FrameDone, BufferFree), BufferFree):
                    free.append(message.number)
                assert message == FrameDone(frame, "updated")

    monkeypatch.setattr(FakeCore, "update", update)
    run(scenario)
    assert lumas == [{100 + frame} for frame in range(6)]


@pytest.mark.parametrize(
    ("hello", "messages", "code", "says"),
    [
        (SOURCE, [written(0, 0, 0)], 4406, "buffer: 0: expected none"),
        (SHARING, [written(0, 0, 7)], 4406, "buffer: 7: expected a free buffer: 0, 1, 2"),
        (SHARING, [written(0, 0, 0), written(1, 0, 1)], 4406, "buffer: 1: expected 0 for all views of the frame"),
        (SHARING, [written(k, 0, 0) for k in (0, 1)] + [written(0, 1, 0)], 4406, "buffer: 0: expected a free buffer"),
    ],
    ids=["not shared", "no such buffer", "two buffers for a frame", "not given again"],
)
def test_what_is_wrong_with_shared_views_is_told(
    url: str, cores: Cores, hello: SourceHello, messages: list[ViewData], code: int, says: str
) -> None:
    async def scenario() -> None:
        async with connect(url, hello) as (source, welcome):
            if welcome.memory:
                for _ in welcome.memory.files:
                    await source.receive(BufferFree)
            cores.made[0].updating.close()
            for message in messages:
                await source.send(message)
            with pytest.raises(RefusedError, match=rf"{says}.*code {code}"):
                await all_answers(source)

    run(scenario)


def test_codes_out_of_range_in_shared_memory_leave_the_view_out(url: str) -> None:
    async def scenario() -> None:
        async with connect(url, SHARING) as (source, welcome):
            buffer = (await source.receive(BufferFree)).number
            planes = opened(welcome)[buffer]
            write(planes, 300)
            planes["v0"].texture.cr[3, 5] = 1024
            for camera in (0, 1):
                await source.send(written(camera, 0, buffer))
            while isinstance(done := await source.receive(FrameDone, BufferFree), BufferFree):
                pass
            said = "texture: texture.cr: 1024: expected codes of at most 1023"
            assert done == FrameDone(0, "updated", {"v0": said})

    run(scenario)


def test_a_source_that_shares_may_send_all_the_same(url: str) -> None:
    async def scenario() -> None:
        async with connect(url, SHARING) as (source, welcome):
            assert welcome.memory is not None
            for frame in range(7):
                for camera in (0, 1):
                    await source.send(view(camera, frame))
                while isinstance(message := await source.receive(FrameDone, BufferFree), BufferFree):
                    pass
                assert message == FrameDone(frame, "updated")

    run(scenario)


def test_memory_is_offered_to_this_machine_only(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("farside.server.ingest._on_this_machine", lambda socket: False)

    async def scenario() -> None:
        async with connect(url, SHARING) as (source, welcome):
            assert welcome.memory is None
            assert await send_frame(source, 0) == FrameDone(0, "updated")

    run(scenario)


@pytest.mark.parametrize(
    ("address", "here"),
    [
        ("127.0.0.1", True), ("::1", True), ("::ffff:127.0.0.1", True),
        ("::ffff:192.0.2.7", False), ("192.0.2.7", False), ("testclient", False), (None, False),
    ],
)  # fmt: skip
def test_which_addresses_are_this_machines(address: str | None, here: bool) -> None:
    client = None if address is None else SimpleNamespace(host=address)
    assert ingest._on_this_machine(SimpleNamespace(client=client)) is here


def test_a_server_that_stops_says_so_and_takes_its_threads_along() -> None:
    async def scenario(url: str, stop: Callable[[], None]) -> None:
        async with connect(url, VIEWER) as (viewer, _), connect(url, SOURCE) as (source, _):
            await send_frame(source, 0)
            await picture(viewer, 0)
            await asyncio.to_thread(stop)
            with pytest.raises(ConnectionError, match="closed the connection"):
                await viewer.receive(Stereo)

    context = running(FakeCore)
    url = context.__enter__()
    run(lambda: scenario(url, lambda: context.__exit__(None, None, None)))


# The client's side


def test_no_server_there() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    told: list[str] = []

    async def attempt() -> None:
        async with connect(f"127.0.0.1:{port}", VIEWER):
            pass

    with pytest.raises(ConnectionError, match=f"no server at 127.0.0.1:{port}"):
        asyncio.run(persist(attempt, 0.15, told.append, 0.05))
    assert len(told) == 1  # however often it is tried
    assert "trying again" in told[0]


def test_a_refusal_is_not_tried_again() -> None:
    calls: list[int] = []

    async def attempt() -> None:
        calls.append(1)
        raise RefusedError("no")

    with pytest.raises(RefusedError):
        asyncio.run(persist(attempt, 10.0, print))
    assert calls == [1]


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("localhost:80", "ws://localhost:80"),
        ("http://a/", "ws://a"),
        ("https://a:1/b/", "wss://a:1/b"),
        ("ws://[::1]:5", "ws://[::1]:5"),
    ],
)
def test_addresses(given: str, expected: str) -> None:
    assert base_url(given, "ws") == expected


@pytest.mark.parametrize("given", ["", "ftp://a", "http://", "http://a:notaport"])
def test_addresses_that_are_none(given: str) -> None:
    with pytest.raises(ValueError, match="expected an address like"):
        base_url(given, "ws")


def test_home_is_amid_the_cameras_level_and_looks_where_they_look() -> None:
    pose = home_pose(CAMERAS)
    assert pose.position == pytest.approx((0.0, 0.05, 1.5))
    assert pose.rotation() @ [1, 0, 0] == pytest.approx([1, 0, 0])
