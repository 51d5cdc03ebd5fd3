"""A preset compared with the published algorithm: rows are consistent and printed at once; `render` accepts it."""

from __future__ import annotations

import csv
import dataclasses
import json

import pytest
from farside.clients.bench.paper import command, show_paper
from farside.clients.cli import app
from farside.engine.evaluation import paper as evaluation
from farside.engine.evaluation.paper import compare_with_paper
from farside.engine.io.tmiv import SequenceWriter
from farside.engine.pipeline.engine import Engine
from support.clocks import Clock
from support.recordings import Bare, MemoryRecording
from support.rooms import camera_row, frame, see
from typer.testing import CliRunner

BOXES = (-0.4, 0.0, 0.4, 0.8)
W, H = 64, 48
TOOK_S = {"first": 5.0, "paper": 2.0, "update": 1.0, "picture": 0.5}


@pytest.fixture(scope="module")
def recording():
    cameras = camera_row(4, (W, H))
    target = dataclasses.replace(cameras[1], name="t0")
    truth = {"t0": [see(target, box).texture for box in BOXES]}
    return MemoryRecording([frame(index, cameras, box) for index, box in enumerate(BOXES)], [target], truth)


@pytest.fixture(scope="module")
def rows(recording):
    """By a clock that updates and pictures move on by the seconds of `TOOK_S`."""
    steps, clock, update, render = [], Clock(), Engine.update, Engine.render_camera

    def timed_update(engine, *given):
        first, paper = engine.frame_index is None, engine.settings.culling_stride == 1
        clock.advance(TOOK_S["first" if first else "paper" if paper else "update"])
        return update(engine, *given)

    def timed_render(engine, *given):
        clock.advance(TOOK_S["picture"])
        return render(engine, *given)

    with pytest.MonkeyPatch.context() as patch:
        clock.instead_of(patch, evaluation)
        patch.setattr(Engine, "update", timed_update)
        patch.setattr(Engine, "render_camera", timed_render)
        found = compare_with_paper(Bare(recording), ["t0"], 4, 3, "balanced", lambda: steps.append(1))
    assert len(steps) == 4
    return {row.mode: row for row in found}


def test_the_paper_draws_and_models_two_triangles_a_pixel(rows):
    paper, own, without = rows["paper"], rows["balanced"], rows["balanced, no model"]
    quads = (W - 1) * (H - 1)
    assert paper.drawn >= 2 * quads
    assert paper.modelled > 1.8 * quads
    assert own.drawn < 0.5 * paper.drawn
    assert 0 < own.modelled < 0.5 * paper.modelled
    assert without.modelled == without.model_bytes == 0
    assert paper.model_bytes > own.model_bytes > 0


def test_pictures_are_judged_by_the_truth(rows):
    for row in rows.values():
        assert row.psnr_y > 30
        assert row.iv_psnr > 30
        assert 0 <= row.holes_backdrop <= row.holes_warped < 0.2
        assert row.camera == "t0"
        assert row.recording == "in memory"
        update = TOOK_S["paper" if row.mode == "paper" else "update"]
        assert (row.first_s, row.update_s, row.picture_s) == pytest.approx((TOOK_S["first"], update, TOOK_S["picture"]))
    assert rows["balanced"].psnr_y != rows["paper"].psnr_y


def test_a_table_a_line_and_a_file(recording, tmp_path, capsys):
    show_paper([recording], ["t0"], 2, 1, "fast", tmp_path / "out")
    printed = capsys.readouterr().out
    assert "in memory, 2 frames" in printed
    assert "in memory: fast over the paper: PSNR-Y" in printed
    with (tmp_path / "out" / "paper.csv").open(newline="") as file:
        written = list(csv.DictReader(file))
    assert [row["mode"] for row in written] == ["paper", "fast", "fast, no model"]
    for name in ("psnr_y", "iv_psnr", "holes_backdrop", "picture_s", "drawn", "modelled", "model_bytes"):
        assert all(float(row[name]) >= 0 for row in written)


def test_the_command_takes_the_papers_twins(monkeypatch, capsys):
    asked = []
    monkeypatch.setattr("farside.clients.bench.paper.show_paper", lambda *given: asked.append(given))
    command(scale=0.02)
    command(twins="frog", scale=0.02, quality="best")
    assert [recording.name for recording in asked[0][0]] == ["museum", "hijack", "painter", "frog"]
    assert [recording.name for recording in asked[1][0]] == ["frog"]
    assert asked[0][2:] == (21, 5, "balanced", None)
    assert asked[1][4] == "best"


def test_render_takes_the_preset(tmp_path):
    sources = camera_row(3, (W, H))
    target = dataclasses.replace(sources[1], name="t0")
    with SequenceWriter(tmp_path / "Room", "Room", 30.0, [*sources, target], ("v0", "v1", "v2")) as writer:
        for index in range(2):
            for view in frame(index, sources, 0.3 * index).views:
                writer.write(view.camera.name, view.texture, view.codes)
    options = ["--camera", "t0", "--quality", "paper", "--report", str(tmp_path / "report.json")]
    done = CliRunner().invoke(app, ["render", str(tmp_path / "Room"), "--out", str(tmp_path / "out"), *options])
    assert done.exit_code == 0, done.output
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["settings"]["culling_stride"] == 1
    assert report["settings"]["backdrop"] == "farthest"
    assert report["settings"]["delta_m"] == 0.2
    assert report["summary"]["triangles"]["warped"]["median"] >= 2 * (W - 1) * (H - 1)
