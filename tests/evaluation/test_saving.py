"""`farside bench saving`: pictures and updates while the model is copied and written."""

from __future__ import annotations

import math

import pytest
from farside.clients.bench.saving import command
from farside.engine.background.saved_model import SavedModel
from farside.engine.evaluation.saving import SavingRun, Span, measure_saving
from farside.engine.settings import Settings
from support.rooms import camera_row, frame


def test_pictures_and_updates_are_told_apart_by_what_happens_to_the_model():
    saved = [Span("copied", 10.0, 11.0), Span("written", 11.0, 15.0)]
    asked = [
        Span("picture", 9.0, 9.1), Span("picture", 9.9, 10.1), Span("picture", 10.9, 11.2), Span("picture", 12.0, 12.4),
        Span("picture", 15.0, 15.2), Span("update", 9.5, 11.0), Span("update", 14.0, 16.0),
    ]  # fmt: skip
    run = SavingRun(asked, saved, 7)
    found = {(row.what, row.when): (row.number, row.median_ms, row.longest_ms) for row in run.delays()}
    assert found["picture", "untouched"] == pytest.approx((2, 150.0, 200.0))
    assert found["picture", "copied"] == pytest.approx((2, 250.0, 300.0))
    assert found["picture", "written"] == pytest.approx((1, 400.0, 400.0))
    assert found["update", "copied"] == pytest.approx((1, 1500.0, 1500.0))
    assert found["update", "written"] == pytest.approx((1, 2000.0, 2000.0))
    assert found["update", "untouched"][0] == 0
    assert math.isnan(found["update", "untouched"][1])
    assert run.took_ms("written") == pytest.approx([4000.0])


def test_a_model_is_saved_while_pictures_are_rendered(tmp_path):
    cameras, path = camera_row(), tmp_path / "room.farside"
    frames = [frame(k, cameras, 0.1 * k - 0.3) for k in range(4)]
    run = measure_saving(frames, Settings.preset("fast"), 30.0, path, 0.02, 2.0)
    assert run.took_ms("copied")
    assert run.took_ms("written")
    assert run.size == pytest.approx(path.stat().st_size, rel=0.01)  # it is saved once more at the end
    assert SavedModel.read(path).model.frames > 0
    kinds = {span.what for span in run.asked}
    assert kinds == {"picture", "update"}
    assert sum(row.number for row in run.delays()) == len(run.asked)


def test_a_file_that_cannot_be_written_is_told_of(tmp_path):
    cameras = camera_row()
    frames = [frame(k, cameras) for k in range(2)]
    with pytest.raises(OSError, match="expected to be written"):
        measure_saving(frames, Settings.preset("fast"), 30.0, tmp_path / "gone" / "room.farside", 0.02, 0.5)
    with pytest.raises(ValueError, match="frames: 1: expected two or more"):
        measure_saving(frames[:1], Settings.preset("fast"), 30.0, tmp_path / "room.farside", 0.02, 0.5)


def test_the_table(capsys):
    command("museum", scale=0.02, frames=2, quality="fast", seconds=2.0, save_interval_s=0.1)
    said = capsys.readouterr().out
    assert "museum at scale 0.02, quality fast" in said
    assert "the longest wait for a picture" in said
