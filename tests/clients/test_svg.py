"""Plots as SVG: points and bars stand where their numbers are."""

from __future__ import annotations

import itertools
import math
from xml.etree import ElementTree

import numpy as np
import pytest
from farside.clients.bench.svg import ACROSS, HEIGHT, LEFT, TOP, UP, WIDTH, Limit, Series, bars, lines, ticks
from hypothesis import given
from hypothesis import strategies as st

NAMES = {"svg": "http://www.w3.org/2000/svg"}


def drawn(text: str) -> ElementTree.Element:
    tree = ElementTree.fromstring(text)
    assert tree.get("viewBox") == f"0 0 {WIDTH} {HEIGHT}"
    return tree


def texts(tree: ElementTree.Element) -> list[str]:
    return [element.text or "" for element in tree.iterfind(".//svg:text", NAMES)]


def points(tree: ElementTree.Element) -> list[list[tuple[float, float]]]:
    found = [element.get("points") or "" for element in tree.iterfind(".//svg:polyline", NAMES)]
    return [[(float(x), float(y)) for x, _, y in (p.partition(",") for p in line.split())] for line in found]


def test_points_are_at_their_numbers() -> None:
    tree = drawn(lines("a < b", "frame", "ms & more", [
        Series("up", [0.0, 5.0, 10.0], [0.0, 4.0, 10.0]), Series("flat", [2.5, 2.5], [0.0, 10.0]),
    ], [Limit("limit", 7.5)]))  # fmt: skip
    up, flat = points(tree)
    expected = [(LEFT, TOP + UP), (LEFT + 0.4 * ACROSS, TOP + 0.5 * UP), (LEFT + ACROSS, TOP)]
    assert np.array(up) == pytest.approx(np.array(expected), abs=0.051)  # written with one decimal place
    assert flat == [(LEFT, TOP + 0.75 * UP), (LEFT + ACROSS, TOP + 0.75 * UP)]
    (dashed,) = [e for e in tree.iterfind(".//svg:line", NAMES) if e.get("stroke-dasharray")]
    assert float(dashed.get("y1") or 0) == float(dashed.get("y2") or 0) == TOP + 0.25 * UP
    assert {"a < b", "frame", "ms & more", "up", "flat", "limit", "0", "10"} <= set(texts(tree))


def test_lines_reach_from_side_to_side() -> None:
    tree = drawn(lines("title", "frame", "y", [Series("a", [1.0, 2.0], [0.0, 104.0])]))
    ((start, _), (end, _)), *_ = points(tree)
    assert (start, end) == (LEFT, LEFT + ACROSS)
    assert {"0", "50", "100"} <= set(texts(tree))
    assert "150" not in texts(tree)


def test_bars_reach_up_to_their_numbers() -> None:
    tree = drawn(bars("title", "ms", ["A", "B"], [Series("one", [10.0, 5.0]), Series("two", [0.0, 2.5])]))
    boxes = [e for e in tree.iterfind(".//svg:rect", NAMES) if e.find("svg:title", NAMES) is not None]
    told = {(e.findtext("svg:title", None, NAMES) or ""): float(e.get("height") or 0) for e in boxes}
    expected = {"A, one: 10": UP, "B, one: 5": 0.5 * UP, "A, two: 0": 0.0, "B, two: 2.5": 0.25 * UP}
    assert told == pytest.approx(expected)
    assert all(float(e.get("y") or 0) + float(e.get("height") or 0) == pytest.approx(TOP + UP) for e in boxes)
    sides = sorted((float(e.get("x") or 0), float(e.get("width") or 0)) for e in boxes)
    assert all(x + width <= after for (x, width), (after, _) in itertools.pairwise(sides))


def test_one_point_and_negative_numbers_are_drawn() -> None:
    ((x, y),) = points(drawn(lines("one", "x", "y", [Series("a", [-3.0], [7.0])])))[0:1][0]
    assert LEFT <= x <= LEFT + ACROSS
    assert TOP < y <= TOP + UP


@given(st.floats(-1e9, 1e9), st.floats(0, 1e9))
def test_ticks_hold_the_numbers_at_equal_distances(low: float, span: float) -> None:
    found = ticks(low, low + span)
    steps = [b - a for a, b in itertools.pairwise(found)]
    assert 2 <= len(found) <= 8
    slack = 1e-6 * max(steps)
    assert found[0] <= low + slack
    assert found[-1] >= low + span - slack
    assert max(steps) - min(steps) <= 1e-6 * max(abs(found[0]), abs(found[-1]), max(steps))


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "plot: nothing to draw"),
        ([Series("a", [])], "plot: nothing to draw"),
        ([Series("a", [math.nan], [1.0])], "plot: .*nan.*: expected finite numbers"),
        ([Series("a", [1.0], [math.inf])], "plot: .*inf.*: expected finite numbers"),
        ([Series("a", [1.0, 2.0], [1.0])], "plot: expected one x for each y"),
    ],
)
def test_what_cannot_be_drawn_is_refused(given: list[Series], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        lines("plot", "x", "y", given)


def test_bars_need_a_height_for_each_group() -> None:
    with pytest.raises(ValueError, match="plot: expected 2 heights in each series"):
        bars("plot", "y", ["A", "B"], [Series("a", [1.0])])
