"""`farside bench`: measures as sub-commands, and as the earlier flags."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import pytest
from farside.clients.bench.group import MEASURES, load, old_calls
from farside.clients.cli import app
from typer.testing import CliRunner


def run(*args: str) -> Any:
    done = CliRunner().invoke(app, ["bench", *args])
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


@pytest.mark.parametrize("name", MEASURES)
def test_every_measure_has_a_command_with_help(name: str) -> None:
    command = load(name)
    assert command.help
    done = run(name, "--help")
    assert done.exit_code == 0
    assert "--help" in done.output
    arguments = [p for p in command.params if p.param_type_name == "argument" and p.required]
    assert bool(arguments) == MEASURES[name].named


def test_the_list_needs_no_measure() -> None:
    done = run("--help")
    assert done.exit_code == 0
    for name in MEASURES:
        assert name in done.output


OLD: dict[str, tuple[list[str], list[tuple[str, list[str]]]]] = {
    "a name": (["--stages", "museum", "--scale", "0.1"], [("stages", ["museum", "--scale", "0.1"])]),
    "after its options": (["--frames=3", "--ghosts=frog"], [("ghosts", ["frog", "--frames=3"])]),
    "folders": (["A", "B", "--trade", "--every", "2"], [("trade", ["A", "B", "--every", "2"])]),
    "two at once, each its own options": (
        ["--noise", "frog", "--ghosts", "museum", "--views", "3", "--report", "R"],
        [("noise", ["frog", "--views", "3"]), ("ghosts", ["museum", "--report", "R"])],
    ),
    "what another knows is ignored": (["--pairs", "museum", "--frames", "3"], [("pairs", ["museum"])]),
    "what nobody knows is refused": (["--pairs", "museum", "--what", "3"], [("pairs", ["museum", "--what", "3"])]),
    "a switch takes no value": (
        ["--peers", "F", "--no-background", "--quality", "fast"],
        [("peers", ["F", "--no-background", "--quality", "fast"])],
    ),
    "no flag": (["trade", "--every", "2"], []),
    "paper": (["--paper", "--twins", "frog"], [("paper", ["--twins", "frog"])]),
}


@pytest.mark.parametrize("case", OLD)
def test_old_flags_stand_for_sub_commands(case: str) -> None:
    given, expected = OLD[case]
    assert old_calls(given) == expected


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, tuple[Any, ...]]]:
    """The calls that reach the measures, which are recorded instead of measuring."""
    asked: list[tuple[str, tuple[Any, ...]]] = []

    def noting(name: str) -> Callable[..., None]:
        return lambda *given: asked.append((name, given))

    for module, function in (("stages", "show_stages"), ("spared", "show_spared"), ("fill", "show_fills")):
        monkeypatch.setattr(importlib.import_module(f"farside.clients.bench.{module}"), function, noting(module))
    return asked


def test_both_ways_ask_for_the_same(calls: list[tuple[str, tuple[Any, ...]]]) -> None:
    run("--stages", "museum", "--scale", "0.1", "--views", "3", "--quality", "fast", "--no-background")
    run("stages", "museum", "--scale", "0.1", "--views", "3", "--quality", "fast", "--no-background")
    assert calls[0] == calls[1]
    _, (name, scale, frames, settings, report) = calls[0]
    assert (name, scale, frames, report) == ("museum", 0.1, 8, None)
    assert (settings.n_render, settings.background) == (3, False)
    run("--fill", "SEQ", "--spared", "museum,frog", "--frames", "4")
    assert [name for name, _ in calls[2:]] == ["fill", "spared"]
    assert calls[2][1][2:6] == (4, 5, "best", 2)
    assert calls[3][1] == (["museum", "frog"], 0.25, 4)


@pytest.mark.parametrize(
    ("args", "said"),
    [([], "nothing to measure: expected one of paper, accuracy"), (["--views", "x", "--accuracy"], "--views: 'x'")],
)
def test_what_is_wrong_is_told(args: list[str], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        run(*args)


@pytest.mark.parametrize("given", ["--pairs museum --what 3", "nothing", "pairs museum --frames 3"])
def test_what_nobody_knows_is_refused(given: str) -> None:
    done = run(*given.split())
    assert done.exit_code == 2
