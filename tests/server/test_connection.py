"""Peers that stop reading, or send more than anybody may, do not keep the server's places and memory."""

from __future__ import annotations

import asyncio
import gc
import os
import socket
import struct
from collections.abc import AsyncIterator, Collection
from contextlib import ExitStack, asynccontextmanager, closing
from functools import partial
from urllib.parse import urlsplit

import pytest
from farside.clients.connection import RefusedError, base_url, connect
from farside.engine.rig.camera import Camera, Perspective, Pose
from farside.server import connection, poses
from farside.server.pictures import encode_view
from farside.server.protocol import MAX_HELLO_BYTES, PoseUpdate, SourceHello, ViewerHello, Welcome, decode, encode
from support.doubles import CAMERAS, CODING, HANG_S, FakeCore, a_view
from support.serving import run_within, running
from websockets.asyncio.client import connect as raw_connect
from websockets.client import ClientProtocol
from websockets.exceptions import ConnectionClosed
from websockets.frames import Frame
from websockets.uri import parse_uri

SOURCE = SourceHello("walls", 30.0, CAMERAS)
VIEWER = ViewerHello.symmetric(32, 24, 1.5)
LARGE = ViewerHello.symmetric(2048, 2048, 1.5, encoding="raw")  # a pair takes 25 MB


run = partial(run_within, 2 * HANG_S)


@asynccontextmanager
async def playing(url: str) -> AsyncIterator[None]:
    """While a source has sent a frame."""
    async with connect(url, SOURCE) as (source, _):
        for camera in CAMERAS:
            await source.send(encode_view(a_view(camera), 0))
        yield


async def let_in(url: str) -> None:
    """Returns once a viewer is welcome."""
    while True:
        try:
            async with connect(url, VIEWER):
                return
        except RefusedError:
            await asyncio.sleep(0.01)


class Mute:
    """A client on a bare socket that never reads, hence answers no ping."""

    def __init__(self, url: str, path: str) -> None:
        parts = urlsplit(url)
        self._socket = socket.create_connection((parts.hostname, parts.port))
        self._protocol = ClientProtocol(parse_uri(base_url(url, "ws") + path))
        self._protocol.send_request(self._protocol.connect())
        self._flush()
        answer = b""
        while b"\r\n\r\n" not in answer:
            answer += self._socket.recv(1)
        self._protocol.receive_data(answer)

    def _flush(self) -> None:
        for data in self._protocol.data_to_send():
            self._socket.sendall(data)

    def send(self, message: bytes) -> None:
        self._protocol.send_binary(message)
        self._flush()

    def send_raw(self, data: bytes) -> None:
        self._socket.sendall(data)

    def flood(self, data: bytes) -> None:
        """Send the same without end; raises ConnectionError when the server has cut the connection."""
        while True:
            self._socket.sendall(data)

    def say_goodbye(self) -> None:
        self._protocol.send_close(1000)
        self._flush()

    def half_close(self) -> None:
        self._socket.shutdown(socket.SHUT_WR)

    def received(self) -> bytes:
        """All that came until the end."""
        found = b""
        self._socket.settimeout(HANG_S)
        while part := self._socket.recv(1 << 16):
            found += part
        return found

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody is waited for longer than a moment."""
    monkeypatch.setattr(connection, "STALL_S", 0.3)


@pytest.mark.usefixtures("impatient")
def test_a_viewer_that_stops_reading_loses_its_place() -> None:
    with running(FakeCore, max_viewers=1) as url, closing(Mute(url, "/viewer")) as mute:

        async def scenario() -> None:
            async with playing(url):
                mute.send(encode(LARGE))
                for seq in range(5):
                    mute.send(encode(PoseUpdate(seq, 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))))
                    await asyncio.sleep(0.05)
                await let_in(url)

        run(scenario)


def test_the_server_ends_in_order_while_what_a_viewer_left_unread_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "STALL_S", 3.0)

    async def scenario() -> None:
        with ExitStack() as served:
            url = served.enter_context(running(FakeCore, max_viewers=2))
            with closing(Mute(url, "/viewer")) as mute:
                async with raw_connect(base_url(url, "ws") + "/viewer") as viewer:
                    await viewer.send(encode(VIEWER))
                    mute.send(encode(LARGE))
                    async with playing(url):
                        mute.send(encode(PoseUpdate(0, 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))))
                        await asyncio.sleep(0.5)  # until what it does not read fills the buffers
                    mute.say_goodbye()
                    await let_in(url)
                    await asyncio.to_thread(served.close)
                    with pytest.raises(ConnectionClosed, match="1012"):
                        _earlier = [message async for message in viewer]

    run(scenario)


def test_a_viewer_that_reads_slowly_keeps_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connection, "STALL_S", 1.0)

    async def scenario() -> None:
        with running(FakeCore, max_viewers=1) as url:
            async with playing(url), raw_connect(base_url(url, "ws") + "/viewer", max_queue=1, max_size=None) as viewer:
                await viewer.send(encode(LARGE))
                await viewer.send(encode(PoseUpdate(0, 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))))
                received, transport = 0, viewer.transport
                while received < 20 << 20:  # read a little at a time: the server waits longer than it would for nothing
                    transport.pause_reading()
                    await asyncio.sleep(0.1)
                    transport.resume_reading()
                    received += len(await viewer.recv())

    run(scenario)


def test_a_viewer_that_answers_no_ping_loses_its_place(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(poses, "PING_S", 0.05)
    monkeypatch.setattr(poses, "PONG_S", 0.2)
    with running(FakeCore, max_viewers=1) as url, closing(Mute(url, "/viewer")) as mute:
        mute.send(encode(VIEWER))  # nothing is on: nothing but pings is sent

        run(lambda: let_in(url))


@pytest.mark.usefixtures("impatient")
def test_a_client_that_is_refused_and_does_not_read_is_cut_off() -> None:
    with running(FakeCore) as url, closing(Mute(url, "/viewer")) as mute:
        mute.send(encode(SOURCE))  # at the wrong address
        assert b"expected the role of this address" in mute.received()


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("path", ["/viewer", "/source"])
@pytest.mark.parametrize("greeted", [True, False])
def test_who_pings_and_does_not_read_the_answers_is_cut_off(path: str, greeted: bool) -> None:
    pings = Frame(9, b"x" * 125).serialize(mask=True) * 500
    with running(FakeCore, hello_timeout_s=HANG_S) as url, closing(Mute(url, path)) as mute:
        if greeted:
            mute.send(encode(SOURCE if path == "/source" else VIEWER))
        with pytest.raises(ConnectionError):
            mute.flood(pings)
        if path == "/source":
            run(lambda: come_again(url))


async def come_again(url: str) -> None:
    """Returns once a source is welcome."""
    while True:
        try:
            async with playing(url):
                return
        except RefusedError:
            await asyncio.sleep(0.01)


@pytest.mark.usefixtures("impatient")
def test_who_sends_no_more_and_does_not_read_is_cut_off() -> None:
    with running(FakeCore, max_viewers=1) as url, closing(Mute(url, "/viewer")) as mute:

        async def scenario() -> None:
            async with playing(url):
                mute.send(encode(LARGE))
                mute.send(encode(PoseUpdate(0, 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))))
                await asyncio.sleep(0.1)
                mute.half_close()
                await let_in(url)

        run(scenario)


def test_a_message_of_endless_fragments_ends_its_connection() -> None:
    part = Frame(0, b"", fin=False).serialize(mask=True) * 1000
    with running(FakeCore, hello_timeout_s=HANG_S) as url, closing(Mute(url, "/viewer")) as mute:
        mute.send_raw(Frame(2, b"", fin=False).serialize(mask=True))
        with pytest.raises(ConnectionError):
            mute.flood(part)


# What clients that nobody knows can make the server keep


@pytest.mark.parametrize(("path", "most"), [("/viewer", 1 << 16), ("/source", MAX_HELLO_BYTES)])
@pytest.mark.parametrize("whole", [True, False])
def test_a_hello_that_is_too_long_is_refused_as_soon_as_its_length_is_known(path: str, most: int, whole: bool) -> None:
    with running(FakeCore, hello_timeout_s=HANG_S) as url, closing(Mute(url, path)) as mute:
        if whole:
            mute.send_raw(b"\x82\xff" + struct.pack(">Q", most + 1) + bytes(4))  # nothing of it follows
        else:
            part = Frame(2, bytes(most // 2), fin=False), Frame(0, bytes(most // 2), fin=False), Frame(0, b"\0\0")
            for frame in part:
                mute.send_raw(frame.serialize(mask=True))
        assert struct.pack(">H", 1009) in mute.received()


def test_a_rig_as_large_as_the_protocol_allows_is_let_in() -> None:
    projection = Perspective(24, 16, 20.123456789, 20.123456789, 12.123456789, 8.123456789)
    cameras = tuple(
        Camera(f"{i:03}" + "é" * 97, projection, Pose((0.1 * i, 0.1, 1.5), (0.5, 0.5, 0.5, 0.5)), CODING)
        for i in range(256)
    )
    hello = SourceHello("n" * 200, 29.97, cameras, "t" * 200)
    assert 1 << 16 < len(encode(hello)) <= MAX_HELLO_BYTES

    async def scenario() -> None:
        with running(FakeCore) as url:
            async with connect(url, hello) as (_, welcome):
                assert welcome.max_message == 64 << 20

    run(scenario)


def test_who_has_been_greeted_may_send_what_was_announced() -> None:
    async def scenario() -> None:
        with running(FakeCore, max_message_bytes=1 << 20) as url:
            async with raw_connect(base_url(url, "ws") + "/source", max_size=None) as source:
                await source.send(encode(SOURCE))
                assert decode(await source.recv(), Welcome).max_message == 1 << 20
                await source.send(bytes((1 << 20) + 1))
                with pytest.raises(ConnectionClosed) as caught:
                    await source.recv()
                assert caught.value.rcvd is not None
                assert caught.value.rcvd.code == 1009

    run(scenario)


# Sources that leave in the middle of a frame


def frame_files(earlier: Collection[str] = ()) -> list[str]:
    """The memory for frames that this process has open, except for `earlier` tests' (their names differ)."""
    found = []
    for name in os.listdir("/proc/self/fd"):
        try:
            found.append(os.readlink(f"/proc/self/fd/{name}"))
        except OSError:
            continue  # closed meanwhile
    return [path for path in found if path.startswith("/memfd:farside-") and path not in earlier]


@pytest.mark.parametrize("views", [0, 1, 2, 3])
def test_a_source_that_leaves_in_mid_frame_leaves_no_memory_behind(views: int) -> None:
    earlier = frame_files()

    async def scenario() -> None:
        with running(FakeCore) as url:
            for turn in range(15):
                async with connect(url, SOURCE) as (source, _):
                    for k in range(views):
                        await source.send(encode_view(a_view(CAMERAS[k % 2]), turn + k // 2))
            # The frame that is shown last may be kept; the others are gone as soon as their connections have ended.
            while len(frame_files(earlier)) > 3:
                await asyncio.sleep(0.01)
        while frame_files(earlier):
            gc.collect()  # nothing else is done here any more that would bring it about
            await asyncio.sleep(0.01)

    run(scenario)
