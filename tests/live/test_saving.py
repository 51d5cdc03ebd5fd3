"""Saving while a model is used: when, by whom, and what happens if it fails."""

from __future__ import annotations

import logging
import threading
from pathlib import Path

import pytest
from farside.engine.live.core import LocalCore
from farside.engine.live.saving import Saver

HANG_S = 20.0


class Model:
    """A model whose copies are numbered; writing waits for `gate`, and fails while `fault` is set."""

    def __init__(self) -> None:
        self.updates, self.copies, self.written = 0, 0, []
        self.gate, self.done = threading.Event(), threading.Semaphore(0)
        self.gate.set()
        self.fault: Exception | None = None
        self.copiers: list[str] = []

    def copy(self) -> Copy:
        self.copies += 1
        self.copiers.append(threading.current_thread().name)
        return Copy(self, self.updates)


class Copy:
    def __init__(self, model: Model, updates: int) -> None:
        self.model, self.updates = model, updates

    def write(self, path: Path) -> int:
        try:
            assert self.model.gate.wait(HANG_S)
            if self.model.fault is not None:
                raise self.model.fault
            self.model.written.append((threading.current_thread().name, self.updates))
            return 7
        finally:
            self.model.done.release()


class Clock:
    now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def parts(tmp_path):
    model, clock = Model(), Clock()
    saver = Saver(tmp_path / "room.farside", 1000.0, model.copy, clock)
    yield model, clock, saver
    model.gate.set()
    saver.finish()


def update(model, saver):
    with saver.updating:
        model.updates += 1
        saver.offer()


def test_a_model_is_copied_by_who_updates_it_and_written_by_another(parts):
    model, clock, saver = parts
    update(model, saver)
    assert model.copies == 0  # it is not time
    clock.now += 1000.0
    update(model, saver)
    assert model.copiers == [threading.current_thread().name]
    assert model.done.acquire(timeout=HANG_S)
    assert model.written == [("farside-save", 2)]
    clock.now += 999.0
    update(model, saver)
    assert model.copies == 1


def test_updates_go_on_while_it_is_written(parts):
    model, clock, saver = parts
    model.gate.clear()
    clock.now += 1000.0
    update(model, saver)
    for _ in range(3):  # the disk is slow: no second copy waits for it
        clock.now += 1000.0
        update(model, saver)
    assert model.copies == 1
    assert model.written == []
    model.gate.set()
    assert model.done.acquire(timeout=HANG_S)


def test_what_cannot_be_written_is_logged_and_counted_and_tried_again(parts, caplog):
    model, clock, saver = parts
    model.fault = OSError(28, "No space left on device")
    clock.now += 1000.0
    with caplog.at_level(logging.ERROR):
        update(model, saver)
        assert model.done.acquire(timeout=HANG_S)
        model.fault = None
        saver.finish()
    assert "could not be saved: OSError: [Errno 28] No space left on device" in caplog.text
    assert model.written[-1][1] == 1
    status = saver.status()
    assert (status["saves"], status["failures"], status["bytes"], status["error"]) == (1, 1, 7, "")


def test_the_end_saves_only_what_has_changed(parts):
    model, _clock, saver = parts
    saver.finish()
    assert model.copies == 0


def test_the_end_says_that_there_was_nothing_to_save(tmp_path, caplog):
    saver = Saver(tmp_path / "room.farside", 1000.0, lambda: None)
    with saver.updating:
        saver.offer()
    saver.finish()
    assert caplog.messages == [f"model {tmp_path / 'room.farside'}: nothing was saved: there was no model yet"]


def test_the_end_waits_for_the_newest_state(tmp_path):
    model = Model()
    saver = Saver(tmp_path / "room.farside", 1000.0, model.copy)
    update(model, saver)
    update(model, saver)
    saver.finish()
    assert [updates for _, updates in model.written] == [2]


def test_a_model_that_is_not_updated_any_more_is_saved_too(tmp_path):
    model = Model()
    saver = Saver(tmp_path / "room.farside", 0.05, model.copy)
    update(model, saver)
    assert model.done.acquire(timeout=HANG_S)
    assert model.written[0][1] == 1
    saver.finish()
    assert len(model.written) == 1


def test_a_core_saves_after_updates_and_at_its_end(tmp_path):
    model = Model()

    class Engine:
        f_vin = 0.0

        def update(self, *_):
            model.updates += 1
            return type("Report", (), {"stages": {}, "left_out": {}})

        def status(self):
            return {"frame_index": model.updates}

        def close(self):
            model.closed_after = len(model.written)

    saver = Saver(tmp_path / "room.farside", 0.0, model.copy)
    core = LocalCore(Engine(), saver)
    one = type("Frame", (), {"views": (None,)})
    saved = core.update(one, dict, {}, 30.0).status["saved"]
    assert saved["file"] == str(tmp_path / "room.farside")
    core.close()
    assert model.written[-1][1] == 1
    assert model.closed_after == len(model.written)
