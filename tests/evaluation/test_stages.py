"""`farside bench --stages`: every stage, with the work that the reports say, and times that add up."""

from __future__ import annotations

import contextlib
import json
from types import SimpleNamespace

import numpy as np
import pytest
from farside.clients.bench import stages
from farside.engine.evaluation import stages as evaluation
from farside.engine.evaluation.stages import PHASES, head_amid, measure_stages
from farside.engine.evaluation.twin_recording import TwinRecording, open_recording_or_twin
from farside.engine.io.images import encode_jpeg
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Perspective
from farside.engine.settings import Settings
from farside.engine.support import stages as stage_times
from farside.engine.support.runtime import one_thread, set_thread_count, thread_count
from farside.engine.support.stages import Stages, timed
from farside.engine.synth import make_twin, write_twin
from support.clocks import Clock

TWIN, SCALE, FRAMES = "museum", 0.04, 4
TICK_MS = 1.0  # each look at the clock; so long at least takes what is measured at all
COMPILING_S = 2.5
SETTINGS = Settings.preset("balanced", n_render=3)
MODEL = {f"background: {name}" for name in ("maximum_depth", "triangulate", "commit", "culling")}
FRAME = {"ingest", "exposure", "background", "pbi", "triangulate", "other", "total"}
PAIR = {"select", "warp", "backdrop", "shade", "antialias", "fill", "encode", "other", "total"}


@pytest.fixture(scope="module")
def report():
    """By a clock that moves on with each look at it; the first engine's updates take longer, as if compiled."""
    clock, made = Clock(tick=1e-3 * TICK_MS), []

    class Slow(Engine):
        def __init__(self, *given, **options):
            super().__init__(*given, **options)
            made.append(self)

        def update(self, *given):
            clock.advance(COMPILING_S if self is made[0] else 0.0)
            return super().update(*given)

    with pytest.MonkeyPatch.context() as patch:
        clock.instead_of(patch, stage_times, evaluation)
        patch.setattr(evaluation, "Engine", Slow)
        yield measure_stages(TwinRecording(make_twin(TWIN, SCALE)), SETTINGS, FRAMES)


def test_every_stage_has_its_row_and_parts_make_up_the_whole(report):
    stages = {phase: {row.stage for row in report.rows if row.phase == phase} for phase in PHASES}
    assert stages["first frame"] == FRAME | MODEL
    assert stages["later frame"] >= FRAME | {"background: maximum_depth", "background: filter", "background: culling"}
    assert stages["pair"] == PAIR
    for phase in PHASES:
        rows = [row for row in report.rows if row.phase == phase and row.stage not in ("ingest", "total")]
        whole, parts = ([row for row in rows if (":" in row.stage) == inner] for inner in (False, True))
        assert sum(row.share for row in whole) == pytest.approx(1.0, abs=1e-9)
        assert report.row(phase, "total").share == 1.0
        if parts:
            background = report.row(phase, "background")
            assert 0 < sum(row.share for row in parts) < background.share
            assert max(row.wall_ms for row in parts) < background.wall_ms
    timed = [row for row in report.rows if row.stage != "other"]  # that is what others leave of the total's median
    assert all(min(row.wall_ms, row.cpu_ms) >= TICK_MS - 1e-6 for row in timed)


def test_a_stage_counts_as_often_as_it_took_place(report):
    expected = {"first frame": 1, "later frame": FRAMES - 1, "pair": FRAMES}
    for row in report.rows:
        if ":" not in row.stage:
            assert row.times == expected[row.phase], row


def test_what_the_first_run_takes_longer_is_compiling(report):
    assert report.compile_s == pytest.approx(2 * COMPILING_S, abs=1e-9)  # its two frames


def test_the_work_is_that_of_the_engines_reports(report):
    twin = TwinRecording(make_twin(TWIN, SCALE))
    cameras = [twin.camera(name) for name in twin.source_names]
    engine, head = Engine(cameras, SETTINGS, f_vin=twin.fps), head_amid(cameras)
    drawn, sent = [], []
    for index in range(FRAMES):
        update = engine.update(twin.frame(index), {"head": head})
        if index == 0:
            first = update
        pair = engine.render(head, "head")
        drawn.append(pair.left.report.warped + pair.right.report.warped)
        sent.append(sum(len(encode_jpeg(eye.texture, SETTINGS.jpeg_quality)) for eye in (pair.left, pair.right)))
    assert report.row("first frame", "background: culling").work == {"rays": first.background.rays}
    assert report.row("first frame", "background: triangulate").work == {"triangles": first.background.s_pbs}
    assert report.row("first frame", "pbi").work == {"rays": first.pbi_rays}
    assert first.pbi_rays > 0
    assert report.row("first frame", "triangulate").work == {"triangles": first.triangles}
    size = report.size[0] * report.size[1]
    assert report.row("pair", "shade").work == {"pixels": 2 * size}
    assert report.row("pair", "warp").work == {"triangles": np.median(drawn)}
    assert report.row("pair", "encode").work == {"bytes": np.median(sent)}
    views = 24 * cameras[0].width * cameras[0].height
    assert report.row("later frame", "ingest").work["bytes"] == views * (2 + 3)


def test_one_thread_is_one_and_those_from_before_come_back():
    before = thread_count()
    try:
        for threads in {before, 1}:
            set_thread_count(threads)
            with contextlib.suppress(KeyError), one_thread():
                assert thread_count() == 1
                raise KeyError
            assert thread_count() == threads
    finally:
        set_thread_count(before)


def test_a_stage_has_the_times_of_both_clocks(monkeypatch):
    wall, cpu = Clock(), Clock()
    monkeypatch.setattr(stage_times, "time", SimpleNamespace(perf_counter=wall.read, process_time=cpu.read))
    stages = Stages()
    for seconds in (0.5, 0.25):
        with timed(stages, "a"):
            wall.advance(seconds)
            cpu.advance(3 * seconds)
    with contextlib.suppress(KeyError), timed(stages, "b"):
        wall.advance(1.0)
        raise KeyError
    assert stages == {"a": 750.0, "b": 1000.0}
    assert stages.cpu == {"a": 2250.0, "b": 0.0}


def test_a_head_like_perspective_cameras_has_their_eyes():
    twin = TwinRecording(make_twin("painter", 0.05))
    camera = twin.camera(twin.source_names[0])
    assert isinstance(camera.projection, Perspective)
    assert head_amid([camera]).left == camera.projection


def test_a_sequence_on_disk_is_measured_and_reported(tmp_path, capsys, monkeypatch):
    Clock(tick=1e-3 * TICK_MS).instead_of(monkeypatch, stage_times, evaluation)
    write_twin("painter", tmp_path / "painter", 0.05, frames=2)
    stages.command(str(tmp_path / "painter"), frames=2, quality="fast", report=tmp_path / "report")
    printed = capsys.readouterr().out
    assert all(stage in printed for stage in FRAME | PAIR)
    figures = json.loads((tmp_path / "report" / "stages.json").read_text())
    rows = {(row["phase"], row["stage"]): row for row in figures["rows"]}
    cameras = make_twin("painter", 0.05).sources
    pixels = sum(camera.width * camera.height for camera in cameras)
    assert rows["first frame", "ingest"]["work"] == {"bytes": pixels * (2 + 3)}  # codes, and 4:2:0 of 16 bits
    for clock in ("cpu_ms", "wall_ms"):
        whole = sum(row[clock] for (phase, stage), row in rows.items() if phase == "first frame" and ":" not in stage)
        ingest, total = (rows["first frame", stage][clock] for stage in ("ingest", "total"))
        assert whole - ingest - total == pytest.approx(total, abs=1e-6)  # one sample: medians add up
    assert figures["compile_s"] == 0.0  # as many looks at the clock in either run


def test_what_is_neither_a_folder_nor_a_twin_is_named():
    with pytest.raises(ValueError, match="sequence: 'musem': expected a folder, or a twin: museum"):
        open_recording_or_twin("musem", 1.0)
