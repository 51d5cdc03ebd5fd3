"""What the whole suite needs once: its kernels, compiled on all cores before the first test, with progress."""

from __future__ import annotations

import sys
import time

import pytest
from farside.engine.compiling.needed import USES
from farside.engine.compiling.pool import Compiling

_MANY = 1000  # tests: for fewer, kernels are compiled as they are met


def pytest_sessionstart(session: pytest.Session) -> None:
    """With several processes (-n), before these start: they cannot say how far it is."""
    config = session.config
    whole = config.args_source == pytest.Config.ArgsSource.TESTPATHS and not config.option.keyword
    if getattr(config.option, "numprocesses", None) and whole and not config.option.collectonly:
        _compile_all(config)


def pytest_collection_finish(session: pytest.Session) -> None:
    """In one process, as soon as it is known that there are many tests."""
    if _is_one_process(session.config) and len(session.items) >= _MANY and not session.config.option.collectonly:
        _compile_all(session.config)


def _is_one_process(config: pytest.Config) -> bool:
    return not hasattr(config, "workerinput") and not getattr(config.option, "numprocesses", None)


def _compile_all(config: pytest.Config) -> None:
    """Compile what is missing, and say every few seconds how far it is: otherwise nothing is seen for minutes."""
    capture = config.pluginmanager.getplugin("capturemanager")
    compiling, started = Compiling(USES), time.monotonic()
    with capture.global_and_fixture_disabled():
        try:
            compiling.start()
            while not compiling.wait(timeout=5.0):
                done = compiling.progress
                print(f"compiling kernels: {done.done} of {done.total}", file=sys.stderr, flush=True)
        finally:
            compiling.stop()
        print(f"kernels are ready ({time.monotonic() - started:.0f} s)", file=sys.stderr, flush=True)
