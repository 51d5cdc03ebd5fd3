"""POST /query of a real server: by JSON and msgpack, while a source plays, with limits, and with what is wrong."""

from __future__ import annotations

import asyncio
import json
import math
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any, ClassVar

import httpx
import msgpack
import numpy as np
import pytest
from farside.clients.connection import connect
from farside.engine.compiling.pool import Progress
from farside.engine.live.core import CoreLostError, LocalCore, Source, make_local_core
from farside.engine.live.core_process import ProcessCore
from farside.engine.rig.frame import Frame
from farside.engine.rig.questions import NoModelError
from farside.engine.settings import Settings
from farside.server.pictures import encode_view
from farside.server.protocol import BufferFree, FrameDone, PoseUpdate, Scene, SourceHello, Stereo, ViewerHello
from farside.server.queries import JSON_BYTES
from support.doubles import CAMERAS, FakeCore, Gate, a_view
from support.rooms import WALL_X, camera_row, frame
from support.serving import running

RIG = tuple(camera_row(2))
TIMEOUT_S = 120.0
AHEAD: dict[str, Any] = {"query": "rays", "origins": [[0.0, 0.0, 0.0]], "directions": [[3.0, 0.0, 0.0]]}
JSON, PACKED = {"content-type": "application/json"}, {"content-type": "application/x-msgpack"}


def make_core(source: Source) -> ProcessCore:
    """An engine in a process of its own."""
    return ProcessCore(make_local_core, source.cameras, Settings(n_init=2, n_update=1))


async def play(url: str, ended: Callable[[], bool], pace: Callable[[Frame], Any] = lambda seen: None) -> None:
    """Plays frames of a room in which someone walks to and fro, until `ended()`."""
    async with connect(url, SourceHello("room", 30.0, RIG)) as (source, _welcome):
        index = 0
        while index == 0 or not ended():
            seen = frame(index, RIG, box_y=None if index == 0 else math.sin(index), half=0.2)
            for view in seen.views:
                await source.send(encode_view(view, index))
            while not isinstance(await source.receive(FrameDone, BufferFree), FrameDone):
                pass
            pace(seen)
            index += 1


@pytest.fixture(scope="module")
def url() -> Iterator[str]:
    """A server with a source that plays all the time."""
    ended, begun = threading.Event(), threading.Event()
    with running(make_core, max_queries=20_000, max_query_bytes=1 << 20) as address:
        thread = threading.Thread(target=asyncio.run, args=(play(address, ended.is_set, lambda seen: begun.set()),))
        thread.start()
        try:
            assert begun.wait(TIMEOUT_S)
            yield address
        finally:
            ended.set()
            thread.join()


def ask(url: str, fields: Any, **options: Any) -> httpx.Response:
    return httpx.post(f"{url}/query", json=fields, timeout=TIMEOUT_S, trust_env=False, **options)


def ask_packed(url: str, fields: Mapping[str, Any]) -> dict[str, Any]:
    data = {name: value.tobytes() if isinstance(value, np.ndarray) else value for name, value in fields.items()}
    answer = httpx.post(
        f"{url}/query", content=msgpack.packb(data), headers=PACKED, timeout=TIMEOUT_S, trust_env=False
    )
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == "application/x-msgpack"
    unpacked: dict[str, Any] = msgpack.unpackb(answer.content)
    return unpacked


def test_a_ray_hits_the_wall_and_one_beside_it_nothing(url: str) -> None:
    asked = AHEAD | {"origins": [[0, 0, 0], [0.0, 0.0, 0.0]], "directions": [[3, 0, 0], [-1.0, 0.0, 0.0]]}
    answer = ask(url, asked)
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/json")
    found = answer.json()
    assert set(found) == {"hit", "distances", "points", "normals", "ages", "frame"}
    assert found["hit"] == [True, False]
    assert found["distances"][0] == pytest.approx(WALL_X, abs=5e-3)
    assert found["points"][0] == pytest.approx([WALL_X, 0.0, 0.0], abs=5e-3)
    assert found["normals"][0] == pytest.approx([-1.0, 0.0, 0.0], abs=0.05)
    assert found["distances"][1] is None
    assert found["points"][1] == [None] * 3
    assert found["ages"][0] >= 0
    assert found["ages"][1] == -1
    assert ask(url, AHEAD | {"far": 3.0}).json()["hit"] == [False]
    assert ask(url, AHEAD | {"far": [5.0], "farthest": True}).json()["hit"] == [True]


def test_other_questions_are_answered(url: str) -> None:
    free = ask(url, AHEAD | {"query": "free", "far": 3.0}).json()
    assert free == {"free": [True]}
    near = ask(url, {"query": "closest", "points": [[WALL_X - 0.5, 0.1, 0.0], [-90.0, 0.0, 0.0]], "within": 1.0}).json()
    assert near["hit"] == [True, False]
    assert near["points"][0] == pytest.approx([WALL_X, 0.1, 0.0], abs=0.02)
    spheres = {"query": "overlaps", "centres": [[WALL_X, 0.0, 0.0], [0.0, 0.0, 0.0]], "radii": [0.3, 0.3], "listed": 1}
    touched = ask(url, spheres).json()
    assert touched["counts"][0] >= 1
    assert touched["counts"][1] == 0
    assert np.array(touched["corners"][0], float)[..., 0] == pytest.approx(np.full((1, 3), WALL_X), abs=0.02)
    assert touched["corners"][1] == [[[None] * 3] * 3]


@pytest.mark.parametrize("floats", ["float32", "float64"])
def test_many_rays_come_and_go_as_binary_data(url: str, floats: str) -> None:
    ways = np.array([1.0, 0.0, 0.0]) + np.random.default_rng(0).uniform(-0.3, 0.3, (15_000, 3)) * [0, 1, 1]
    fields = {"query": "rays", "floats": floats, "directions": ways.astype(floats)}
    fields["origins"] = np.zeros_like(ways, floats)
    found = ask_packed(url, fields)
    distances = np.frombuffer(found["distances"], np.float32)
    points = np.frombuffer(found["points"], floats).reshape(-1, 3)
    assert len(distances) == len(points) == len(ways)
    hit = np.frombuffer(found["hit"], np.uint8) != 0
    assert hit.mean() > 0.99
    expected = WALL_X * np.linalg.norm(ways, axis=1)
    assert np.median(np.abs(distances - expected)[hit]) < 5e-3
    assert np.abs(points[hit, 0] - WALL_X).max() < 0.1
    assert np.frombuffer(found["normals"], np.float32).shape == (3 * len(ways),)
    assert np.frombuffer(found["ages"], np.int32).min() >= -1
    limited = ask_packed(url, fields | {"far": np.full(len(ways), 3.0, floats)})
    assert not np.frombuffer(limited["hit"], np.uint8).any()


def test_answers_are_of_newer_frames_as_the_source_plays_on(url: str) -> None:
    first = ask(url, AHEAD).json()["frame"]
    for _ in range(2000):
        if ask(url, AHEAD).json()["frame"] > first + 3:
            return
    pytest.fail("no newer frame")


def body(**changes: Any) -> dict[str, Any]:
    return {name: value for name, value in (AHEAD | changes).items() if value is not None}


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ([], "body: list: expected a map"),
        ({}, "query: None: expected one of rays, free, closest, overlaps"),
        (body(query="spheres"), "query: 'spheres': expected one of rays"),
        (body(query=["rays"]), "query: ['rays']: expected one of rays"),
        (body(floats="float16"), "floats: 'float16': expected float32 or float64"),
        (body(radius=1), "'radius': unknown: expected one of query, floats, origins, directions, far, farthest"),
        (body(origins=None), "origins: missing: expected [n, 3]"),
        (body(origins=5), "origins: 5: expected [n, 3]"),
        (body(origins=[0.0, 0.0, 0.0]), "origins[0]: 0.0: expected 3 numbers"),
        (body(origins=[[0.0, 0.0]]), "origins[0]: [0.0, 0.0]: expected 3 numbers"),
        (body(origins=[["0", "0", "0"]]), "origins[0]: ['0', '0', '0']: expected 3 numbers"),
        (body(origins=[[True, 0, 0]]), "origins[0]: [True, 0, 0]: expected 3 numbers"),
        (body(origins=[[0, 0, None]]), "origins[0]: [0, 0, None]: expected 3 numbers"),
        (body(origins=[[10**400, 0, 0]]), "origins: int too large to convert to float: expected numbers"),
        (body(origins=[[1e7, 0, 0]]), "origins: [0] = [10000000.0, 0.0, 0.0]: expected metres from -1e+06 to 1e+06"),
        (body(directions=[[0, 0, 0]]), "directions: [0] = [0.0, 0.0, 0.0]: expected finite numbers, not all 0"),
        (body(directions=[[1, 0, 0]] * 2), "directions: [2, 3]: expected [1, 3], as many as origins"),
        (body(far=0), "far: 0.0: expected metres above 0"),
        (body(far="far"), "far: 'far': expected a number above 0, or [n] of them"),
        (body(far=[1.0, 2.0]), "far: [2]: expected one number or [1]"),
        (body(farthest=1), "farthest: 1: expected true or false"),
        ({"query": "closest", "points": [[0, 0, 0]], "within": -1}, "within: -1.0: expected metres above 0"),
        ({"query": "overlaps", "centres": [[0, 0, 0]]}, "radii: missing: expected a number above 0"),
        ({"query": "overlaps", "centres": [[0, 0, 0]], "radii": 1, "listed": 99}, "listed: 99: expected an integer"),
        ({"query": "overlaps", "centres": [[0, 0, 0]], "radii": 1, "listed": 1.5}, "listed: 1.5: expected an integer"),
    ],
)
def test_what_cannot_be_asked_is_refused_by_name(url: str, fields: Any, message: str) -> None:
    answer = ask(url, fields)
    assert answer.status_code == 422
    assert answer.json()["detail"].startswith(message)


@pytest.mark.parametrize(
    ("content", "headers", "message"),
    [
        (b"{", JSON, "body: JSONDecodeError"),
        (b"\xff", JSON, "body: UnicodeDecodeError"),
        (b"[" * 100_000, JSON, "body: RecursionError"),
        (json.dumps(AHEAD | {"far": math.nan}).encode(), JSON, "far: nan: expected a number above 0"),
        (json.dumps(AHEAD | {"origins": [[math.nan, 0, 0]]}).encode(), JSON, "origins: [0] = [nan, 0.0, 0.0]"),
        (json.dumps(AHEAD | {"directions": [[1, 0, math.inf]]}).encode(), JSON, "directions: [0] = [1.0, 0.0, inf]"),
        (b"\xc1", PACKED, "body: ValueError"),
        (msgpack.packb(AHEAD | {"origins": bytes(13)}), PACKED, "origins: 13 bytes: expected a multiple of 12"),
        (msgpack.packb(AHEAD | {"far": bytes(5)}), PACKED, "far: 5 bytes: expected a multiple of 4, float32 [n]"),
        (
            msgpack.packb(AHEAD | {"origins": np.full(3, math.nan, "f4").tobytes()}), PACKED,
            "origins: [0] = [nan, nan, nan]: expected metres",
        ),
    ],
)  # fmt: skip
def test_damaged_bodies_are_refused(url: str, content: bytes, headers: dict[str, str], message: str) -> None:
    answer = httpx.post(f"{url}/query", content=content, headers=headers, timeout=TIMEOUT_S, trust_env=False)
    assert answer.status_code == 422
    assert answer.json()["detail"].startswith(message)


def test_too_much_at_once_is_refused_with_the_limit(url: str) -> None:
    def post(content: Any, headers: dict[str, str]) -> tuple[int, str]:
        answer = httpx.post(f"{url}/query", content=content, headers=headers, timeout=TIMEOUT_S, trust_env=False)
        return answer.status_code, answer.json()["detail"]

    many = np.ones((20_001, 3), np.float32).tobytes()
    assert post(msgpack.packb(AHEAD | {"origins": many, "directions": many}), PACKED) == (
        413, "origins: 20001 items: expected at most 20000",
    )  # fmt: skip
    assert post(bytes((1 << 20) + 1), PACKED) == (413, "body: 1048577 bytes: expected at most 1048576")
    assert post(bytes(JSON_BYTES + 1), JSON) == (413, f"body: {JSON_BYTES + 1} bytes: expected at most {JSON_BYTES}")
    status, detail = post(iter([bytes(1 << 19)] * 3), PACKED)  # without a length
    assert (status, detail) == (413, "body: more than 1048576 bytes: expected at most 1048576")


def test_content_of_another_type_is_refused(url: str) -> None:
    answer = httpx.post(f"{url}/query", content=b"{}", headers={"content-type": "text/plain"}, trust_env=False)
    assert answer.status_code == 415
    assert answer.json()["detail"] == "content-type: text/plain: expected application/json or application/x-msgpack"
    assert httpx.get(f"{url}/query", trust_env=False).status_code == 405


def test_foreign_pages_may_not_ask(url: str) -> None:
    assert ask(url, AHEAD, headers={"origin": "http://evil.example"}).status_code == 403
    assert ask(url, AHEAD, headers={"host": "evil.example"}).status_code == 403
    assert ask(url, AHEAD, headers={"origin": url}).status_code == 200


def test_pages_that_are_allowed_may_ask() -> None:
    origin = "https://friend.example"
    with running(FakeCore, allowed_origins=origin) as url:
        headers = {"origin": origin, "access-control-request-method": "POST"}
        headers["access-control-request-headers"] = "content-type"
        answer = httpx.options(f"{url}/query", headers=headers, trust_env=False)
        assert (answer.status_code, answer.headers["access-control-allow-origin"]) == (200, origin)
        answer = ask(url, AHEAD, headers={"origin": origin})
        assert (answer.status_code, answer.headers["access-control-allow-origin"]) == (409, origin)


def test_nothing_is_asked_before_a_source_plays_or_without_the_token() -> None:
    with running(FakeCore, token="sesame") as url:
        assert ask(url, AHEAD).status_code == 401
        answer = ask(url, AHEAD, headers={"authorization": "Bearer sesame"})
        assert answer.status_code == 409
        assert answer.json()["detail"].startswith("model: there is none before the first frame")


class Compiling:
    """Kernels of which those of the model are still being compiled."""

    progress, first = Progress(300, 333), Progress(8, 8)

    def start(self) -> None:
        pass

    stop = start


class Unmodelled(FakeCore):
    def query(self, question: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        raise NoModelError("model: there is none before the first frame: expected a source to be playing")

    def mesh(self, *given: Any) -> bytes:
        raise NoModelError("mesh: there is none before the first frame: expected one to be taken")


def test_while_its_kernels_are_compiled_the_answer_is_why_there_is_no_model() -> None:
    with running(Unmodelled, Compiling()) as url:
        answers: list[httpx.Response] = []

        async def ask_both() -> None:
            answers.append(await asyncio.to_thread(ask, url, AHEAD))
            answers.append(await asyncio.to_thread(httpx.get, f"{url}/mesh.glb", trust_env=False))

        asyncio.run(with_frame(url, ask_both))
        done = "kernels for it are being compiled: 300 of 333"
        expected = f"model: there is none yet: {done}: expected a request after that"
        assert [(answer.status_code, answer.json()["detail"]) for answer in answers] == 2 * [(409, expected)]


def test_a_server_without_a_model_says_so() -> None:
    def make(source: Source) -> LocalCore:
        return make_local_core(source.cameras, Settings(background=False))

    with running(make) as url:
        async def scenario() -> None:
            asked = asyncio.Event()
            answers = []

            def pace(seen: Frame) -> None:
                answers.append(ask(url, AHEAD))
                asked.set()

            await play(url, asked.is_set, pace)
            assert answers[0].status_code == 409

        asyncio.run(scenario())


class SlowAnswers(FakeCore):
    """A core whose answers take as long as the gate is closed."""

    def query(self, question: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        ANSWERING.pass_through()
        return super().query(question, arguments)


class LostAnswers(FakeCore):
    def query(self, question: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        raise CoreLostError("the engine's process ended by SIGKILL")


ANSWERING = Gate()


async def with_frame(url: str, then: Callable[[], Any]) -> None:
    """A source has shown a frame; `then` is awaited while it stays."""
    async with connect(url, SourceHello("walls", 30.0, CAMERAS)) as (source, _):
        for camera in CAMERAS:
            await source.send(encode_view(a_view(camera), 0))
        await source.receive(FrameDone)
        await then()


def test_pictures_come_while_a_question_is_being_answered() -> None:
    ANSWERING.close()
    with running(SlowAnswers) as url:
        async def scenario() -> None:
            asking = asyncio.create_task(asyncio.to_thread(ask, url, AHEAD | {"query": "free"}))
            await asyncio.to_thread(ANSWERING.entered.wait, 20.0)
            async with connect(url, ViewerHello.symmetric(32, 24, 1.5)) as (viewer, _):
                for index in range(3):
                    await viewer.send(PoseUpdate(index, 0.0, (0.0, 0.0, 1.5), (1.0, 0.0, 0.0, 0.0)))
                    while not isinstance(await viewer.receive(Stereo, Scene), Stereo):
                        pass
            assert not asking.done()
            ANSWERING.open()
            assert (await asking).json() == {"free": [True]}

        asyncio.run(with_frame(url, scenario))


class Counts(FakeCore):
    """A core that answers with what it was asked, as long as the gate is open, and notes how much that was."""

    asked: ClassVar[list[int]] = []

    def query(self, question: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        ANSWERING.pass_through()
        self.asked.append(len(arguments["centres"]))
        return {"counts": arguments["radii"].astype(np.int32), "frame": len(self.asked)}


def test_a_long_question_is_answered_in_parts_between_which_others_have_their_turn() -> None:
    ANSWERING.close()
    radii = np.arange(1, 3001)
    long = {"query": "overlaps", "centres": np.zeros((3000, 3), "<f4"), "radii": radii.astype("<f4")}
    with running(Counts) as url:
        async def scenario() -> None:
            asking = asyncio.create_task(asyncio.to_thread(ask_packed, url, long))
            await asyncio.to_thread(ANSWERING.entered.wait, 20.0)
            short = {"query": "overlaps", "centres": [[0.0, 0.0, 0.0]], "radii": [7.0]}
            other = asyncio.create_task(asyncio.to_thread(ask, url, short))
            await asyncio.sleep(0.5)  # until it waits
            ANSWERING.open()
            answer = await asking
            np.testing.assert_array_equal(np.frombuffer(answer["counts"], "<i4"), radii)
            assert (await other).json()["counts"] == [7]
            assert Counts.asked == [1024, 1, 1024, 952]
            assert answer["frame"] == 4

        asyncio.run(with_frame(url, scenario))


def test_more_triangles_than_an_answer_may_list_are_refused() -> None:
    vast = {"query": "overlaps", "centres": 100 * [[0.0, 0.0, 0.0]], "radii": 1.0, "listed": 41}
    with running(FakeCore, max_queries=1000) as url:
        answer = ask(url, vast)
        told = "listed: 4100 triangles in all: expected at most 4000"
        assert (answer.status_code, answer.json()["detail"]) == (413, told)


def test_an_engine_that_is_lost_is_told() -> None:
    with running(LostAnswers) as url:
        async def scenario() -> None:
            answer = await asyncio.to_thread(ask, url, AHEAD)
            assert (answer.status_code, answer.json()["detail"]) == (503, "the engine's process ended by SIGKILL")

        asyncio.run(with_frame(url, scenario))
