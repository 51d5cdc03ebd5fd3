"""The governor against a core whose cost follows rung and load, on a clock of its own."""

from __future__ import annotations

import itertools
import random

import pytest
from farside.engine.live.governor import LADDER, Governor, Rung, make_ladder
from farside.engine.settings import PER_PICTURE, QUALITIES, Settings

COSTS = (0.15, 0.27, 0.5, 0.7, 1.0, 1.9)


def rungs(costs=COSTS):
    return [Rung(f"r{k}", cost, Settings()) for k, cost in enumerate(costs)]


class Machine:
    """Renders pair after pair for its viewers in turn; a rung's true cost may differ from what the ladder says."""

    def __init__(self, governor, truth=COSTS, viewers=("a",), noise=0.0, seed=1):
        self.governor, self.truth, self.viewers = governor, truth, viewers
        self.now, self.trail, self.times = 0.0, [], []
        self._random, self._noise = random.Random(seed), noise

    def run(self, seconds, balanced_s, sizes=(1.0,)):
        """For some seconds, `balanced_s` a pair at cost 1 and size 1; returns the rung after each picture."""
        start, end = len(self.trail), self.now + seconds
        turns = itertools.cycle(zip(self.viewers, sizes, strict=True))
        while self.now < end:
            viewer, size = next(turns)
            rung = self.governor.rungs.index(self.governor.rung)
            took = balanced_s * size * self.truth[rung] * self._random.lognormvariate(0.0, self._noise)
            self.now += max(took, 1 / 72)  # as often as a headset sends poses
            self.governor.observe(viewer, took, self.now)
            self.trail.append(self.governor.rungs.index(self.governor.rung))
            self.times.append(took)
        return self.trail[start:]


def changes(trail):
    return [b - a for a, b in itertools.pairwise(trail) if a != b]


@pytest.mark.parametrize("noise", [0.0, 0.15])
def test_a_load_step_is_answered_at_once_and_undone_slowly_without_going_to_and_fro(noise):
    governor = Governor(rungs(), 30.0)
    machine = Machine(governor, noise=noise)
    assert machine.run(3, 0.015)[-1] == 5  # 1.9 x 15 ms fits 33 ms
    loaded = machine.run(20, 0.060)
    assert loaded[3] <= 2  # three slow pictures, and it is about where it fits
    assert loaded[-1] in (1, 2)
    assert len([step for step in changes(loaded[4:]) if step > 0]) <= 1
    assert sorted(machine.times[-50:])[25] < 1 / 30
    quiet = machine.run(20, 0.015)
    assert quiet[-1] in (4, 5)
    assert all(step == 1 for step in changes(quiet))


def test_a_climb_waits_and_happens_only_where_the_next_rung_fits():
    governor = Governor(rungs(), 30.0)
    machine = Machine(governor)
    machine.run(0.5, 0.1)
    low, since = machine.trail[-1], machine.now
    while machine.trail[-1] == low:
        machine.run(0.001, 0.03)
    assert Governor.DWELL_S - 0.5 <= machine.now - since <= Governor.DWELL_S + 0.5
    trail = machine.run(60, 0.03)
    # 1.0 x 30 ms is within 33.3 ms but not with room to spare: it stays below.
    assert trail[-1] == 3
    assert not changes(trail[300:])
    assert "r4 would take 30.0 ms" in governor.status(machine.now)["reason"]


@pytest.mark.parametrize("rung", [2, 3, 4])
def test_a_rung_that_costs_more_than_the_ladder_says_is_tried_once_in_a_while(rung):
    truth = [cost * (1.6 if k >= rung else 1.0) for k, cost in enumerate(COSTS)]
    balanced = 0.85 / 30 / COSTS[rung]
    governor = Governor(rungs(), 30.0)
    machine = Machine(governor, truth)
    machine.run(4, 10 * balanced)
    trail = machine.run(60, balanced)
    assert max(trail) == rung
    assert changes(trail[-1000:]) in ([], [-1])
    assert changes(trail).count(-1) == 1  # it fell back and did not try again
    assert trail[-1] == rung - 1


def test_what_a_failed_climb_taught_is_forgotten():
    governor = Governor(rungs(), 30.0)
    machine = Machine(governor, [1.6 * c if k == 4 else c for k, c in enumerate(COSTS)])
    machine.run(20, 0.028)
    assert governor.rung.name == "r3"
    machine.truth = COSTS
    machine.run(200, 0.028)
    assert governor.rung.name == "r4"


def test_below_the_lowest_rung_it_stays_and_says_so():
    governor = Governor(rungs(), 30.0)
    machine = Machine(governor)
    trail = machine.run(60, 1.0)
    assert trail[-1] == 0
    assert governor.changes == 1
    assert governor.status(machine.now)["reason"] == "slower than the target on the lowest rung"


def test_one_hitch_is_no_load():
    governor = Governor(rungs(), 30.0)
    machine = Machine(governor)
    for _ in range(20):
        machine.run(0.3, 0.015)
        machine.run(0.001, 0.5)
    assert governor.changes == 0


def test_the_slowest_viewer_counts_until_it_is_gone():
    governor = Governor(rungs(), 30.0)
    machine = Machine(governor, viewers=("small", "large"))
    assert machine.run(20, 0.016, sizes=(0.3, 3.0))[-1] == 2
    machine.viewers = ("small",)
    assert machine.run(20, 0.016, sizes=(0.3,))[-1] == 5


def test_status_predicts_every_rung_from_the_present_one():
    governor = Governor(rungs(), 20.0)
    status = governor.status(0.0)
    assert (status["rung"], status["measured_ms"], status["reason"]) == ("r5", None, "waiting for pictures")
    machine = Machine(governor)
    machine.run(0.15, 0.02)
    status = governor.status(machine.now)
    assert status["measured_ms"] == pytest.approx(38.0)
    assert status["predicted_ms"] == {f"r{k}": pytest.approx(20.0 * cost) for k, cost in enumerate(COSTS)}
    assert (status["target_fps"], status["changes"]) == (20.0, 0)


@pytest.mark.parametrize("quality", QUALITIES)
def test_the_ladder_leads_up_to_a_preset_and_differs_only_in_what_rendering_reads(quality):
    ladder, top = make_ladder(quality), Settings.preset(quality)
    assert ladder[-1].settings == top
    assert ladder[-1].name == quality
    for rung in ladder:
        rung.settings.fixed_as_in(top)
    assert [rung.cost for rung in ladder] == sorted({rung.cost for rung in ladder})
    assert len(ladder) >= 3
    assert ladder[0].settings.output_scale < 1


def test_what_is_given_holds_on_every_rung_and_equal_rungs_are_one():
    ladder = make_ladder("best", n_render=2, output_scale=0.8, jpeg_quality=33)
    assert {(r.settings.n_render, r.settings.output_scale, r.settings.jpeg_quality) for r in ladder} == {(2, 0.8, 33)}
    assert len({r.settings for r in ladder}) == len(ladder) < len(LADDER)
    assert {name for *_, changes in LADDER for name in changes} <= set(PER_PICTURE)


def test_what_cannot_be_governed_is_named():
    with pytest.raises(ValueError, match=r"rungs: costs \[\]: expected"):
        Governor([], 30.0)
    with pytest.raises(ValueError, match=r"rungs: costs \[2.0, 1.0\]: expected"):
        Governor(rungs((2.0, 1.0)), 30.0)
    for target in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="target_fps: "):
            Governor(rungs(), target)
