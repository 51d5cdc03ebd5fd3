"""3D effects over HTTP: what can be put, moved, asked for and removed; bad input; the real engine while a source plays.
"""

from __future__ import annotations

import asyncio
import http.client
import json
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from farside.clients.connection import RefusedError, connect
from farside.engine.live.core import Source, make_local_core
from farside.engine.live.core_process import ProcessCore
from farside.engine.live.scene_effects import MOST_EFFECTS
from farside.engine.rig.camera import Camera, Pose
from farside.engine.rig.effects import AddedMesh, Projector
from farside.engine.settings import Settings
from farside.server import effects as routes
from farside.server.pictures import decode_texture, encode_view
from farside.server.protocol import (
    EFFECTS,
    EffectRemoval,
    EffectUpdate,
    Features,
    FrameDone,
    PoseUpdate,
    Scene,
    SourceHello,
    Stereo,
    ViewerHello,
)
from support import effects as room
from support.doubles import CAMERAS, Cores, a_view
from support.rooms import WALL_Y, camera_row
from support.serving import run_within, running

POSED = {"position": [1.0, 2.0, 3.0], "orientation": [1.0, 0.0, 0.0, 0.0]}
PROJECTOR = {"kind": "projector", **POSED, "fov": 1.0}
MESH = {"kind": "mesh", **POSED}
PNG = room.png(room.white())


def ask(url: str, method: str, path: str, body: Any = None, **headers: str) -> tuple[int, Any]:
    """A request's status and its answer, read as JSON where it is JSON."""
    parts = urlsplit(url)
    client = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=60)
    try:
        data = json.dumps(body).encode() if isinstance(body, dict | list) else body
        client.request(method, path, data, headers)
        answer = client.getresponse()
        text = answer.read().decode()
        return answer.status, json.loads(text) if text[:1] in ("{", "[") else text
    finally:
        client.close()


def test_effects_are_put_moved_asked_for_and_removed(url: str) -> None:
    assert ask(url, "GET", "/effects") == (200, {"effects": {}})
    status, made = ask(url, "PUT", "/effects/screen", PROJECTOR)
    assert (status, made) == (200, {**PROJECTOR, "strength": 1.0, "blend": "mix", "camera": ""})
    assert ask(url, "PUT", "/effects/screen/picture", PNG)[0] == 200
    assert ask(url, "PUT", "/effects/cube", {**MESH, "scale": 0.5})[0] == 200
    _, there = ask(url, "GET", "/effects")
    assert there["effects"] == {
        "screen": {**made, "has_content": True}, "cube": {**MESH, "scale": 0.5, "has_content": False}
    }  # fmt: skip
    assert ask(url, "PUT", "/effects/cube/mesh", room.cube_glb())[0] == 200
    moved = {**PROJECTOR, "position": [0.0, 0.0, 1.0], "blend": "add", "strength": 0.5}
    assert ask(url, "PUT", "/effects/screen", moved)[1]["position"] == [0.0, 0.0, 1.0]
    assert ask(url, "GET", "/effects")[1]["effects"]["screen"]["has_content"] is True
    assert ask(url, "DELETE", "/effects/screen") == (204, "")
    assert list(ask(url, "GET", "/effects")[1]["effects"]) == ["cube"]


def test_openxr_axes(url: str) -> None:
    there = {**MESH, "axes": "openxr", "position": [1.0, 2.0, 3.0], "orientation": [0.0, 0.0, 0.0, 1.0]}
    assert ask(url, "PUT", "/effects/cube", there)[1]["position"] == [-3.0, -1.0, 2.0]
    assert ask(url, "PUT", "/effects/cube", there)[1]["orientation"] == [1.0, 0.0, 0.0, 0.0]


BAD: list[tuple[str, str, Any, int, str]] = [
    ("PUT", "/effects/a", b"{", 400, "body: "),
    ("PUT", "/effects/a", b"[" * 5000, 400, "body: "),
    ("PUT", "/effects/a", b"\xff", 400, "body: "),
    ("PUT", "/effects/a", [], 400, "message: list: expected a map"),
    ("PUT", "/effects/a", {}, 400, "kind: missing: expected one of projector, mesh"),
    ("PUT", "/effects/a", {**PROJECTOR, "kind": "ghost"}, 400, "kind: ghost: expected one of projector, mesh"),
    ("PUT", "/effects/a", {**PROJECTOR, "fov": 4}, 400, "fov: 4: expected a number from 0.01 to 2.967"),
    ("PUT", "/effects/a", {**PROJECTOR, "fov": float("nan")}, 400, "fov: nan"),
    ("PUT", "/effects/a", {**PROJECTOR, "position": [1, 2]}, 400, "position: 2 items: expected an array of 3"),
    ("PUT", "/effects/a", {**PROJECTOR, "position": [1, 2, float("inf")]}, 400, "position: [1, 2, inf]: expected 3"),
    ("PUT", "/effects/a", {**PROJECTOR, "orientation": [1, 1, 0, 0]}, 400, "orientation: [1.0, 1.0, 0.0, 0.0]"),
    ("PUT", "/effects/a", {**PROJECTOR, "strength": -1}, 400, "strength: -1: expected a number from 0 to 1"),
    ("PUT", "/effects/a", {**PROJECTOR, "blend": "burn"}, 400, "blend: burn: expected one of mix, add"),
    ("PUT", "/effects/a", {**PROJECTOR, "axes": "up"}, 400, "axes: up: expected one of omaf, openxr"),
    ("PUT", "/effects/a", {**MESH, "scale": 0}, 400, "scale: 0: expected a number from 1e-06"),
    ("PUT", "/effects/" + 101 * "a", MESH, 400, "name: aaa"),
    ("PUT", "/effects/%ff", MESH, 400, "name: \ufffd: expected 1 to 100 characters in UTF-8"),
    ("PUT", "/effects/a", b" " * 70000, 413, "body: more than 65536 bytes"),
    ("PUT", "/effects/none/picture", PNG, 404, "effect: none: expected one of screen, cube"),
    ("PUT", "/effects/screen/sound", PNG, 404, "sound: expected picture or mesh"),
    ("PUT", "/effects/cube/picture", PNG, 409, "picture: for a mesh: expected it for a projector"),
    ("PUT", "/effects/screen/mesh", room.cube_glb(), 409, "mesh: for a projector: expected it for a mesh"),
    ("PUT", "/effects/screen/picture", b"no", 400, "picture: 2 bytes: expected a whole PNG or JPEG picture"),
    ("PUT", "/effects/cube/mesh", PNG, 400, "mesh: first bytes: "),
    ("PUT", "/effects/cube/mesh", room.cube_glb()[:-9], 400, "it is cut short"),
    ("DELETE", "/effects/none", None, 404, "effect: none: expected one of screen, cube"),
]


@pytest.mark.parametrize(("method", "path", "body", "status", "said"), BAD)
def test_bad_input_is_told_and_changes_nothing(
    url: str, method: str, path: str, body: Any, status: int, said: str
) -> None:
    ask(url, "PUT", "/effects/screen", PROJECTOR)
    ask(url, "PUT", "/effects/cube", MESH)
    before = ask(url, "GET", "/effects")
    found, answer = ask(url, method, path, body)
    assert (found, said in answer["detail"]) == (status, True), answer
    assert ask(url, "GET", "/effects") == before


def test_files_are_decoded_one_at_a_time_and_for_the_effect_that_is_there_then(
    url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go_on, most, now = threading.Event(), threading.Event(), [], [0]

    def slow(data: bytes) -> np.ndarray:
        now[0] += 1
        most.append(now[0])
        begun.set()
        assert go_on.wait(60)
        now[0] -= 1
        return np.zeros((4, 4, 4), np.uint8)

    monkeypatch.setitem(routes._READERS, "picture", (Projector, slow))
    names = [f"slow{k}" for k in range(4)]
    for name in names:
        assert ask(url, "PUT", f"/effects/{name}", PROJECTOR)[0] == 200
    with ThreadPoolExecutor(4) as pool:
        answers = [pool.submit(ask, url, "PUT", f"/effects/{name}/picture", PNG) for name in names]
        assert begun.wait(60)
        for name in names[:3]:
            assert ask(url, "PUT", f"/effects/{name}", MESH)[0] == 200
        assert ask(url, "DELETE", "/effects/slow3")[0] == 204
        go_on.set()
    told = [answer.result() for answer in answers]
    assert [status for status, _ in told] == [409, 409, 409, 404]
    assert told[0][1]["detail"].startswith("picture: for a mesh: expected it for a projector")
    assert set(most) == {1}
    for name in names[:3]:
        assert ask(url, "DELETE", f"/effects/{name}")[0] == 204


def test_what_is_too_long_is_not_read(url: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "MOST_BYTES", 1000)
    ask(url, "PUT", "/effects/screen", PROJECTOR)
    status, answer = ask(url, "PUT", "/effects/screen/picture", bytes(1001))
    assert (status, answer["detail"]) == (413, "body: more than 1000 bytes: expected at most 1000")


def test_there_are_only_so_many(url: str) -> None:
    for number in range(MOST_EFFECTS):
        assert ask(url, "PUT", f"/effects/{number}", MESH)[0] == 200
    status, answer = ask(url, "PUT", "/effects/more", MESH)
    assert (status, answer["detail"][:8]) == (400, "effects:")
    assert ask(url, "PUT", "/effects/0", MESH)[0] == 200


def test_tokens_and_other_pages() -> None:
    with running(Cores(), token="secret") as url:
        for method, path in (("GET", "/effects"), ("PUT", "/effects/a"), ("DELETE", "/effects/a")):
            assert ask(url, method, path, MESH)[0] == 401
            assert ask(url, method, path, MESH, Authorization="Bearer other")[0] == 401
        assert ask(url, "PUT", "/effects/a/mesh", room.cube_glb())[0] == 401
        assert ask(url, "PUT", "/effects/a", MESH, Authorization="Bearer secret")[0] == 200
        assert ask(url, "GET", "/effects?token=secret")[0] == 200
    with running(Cores(), allowed_origins="https://a.example") as url:
        status, text = ask(url, "PUT", "/effects/a", MESH, Origin="http://evil.example")
        assert (status, text[:7]) == (403, "origin:")
        assert ask(url, "PUT", "/effects/a", MESH, Origin="https://a.example")[0] == 200
        assert ask(url, "PUT", "/effects/a", MESH, Origin=f"http://{urlsplit(url).netloc}")[0] == 200
        wanted = {"Origin": "https://a.example", "Access-Control-Request-Method": "PUT"}
        assert ask(url, "OPTIONS", "/effects/a", None, **wanted)[0] == 200
        assert ask(url, "OPTIONS", "/effects/a", None, **{**wanted, "Origin": "http://evil.example"})[0] == 400


async def play(url: str, cameras: tuple[Camera, ...], views: Callable[[int], Any], stop: threading.Event) -> None:
    """A source that plays until it is told to stop."""
    async with connect(url, SourceHello("room", 30.0, cameras)) as (source, _):
        index = 0
        while not stop.is_set():
            for view in views(index):
                await source.send(encode_view(view, index))
            await source.receive(FrameDone)
            index += 1
            await asyncio.sleep(0.02)


def test_an_engine_of_other_cameras_gets_all_effects(url: str, cores: Cores) -> None:
    ask(url, "PUT", "/effects/screen", PROJECTOR)
    ask(url, "PUT", "/effects/screen/picture", PNG)
    ask(url, "PUT", "/effects/live", {**PROJECTOR, "camera": "v0"})

    async def come(name: str, count: int) -> None:
        async with connect(url, SourceHello(name, 30.0, CAMERAS[:count])) as (source, _):
            for camera in CAMERAS[:count]:
                await source.send(encode_view(a_view(camera), 0))
            await source.receive(FrameDone)

    run_within(20, lambda: come("two", 2))
    (first,) = cores.made
    assert list(first.effects) == ["screen", "live"]
    assert first.effects["screen"] == (Projector(Pose((1.0, 2.0, 3.0)), 1.0), first.effects["screen"][1])
    assert first.effects["screen"][1].shape == (60, 80, 4)
    assert ask(url, "PUT", "/effects/live", {**PROJECTOR, "camera": "v9"})[0] == 400
    assert ask(url, "PUT", "/effects/live", {**PROJECTOR, "camera": "v1"})[0] == 200
    assert ask(url, "PUT", "/effects/cube", MESH)[0] == 200
    assert ask(url, "DELETE", "/effects/screen")[0] == 204
    run_within(20, lambda: come("one", 1))
    second = cores.made[1]
    assert second.effects == {"cube": (AddedMesh(Pose((1.0, 2.0, 3.0))), None)}  # it has no camera v1
    assert list(ask(url, "GET", "/effects")[1]["effects"]) == ["live", "cube"]


WISHES = Features(required=(EFFECTS,))


async def there(url: str, names: list[str]) -> dict[str, Any]:
    """Waits until there are these effects."""
    while True:
        effects = (await asyncio.to_thread(ask, url, "GET", "/effects"))[1]["effects"]
        if list(effects) == names:
            return effects
        await asyncio.sleep(0.01)


def test_a_viewer_moves_effects_in_its_own_axes(url: str) -> None:
    async def scenario() -> None:
        hello = ViewerHello.symmetric(32, 24, 1.5, axes="openxr", features=WISHES)
        async with connect(url, hello) as (viewer, welcome):
            assert welcome.features == (EFFECTS,)
            for k in range(20):
                await viewer.send(EffectUpdate("cube", "mesh", (0.0, 0.1 * k, -1.0), (0.0, 0.0, 0.0, 1.0), scale=2.0))
            await viewer.send(EffectUpdate("light", "projector", (0.0, 0.0, -1.0), (0.0, 0.0, 0.0, 1.0), 0.5))
            effects = await there(url, ["cube", "light"])
            while effects["cube"]["position"][2] != pytest.approx(1.9):  # the newest wins
                effects = await there(url, ["cube", "light"])
            assert effects["cube"]["position"][:2] == [1.0, 0.0]
            assert effects["cube"]["scale"] == 2.0
            assert effects["light"]["fov"] == 0.5
            await viewer.send(EffectRemoval("cube"))
            await viewer.send(EffectRemoval("nobody"))
            await there(url, ["light"])
        await there(url, ["light"])  # it stays without the viewer

    run_within(20, scenario)


def test_a_viewer_that_has_not_agreed_on_effects_may_not_send_them(url: str) -> None:
    async def scenario() -> None:
        async with connect(url, ViewerHello.symmetric(32, 24, 1.5)) as (viewer, welcome):
            assert welcome.features == ()
            await viewer.send(EffectRemoval("cube"))
            with pytest.raises(RefusedError, match="type: remove_effect: expected pose here"):
                await viewer.receive(Scene)

    run_within(20, scenario)


def test_an_effect_that_the_engine_does_not_take_ends_its_viewer_only(url: str) -> None:
    async def scenario() -> None:
        async with connect(url, SourceHello("room", 30.0, CAMERAS)) as (source, _):
            for camera in CAMERAS:
                await source.send(encode_view(a_view(camera), 0))
            await source.receive(FrameDone)
            async with connect(url, ViewerHello.symmetric(32, 24, 1.5, features=WISHES)) as (viewer, _):
                await viewer.receive(Scene)
                await viewer.send(
                    EffectUpdate("live", "projector", (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), camera="v9")
                )
                with pytest.raises(RefusedError, match="camera: 'v9': expected another one"):
                    await viewer.receive(Stereo)
            for camera in CAMERAS:
                await source.send(encode_view(a_view(camera), 1))
            await source.receive(FrameDone)

    run_within(20, scenario)


def real_core(source: Source) -> ProcessCore:
    return ProcessCore(make_local_core, source.cameras, Settings.preset("balanced"))


def test_a_projector_is_moved_while_a_source_plays_on_the_real_engine() -> None:
    cameras = tuple(camera_row(3, (96, 64)))
    stop = threading.Event()

    async def look(url: str) -> None:
        hello = ViewerHello.symmetric(120, 90, 1.2, encoding="raw")
        async with connect(url, hello) as (viewer, _):
            await viewer.receive(Scene)
            seq = 0

            async def lumas() -> np.ndarray:
                nonlocal seq
                seq += 1
                await viewer.send(PoseUpdate(seq, 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)))
                while True:
                    stereo = await viewer.receive(Stereo, Scene)
                    if isinstance(stereo, Stereo) and stereo.seq == seq:
                        return decode_texture(stereo.left, 90, 120).y.astype(float)

            async def put(path: str, body: Any) -> None:
                status, answer = await asyncio.to_thread(ask, url, "PUT", f"/effects/{path}", body)
                assert status == 200, answer

            assert np.abs(await lumas() - WALL_Y).max() < 12
            aside = {**PROJECTOR, "position": [0.0, 0.7, 0.0], "fov": 0.3}
            await put("screen", aside)
            await put("screen/picture", PNG)
            left = await lumas()
            assert left[45, 35:55].min() > 900
            assert left[45, 62:110].max() < 400
            await put("screen", {**aside, "position": [0.0, -0.7, 0.0]})
            right = await lumas()
            assert right[45, 66:86].min() > 900
            assert right[45, 10:60].max() < 400
            status, _ = await asyncio.to_thread(ask, url, "DELETE", "/effects/screen")
            assert status == 204
            assert np.abs(await lumas() - WALL_Y).max() < 12

    async def scenario(url: str) -> None:
        source = asyncio.create_task(play(url, cameras, lambda k: room.frame(k, cameras).views, stop))
        try:
            await look(url)
        finally:
            stop.set()
            await source

    with running(real_core) as url:
        run_within(300, lambda: scenario(url))
