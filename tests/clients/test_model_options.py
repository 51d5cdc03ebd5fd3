"""`--light`, `--cull-stale`, `--middle-layers` and `--late-rounds`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from farside.clients.cli import app
from farside.engine.settings import Settings
from farside.engine.synth import write_twin
from farside.server.settings import ServerSettings
from typer.testing import CliRunner


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, (0.0, False, 0, 1)),
        ({"light": 1.5}, (1.5, False, 0, 1)),
        ({"cull_stale": True}, (0.0, True, 0, 1)),
        ({"middle_layers": 1000}, (0.0, True, 1000, 1)),
        ({"middle_layers": 1000, "late_rounds": 0}, (0.0, True, 1000, 0)),
        ({"middle_layers": 0, "cull_stale": False}, (0.0, False, 0, 1)),
    ],
)
def test_the_server_takes_them(given: dict[str, object], expected: tuple[float, bool, int, int]) -> None:
    settings = ServerSettings(**given).engine()
    assert (settings.light_s, settings.cull_stale, settings.middle_layers, settings.late_rounds) == expected


def test_middle_layers_with_stale_surfaces_are_refused() -> None:
    with pytest.raises(ValueError, match="middle_layers: 5: expected 0 where cull_stale is False"):
        Settings.preset("balanced", middle_layers=5, cull_stale=False)


@pytest.mark.parametrize("time_s", [float("nan"), float("inf"), -1.0])
def test_the_time_constant_of_light_is_a_number(time_s: float) -> None:
    with pytest.raises(ValueError, match=r"light_s: .*: expected a number of at least 0"):
        Settings.preset("balanced", light_s=time_s)


def test_rounds_without_middle_layers_are_refused() -> None:
    with pytest.raises(ValueError, match="late_rounds: 2: expected with middle_layers above 0"):
        ServerSettings(late_rounds=2).engine()


def test_pictures_are_rendered_with_them(tmp_path: Path) -> None:
    write_twin("museum", tmp_path / "Museum", 0.03, frames=3)
    report = tmp_path / "report.json"
    arguments = ["render", str(tmp_path / "Museum"), "--out", str(tmp_path), "--camera", "t0", "--report", str(report)]
    done = CliRunner().invoke(app, [*arguments, "--light", "0.5", "--middle-layers", "500", "--late-rounds", "2"])
    assert done.exit_code == 0, done.output
    settings = json.loads(report.read_text())["settings"]
    names = ("light_s", "cull_stale", "middle_layers", "late_rounds")
    assert [settings[name] for name in names] == [0.5, True, 500, 2]
