"""What the whole suite needs once: its kernels, compiled on all cores before the first test, with progress."""

from __future__ import annotations

import sys
import time

import pytest
from farside.engine.compiling.needed import USES
from farside.engine.compiling.pool import Compiling

_MANY = 1000  # tests: for fewer, kernels are compiled as they are met


def pytest_collection_finish(session: pytest.Session) -> None:
    """Compile what is missing, and say every few seconds how far it is: otherwise nothing is seen for minutes."""
    if len(session.items) < _MANY or session.config.option.collectonly:
        return
    capture = session.config.pluginmanager.getplugin("capturemanager")
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
