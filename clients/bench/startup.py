"""`farside bench startup`: from nothing to a picture in a browser, and how soon the small commands answer."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from ..fetching import fetch
from .processes import cpu_of_tree_s

__all__ = ["Startup", "command", "measure_start"]

_HANG_MS = 900_000
_FLAGS = ("--headless", "--no-sandbox", "--disable-gpu")


@dataclass(frozen=True, slots=True)
class Startup:
    """Seconds from the start of `farside demo` until it printed its address, until the page showed progress that moves
    (kernels or a picture), and until the first picture; CPU seconds of all processes, the browser's included."""

    address: float
    progress: float
    picture: float
    cpu: float


def command(
    runs: Annotated[int, typer.Option(min=1, help="Runs, of which the medians are told.")] = 3,
    browser: Annotated[Path, typer.Option(help="A chromium.")] = Path("/usr/bin/chromium"),
) -> None:
    """Start the demo in an empty cache, once more, and with kernels alone, as a wheel or a container brings them; look
    at it with a real browser, and tell the times."""
    if not browser.is_file():
        raise ValueError(f"--browser: {browser}: expected a chromium")
    first, second, warm = list[Startup](), list[Startup](), list[Startup]()
    console = Console(stderr=True)
    for run in range(runs):
        console.print(f"run {run + 1} of {runs}: this takes minutes", highlight=False)
        with tempfile.TemporaryDirectory() as cache:
            first.append(measure_start(Path(cache), browser))
            second.append(measure_start(Path(cache), browser))
            for twin in Path(cache).rglob("museum-*"):
                shutil.rmtree(twin)
            warm.append(measure_start(Path(cache), browser, whole=False))
    table = Table(title=f"from nothing to a picture, medians of {runs}")
    for column in ("seconds until", "empty cache", "second start", "kernels alone"):
        table.add_column(column, justify="left" if column == "seconds until" else "right")
    for name, title in (
        ("address", "the address is printed"), ("progress", "the page shows progress that moves"),
        ("picture", "the first picture"), ("cpu", "(CPU seconds of all processes until then)"),
    ):  # fmt: skip
        table.add_row(title, *(_median(getattr(start, name) for start in starts) for starts in (first, second, warm)))
    for title, arguments in (("farside --help", ["--help"]), ("farside info", ["info", "."])):
        spent = statistics.median(_answer_s(arguments) for _ in range(5))
        table.add_row(f"{title} has ended", "", f"{spent:.2f}", "")
    Console(width=100).print(table)


def _median(seconds: Iterable[float]) -> str:
    return f"{statistics.median(seconds):.1f}"


def measure_start(cache: Path, browser: Path, *, whole: bool = True) -> Startup:
    """Start the demo with a cache folder, and watch it until the first picture; needs playwright. whole: it goes on
    until the whole sequence and all kernels are there."""
    from playwright.sync_api import sync_playwright

    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    environment.pop("NUMBA_CACHE_DIR", None)
    with sync_playwright() as play:
        window = play.chromium.launch(executable_path=str(browser), args=list(_FLAGS))  # before the clock starts
        page = window.new_page(viewport={"width": 1280, "height": 720})
        started, cpu_before = time.monotonic(), cpu_of_tree_s(os.getpid())
        with _demo(environment) as address:
            at_address = time.monotonic() - started
            page.goto(address)
            page.wait_for_function(_MOVES, timeout=_HANG_MS)
            at_progress = time.monotonic() - started
            page.wait_for_function("() => globalThis.farside?.seen > 0", timeout=_HANG_MS)
            at_picture, cpu = time.monotonic() - started, cpu_of_tree_s(os.getpid()) - cpu_before
            if whole:
                _wait_for_all(address, cache)
        window.close()
    return Startup(at_address, at_progress, at_picture, cpu)


# What the page says about kernels has changed, or there is a picture.
_MOVES = """() => {
  const said = (document.getElementById("message").textContent.match(/(\\d+) of/) ?? [])[1];
  if (said !== undefined && globalThis.firstSaid === undefined) globalThis.firstSaid = said;
  return globalThis.farside?.seen > 0 || (said !== undefined && said !== globalThis.firstSaid);
}"""


@contextmanager
def _demo(environment: Mapping[str, str]) -> Iterator[str]:
    """A demo that runs while the block does; gives its address."""
    command = [sys.executable, "-u", "-m", "farside.clients.cli", "demo", "--port", "0"]
    process = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if found := re.search(r"http://\S+", line):
                yield found[0]
                return
        raise RuntimeError("farside demo has ended without an address")
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate()


def _wait_for_all(address: str, cache: Path) -> None:
    """Wait until the demo has made the whole twin and all kernels, as someone does who looks at it for some minutes."""
    while any(cache.rglob(".museum-*")) or _kernels_left(address):
        time.sleep(1.0)


def _kernels_left(address: str) -> int:
    kernels = json.loads(fetch(address, "status", timeout_s=60))["kernels"]
    return int(kernels["of"]) - int(kernels["ready"])


def _answer_s(arguments: list[str]) -> float:
    """Seconds that a command takes."""
    started = time.monotonic()
    subprocess.run([sys.executable, "-m", "farside.clients.cli", *arguments], capture_output=True)
    return time.monotonic() - started
