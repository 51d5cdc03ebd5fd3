"""`farside bench --live`: real processes over localhost; all figures are present and consistent."""

from __future__ import annotations

import dataclasses
import math
import os

import pytest
from farside.clients.bench import live, processes
from farside.clients.bench.live_run import measure_live
from farside.engine.synth import write_twin

SIZE = (64, 48)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("twin") / "hijack"
    write_twin("hijack", folder, 0.03, 3)
    return folder


@pytest.fixture(scope="module")
def figures(folder):
    return measure_live(folder, 5.0, 2.0, "fast", SIZE)


def test_pictures_come_while_the_video_plays_and_when_it_has_stopped(figures):
    for part in figures:
        assert part.pairs >= 2
        assert part.rate == part.pairs / part.seconds
        assert 0 < part.motion_to_photon[0] <= part.motion_to_photon[1] <= part.motion_to_photon[2]
        assert 500 < part.picture_bytes < 2 * 64 * 48 * 3
        assert max(part.status["pictures"].values()) > 0
    playing, still = figures
    assert playing.seconds >= 2.0
    assert playing.frames["updated"] >= 1
    assert playing.frames["failed"] == still.frames["failed"] == 0
    assert playing.status["source_connected"] is True
    assert still.status["source_connected"] is False


def test_the_server_is_measured_from_outside_and_from_inside(figures):
    for part in figures:
        server, loop, _ = part.cores
        assert 0 < loop < server
        assert 50 < part.server.resident_mb <= part.server.peak_mb
        stalls = part.status["event_loop"]
        for when in ("", "_during_update"):
            assert stalls[f"longest_own_stall{when}_ms"] <= stalls[f"longest_stall{when}_ms"]
        assert stalls["longest_stall_during_update_ms"] <= stalls["longest_stall_ms"]
        assert part.idle["longest_own_stall_ms"] <= part.idle["longest_stall_ms"]
        assert 0 < part.idle["loop_busy_s"] < stalls["loop_busy_s"]
    assert figures[0].status["event_loop"]["longest_stall_during_update_ms"] > 0
    assert figures[0].cores[2] > 0
    assert figures[1].cores[2] == 0


def test_the_command_prints_them(folder, figures, monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(live, "measure_live", lambda *given: asked.append(given) or figures)
    live.command(folder, 5.0, 2.0, "64x48", "fast")
    assert asked == [(folder, 5.0, 2.0, "fast", SIZE)]
    printed = capsys.readouterr().out
    for said in ("10 views of 62x62", "longest event-loop stall", "wanted", "a frame is 0.192 MB", "MB resident"):
        assert said in printed


def test_a_size_that_no_viewer_may_have_is_refused(folder):
    with pytest.raises(ValueError, match="--size: '99999x9': expected at most 4096 pixels"):
        live.command(folder, size="99999x9")


def test_a_pause_is_what_an_update_adds_to_a_picture(figures):
    playing, still = figures
    longest = {"longest_picture_during_update_ms": 31.0}
    playing = dataclasses.replace(playing, status=playing.status | {"pictures": longest})
    still = dataclasses.replace(still, status=still.status | {"stages_ms": {"picture": {"p50": 12.5}}})
    assert live.pause_ms(playing, still) == 18.5
    still = dataclasses.replace(still, status=still.status | {"pictures": {**longest, "longest_picture_ms": 20.0}})
    assert live.pause_ms(still, still) == 18.5
    still.status["pictures"]["longest_picture_during_update_ms"] = 0.0
    assert live.pause_ms(still, still) == 7.5


def test_memory_that_processes_share_is_counted_once():
    own = processes.Usage.of(os.getpid())
    twice = processes.Usage.of(os.getpid(), os.getpid())
    assert own.cpu_s > 0
    shared = 2 * own.resident_mb - twice.resident_mb
    assert 0 <= shared < own.resident_mb
    assert twice.peak_mb == pytest.approx(2 * own.peak_mb - shared, abs=1)


def test_a_server_that_cannot_start_is_told(folder):
    with pytest.raises(RuntimeError, match="serve ended with 2: farside: --quality: 'poor'"):
        measure_live(folder, 5.0, 1.0, "poor", SIZE)


def test_parts_without_updates_have_no_such_figures(figures):
    status = dict(figures[1].status, stages_ms={"picture": {"p50": 1.0}})
    rows = dict(live._rows(dataclasses.replace(figures[1], seconds=2.0, pairs=5, status=status)))
    assert rows["pairs a second"] == "2.5"
    assert rows["update.total, median, ms"] == str(math.nan)
