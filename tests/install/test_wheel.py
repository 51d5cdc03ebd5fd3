"""The wheel, built once, contains every module, and every module can be imported from it."""

from __future__ import annotations

import importlib.metadata
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from farside.engine.support.cpu_level import cpu_level
from support.checkout import ROOT, copy_checkout

PACKAGES = ("engine", "server", "clients")


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    source = copy_checkout(folder / "source")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir"]
    done = subprocess.run([*build, str(folder), str(source)], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = folder.glob("farside-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "unpacked")
    return folder / "unpacked"


def test_wheel_holds_every_module_and_the_page(unpacked: Path) -> None:
    expected = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.suffix == ".py" or (path.is_file() and "page" in path.parent.parts)
    }
    found = {
        path.relative_to(unpacked / "farside").as_posix()
        for path in (unpacked / "farside").rglob("*")
        if path.is_file()
    }
    assert len(expected) > 20
    assert expected <= found, expected - found


def test_every_module_is_imported_from_the_wheel(unpacked: Path) -> None:
    names = [
        ".".join(path.relative_to(unpacked).with_suffix("").parts).removesuffix(".__init__")
        for path in sorted((unpacked / "farside").rglob("*.py"))
    ]
    code = (
        "import importlib, sys\n"
        f"sys.path.insert(0, {str(unpacked)!r})\n"
        f"for name in {names!r}:\n"
        "    module = importlib.import_module(name)\n"
        f"    assert module.__file__.startswith({str(unpacked)!r}), module.__file__\n"
        "    for public in getattr(module, '__all__', ()): getattr(module, public)\n"
        "print(len(sys.modules))\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=unpacked,
    )
    assert done.returncode == 0, done.stderr


def test_wheel_installs_the_command(unpacked: Path) -> None:
    (info,) = unpacked.glob("farside-*.dist-info")
    (entry,) = importlib.metadata.Distribution.at(info).entry_points
    assert (entry.name, entry.group) == ("farside", "console_scripts")
    assert entry.value == "farside.clients.cli:main"


@pytest.mark.skipif(not (ROOT / ".git").exists() or not cpu_level(), reason="needs a checkout, and a CPU with AVX2")
def test_a_wheel_with_kernels_needs_no_compiler_and_no_place_to_write(tmp_path: Path) -> None:
    """For one use and this machine's level, because each use of each level is compiled for a minute."""
    built = {**os.environ, "FARSIDE_WHEEL_LEVELS": cpu_level()}
    done = subprocess.run([ROOT / ".ci" / "wheel", tmp_path, "synth"], env=built, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("farside-*.whl")
    assert wheel.name.endswith(f"-cp3{sys.version_info[1]}-none-linux_x86_64.whl")
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    python = tmp_path / "venv" / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", "-q", wheel], check=True)
    ours = ("NUMBA_", "XDG_", "_FARSIDE", "PYTHON")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(ours)}
    nowhere = kept | {"HOME": "/dev/null/x"}
    code = (
        "from dataclasses import astuple\n"
        "from farside.engine.compiling.needed import needed_for, read\n"
        "from farside.engine.compiling.pool import Compiling\n"
        "from farside.engine.compiling.worker import compile_kernel\n"
        "started = Compiling(['synth']); started.start(); assert started.finished, started.progress\n"
        "print({compile_kernel(*astuple(read()[number])[:3]) for number in needed_for(['synth'])})\n"
    )
    ran = subprocess.run([python, "-c", code], env=nowhere, cwd="/", capture_output=True, text=True)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "{'known'}\n", "")
    options = ["--scale", "0.02", "--frames", "1"]
    made = subprocess.run(
        [tmp_path / "venv" / "bin" / "farside", "synth", "museum", tmp_path / "museum", *options],
        env=nowhere, cwd="/", capture_output=True, text=True,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr
