"""`farside bench all`: finished results are kept, outdated ones are measured again, and the document is written."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import typer
from farside.clients.bench import all as module
from farside.clients.bench.all import command
from farside.clients.bench.group import MEASURES, load
from farside.clients.bench.sections import SECTIONS, sized

ONLY = "exposure,sparse,ghosts"


class FakeRuns:
    """Commands that print a line instead of measuring; some fail."""

    def __init__(self) -> None:
        self.ran: list[tuple[str, ...]] = []
        self.failing: set[str] = set()

    def __call__(self, *arguments: str) -> str:
        self.ran.append(arguments)
        if arguments[1] in self.failing:
            raise RuntimeError(f"farside {arguments[1]}: exit code 2")
        if arguments[0] == "synth":
            Path(arguments[2]).mkdir()
        if "--report" in arguments:
            folder = Path(arguments[arguments.index("--report") + 1])
            (folder / "plot.png").write_bytes(b"png")
            return f"{arguments[1]}: 42.0 dB\nplot: {folder / 'plot.png'}\n"
        return f"{arguments[1]}: 42.0 dB\n"

    @property
    def measured(self) -> list[str]:
        return [arguments[1] for arguments in self.ran if arguments[0] == "bench"]


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> FakeRuns:
    fake = FakeRuns()
    monkeypatch.setattr(module, "_farside", fake)
    monkeypatch.setattr(module, "machine_name", lambda: "a machine")
    monkeypatch.setattr(module, "commit_name", lambda: "abc123")
    return fake


@pytest.mark.parametrize("section", SECTIONS, ids=lambda section: section.key)
@pytest.mark.parametrize("small", [False, True])
def test_every_section_is_a_command_that_there_is(section, small: bool) -> None:
    assert section.key in MEASURES
    chosen = sized(section, 0.05, 2) if small else section
    name, *arguments = chosen.arguments
    arguments += ["--report", "DIR"] if chosen.reports else []
    context = load(name).make_context(name, arguments)
    for option in ("scale", "frames"):
        if small and option in context.params:
            assert context.params[option] <= {"scale": 0.05, "frames": 2}[option]
    assert all(need == "sequences" or need in ("museum", "hijack", "painter") for need in chosen.needs)


def test_sections_ask_each_question_once() -> None:
    assert len({section.key for section in SECTIONS}) == len(SECTIONS)
    assert set(MEASURES) - {section.key for section in SECTIONS} == {"against", "all"}  # which compares versions


def test_what_is_finished_is_kept(runs: FakeRuns, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    command(tmp_path / "R", only=ONLY, scale=0.05, frames=2)
    assert runs.measured == ["exposure", "sparse", "ghosts"]
    twin = tmp_path / "R" / "twins" / "hijack-0.05-1" / "hijack"
    assert ("synth", "hijack", str(twin.with_name("hijack.partial")), "--scale", "0.05", "--frames", "1") in runs.ran
    assert twin.is_dir()
    first = (tmp_path / "R" / "RESULTS.md").read_text()
    command(tmp_path / "R", only=ONLY, scale=0.05, frames=2, results=tmp_path / "elsewhere.md")
    assert len(runs.measured) == 3
    assert (tmp_path / "R" / "RESULTS.md").read_text() == first
    text = (tmp_path / "elsewhere.md").read_text()  # the same, with pictures of its own
    found = re.search(r"!\[ghosts\]\((.+)\)", first)
    assert found is not None
    assert text == first.replace(found[1], "results/ghosts.png")
    assert (tmp_path / "results" / "ghosts.png").read_bytes() == (tmp_path / "R" / found[1]).read_bytes()
    command(tmp_path / "R", only="ghosts", scale=0.06, frames=2)  # another command
    assert runs.measured[3:] == ["ghosts"]
    monkeypatch.setattr(module, "commit_name", lambda: "def456")
    command(tmp_path / "R", only="ghosts", scale=0.06, frames=2)
    monkeypatch.setattr(module, "machine_name", lambda: "another machine")
    command(tmp_path / "R", only="ghosts", scale=0.06, frames=2)
    assert runs.measured[4:] == ["ghosts", "ghosts"]


def test_results_of_earlier_commits_count_if_wanted_and_are_called_so(
    runs: FakeRuns, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command(tmp_path, only=ONLY, scale=0.05, frames=2)
    monkeypatch.setattr(module, "commit_name", lambda: "def456")
    command(tmp_path, only="ghosts", scale=0.05, frames=2)
    command(tmp_path, only=ONLY, scale=0.05, frames=2, earlier=True)
    assert runs.measured == ["exposure", "sparse", "ghosts", "ghosts"]
    text = (tmp_path / "RESULTS.md").read_text()
    assert "Commit: def456, where a section does not name an earlier one." in text
    told = [line for line in text.splitlines() if line.startswith("`farside")]
    assert [line.endswith(", abc123") for line in told] == [True, True, False]
    command(tmp_path, only="ghosts", scale=0.06, frames=2, earlier=True)  # another command
    monkeypatch.setattr(module, "machine_name", lambda: "another machine")
    command(tmp_path, only="ghosts", scale=0.06, frames=2, earlier=True)
    assert runs.measured[4:] == ["ghosts", "ghosts"]


def test_the_document_has_question_command_machine_commit_table_and_reading(runs: FakeRuns, tmp_path: Path) -> None:
    command(tmp_path, only=ONLY, scale=0.05, frames=2)
    text = (tmp_path / "RESULTS.md").read_text()
    for said in (
        "## How fast do people who move on disappear from the model?", "Machine: a machine. Commit: abc123.",
        "`farside bench ghosts museum --scale 0.05 --frames 2 --report DIR`", "ghosts: 42.0 dB", "plot: DIR/plot.png",
        "Percent of pixels. Ghosts:",
        "`farside synth hijack HIJACK --scale 0.05 --frames 1; farside bench sparse HIJACK`",
    ):  # fmt: skip
        assert said in text
    (picture,) = [line for line in text.splitlines() if line.startswith("![")]
    assert (tmp_path / picture.partition("(")[2].rstrip(")")).read_bytes() == b"png"


def test_what_fails_is_told_and_tried_again(runs: FakeRuns, tmp_path: Path) -> None:
    runs.failing = {"sparse"}
    with pytest.raises(typer.Exit):
        command(tmp_path, only=f"{ONLY},peers")
    text = (tmp_path / "RESULTS.md").read_text()
    assert "No result: farside sparse: exit code 2." in text
    assert "No result: not measured: expected --sequences." in text
    assert "ghosts: 42.0 dB" in text
    runs.failing = set()
    command(tmp_path, only=f"{ONLY},peers", sequences=tmp_path)
    assert runs.measured == ["exposure", "sparse", "ghosts", "sparse", "peers"]
    with pytest.raises(ValueError, match="--only: 'nothing': expected names among peers"):
        command(tmp_path, only="nothing")


def test_a_stopped_measure_is_not_kept(runs: FakeRuns, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(*arguments: str) -> str:
        if arguments[1] == "sparse":
            raise KeyboardInterrupt
        return runs(*arguments)

    monkeypatch.setattr(module, "_farside", stop)
    with pytest.raises(KeyboardInterrupt):
        command(tmp_path, only=ONLY)
    assert "exposure: 42.0 dB" in (tmp_path / "RESULTS.md").read_text()
    monkeypatch.setattr(module, "_farside", runs)
    command(tmp_path, only=ONLY)
    assert runs.measured == ["exposure", "sparse", "ghosts"]
    kept = [json.loads(path.read_text()) for path in tmp_path.glob("*/result.json")]
    assert {result["key"] for result in kept} == {"exposure", "sparse", "ghosts"}


def test_machine_and_commit_have_names() -> None:
    assert "cores" in module.machine_name()
    assert "Python 3." in module.machine_name()
    assert module.commit_name()
