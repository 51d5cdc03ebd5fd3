"""Numerical extremes: the very cases of `farside bench --extremes`, and how a row is judged."""

from __future__ import annotations

import contextlib
import csv
import math

import pytest
import typer
from farside.clients.bench import extremes
from farside.engine.evaluation.extremes import all_cases, growth_cases, run
from farside.engine.evaluation.extremes.case import Case, Measured

CASES = all_cases()


@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_extreme(case):
    row = run(case)
    assert row.verdict == ("limit" if case.refused else "holds"), (row.measured, row.said)


@pytest.mark.long
@pytest.mark.parametrize("case", growth_cases(10_000), ids=[case.name for case in growth_cases(10_000)])
def test_ten_thousand_frames(case):
    row = run(case)
    assert row.verdict == "holds", (row.measured, row.said)


def raising(error):
    def measure():
        raise error

    return measure


@pytest.mark.parametrize(
    ("measure", "refused", "verdict"),
    [
        (lambda: [Measured(1.0, 1.0, "m"), Measured(0.0, 0.0, "m")], "", "holds"),
        (lambda: [Measured(0.1, 1.0, "m"), Measured(1.1, 1.0, "m")], "", "fails"),
        (lambda: [Measured(1e-9, 0.0, "m")], "", "fails"),
        (lambda: [Measured(math.nan, 1.0, "m")], "", "fails"),
        (lambda: [Measured(1.0, math.nan, "m")], "", "fails"),
        (lambda: [Measured(0.0, 1.0, "m")], "expected more", "fails"),
        (raising(ValueError("size: expected more")), "expected more", "limit"),
        (raising(ValueError("size: expected less")), "expected more", "fails"),
        (raising(ZeroDivisionError("expected more")), "expected more", "fails"),
        (raising(ValueError("size: expected more")), "", "fails"),
    ],
)
def test_a_row_holds_only_within_its_bound_or_where_it_is_refused_as_documented(measure, refused, verdict):
    assert run(Case("group", "value", measure, refused)).verdict == verdict


@pytest.mark.parametrize(("error", "code"), [(0.5, 0), (1.5, 1)])
def test_the_benchmark_prints_and_writes_rows_and_tells_by_its_exit_code(error, code, monkeypatch, tmp_path, capsys):
    cases = [
        Case("group", "some value", lambda: [Measured(error, 1.0, "m")]),
        Case("group", "other", raising(ValueError("size: 0: expected more")), "expected more"),
    ]
    monkeypatch.setattr(extremes, "all_cases", lambda: cases)
    with pytest.raises(typer.Exit) if code else contextlib.nullcontext() as caught:
        extremes.show_extremes(tmp_path / "report")
    assert caught is None or caught.value.exit_code == code
    verdict = "fails" if code else "holds"
    assert f"2 cases: {1 - code} holds, 1 limit, {code} fails" in capsys.readouterr().out
    with (tmp_path / "report" / "extremes.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[1] == ["group", "some value", f"{error:g}", "1", "m", verdict]
    assert rows[2] == ["group", "other", "", "", "ValueError: size: 0: expected more", "limit"]


def test_no_two_rows_have_one_name():
    assert len({case.name for case in CASES}) == len(CASES)
