"""Kernels are compiled by several processes, each once, callees first; what fails or is stopped ends in order."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from farside.engine.compiling import needed, pool
from farside.engine.compiling.needed import Kernel
from farside.engine.compiling.pool import Compiling, Progress
from farside.engine.support import kernel_folders

# Small kernels, which call one another: name, types, numbers of callees.
SMALL = (
    Kernel("base.tolerance", "delta_at", "(float64, float64), float64", (), ("fast",)),
    Kernel("geometry.minify", "no_such_kernel", "int64", (), ("best",)),
)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for kernels, for this process and its children."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    kernel_folders.base_folder.cache_clear()
    yield tmp_path
    kernel_folders.base_folder.cache_clear()


def _use(monkeypatch: pytest.MonkeyPatch, *kernels: Kernel) -> None:
    monkeypatch.setattr(needed, "read", lambda: kernels)
    monkeypatch.setattr(pool, "read", lambda: kernels)


def _small(monkeypatch: pytest.MonkeyPatch, count: int = 6) -> list[Kernel]:
    """The listed kernels for making twins that call nothing, and one that calls some of them."""
    listed = [kernel for kernel in needed.read() if not kernel.after and kernel.name][:count]
    kernels = [Kernel(k.module, k.name, k.types, (), ("fast",)) for k in listed]
    kernels[-1] = Kernel(kernels[-1].module, kernels[-1].name, kernels[-1].types, tuple(range(count - 1)), ("fast",))
    _use(monkeypatch, *kernels)
    return kernels


def test_each_kernel_is_compiled_once_and_found_by_the_next(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kernels, seen, answers = _small(monkeypatch), list[Progress](), list[str]()
    ask = pool._ask

    def noted(process: subprocess.Popen[str], line: str) -> str:
        answers.append(ask(process, line))
        return answers[-1]

    monkeypatch.setattr(pool, "_ask", noted)
    first = Compiling(("fast",), 3, seen.append)
    first.run()
    assert len(answers) == len(kernels)
    assert set(answers) <= {"compiled", "known"}  # one that another calls may be kept already
    assert "compiled" in answers
    assert first.progress == Progress(len(kernels), len(kernels))
    assert sorted(each.done for each in seen) == list(range(1, len(kernels) + 1))
    assert first.finished
    for note in folder.glob("all-for-*"):
        note.unlink()
    answers.clear()
    Compiling(("fast",), 2).run()
    assert answers == ["known"] * len(kernels)


def test_nothing_is_started_when_all_are_known_to_be_there(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _small(monkeypatch, 2)
    Compiling(("fast",), 1).run()
    monkeypatch.setattr(subprocess, "Popen", None)
    again = Compiling(("fast",), 1)
    again.start()
    assert again.finished
    assert again.wait()
    monkeypatch.setattr(pool, "_state", lambda: "of another CPU")
    assert not any(note.is_file() for note in pool._notes("fast"))


def test_a_kernel_does_not_wait_for_callees_of_other_types_that_a_later_use_needs(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    listed = [kernel for kernel in needed.read() if not kernel.after and kernel.name][:3]
    uses, after = (("best",), ("fast",), ("fast",)), ((), (), (0, 1))
    _use(monkeypatch, *(Kernel(k.module, k.name, k.types, *ours) for k, *ours in zip(listed, after, uses, strict=True)))
    order, ask = list[str](), pool._ask

    def noted(process: subprocess.Popen[str], line: str) -> str:
        order.append(json.loads(line)["name"])
        return ask(process, line)

    monkeypatch.setattr(pool, "_ask", noted)
    Compiling(("fast", "best"), 1).run()
    assert order == [listed[k].name for k in (1, 2, 0)]


def test_a_note_is_left_once_for_each_use(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    listed = [kernel for kernel in needed.read() if not kernel.after and kernel.name][:4]
    uses = ("fast",), ("fast", "best"), ("best",), ("best",)
    _use(monkeypatch, *(Kernel(k.module, k.name, k.types, (), use) for k, use in zip(listed, uses, strict=True)))
    notes = list[str]()
    monkeypatch.setattr(pool, "_leave_note", notes.append)
    Compiling(("fast", "best"), 1).run()
    assert notes == ["fast", "best"]


@pytest.mark.parametrize("damage", ["shorter", "gone", "no note"])
def test_what_is_damaged_is_compiled_again(folder: Path, monkeypatch: pytest.MonkeyPatch, damage: str) -> None:
    _small(monkeypatch, 2)
    Compiling(("fast",), 1).run()
    (note,), answers, ask = list(folder.glob("all-for-fast-*")), list[str](), pool._ask
    files = sorted(folder.glob("*/*.nbc"))
    assert files
    if damage == "no note":
        note.write_text(note.read_text()[:-3])
    for file in files if damage != "no note" else ():
        file.unlink() if damage == "gone" else file.write_bytes(file.read_bytes()[:100])

    def noted(process: subprocess.Popen[str], line: str) -> str:
        answers.append(ask(process, line))
        return answers[-1]

    monkeypatch.setattr(pool, "_ask", noted)
    again = Compiling(("fast",), 1)
    assert again.progress.done == 0
    again.run()
    assert ("compiled" in answers) == (damage != "no note")
    assert set(answers) <= {"compiled", "known"}
    answers.clear()
    Compiling(("fast",), 1).run()
    assert answers == []


def test_nothing_is_started_where_nothing_can_be_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    _small(monkeypatch, 2)
    monkeypatch.setattr(pool, "base_folder", lambda: None)
    monkeypatch.setattr(subprocess, "Popen", None)
    compiling = Compiling(("fast",), 1)
    compiling.start()
    assert compiling.wait(timeout=0.0)


def test_a_kernel_that_cannot_be_compiled_does_not_stop_the_others(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kernels = _small(monkeypatch, 3)
    bad = Kernel("geometry.minify", "no_such_kernel", "int64", (), ("fast",))
    odd = Kernel("geometry.minify", "minify", "int64", (), ("fast",))
    _use(monkeypatch, bad, odd, Kernel(*(getattr(kernels[0], n) for n in ("module", "name", "types")), (0,), ("fast",)))
    compiling = Compiling(("fast",), 2)
    compiling.run()
    assert compiling.progress == Progress(3, 3, 2)
    assert not list(folder.glob("all-for-*"))


def test_a_process_that_is_killed_is_replaced(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kernels, killed, ask = _small(monkeypatch, 3), list[int](), pool._ask

    def killing(process: subprocess.Popen[str], line: str) -> str:
        if not killed:
            killed.append(process.pid)
            process.kill()
        return ask(process, line)

    monkeypatch.setattr(pool, "_ask", killing)
    compiling = Compiling(("fast",), 1)
    compiling.run()
    assert compiling.progress == Progress(len(kernels), len(kernels), 1)


def test_it_can_be_stopped_while_others_wait(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _small(monkeypatch)
    compiling, started = Compiling(("fast",), 2), threading.Event()
    monkeypatch.setattr(pool, "_ask", lambda process, line: started.set() or process.stdout.readline())
    ended: list[bool] = []
    compiling.start()
    waiting = threading.Thread(target=lambda: ended.append(compiling.wait(("fast",))))
    waiting.start()
    started.wait()
    compiling.stop()
    waiting.join()
    assert ended == [True]
    assert compiling.finished
    assert all(process.poll() is not None for process in compiling._processes)


def test_none_is_begun_in_a_rest(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kernels = _small(monkeypatch)
    monkeypatch.setattr(pool, "_ask", lambda process, line: "compiled")
    compiling = Compiling(("fast",), 2)
    compiling.rest(3600.0)
    compiling.start()
    assert not compiling.wait(timeout=0.2)
    assert compiling.progress == Progress(0, len(kernels))
    compiling.rest(0.0)
    assert compiling.wait()
    assert compiling.progress == Progress(len(kernels), len(kernels))
    resting = Compiling(("best",), 2)
    resting.rest(3600.0)
    resting.start()
    resting.stop()
    assert resting.finished


def test_an_unknown_use_is_refused() -> None:
    with pytest.raises(ValueError, match="use: 'quick': expected one of synth, picture, fast"):
        Compiling(("quick",))


def test_a_worker_ends_with_its_input(folder: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "farside.engine.compiling.worker"],
        input=json.dumps({"module": "base.nothing", "name": "x", "types": ""}) + "\n",
        capture_output=True, text=True, check=True, env=os.environ,
    )  # fmt: skip
    assert ended.stdout.startswith("failed: ModuleNotFoundError")
