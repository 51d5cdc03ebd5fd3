"""A frame rate held by the service, over a real socket, with a core whose pairs take as long as its settings imply."""

from __future__ import annotations

import asyncio
import json
import time
import urllib.request

import numpy as np
import pytest
from farside.clients.connection import connect
from farside.clients.headset import Headset
from farside.clients.serve import server_settings
from farside.engine.live.governor import Governor, make_ladder
from farside.server.pictures import encode_view
from farside.server.protocol import FrameDone, PoseUpdate, Scene, SourceHello, Stereo, ViewerHello
from support.doubles import CAMERAS, FakeCore, a_view
from support.serving import running

HANG_S = 30.0
LADDER = make_ladder("balanced")


class Slow(FakeCore):
    """A core whose pairs have the size of its settings and take `balanced_s` times the cost of the rung."""

    balanced_s = 0.0

    def picture(self, view, viewer, encoding):
        (cost,) = (rung.cost for rung in LADDER if rung.settings == self.settings)
        time.sleep(Slow.balanced_s * cost)
        return super().picture(view.scaled(self.settings.output_scale), viewer, encoding)


def status(url):
    with urllib.request.urlopen(f"{url}/status", timeout=HANG_S) as answer:
        return json.load(answer)


async def pairs(peer, count, first=0):
    """Request `count` pairs one after the other."""
    found = []
    for seq in range(first, first + count):
        await peer.send(PoseUpdate(seq, seq / 10, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
        while not isinstance(message := await peer.receive(Stereo, Scene), Stereo):
            pass
        found.append(message)
    return found


def watch(url, scenario):
    async def guarded():
        async with asyncio.timeout(HANG_S), connect(url, SourceHello("walls", 30.0, CAMERAS)) as (source, _):
            for camera in CAMERAS:
                await source.send(encode_view(a_view(camera), 0))
            await source.receive(FrameDone)
            async with connect(url, ViewerHello.symmetric(64, 48, 1.5)) as (peer, _):
                await scenario(peer)

    asyncio.run(guarded())


def test_under_load_smaller_pairs_come_and_the_status_says_why(monkeypatch):
    monkeypatch.setattr(Slow, "balanced_s", 0.2)
    cores = []
    with running(lambda source: cores.append(Slow(source)) or cores[-1], target_fps=100.0) as url:
        assert status(url)["governor"]["rung"] == "balanced"

        async def scenario(peer):
            got = await pairs(peer, 8)
            assert (got[0].rung, got[0].width, got[0].height) == ("balanced", 64, 48)
            assert got[-1].rung == LADDER[0].name
            scale = LADDER[0].settings.output_scale
            assert (got[-1].width, got[-1].height) == (round(64 * scale), round(48 * scale))

        watch(url, scenario)
        governor = status(url)["governor"]
    assert cores[0].settings == LADDER[0].settings
    assert (governor["rung"], governor["target_fps"]) == (LADDER[0].name, 100.0)
    assert governor["reason"] == "slower than the target on the lowest rung"
    assert governor["measured_ms"] > 10
    predicted = [governor["predicted_ms"][rung.name] for rung in LADDER]
    assert predicted == sorted(predicted)
    assert predicted[0] == pytest.approx(governor["measured_ms"])
    assert governor["changes"] == 1


def test_with_time_to_spare_it_climbs_back_to_the_quality_that_was_asked_for(monkeypatch):
    monkeypatch.setattr(Slow, "balanced_s", 0.2)
    monkeypatch.setattr(Governor, "DWELL_S", 0.0)
    with running(Slow, target_fps=10.0) as url:

        async def scenario(peer):
            assert (await pairs(peer, 6))[-1].rung != "balanced"
            Slow.balanced_s = 0.0
            got = await pairs(peer, 200, first=6)
            rungs = [pair.rung for pair in got]
            assert rungs[-1] == "balanced"
            names = [rung.name for rung in LADDER]
            steps = np.diff([names.index(rung) for rung in rungs])
            assert steps.min() == 0
            assert steps.max() == 1

        watch(url, scenario)


def test_without_a_frame_rate_nothing_is_governed():
    with running() as url:
        assert status(url)["governor"] is None


def test_a_headset_counts_the_rungs_that_its_pictures_came_on(monkeypatch):
    monkeypatch.setattr(Slow, "balanced_s", 0.001)
    with running(Slow, target_fps=5.0) as url:

        async def scenario(peer):
            headset = Headset(ViewerHello.symmetric(64, 48, 1.5), seconds=0.3)
            await headset.run(url)
            assert list(headset.rungs) == ["balanced"]
            assert "ladder: balanced " in headset.summary()

        watch(url, scenario)


def test_what_is_given_bounds_the_ladder_and_bad_targets_are_named():
    settings = server_settings(target_fps=30.0, quality="fast", views=2, jpeg_quality=40)
    governor = settings.governor()
    assert governor.rung.settings == settings.engine()
    assert {rung.settings.n_render for rung in governor.rungs} == {2}
    for bad in (0, -3, 1e6):
        with pytest.raises(ValueError, match=r"^--target-fps: "):
            server_settings(target_fps=bad)
