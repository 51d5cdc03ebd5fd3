"""`farside bench --stages`: every stage, with the work that the reports say, and times that add up."""

from __future__ import annotations

import json

import pytest
from farside.clients.bench import stages
from farside.engine.evaluation.stages import PHASES, head_amid, measure_stages
from farside.engine.evaluation.twin_recording import TwinRecording, open_recording_or_twin
from farside.engine.io.images import encode_jpeg
from farside.engine.pipeline.engine import Engine
from farside.engine.rig.camera import Perspective
from farside.engine.settings import Settings
from farside.engine.support.runtime import thread_count
from farside.engine.support.stages import Stages, timed
from farside.engine.synth import make_twin, write_twin

TWIN, SCALE = "museum", 0.04
SETTINGS = Settings.preset("balanced", n_render=3)
MODEL = {f"background: {name}" for name in ("maximum_depth", "triangulate", "commit", "culling")}
FRAME = {"ingest", "exposure", "background", "pbi", "triangulate", "other", "total"}
PAIR = {"select", "warp", "backdrop", "shade", "antialias", "fill", "encode", "other", "total"}


@pytest.fixture(scope="module")
def report():
    return measure_stages(TwinRecording(make_twin(TWIN, SCALE)), SETTINGS, 4)


def test_every_stage_has_its_row_and_parts_do_not_exceed_the_whole(report):
    stages = {phase: {row.stage for row in report.rows if row.phase == phase} for phase in PHASES}
    assert stages["first frame"] == FRAME | MODEL
    assert stages["later frame"] >= FRAME | {"background: maximum_depth", "background: filter", "background: culling"}
    assert stages["pair"] == PAIR
    for phase in PHASES:
        whole = [row for row in report.rows if row.phase == phase and row.stage not in ("ingest", "total")]
        assert sum(row.share for row in whole if ":" not in row.stage) == pytest.approx(1.0, abs=0.2)
        assert sum(row.share for row in whole if ":" in row.stage) <= 1.0
        assert report.row(phase, "total").share == 1.0
    assert all(row.wall_ms >= 0 and row.cpu_ms >= 0 and row.times >= 1 for row in report.rows)


def test_the_work_is_that_of_the_engines_reports(report):
    twin = TwinRecording(make_twin(TWIN, SCALE))
    cameras = [twin.camera(name) for name in twin.source_names]
    engine, head = Engine(cameras, SETTINGS, f_vin=twin.fps), head_amid(cameras)
    first = engine.update(twin.frame(0), {"me": head})
    pair = engine.render(head, "me")
    assert report.row("first frame", "background: culling").work == {"rays": first.background.rays}
    assert report.row("first frame", "background: triangulate").work == {"triangles": first.background.s_pbs}
    assert report.row("first frame", "pbi").work == {"rays": first.pbi_rays}
    assert first.pbi_rays > 0
    assert report.row("first frame", "triangulate").work == {"triangles": first.triangles}
    size = report.size[0] * report.size[1]
    assert report.row("pair", "shade").work == {"pixels": 2 * size}
    drawn = pair.left.report.warped + pair.right.report.warped
    assert report.row("pair", "warp").work["triangles"] == pytest.approx(drawn, rel=0.2)  # people move
    sent = sum(len(encode_jpeg(eye.texture, SETTINGS.jpeg_quality)) for eye in (pair.left, pair.right))
    assert report.row("pair", "encode").work["bytes"] == pytest.approx(sent, rel=0.2)
    views = 24 * cameras[0].width * cameras[0].height
    assert report.row("later frame", "ingest").work["bytes"] == views * (2 + 3)


def test_threads_are_as_before_and_stages_have_both_clocks(report):
    assert thread_count() >= 1
    stages = Stages()
    for _ in range(2):
        with timed(stages, "a"):
            sum(range(100_000))
    assert stages.cpu["a"] > 0
    assert stages["a"] > 0
    assert list(stages) == ["a"]


def test_a_head_like_perspective_cameras_has_their_eyes():
    twin = TwinRecording(make_twin("painter", 0.05))
    camera = twin.camera(twin.source_names[0])
    assert isinstance(camera.projection, Perspective)
    assert head_amid([camera]).left == camera.projection


def test_a_sequence_on_disk_is_measured_and_reported(tmp_path, capsys):
    write_twin("painter", tmp_path / "painter", 0.05, frames=2)
    stages.command(str(tmp_path / "painter"), frames=2, quality="fast", report=tmp_path / "report")
    printed = capsys.readouterr().out
    assert all(stage in printed for stage in FRAME | PAIR)
    figures = json.loads((tmp_path / "report" / "stages.json").read_text())
    rows = {(row["phase"], row["stage"]): row for row in figures["rows"]}
    assert rows["first frame", "ingest"]["work"]["bytes"] > 0
    assert rows["pair", "total"]["cpu_ms"] > 0
    assert figures["compile_s"] >= 0


def test_what_is_neither_a_folder_nor_a_twin_is_named():
    with pytest.raises(ValueError, match="sequence: 'musem': expected a folder, or a twin: museum"):
        open_recording_or_twin("musem", 1.0)
