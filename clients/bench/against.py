"""`farside bench against`: the stages of this version next to those of another commit, in turns."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from farside.engine.evaluation.paired import FEWEST, Ratio, paired_ratio
from farside.engine.evaluation.twin_recording import is_twin
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .options import Frames, Quality, Report, Scale, Views

__all__ = ["command", "compare"]

Stage = tuple[str, str]  # phase and name
Costs = Mapping[Stage, tuple[float, float]]  # wall and CPU time, ms


def command(
    commit: Annotated[str, typer.Argument(metavar="COMMIT", help="What git knows the other version by.")],
    name: Annotated[str, typer.Argument(metavar="SEQ|NAME", help="A sequence's folder, or the name of a twin.")],
    scale: Scale = 0.25,
    frames: Frames = 8,
    quality: Quality = "balanced",
    views: Views = 5,
    turns: Annotated[int, typer.Option(min=FEWEST, help="How often each version is measured.")] = 20,
    report: Report = None,
) -> None:
    """Measure every stage of this version and of another commit in turns, and tell the ratios."""
    console, is_made = Console(stderr=True), is_twin(name)
    with tempfile.TemporaryDirectory() as scratch, _installed(commit, Path(scratch), console) as other:
        folder = _twin(name, scale, frames, Path(scratch), console) if is_made else Path(name)
        asked = [
            "bench", "--stages", str(folder), "--frames", str(frames), "--quality", quality, "--views", str(views),
        ]  # fmt: skip
        versions = {"now": [sys.executable, "-m", "farside.clients.cli"], "then": [str(other)]}
        runs = {side: _runner([*program, *asked], Path(scratch) / side) for side, program in versions.items()}
        with Progress(console=console) as bar:
            task = bar.add_task("measuring (the first runs compile kernels)", total=2 * turns + 2)
            ratios = compare(runs["now"], runs["then"], turns, lambda: bar.advance(task))
    Console(width=120).print(_table(ratios, f"{folder.name}, {quality}: this version / {commit}, {turns} turns"))
    if report:
        report.mkdir(parents=True, exist_ok=True)
        told = [{"phase": phase, "stage": stage, "wall": wall, "cpu": cpu} for (phase, stage), (wall, cpu) in ratios]
        (report / "against.json").write_text(json.dumps(told, indent=1) + "\n", "utf-8")
        console.print(f"figures: {report / 'against.json'}")


def compare(
    now: Callable[[], Costs], then: Callable[[], Costs], turns: int, progress: Callable[[], None] = lambda: None
) -> list[tuple[Stage, tuple[Ratio, Ratio]]]:
    """The ratios now / then, of wall and CPU times, of each stage that took time in all runs.

    Each version runs once for nothing (kernels), then `turns` times, each time the other one first. progress: called
    after each run. Raises ValueError as `paired_ratio` does.
    """
    found: list[tuple[Costs, Costs]] = []
    for turn in range(turns + 1):
        costs: dict[Callable[[], Costs], Costs] = {}
        for run in (now, then) if turn % 2 else (then, now):
            costs[run] = run()
            progress()
        if turn > 0:
            found.append((costs[now], costs[then]))
    return [
        (stage, (_ratio(found, stage, 0), _ratio(found, stage, 1)))
        for stage in found[0][0]
        if all(min(costs.get(stage, (0.0, 0.0))) > 0 for pair in found for costs in pair)
    ]


def _ratio(found: Sequence[tuple[Costs, Costs]], stage: Stage, which: int) -> Ratio:
    return paired_ratio([now[stage][which] for now, _ in found], [then[stage][which] for _, then in found])


@contextmanager
def _installed(commit: str, scratch: Path, console: Console) -> Iterator[Path]:
    """The program of a commit of this checkout, installed in an environment of its own as long as the block runs."""
    here, source, environment = Path(__file__).resolve().parent, scratch / "source", scratch / "environment"
    root = Path(_git(here, "rev-parse", "--show-toplevel").strip())
    _git(root, "worktree", "add", "--detach", str(source), f"{commit}^{{commit}}")
    try:
        console.print(f"installing {commit}", highlight=False)
        _run([sys.executable, "-m", "venv", str(environment)])
        _run([str(environment / "bin" / "pip"), "install", "-q", str(source)])
        yield environment / "bin" / "farside"
    finally:
        _git(root, "worktree", "remove", "--force", str(source))


def _git(folder: Path, *arguments: str) -> str:
    """What git says; raises ValueError where it fails, as it does for an unknown commit, or without a checkout."""
    try:
        return subprocess.run(["git", *arguments], cwd=folder, capture_output=True, text=True, check=True).stdout
    except (OSError, subprocess.CalledProcessError) as error:
        said = getattr(error, "stderr", None) or error
        raise ValueError(f"git {arguments[0]}: {str(said).strip()}: expected a checkout that has the commit") from None


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}: exit status {done.returncode}: {done.stderr.strip()[-2000:]}")


def _twin(name: str, scale: float, frames: int, scratch: Path, console: Console) -> Path:
    """A twin's sequence, written by this version, so that both read the same."""
    console.print(f"making {name}", highlight=False)
    size = ("--scale", f"{scale:g}", "--frames", str(frames))
    _run([sys.executable, "-m", "farside.clients.cli", "synth", name, str(scratch / name), *size])
    return scratch / name


def _runner(command: Sequence[str], folder: Path) -> Callable[[], Costs]:
    """A function that runs `farside bench --stages`, as all versions know it, and returns its figures."""

    def run() -> Costs:
        _run([*command, "--report", str(folder)])
        rows = json.loads((folder / "stages.json").read_text("utf-8"))["rows"]
        return {(row["phase"], row["stage"]): (row["wall_ms"], row["cpu_ms"]) for row in rows}

    return run


def _table(ratios: Sequence[tuple[Stage, tuple[Ratio, Ratio]]], title: str) -> Table:
    table = Table(title=title)
    for column in ("", "stage", "wall", "95 %", "CPU", "95 %"):
        table.add_column(column, justify="left" if column in ("", "stage") else "right")
    before = ""
    for (phase, stage), costs in ratios:
        cells = [text for ratio in costs for text in (f"{ratio.median:.3f}", f"{ratio.low:.3f} to {ratio.high:.3f}")]
        table.add_row(phase if phase != before else "", stage, *cells, end_section=stage == "total")
        before = phase
    return table
