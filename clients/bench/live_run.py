"""Server, replay and headset over localhost, each a process of its own, and the figures of such a run."""

from __future__ import annotations

import asyncio
import json
import math
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from farside.server.protocol import ViewerHello

from ..connection import persist
from ..fetching import fetch
from ..headset import Headset
from .processes import Usage

__all__ = ["LiveFigures", "measure_live"]

_HANG_S = 600.0  # the first run compiles every kernel
_WARM_UPDATES = 4  # updates with a viewer before counting starts: the first ones do work that is done only once
_POSE_RATE = 72.0
_REPLAY_NICENESS = 5  # the replay stands for cameras, which would not use the server's cores


# An event loop with nothing to do, in a process of its own: its delays are caused by the machine alone.
_IDLE = """
import asyncio, contextlib, json, sys
from farside.engine.live.timing import Activity, StallMonitor

monitor = StallMonitor(Activity())
with contextlib.suppress(TimeoutError):
    asyncio.run(asyncio.wait_for(monitor.run(), float(sys.argv[1])))
print(json.dumps(monitor.summary()))
"""


@dataclass(frozen=True, slots=True)
class LiveFigures:
    """Figures of a part of a run. Times are in milliseconds; `cores` are CPU seconds a second."""

    seconds: float
    pairs: int
    frames: dict[str, int]  # by outcome
    motion_to_photon: tuple[float, float, float]  # pose sent to picture received: p50, p95, p99
    picture_bytes: float  # of a pair
    cores: tuple[float, float, float]  # of server and engine together, of the server's event loop, of the replay
    server: Usage
    status: dict[str, Any]  # the server's, at the end; the longest stalls and pictures are those of this part only
    idle: dict[str, float]  # stalls of an idle event loop in another process at the same time

    @property
    def rate(self) -> float:
        """Stereo pairs a second."""
        return self.pairs / self.seconds


def measure_live(
    folder: Path, fps: float | None, seconds: float, quality: str, size: tuple[int, int] = (640, 720)
) -> tuple[LiveFigures, LiveFigures]:
    """Serve, replay in a loop and watch for `seconds`; then watch half as long without the replay.

    Server and replay are processes of their own, as users run them, the replay at a lower priority; this process is the
    headset. `fps`: video frames a second, None for the sequence's; `size`: width and height of an eye. Counting begins
    after a few frames have been taken while there was a viewer. Raises RuntimeError if one of the processes fails.
    """
    rate = [] if fps is None else ["--rate", str(fps)]
    with ExitStack() as stack:
        server, url = stack.enter_context(_served(quality))
        replay = stack.enter_context(_running("replay", str(folder), url, "--loop", *rate))
        os.setpriority(os.PRIO_PROCESS, replay.pid, _REPLAY_NICENESS)
        _watch_until_warm(url, size, (server, replay))
        playing = _measure(url, seconds, size, server, replay)
        replay.terminate()
        replay.wait(_HANG_S)
        while _status(url)["updating"]:
            time.sleep(0.2)
        time.sleep(1.0)  # the longest stalls and pictures are kept for each second
        still = _measure(url, seconds / 2, size, server, None)
    return playing, still


@contextmanager
def _running(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A farside command in a process that ends with the block; its error output is shown if it fails."""
    command = [sys.executable, "-m", "farside.clients.cli", *arguments]
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=said, text=True)
        try:
            yield process
            if process.poll() not in (None, 0, -15, 128 + 15):  # it was told to end
                said.seek(0)
                raise RuntimeError(f"{arguments[0]} ended with {process.returncode}: {said.read()[-2000:]}")
        finally:
            process.terminate()
            process.communicate(timeout=_HANG_S)


@contextmanager
def _served(quality: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    with _running("serve", "--port", "0", "--quality", quality) as server:
        assert server.stdout is not None
        said = server.stdout.readline()
        found = re.match(r"serving at (\S+)", said)
        if found is None:
            server.wait(_HANG_S)
        else:
            yield server, found[1].rstrip("/")


def _watch_until_warm(url: str, size: tuple[int, int], processes: Sequence[subprocess.Popen[str]]) -> None:
    async def warm() -> None:
        watching = asyncio.create_task(_watch(url, math.inf, size))
        try:
            async with asyncio.timeout(_HANG_S):
                before = None
                while before is None or (await _updates(url))[0] < before + _WARM_UPDATES:
                    await asyncio.sleep(0.2)
                    if watching.done() or any(process.poll() is not None for process in processes):
                        raise RuntimeError("live: the server, the replay or the headset ended before it was watched")
                    updated, viewers = await _updates(url)
                    if before is None and viewers:
                        before = updated
        finally:
            watching.cancel()
            await asyncio.gather(watching, return_exceptions=True)

    asyncio.run(warm())


async def _updates(url: str) -> tuple[int, int]:
    """The numbers of frames taken so far and of viewers that have received a picture."""
    status = await asyncio.to_thread(_status, url)
    return status["frames"]["updated"], sum(viewer["rendered"] > 0 for viewer in status["viewers"].values())


async def _watch(url: str, seconds: float, size: tuple[int, int]) -> Headset:
    hello = ViewerHello.symmetric(*size, math.radians(90), axes="openxr")
    headset = Headset(hello, rate=_POSE_RATE, seconds=seconds)
    await persist(lambda: headset.run(url), 10.0, lambda message: None)
    return headset


def _measure(
    url: str, seconds: float, size: tuple[int, int],
    server: subprocess.Popen[str], replay: subprocess.Popen[str] | None,
) -> LiveFigures:  # fmt: skip
    start = time.monotonic()
    before = _status(url)
    processes = server.pid, before["engine"]["pid"]
    used = Usage.of(*processes)
    replay_used = Usage.of(replay.pid).cpu_s if replay else 0.0
    with subprocess.Popen([sys.executable, "-c", _IDLE, str(seconds)], stdout=subprocess.PIPE, text=True) as idle:
        headset = asyncio.run(_watch(url, seconds, size))
        elapsed = time.monotonic() - start
        idle_stalls = json.loads(idle.communicate(timeout=_HANG_S)[0])
    status, now = _status(url, time.monotonic() - start), Usage.of(*processes)
    if not headset.frames:
        raise RuntimeError("live: the headset received no picture")
    looping = status["event_loop"]["loop_busy_s"] - before["event_loop"]["loop_busy_s"]
    replaying = Usage.of(replay.pid).cpu_s - replay_used if replay else 0.0
    seconds_of_cores = now.cpu_s - used.cpu_s, looping, replaying
    p50, p95, p99 = np.percentile(headset.latencies_ms, (50, 95, 99)).tolist()
    return LiveFigures(
        elapsed,
        len(headset.frames),
        {outcome: count - before["frames"][outcome] for outcome, count in status["frames"].items()},
        (p50, p95, p99),
        headset.bytes_received / len(headset.frames),
        (seconds_of_cores[0] / elapsed, seconds_of_cores[1] / elapsed, seconds_of_cores[2] / elapsed),
        now,
        status,
        idle_stalls,
    )


def _status(url: str, seconds: float = 3600.0) -> dict[str, Any]:
    status: dict[str, Any] = json.loads(fetch(url, f"status?seconds={seconds}", timeout_s=_HANG_S))
    return status
