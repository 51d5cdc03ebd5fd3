"""`farside bench all`: every table and plot of the document of results, in one run that can be stopped and resumed."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import shlex
import shutil
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

__all__ = ["Kept", "Result", "command", "document", "measure_all"]


@dataclass(frozen=True, slots=True)
class Result:
    """A section's printed output, and everything that it depends on; `files` are names in the result's own folder."""

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
        """The result's folder, named after everything that the result depends on."""
        return _folder(self.key, self.command, self.machine, self.commit)


@dataclass(frozen=True, slots=True)
class Kept:
    """The finished results in a folder, of a machine and a commit; `earlier`: those of other commits count as well."""

    folder: Path
    machine: str
    commit: str
    earlier: bool

    def folder_of(self, section: Section) -> Path:
        """The folder of a section's result of this commit."""
        return self.folder / _folder(section.key, _told(section), self.machine, self.commit)

    def of(self, section: Section) -> Result | None:
        """The result of a section: of this commit, or else the newest."""
        path = self.folder_of(section) / "result.json"
        if path.is_file():
            return _result(path)
        found = sorted(self.folder.glob(f"{section.key}-*/result.json"), key=lambda path: path.stat().st_mtime)
        results = [_result(path) for path in found if self.earlier]
        wanted = _told(section), self.machine
        return next((each for each in reversed(results) if (each.command, each.machine) == wanted), None)


def _result(path: Path) -> Result:
    return Result(**json.loads(path.read_text("utf-8")))


def command(
    report: Annotated[Path, typer.Option(metavar="DIR", help="Folder for finished results and RESULTS.md.")],
    sequences: Annotated[
        Path | None,
        typer.Option(help="Folder of sequences with ground truth; its README has other renderers' figures."),
    ] = None,
    only: Annotated[str | None, typer.Option(metavar="NAME,...", help="Only these sections.")] = None,
    scale: Annotated[
        float | None, typer.Option(min=0.001, help="Size of all twins' pictures, for a quick trial.")
    ] = None,
    frames: Annotated[int | None, typer.Option(min=1, help="Most frames played, for a quick trial.")] = None,
    results: Annotated[
        Path | None, typer.Option("--document", metavar="FILE.md", help="Also write the document to this file.")
    ] = None,
    earlier: Annotated[
        bool, typer.Option("--earlier", help="Where there is none of this commit, take results of earlier commits.")
    ] = False,
) -> None:
    """Make every table and plot of the document of results (an hour and a half); finished results are kept.

    A kept result is measured again when its command, the machine or (without --earlier) the commit differs.
    """
    chosen = [sized(section, scale, frames) for section in _chosen(only)]
    failed: dict[str, str] = {}
    paths = [report / "RESULTS.md", *([results] if results else [])]
    kept = Kept(report, machine_name(), commit_name(), earlier)
    for _ in measure_all(chosen, kept, sequences, failed):  # after Ctrl-C there is a document of the finished part
        for path in paths:
            write_document(path, chosen, kept, failed)
    print("\n".join(f"document: {path}" for path in paths))
    if failed:
        raise typer.Exit(1)


def measure_all(
    sections: Sequence[Section], kept: Kept, sequences: Path | None, failed: dict[str, str]
) -> Iterator[None]:
    """Run the sections that `kept` has no result of, one in each step; each result is saved at once.

    `sequences`: a folder of sequences with ground truth; if None, sections that need it fail. The reason why a section
    has no result is put into `failed`, by the section's key.
    """
    console = Console(stderr=True)
    kept.folder.mkdir(parents=True, exist_ok=True)
    for number, section in enumerate(sections):
        said = f"{number + 1} of {len(sections)}, {section.key}"
        if "sequences" in section.needs and sequences is None:
            failed[section.key] = "not measured: expected --sequences"
        elif (result := kept.of(section)) is not None:
            console.print(f"{said}: kept in {escape(str(kept.folder / result.folder))}")
        else:
            console.print(f"{said}: [bold]{escape(_told(section))}[/]")
            try:
                _measure(section, kept, sequences)
            except (OSError, RuntimeError) as error:
                failed[section.key] = str(error)
                console.print(f"[red]failed[/] {escape(str(error))}")
        yield


def write_document(path: Path, sections: Sequence[Section], kept: Kept, failed: Mapping[str, str]) -> None:
    """Write the document of the kept results to a file. For a file elsewhere than in their folder, the pictures are
    copied to a folder `results` next to it."""
    text = document(sections, kept, failed)
    if path.parent.resolve() != kept.folder.resolve():
        for section, picture in re.findall(r"^!\[(\w+)\]\((.+)\)$", text, re.MULTILINE):
            copy = Path("results") / f"{section}{Path(picture).suffix}"
            (path.parent / copy).parent.mkdir(exist_ok=True)
            shutil.copyfile(kept.folder / picture, path.parent / copy)
            text = text.replace(f"]({picture})", f"]({copy})")
    path.write_text(text, "utf-8")


def document(sections: Sequence[Section], kept: Kept, failed: Mapping[str, str]) -> str:
    """The results of sections in Markdown: question, command, machine, commit, table, how to read it."""
    about = f"Machine: {kept.machine}. Commit: {kept.commit}"
    lines = [
        "# Results", "",
        "Written by `farside bench all`; do not edit it. Every section names the command that repeats it.", "",
        f"{about}, where a section does not name an earlier one." if kept.earlier else f"{about}.",
    ]  # fmt: skip
    for section in sections:
        lines += ["", f"## {section.question}", ""]
        result = kept.of(section)
        if section.key in failed or result is None:
            lines += [f"`{_told(section)}`", "", f"No result: {failed.get(section.key, 'not measured yet')}."]
            continue
        when = f"{result.date}, {result.seconds:.0f} s" + (f", {result.commit}" if result.commit != kept.commit else "")
        lines += [f"`{result.command}`, {when}", "", section.reading, "", "```text"]
        lines += [*map(str.rstrip, result.output.rstrip().splitlines()), "```"]
        pictures = [name for name in result.files if name.endswith(".png")]
        lines += [line for name in pictures[:1] for line in ("", f"![{section.key}]({result.folder}/{name})")]
    return "\n".join(lines) + "\n"


def machine_name() -> str:
    """The processor, the number of cores that this process may use, memory, system and Python version."""
    found = re.search(r"model name\s*:\s*(.+)", _read("/proc/cpuinfo"))
    memory = re.search(r"MemTotal:\s*(\d+)", _read("/proc/meminfo"))
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    parts = [found[1].strip() if found else platform.machine(), f"{cores} cores"]
    parts += [f"{int(memory[1]) / (1 << 20):.0f} GiB"] if memory else []
    return ", ".join([*parts, platform.system(), f"Python {platform.python_version()}"])


def commit_name() -> str:
    """The commit of the running checkout, with a digest of uncommitted changes of code; without git, the version."""
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
            raise ValueError(f"--only: {key!r}: expected names among {', '.join(known)}")
        yield known[key]


def _measure(section: Section, kept: Kept, sequences: Path | None) -> None:
    """Run a section's command in a process of its own; its result is written completely or not at all."""
    own = kept.folder_of(section)
    files = own / "files"
    files.mkdir(parents=True, exist_ok=True)
    arguments = [_filled(text, section, kept.folder, sequences) for text in section.arguments]
    arguments += ["--report", str(files)] if section.reports else []
    start = time.monotonic()
    output = _farside("bench", *arguments)
    print(output, flush=True)
    names = sorted(str(path.relative_to(own)) for path in files.rglob("*") if path.is_file())
    date, seconds = time.strftime("%Y-%m-%d"), time.monotonic() - start
    told = output.replace(str(files), "DIR")
    result = Result(section.key, _told(section), kept.machine, kept.commit, date, seconds, told, names)
    partial = own / "result.partial"
    partial.write_text(json.dumps(asdict(result), indent=1) + "\n", "utf-8")
    partial.rename(own / "result.json")


def _filled(text: str, section: Section, folder: Path, sequences: Path | None) -> str:
    """The folder that an argument in braces stands for: of the sequences or of a twin, which is written if missing."""
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
    """The output of a farside command, whose progress is shown; RuntimeError if it fails."""
    done = subprocess.run(
        [sys.executable, "-m", "farside.clients.cli", *arguments], stdout=subprocess.PIPE, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"farside {shlex.join(arguments)}: exit code {done.returncode}: {done.stdout[-500:]}")
    return done.stdout


def _told(section: Section) -> str:
    """The command as the document shows it: folders by their names, reports in DIR."""
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
