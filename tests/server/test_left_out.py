"""Nothing that one camera does ends a source's connection: its view is left out of the frame, counted, named."""

from __future__ import annotations

import asyncio
import dataclasses
import json
import urllib.request
from collections.abc import Iterator
from functools import partial
from typing import Any

import msgpack
import numpy as np
import pytest
from farside.clients.connection import Peer, RefusedError, base_url, connect
from farside.engine.live.core import Source
from farside.engine.rig.camera import Pose
from farside.engine.rig.frame import Frame
from farside.server import ingest, protocol
from farside.server.pictures import encode_view
from farside.server.protocol import BufferFree, Features, FrameDone, Picture, SourceHello, ViewData, Welcome
from support.doubles import CAMERAS, Cores, FakeCore, a_view
from support.serving import run_within, running
from websockets.asyncio.client import connect as raw_connect

HANG_S = 30.0
SOURCE = SourceHello("walls", 30.0, CAMERAS)
ASKING = dataclasses.replace(SOURCE, features=Features(optional=("missing_views", "depth_layers")))
FAR_AWAY = Pose((0.0, 0.1, 900.0))


class Recorder(FakeCore):
    """A core that notes what it is given: the lumas of the views that are there, and where the cameras are."""

    def __init__(self, source: Source) -> None:
        super().__init__(source)
        self.seen: list[dict[str, int]] = []
        self.poses: list[list[Pose]] = []

    def update(self, frame: Frame, *others: Any) -> Any:
        there = [frame.views[c] for c in frame.there]
        self.seen.append({view.camera.name: int(view.texture.y.max()) for view in there})
        self.poses.append([view.camera.pose for view in there])
        return super().update(frame, *others)


@pytest.fixture
def cores() -> Cores:
    return Cores(Recorder)


@pytest.fixture
def url(cores: Cores) -> Iterator[str]:
    with running(cores) as address:
        yield address


run = partial(run_within, HANG_S)


def view(number: int, frame: int, /, **changes: Any) -> ViewData:
    return dataclasses.replace(encode_view(a_view(CAMERAS[number], 100 + frame), frame), **changes)


async def done(source: Peer) -> FrameDone:
    while isinstance(message := await source.receive(FrameDone, BufferFree), BufferFree):
        pass
    return message


def fetch(address: str) -> str:
    with urllib.request.urlopen(address, timeout=HANG_S) as answer:
        return answer.read().decode()


async def left_out(url: str) -> dict[str, dict[str, int]]:
    return json.loads(await asyncio.to_thread(fetch, f"{url}/status"))["left_out"]


# What may be wrong with a view: message, reason, what is said

FLAT = Picture("raw", (b"\0" * 10, b"", b""))
DAMAGED: dict[str, tuple[ViewData | dict[str, Any], str, str]] = {
    "another size": (view(1, 1, width=25), "size", "resolution: 25x16: expected 24x16, as announced for v1"),
    "no JPEG": (
        view(1, 1, texture=Picture("jpeg", (b"\xff\xd8\xff\xe0" + bytes(300),))), "texture",
        "texture: 304 bytes: expected a JPEG picture",
    ),
    "a plane cut short": (view(1, 1, texture=FLAT), "texture", "texture.y: 10 bytes: expected 768 for 24x16"),
    "depth cut short": (
        view(1, 1, depth=protocol.DepthData("raw", bytes(767))), "depth", "depth.data: 767 bytes: expected 768",
    ),
    "depth that does not inflate": (
        view(1, 1, depth=protocol.DepthData("zlib", b"junk")), "depth", "depth.data: Error -3",
    ),
    "a code out of range": (
        view(1, 1, texture=Picture("raw", (b"\xff" * 768, bytes(192), bytes(192)))), "texture",
        "texture.y: 65535: expected codes of at most 1023",
    ),
    "no texture": (msgpack.unpackb(protocol.encode(view(1, 1))) | {"texture": None}, "texture", "expected a map"),
    "a pose of no numbers": (
        msgpack.unpackb(protocol.encode(view(1, 1)))
        | {"pose": {"position": [float("-inf")] * 3, "orientation": [float("nan")] * 4}},
        "pose", "pose.position: [-inf, -inf, -inf]: expected 3 finite numbers",
    ),
    "a pose that jumps": (view(1, 1, pose=FAR_AWAY), "pose", "jumps by 898 m"),
    "missing, says the source": (ViewData.without(1, "v1", missing=True), "missing", "the source has no picture"),
}  # fmt: skip


@pytest.mark.parametrize("case", DAMAGED)
@pytest.mark.parametrize("hello", [SOURCE, ASKING], ids=["not asked", "asked"])
def test_a_bad_view_is_left_out_of_its_frame_and_its_camera_comes_back(
    url: str, cores: Cores, hello: SourceHello, case: str, caplog: pytest.LogCaptureFixture
) -> None:
    message, reason, says = DAMAGED[case]
    data = msgpack.packb(message) if isinstance(message, dict) else protocol.encode(message)

    async def scenario() -> None:
        async with connect(url, hello) as (source, welcome):
            assert welcome.features == (("missing_views",) if hello is ASKING else ())
            for frame in (0, 1, 2):
                await source.send(view(0, frame))
                await source.send_bytes(data if frame == 1 else protocol.encode(view(1, frame)))
                outcome = await done(source)
                assert (outcome.frame, outcome.outcome) == (frame, "updated")
                if frame == 1:
                    assert list(outcome.left_out) == ["v1"]
                    assert outcome.left_out["v1"].startswith(f"{reason}: ")
                    assert says in outcome.left_out["v1"]
                else:
                    assert outcome.left_out == {}
            assert await left_out(url) == {"v1": {reason: 1}}
            metrics = await asyncio.to_thread(fetch, f"{url}/metrics")
            assert f'farside_views_left_out_total{{camera="v1",reason="{reason}"}} 1.0' in metrics

    run(scenario)
    (core,) = cores.made
    assert core.seen == [{"v0": 100, "v1": 100}, {"v0": 101}, {"v0": 102, "v1": 102}]
    said = [record.getMessage() for record in caplog.records if "left out of frame" in record.getMessage()]
    assert len(said) == 1
    assert says in said[0]


def test_a_frame_ends_when_the_next_one_begins(url: str, cores: Cores) -> None:
    """What comes of it afterwards is ignored; the camera is back in the next frame."""

    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, _):
            for camera, frame in ((0, 0), (1, 0), (0, 1), (0, 2), (1, 1), (1, 2), (1, 3), (0, 3)):
                await source.send(view(camera, frame))
            outcomes = sorted([await done(source) for _ in range(4)], key=lambda outcome: outcome.frame)
            assert [outcome.frame for outcome in outcomes] == [0, 1, 2, 3]
            assert [outcome.left_out for outcome in outcomes] == [{}, {"v1": "missing: no view came"}, {}, {}]
            assert await left_out(url) == {"v1": {"missing": 1}}

    run(scenario)


def test_a_frame_ends_when_its_source_sends_nothing_more(
    url: str, cores: Cores, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A source that waits for the outcome of each frame, and one camera of which has failed, goes on."""
    monkeypatch.setattr(ingest, "PATIENCE_S", 0.05)

    async def scenario() -> None:
        async with connect(url, dataclasses.replace(SOURCE, fps=1000.0)) as (source, _):
            for frame in (0, 1, 2):
                for camera in (0, 1) if frame != 1 else (1,):
                    await source.send(view(camera, frame))
                assert (await done(source)).left_out == ({} if frame != 1 else {"v0": "missing: no view came"})
                if frame == 1:
                    await source.send(view(0, frame))  # too late, and no error

    run(scenario)
    assert cores.made[0].seen == [{"v0": 100, "v1": 100}, {"v1": 101}, {"v0": 102, "v1": 102}]


def test_a_frame_that_is_still_arriving_does_not_end(url: str, cores: Cores, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its last view takes longer than the server's patience, but parts of it keep coming."""
    monkeypatch.setattr(ingest, "PATIENCE_S", 0.2)

    async def scenario() -> None:
        address = base_url(url, "ws") + "/source"
        async with raw_connect(address, max_size=None, ping_interval=None) as socket:
            await socket.send(protocol.encode(dataclasses.replace(SOURCE, fps=1000.0)))
            protocol.decode(await socket.recv(), Welcome)
            await socket.send(protocol.encode(view(0, 0)))
            data = protocol.encode(view(1, 0))

            async def slowly() -> Any:
                for start in range(0, len(data), len(data) // 9):
                    yield data[start : start + len(data) // 9]
                    await asyncio.sleep(0.1)

            await socket.send(slowly())
            assert protocol.decode(await socket.recv()) == FrameDone(0, "updated")

    run(scenario)


def test_a_source_whose_views_are_all_missing_changes_nothing(url: str, cores: Cores) -> None:
    async def scenario() -> None:
        async with connect(url, ASKING) as (source, _):
            for frame in (0, 1):
                for camera in (0, 1):
                    await source.send(ViewData.without(frame, f"v{camera}", missing=True))
                outcome = await done(source)
                assert outcome.outcome == "dropped"
                assert list(outcome.left_out) == ["v1", "v0"] or list(outcome.left_out) == ["v0", "v1"]
            assert (await left_out(url))["v0"] == {"missing": 2}
            for camera in (0, 1):
                await source.send(view(camera, 2))
            assert await done(source) == FrameDone(2, "updated")

    run(scenario)
    assert cores.made[0].updates == [2]


def test_a_camera_that_has_been_put_elsewhere_is_believed_in_the_next_frame(url: str, cores: Cores) -> None:
    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, _):
            for frame in range(4):
                pose = CAMERAS[1].pose if frame == 0 else FAR_AWAY
                await source.send(view(0, frame))
                await source.send(view(1, frame, pose=pose))
                assert list((await done(source)).left_out) == (["v1"] if frame == 1 else [])

    run(scenario)
    assert [poses[-1] for poses in cores.made[0].poses] == [CAMERAS[1].pose, CAMERAS[0].pose, FAR_AWAY, FAR_AWAY]


def test_shared_memory_frames_may_lack_views(url: str, cores: Cores) -> None:
    """Buffers of such frames come back: there are more frames than buffers."""

    async def scenario() -> None:
        async with connect(url, dataclasses.replace(ASKING, shares=True)) as (source, welcome):
            assert welcome.memory is not None
            free: list[int] = []
            for frame in range(3 * len(welcome.memory.files)):
                while not free:
                    free.append((await source.receive(BufferFree)).number)
                buffer = free.pop()
                shared = {"texture": None, "depth": None, "buffer": buffer}
                await source.send(ViewData.without(frame, "v0", buffer, missing=True))
                await source.send(view(1, frame, **shared))
                while isinstance(message := await source.receive(FrameDone, BufferFree), BufferFree):
                    free.append(message.number)
                assert message.left_out == {"v0": "missing: the source has no picture of it"}

    run(scenario)
    assert [list(seen) for seen in cores.made[0].seen] == [["v1"]] * 9


def test_an_unknown_camera_is_still_an_error(url: str) -> None:
    async def scenario() -> None:
        async with connect(url, ASKING) as (source, _):
            await source.send(ViewData.without(0, "v7", missing=True))
            with pytest.raises(RefusedError, match=r"camera: v7: expected one of v0, v1 .*4404"):
                await done(source)

    run(scenario)


@pytest.mark.parametrize("damage", ["decoding", "waiting"])
def test_a_damaged_view_keeps_no_buffer(url: str, cores: Cores, damage: str) -> None:
    """There are many more damaged frames than buffers."""
    bad = {"texture": FLAT} if damage == "decoding" else {"width": 0}

    async def scenario() -> None:
        async with connect(url, SOURCE) as (source, _):
            for frame in range(20):
                await source.send(view(0, frame))
                await source.send(view(1, frame, **bad))
                assert list((await done(source)).left_out) == ["v1"]

    run(scenario)
    assert np.array_equal(cores.made[0].updates, np.arange(20))
