"""Compiles kernels in as many processes as there are cores, in the order of their need, and tells how far it is."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from pathlib import Path

from ..support.cores import core_count
from ..support.cpu_level import chosen_cpu, this_cpu
from ..support.kernel_folders import SHIPPED, base_folder, digest, folder_of
from .needed import NEEDED, needed_for, read

__all__ = ["Compiling", "Progress"]


@dataclass(frozen=True, slots=True)
class Progress:
    """How many of the kernels are there, of how many, and how many could not be compiled."""

    done: int
    total: int
    failed: int = 0


class Compiling:
    """Kernels for some uses (`needed.USES`; the first comes first) on their way.

    `changed` is called, from several threads, each time that a kernel is there. Use `start`, then `wait` or `stop`; or
    `run`. Where a note in the folder of kernels says that all are there, and their files have the sizes that it names,
    nothing is started.
    """

    def __init__(
        self, uses: Sequence[str], workers: int = 0, changed: Callable[[Progress], None] = lambda progress: None
    ) -> None:
        self._uses, self._numbers = tuple(uses), needed_for(uses)
        self._left, self._done, self._failed = list(self._numbers), set[int](), 0
        self._after = _callees_by_use(self._uses)
        self._workers, self._changed = workers or core_count(), changed
        self._condition, self._stopped = threading.Condition(), False
        self._rests_until = -math.inf  # monotonic clock, s
        self._processes: list[subprocess.Popen[str]] = []
        self._threads: list[threading.Thread] = []

    @property
    def progress(self) -> Progress:
        """How far it is."""
        return Progress(len(self._done), len(self._numbers), self._failed)

    @property
    def first(self) -> Progress:
        """How far it is with what the first picture needs: "picture" and what comes before it, or else all."""
        uses = self._uses[: self._uses.index("picture") + 1] if "picture" in self._uses else self._uses
        numbers = set(needed_for(uses))
        return Progress(len(self._done & numbers), len(numbers), self._failed)

    @property
    def finished(self) -> bool:
        """Whether nothing is left to do, or it was stopped."""
        return self._stopped or len(self._done) == len(self._numbers)

    def run(self) -> None:
        """Start, and wait for the end."""
        self.start()
        self.wait()

    def start(self) -> None:
        """Start the processes, unless a note says that nothing is missing, or no kernel could be kept for others."""
        with self._condition:
            if base_folder() is None:
                self._done.update(self._numbers)
            for use in self._uses:
                if any(map(_is_true, _notes(use))):
                    self._done.update(needed_for([use]))
            self._condition.notify_all()
        self._left = [number for number in self._numbers if number not in self._done]
        count = min(self._workers, len(self._left))
        self._threads = [threading.Thread(target=self._work, daemon=True) for _ in range(count)]
        for thread in self._threads:
            thread.start()

    def wait(self, uses: Sequence[str] | None = None, timeout: float | None = None) -> bool:
        """Wait until all kernels, or those for some of the uses, are there, or it was stopped; False: time is up."""
        wanted = set(self._numbers if uses is None else needed_for(uses)) & set(self._numbers)
        with self._condition:
            return self._condition.wait_for(lambda: self._stopped or wanted <= self._done, timeout)

    def rest(self, seconds: float) -> None:
        """Begin no other kernel for this time, s, as something else needs the cores now; 0: go on."""
        with self._condition:
            self._rests_until = time.monotonic() + seconds
            self._condition.notify_all()

    def stop(self) -> None:
        """End the processes at once."""
        with self._condition:
            self._stopped = True
            self._condition.notify_all()
            for process in self._processes:
                process.kill()
        for thread in self._threads:
            thread.join()

    def _work(self) -> None:
        """A thread with a process of its own."""
        process = self._start_process()
        while process is not None and (number := self._next()) is not None:
            kernel = read()[number]
            line = json.dumps({"module": kernel.module, "name": kernel.name, "types": kernel.types})
            answer = _ask(process, line)
            self._take(number, answer)
            if not answer:  # the process has ended, on this kernel
                _end(process)
                process = self._start_process()
        if process is not None:
            _end(process)

    def _start_process(self) -> subprocess.Popen[str] | None:
        with self._condition:
            if self._stopped:
                return None
            command = [sys.executable, "-m", f"{__package__}.worker"]
            process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, process_group=0  # Ctrl-C is for us
            )
            self._processes.append(process)
            return process

    def _next(self) -> int | None:
        """The first kernel whose callees are there; waits for one, and returns None if none is left."""
        with self._condition:
            while self._left and not self._stopped:
                if (rest_s := self._rests_until - time.monotonic()) > 0.0:
                    self._condition.wait(rest_s)
                    continue
                for number in self._left:
                    if self._done.issuperset(self._after[number]):
                        self._left.remove(number)
                        return number
                self._condition.wait()
            return None

    def _take(self, number: int, answer: str) -> None:
        with self._condition:
            if self._stopped:
                return
            self._failed += answer not in ("compiled", "known")
            self._done.add(number)
            for use in self._uses if not self._failed else ():
                needed = needed_for([use])
                if number in needed and self._done.issuperset(needed):  # it was the last one
                    _leave_note(use)
            self._condition.notify_all()
        self._changed(self.progress)


def _callees_by_use(uses: Sequence[str]) -> dict[int, frozenset[int]]:
    """Which kernels each kernel waits for: its callees among those of the first use that needs it. A kernel that only a
    later use needs has other types, and is called there."""
    found: dict[int, frozenset[int]] = {}
    for use in uses:
        numbers = set(needed_for([use]))
        found |= {k: frozenset(read()[k].after) & numbers for k in numbers if k not in found}
    return found


def _end(process: subprocess.Popen[str]) -> None:
    """End a process and close its pipes."""
    process.kill()
    process.wait()
    for pipe in (process.stdin, process.stdout):
        with suppress(OSError):  # what is still to be written to a process that has ended
            if pipe is not None:
                pipe.close()


def _ask(process: subprocess.Popen[str], line: str) -> str:
    """The process's answer; nothing if it has ended."""
    assert process.stdin is not None
    assert process.stdout is not None
    with suppress(OSError):
        process.stdin.write(f"{line}\n")
        process.stdin.flush()
        return process.stdout.readline().strip()
    return ""


def _notes(use: str) -> list[Path]:
    """Files of which one says that all kernels for a use are there: the user's, and one of the installation."""
    base, name, cpu = base_folder(), f"all-for-{use}-{_state()}", chosen_cpu()
    return [*([base / name] if base else []), *([SHIPPED / cpu / name] if cpu else [])]


def _leave_note(use: str) -> None:
    if (base := base_folder()) is not None:
        with suppress(OSError):
            (base / f"all-for-{use}-{_state()}").write_text(json.dumps(_sizes(base)))


def _sizes(base: Path) -> dict[str, int]:
    """Bytes of the files of kernels in a folder, by their path below it."""
    folders = [base / folder_of(source) for source in _sources()]
    return {f"{folder.name}/{path.name}": path.stat().st_size for folder in folders for path in folder.glob("*.nbc")}


def _is_true(note: Path) -> bool:
    """Whether the files of kernels are still there whole, as far as their sizes tell."""
    try:
        sizes = json.loads(note.read_text())
        return all((note.parent / name).stat().st_size == size for name, size in sizes.items())
    except (AttributeError, OSError, ValueError):  # not there, not written to its end, or not a note
        return False


def _sources() -> list[Path]:
    return sorted((Path(__file__).parents[1] / "kernels").rglob("*.py"))


@cache
def _state() -> str:
    """What all kernels depend on, in 16 characters: their files, the list, the compiler, the CPU."""
    cpu = f"{chosen_cpu() or this_cpu()} {os.environ.get('NUMBA_CPU_FEATURES', '')}"
    found = sha256(NEEDED.read_bytes() + cpu.encode())
    for path in _sources():
        found.update(digest(path).encode())
    return found.hexdigest()[:16]
