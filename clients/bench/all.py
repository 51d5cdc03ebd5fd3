"""`farside bench all`: every table and plot of the document of results, in one go that may be stopped and resumed."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from .sections import SECTIONS, Section, sized

__all__ = ["Result", "command", "document", "measure_all"]


@dataclass(frozen=True, slots=True)
class Result:
    """What a section's command printed, with what it depends on; `files` are names in the result's own folder."""

    key: str
    command: str
    machine: str
    commit: str
    date: str
    seconds: float
    output: str
    files: list[str]

    @property
    def folder(self) -> str:
        """Where it is kept: named by what it depends on."""
        return _folder(self.key, self.command, self.machine, self.commit)


def command(
    report: Annotated[Path, typer.Option(metavar="DIR", help="Folder that keeps what is finished, and RESULTS.md.")],
    sequences: Annotated[
        Path | None, typer.Option(help="Sequences with ground truth, and a README with other renderers' figures.")
    ] = None,
    only: Annotated[str | None, typer.Option(metavar="NAME,...", help="Only these sections.")] = None,
    scale: Annotated[float | None, typer.Option(min=0.001, help="Size of all twins' pictures, to try it.")] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Frames at most, to try it.")] = None,
    results: Annotated[
        Path | None, typer.Option("--document", metavar="FILE.md", help="Write the document here as well.")
    ] = None,
) -> None:
    """Every table and plot that the documents show (an hour and a half); what is finished is kept and not repeated.

    A measure is repeated when its command, the machine or the commit is another.
    """
    chosen = [sized(section, scale, frames) for section in _chosen(only)]
    failed: dict[str, str] = {}
    paths = [report / "RESULTS.md", *([results] if results else [])]
    for _ in measure_all(chosen, report, sequences, failed):  # stopped half-way there is a document of what is done
        for path in paths:
            path.write_text(document(chosen, report, failed), "utf-8")
    print("\n".join(f"document: {path}" for path in paths))
    if failed:
        raise typer.Exit(1)


def measure_all(
    sections: Sequence[Section], folder: Path, sequences: Path | None, failed: dict[str, str]
) -> Iterator[None]:
    """Run what is not kept yet, a section a step; each is kept at once. Why one has no result goes to `failed`, by key.

    `sequences`: a folder of sequences with ground truth; None: sections that need it fail.
    """
    console = Console(stderr=True)
    folder.mkdir(parents=True, exist_ok=True)
    machine, commit = machine_name(), commit_name()
    for number, section in enumerate(sections):
        said = f"{number + 1} of {len(sections)}, {section.key}"
        if "sequences" in section.needs and sequences is None:
            failed[section.key] = "not measured: expected --sequences"
        elif (path := folder / _folder(section.key, _told(section), machine, commit) / "result.json").is_file():
            console.print(f"{said}: kept in {escape(str(path.parent))}")
        else:
            console.print(f"{said}: [bold]{escape(_told(section))}[/]")
            try:
                _measure(section, folder, sequences, machine, commit)
            except (OSError, RuntimeError) as error:
                failed[section.key] = str(error)
                console.print(f"[red]failed[/] {escape(str(error))}")
        yield


def document(sections: Sequence[Section], folder: Path, failed: Mapping[str, str]) -> str:
    """The results of sections in Markdown: question, command, machine, commit, table, how to read it."""
    machine, commit = machine_name(), commit_name()
    lines = [
        "# Results", "",
        "Written by `farside bench all`; do not edit it. Every section names the command that repeats it.", "",
        f"Machine: {machine}. Commit: {commit}.",
    ]  # fmt: skip
    for section in sections:
        lines += ["", f"## {section.question}", ""]
        path = folder / _folder(section.key, _told(section), machine, commit) / "result.json"
        if section.key in failed or not path.is_file():
            lines += [f"`{_told(section)}`", "", f"No result: {failed.get(section.key, 'not measured yet')}."]
            continue
        result = Result(**json.loads(path.read_text("utf-8")))
        lines += [f"`{result.command}`, {result.date}, {result.seconds:.0f} s", "", section.reading, "", "```text"]
        lines += [result.output.rstrip(), "```"]
        pictures = [name for name in result.files if name.endswith(".png")]
        lines += [line for name in pictures[:1] for line in ("", f"![{section.key}]({result.folder}/{name})")]
    return "\n".join(lines) + "\n"


def machine_name() -> str:
    """The processor, its cores that are ours, memory, system and Python."""
    found = re.search(r"model name\s*:\s*(.+)", _read("/proc/cpuinfo"))
    memory = re.search(r"MemTotal:\s*(\d+)", _read("/proc/meminfo"))
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    parts = [found[1].strip() if found else platform.machine(), f"{cores} cores"]
    parts += [f"{int(memory[1]) / (1 << 20):.0f} GiB"] if memory else []
    return ", ".join([*parts, platform.system(), f"Python {platform.python_version()}"])


def commit_name() -> str:
    """The commit of the checkout that runs, with a digest of what is changed in its code; else the version."""
    here = Path(__file__).resolve().parent
    try:
        commit, changes = (
            subprocess.run(["git", *arguments], cwd=here, capture_output=True, check=True).stdout
            for arguments in (("rev-parse", "--short=12", "HEAD"), ("diff", "HEAD", "--", ":/*.py", ":/pyproject.toml"))
        )
    except (OSError, subprocess.CalledProcessError):
        from importlib.metadata import version

        return f"version {version('farside')}"
    digest = f"+{hashlib.sha1(changes).hexdigest()[:8]}" if changes else ""
    return commit.decode().strip() + digest


def _chosen(only: str | None) -> Iterator[Section]:
    known = {section.key: section for section in SECTIONS}
    for key in only.split(",") if only else known:
        if key not in known:
            raise ValueError(f"--only: {key!r}: expected some of {', '.join(known)}")
        yield known[key]


def _measure(section: Section, folder: Path, sequences: Path | None, machine: str, commit: str) -> None:
    """Run a section's command in a process of its own; its result is there as a whole or not at all."""
    kept = folder / _folder(section.key, _told(section), machine, commit)
    files = kept / "files"
    files.mkdir(parents=True, exist_ok=True)
    arguments = [_filled(text, section, folder, sequences) for text in section.arguments]
    arguments += ["--report", str(files)] if section.reports else []
    start = time.monotonic()
    output = _farside("bench", *arguments)
    print(output, flush=True)
    names = sorted(str(path.relative_to(kept)) for path in files.rglob("*") if path.is_file())
    date, seconds = time.strftime("%Y-%m-%d"), time.monotonic() - start
    told = output.replace(str(files), "DIR")
    result = Result(section.key, _told(section), machine, commit, date, seconds, told, names)
    partial = kept / "result.partial"
    partial.write_text(json.dumps(asdict(result), indent=1) + "\n", "utf-8")
    partial.rename(kept / "result.json")


def _filled(text: str, section: Section, folder: Path, sequences: Path | None) -> str:
    """An argument with what stands in braces: the folder of sequences, or a twin's, which is written if need be."""
    if not text.startswith("{"):
        return text
    name = text[1:-1]
    if name == "sequences":
        return str(sequences)
    twin = folder / "twins" / f"{name}-{section.scale:g}-{section.frames}" / name
    if not twin.is_dir():
        partial = twin.with_name(f"{name}.partial")
        partial.parent.mkdir(parents=True, exist_ok=True)
        _farside("synth", name, str(partial), "--scale", f"{section.scale:g}", "--frames", str(section.frames))
        partial.rename(twin)
    return str(twin)


def _farside(*arguments: str) -> str:
    """What a command of ours prints, its progress shown; RuntimeError where it fails."""
    done = subprocess.run(
        [sys.executable, "-m", "farside.clients.cli", *arguments], stdout=subprocess.PIPE, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"farside {shlex.join(arguments)}: exit code {done.returncode}: {done.stdout[-500:]}")
    return done.stdout


def _told(section: Section) -> str:
    """The command as people read it: folders by their names, reports in DIR."""
    names = [text.strip("{}").upper() if text.startswith("{") else text for text in section.arguments]
    size = "".join(
        f"farside synth {name} {name.upper()} --scale {section.scale:g} --frames {section.frames}; "
        for name in section.needs if name != "sequences"
    )  # fmt: skip
    return f"{size}farside bench {' '.join(names)}" + (" --report DIR" if section.reports else "")


def _folder(key: str, *of: str) -> str:
    return f"{key}-{hashlib.sha1(json.dumps(of).encode()).hexdigest()[:10]}"


def _read(path: str) -> str:
    try:
        return Path(path).read_text("utf-8")
    except OSError:
        return ""
