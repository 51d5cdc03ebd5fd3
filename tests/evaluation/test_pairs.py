"""`farside bench pairs`: rates by a clock that pairs move on, and updates that come when it says so."""

from __future__ import annotations

import re
import threading
from types import SimpleNamespace

import pytest
from farside.clients.cli import app
from farside.engine.evaluation import pairs
from farside.engine.evaluation.pairs import measure_pairs
from farside.engine.pipeline.engine import Engine
from farside.engine.support.runtime import thread_count
from farside.engine.synth import make_twin, twin_frame
from support.clocks import Clock
from support.doubles import HANG_S
from typer.testing import CliRunner

PAIR_S = 0.5  # that a pair takes


class Turns:
    """Both threads of a run in step: an update takes place between two pairs, whenever its time has come."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.due, self.done = threading.Semaphore(0), threading.Semaphore(0)
        self.stopped, self.interval_s, self.next_s = False, None, 0.0

    def wait(self, seconds: float) -> bool:
        """As `threading.Event.wait`, by the update's thread."""
        if self.interval_s is None:
            self.interval_s = seconds
        else:
            assert seconds == self.interval_s
            self.done.release()
        assert self.due.acquire(timeout=HANG_S)
        return self.stopped

    def set(self) -> None:
        self.stopped = True
        self.due.release()

    def pair(self) -> None:
        """A pair takes its time, and the updates that are due meanwhile theirs."""
        self.clock.advance(PAIR_S)
        self.next_s += PAIR_S
        while self.interval_s is not None and self.next_s >= self.interval_s:
            self.next_s -= self.interval_s
            self.due.release()
            assert self.done.acquire(timeout=HANG_S)


@pytest.fixture
def seen(monkeypatch):
    """What engines were asked for: frames and threads of updates, and pairs; stages of the k-th pair take k ms."""
    clock, render, update = Clock(), Engine.render, Engine.update
    found = SimpleNamespace(runs=[], turns=None)

    class Event(Turns):
        def __init__(self):
            super().__init__(clock)
            found.turns = self
            found.runs.append(SimpleNamespace(frames=[], threads=set(), pairs=0))

    def timed_render(engine, *given):
        pair = render(engine, *given)
        if found.turns is None or found.turns.stopped:  # warming up
            return pair
        run = found.runs[-1]
        run.pairs += 1
        found.turns.pair()
        return SimpleNamespace(stages={"warp": float(run.pairs), "fill": 2.0 * run.pairs})

    def noted_update(engine, frame, *given):
        if found.turns is not None and not found.turns.stopped:
            found.runs[-1].frames.append(frame.index)
            found.runs[-1].threads.add(thread_count())
        return update(engine, frame, *given)

    class Thread(threading.Thread):
        def start(self):
            """Waits until it waits itself."""
            super().start()
            while found.turns.interval_s is None:
                assert self.is_alive()

    clock.instead_of(monkeypatch, pairs)
    monkeypatch.setattr(pairs, "threading", SimpleNamespace(Event=Event, Thread=Thread))
    monkeypatch.setattr(Engine, "render", timed_render)
    monkeypatch.setattr(Engine, "update", noted_update)
    return found


@pytest.mark.parametrize(("f_vin", "updates"), [(0.0, 0), (0.5, 5), (1.0, 10), (4.0, 40)])
def test_rates_are_counts_over_the_time_that_passed(seen, f_vin, updates):
    twin, threads = make_twin("painter", 0.04), thread_count()
    frames = [twin_frame(twin, index) for index in range(4)]
    rate = measure_pairs(frames, "fast", f_vin, 10.0, (32, 36))
    (run,) = seen.runs
    assert run.pairs == 20
    assert (rate.pairs, rate.updates) == (pytest.approx(2.0), pytest.approx(updates / 10))
    assert rate.stages == {"warp": 10.5, "fill": 21.0}  # medians
    assert run.frames == [(2 + k) % 4 for k in range(updates)]  # the first two were warmed up with
    assert run.threads == ({max(1, threads - 1)} if updates else set())  # a core is left to rendering
    assert thread_count() == threads


def test_the_command_prints_a_row_a_rate(seen):
    done = CliRunner().invoke(app, ["bench", "pairs", "painter", "--scale", "0.04", "--quality", "fast"])
    assert done.exit_code == 0, done.output
    assert "painter at scale 0.04, quality fast" in done.output
    printed = [re.findall(r"[\d.]+", line) for line in done.output.splitlines() if line.startswith("│")]
    asked = ("0", "0.5", "1", "2", "4")
    assert printed == [[rate, f"{float(rate):.1f}", "2.0", "10.5", "21.0"] for rate in asked]
    assert [len(run.frames) for run in seen.runs] == [0, 5, 10, 20, 40]
