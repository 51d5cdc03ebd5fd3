"""Commands end soon after a signal, whatever they are doing, and leave nothing unfinished behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import pytest
from support.processes import is_gone

HANG_S = 120.0
SIGNALS = [signal.SIGINT, signal.SIGTERM]
# The main thread stays in C and hears of no signal, as while LLVM compiles: the system hands it to another thread.
STUCK = """
import ctypes, signal, subprocess, sys
from pathlib import Path
from farside.clients.ending import end_soon, set_patience, unfinished
end_soon()
set_patience({patience})
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT, signal.SIGTERM])
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(1000)"])
with unfinished(Path({folder!r})):
    Path({folder!r}).mkdir()
    print(child.pid, flush=True)
    while True:
        ctypes.CDLL(None).sleep(1000)
"""


@contextmanager
def running(code: str, **environment: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", code]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env={**os.environ, **environment}, start_new_session=True
    ) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("signals", [1, 2])
def test_a_process_that_computes_in_c_ends_with_its_children_and_what_it_had_not_finished(
    number: signal.Signals, signals: int, tmp_path: Path
) -> None:
    folder, patience = tmp_path / "partial", 0.2 if signals == 1 else 100000
    with running(STUCK.format(folder=str(folder), patience=patience)) as process:
        assert process.stdout is not None
        child = int(process.stdout.readline())
        assert folder.is_dir()
        for _ in range(signals):
            process.send_signal(number)
            time.sleep(0.05)  # two at once would be one
        assert process.wait(HANG_S) == 128 + number
        assert not folder.exists()
        while not is_gone(child):
            pass


@pytest.mark.parametrize("number", SIGNALS)
def test_a_process_that_can_end_by_itself_does_so_in_order(number: signal.Signals, tmp_path: Path) -> None:
    code = f"""
import time
from pathlib import Path
from farside.clients.ending import end_soon, unfinished
end_soon()
try:
    with unfinished(Path({str(tmp_path / "partial")!r})) as _:
        print("ready", flush=True)
        time.sleep(1000)
except (KeyboardInterrupt, SystemExit):
    print("in order")
"""
    with running(code) as process:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(number)
        assert process.stdout.readline() == "in order\n"
        assert process.wait(HANG_S) == 0


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize("until", ["kernels/*/*.nbc", "cache/farside/.museum-*"])
def test_the_demo_ends_while_kernels_compile_or_its_twin_is_made_and_leaves_nothing(
    number: signal.Signals, until: str, tmp_path: Path
) -> None:
    environment = {"NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    code = "import sys; sys.argv = ['farside', 'demo', '--port', '0']; from farside.clients.cli import main; main()"
    with running(code, **environment) as process:
        while not list(tmp_path.glob(until)):
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(number)
        process.wait(HANG_S)
    assert not list((tmp_path / "cache").glob("farside/*museum*"))
    assert not list((tmp_path / "cache").glob("farside/.*"))


def test_the_version_is_that_of_the_package() -> None:
    told = subprocess.run([sys.executable, "-m", "farside.clients.cli", "--version"], capture_output=True, text=True)
    assert told.stdout == f"farside {version('farside')}\n"
