"""A real server on a free port of this machine, in a thread."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from typing import Any

from farside.clients.listening import addresses_of, listen
from farside.engine.live.core import Core, Source
from farside.server.app import make_server
from farside.server.settings import ServerSettings

__all__ = ["run_within", "running"]

HANG_S = 60.0


def run_within(seconds: float, scenario: Callable[[], Awaitable[None]]) -> None:
    """Runs a scenario in an event loop of its own; raises TimeoutError if it hangs."""

    async def guarded() -> None:
        async with asyncio.timeout(seconds):
            await scenario()

    asyncio.run(guarded())


@contextmanager
def running(
    make_core: Callable[[Source], Core] | None = None, compiling: Any = None, preparing: Callable[[], str] = str,
    **given: Any,
) -> Iterator[str]:
    """Yields the server's address; after the block the server has shut down in order. `compiling`: its kernels;
    preparing: see `create_app`."""
    settings = ServerSettings(**({"port": 0} | given))
    server = make_server(settings, make_core, compiling, preparing)
    with listen(settings) as listening:
        thread = threading.Thread(target=server.run, kwargs={"sockets": listening})
        thread.start()
        try:
            deadline = time.monotonic() + HANG_S
            while not server.started and thread.is_alive() and time.monotonic() < deadline:
                time.sleep(0.005)
            assert server.started
            yield addresses_of(listening, settings)[0].rstrip("/")
        finally:
            server.should_exit = True
            thread.join(HANG_S)
            assert not thread.is_alive(), "the server did not shut down"
