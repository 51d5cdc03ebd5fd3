"""The structure of the code: sizes of modules and functions, and no unused file."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest
from support.checkout import ROOT

MODULE_LINES, FUNCTION_LINES = 300, 50
PACKAGES = ("engine", "server", "clients")
ARCHITECTURE = ROOT / "engine" / "ARCHITECTURE.md"
# Loaded by name: the command line's entry point, its commands, and modules that another program runs.
BY_NAME = re.compile(r"clients/(cli|__main__)\.py|clients/bench/\w+\.py|engine/compiling/worker\.py")


def modules(*packages: str) -> list[Path]:
    return sorted(path for package in packages for path in (ROOT / package).rglob("*.py"))


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def excused() -> set[str]:
    """Longer modules and functions that ARCHITECTURE.md allows: items like `engine/a/b.py` or `engine/a/b.py: f`."""
    section = ARCHITECTURE.read_text("utf-8").partition("## Longer than a screen")[2].partition("\n## ")[0]
    return set(re.findall(r"^- `([^`]+)`: \w", section, re.M))


def too_long() -> set[str]:
    found = set()
    for path in modules("engine"):
        text = path.read_text("utf-8")
        if text.count("\n") > MODULE_LINES:
            found.add(name_of(path))
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                start = min([node.lineno, *(d.lineno for d in node.decorator_list)])
                if node.end_lineno is not None and node.end_lineno - start + 1 > FUNCTION_LINES:
                    found.add(f"{name_of(path)}: {node.name}")
    return found


def imported(path: Path) -> set[str]:
    """Files of the project that a module imports anywhere in its code."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom):
            folder = path.parents[node.level - 1] if node.level else ROOT
            parts = (node.module or "").split(".") if node.module else []
            if not node.level:
                if parts[:1] != ["farside"]:
                    continue
                parts = parts[1:]
            base = folder.joinpath(*parts)
            found |= {base.with_suffix(".py"), *(base / f"{alias.name}.py" for alias in node.names)}
            found |= {base / alias.name / "__init__.py" for alias in node.names} | {base / "__init__.py"}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and "farside." in node.value:
            # Lazy public names and other processes name modules in strings.
            for dotted in re.findall(r"farside((?:\.\w+)+)", node.value):
                found.add(ROOT.joinpath(*dotted.split(".")[1:]).with_suffix(".py"))
    return {name_of(file) for file in found if file.is_file()}


def test_modules_and_functions_fit_a_screen_or_the_architecture_says_why() -> None:
    assert too_long() == excused()


def test_no_file_is_there_that_nobody_imports() -> None:
    files = modules(*PACKAGES)
    used = set().union(*(imported(path) - {name_of(path)} for path in files))
    names = re.findall(r'^    "(\w+)":', (ROOT / "clients/cli.py").read_text("utf-8"), re.M)
    commands = {f"clients/{name}.py" for name in names}
    alone = {name_of(path) for path in files if path.name != "__init__.py"} - used - commands
    assert {name for name in alone if not BY_NAME.fullmatch(name)} == set()


def paper_table() -> list[tuple[str, str, str, str]]:
    """Module, function, file of tests and test of every row of the paper's steps."""
    row = re.compile(r"^\| [^|]+ \| [^|]+ \| \[[^]]+\]\(([^)]+)\) \| `([^`]+)` \| `([^`]+)`: `([^`]+)` \|$", re.M)
    return row.findall(ARCHITECTURE.read_text("utf-8"))


@pytest.mark.parametrize("row", paper_table(), ids=lambda row: row[1])
def test_what_the_architecture_names_is_there(row: tuple[str, str, str, str]) -> None:
    module, function, tests, test = row
    tree = ast.parse((ROOT / "engine" / module).read_text("utf-8"))
    names = {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.ClassDef)}
    assert set(function.split(".")) <= names
    assert re.search(rf"^(async )?def {test}\(", (ROOT / "tests" / tests).read_text("utf-8"), re.M)


def test_the_table_holds_the_papers_steps() -> None:
    assert len(paper_table()) >= 20


def test_paths_in_the_architecture_exist() -> None:
    named = re.findall(r"`((?:\w+/)+\w+\.(?:py|md))`", ARCHITECTURE.read_text("utf-8"))
    assert len(named) > 20
    places = ROOT, ROOT / "engine", ROOT / "tests"
    assert [name for name in named if not any((place / name).exists() for place in places)] == []
