"""Two versions are measured in turns; what cannot be measured is told."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from farside.clients.bench.against import compare

PAIR, FRAME = ("pair", "warp"), ("later frame", "pbi")


def test_versions_take_turns_and_the_first_runs_do_not_count():
    order, costs = [], {"now": iter([9.0, 2, 3, 4, 5, 6, 7]), "then": iter([1.0, 4, 6, 8, 10, 12, 14])}

    def run(side):
        def measured():
            order.append(side)
            cost = next(costs[side])
            found = {PAIR: (cost, 3 * cost), ("pair", "select"): (cost, 0.0), FRAME: (1.0, 1.0)}
            return found if side == "now" else {PAIR: found[PAIR]}

        return measured

    done = []
    found = dict(compare(run("now"), run("then"), 6, lambda: done.append(1)))
    assert order == ["then", "now", "now", "then"] * 3 + ["then", "now"]
    assert len(done) == 14
    assert found.keys() == {PAIR}  # others took no time, or only one version has them
    wall, cpu = found[PAIR]
    assert wall == cpu == (0.5, 0.5, 0.5)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["against", "no-such-commit", "museum"], "expected a checkout that has the commit"),
        (["against", "HEAD", "no-such-twin"], "expected a folder, or a twin: "),
        (["against", "HEAD", "museum", "--turns", "3"], "--turns"),
        (["spared", "no-such-twin"], "expected one of "),
        (["peers", "/no/such/folder"], "/no/such/folder: expected a folder of sequences with a README.md"),
    ],
)
def test_what_cannot_be_measured_is_told_before_anything_is_done(arguments, told):
    program = [sys.executable, "-m", "farside.clients.cli", "bench", *arguments]
    done = subprocess.run(program, capture_output=True, text=True, check=False, env=os.environ | {"COLUMNS": "200"})
    assert done.returncode == 2
    assert told in done.stderr
    assert len(done.stderr.splitlines()) < 12
    assert "Traceback" not in done.stderr
