"""Real proxies on free ports of this machine, in a thread each: a reverse proxy with a path, and a forward proxy."""

from __future__ import annotations

import asyncio
import base64
import contextlib
import re
import ssl
import threading
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from urllib.parse import urlsplit

__all__ = ["Forward", "forward_proxy", "reverse_proxy"]

Serve = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]
HANG_S = 60.0


@contextmanager
def reverse_proxy(
    target: str,
    prefix: str,
    *,
    keep: bool,
    host: str | None = None,
    user: str | None = None,
    tls: ssl.SSLContext | None = None,
) -> Iterator[str]:
    """Yields the proxy's address (without `prefix`). It passes on what is asked for under `prefix`, WebSockets too.

    `keep`: the path in its requests is the client's; else `prefix` is stripped, and nothing tells of it. `host`: the
    Host that it sends instead of the client's. `user`: the "name:password" that it asks for. `tls`: its certificate;
    `target` is spoken to without.
    """
    there = urlsplit(target)

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
        method, path, rest = head.split(" ", 2)
        if not re.match(rf"{re.escape(prefix)}([/?]|$)", path):
            writer.write(b"HTTP/1.1 404 Not Found\r\nContent-Length: 6\r\nConnection: close\r\n\r\nproxy\n")
            return
        if user is not None:
            expected = base64.b64encode(user.encode()).decode()
            if f"authorization: basic {expected}\r\n".lower() not in rest.lower():
                writer.write(b"HTTP/1.1 401 Unauthorized\r\nContent-Length: 4\r\nConnection: close\r\n\r\nwho?")
                return
        if not keep:
            path = path.removeprefix(prefix)
            path = path if path.startswith("/") else f"/{path}"
        if host is not None:
            rest = re.sub(r"(?im)^host:.*\r$", f"Host: {host}\r", rest)
        if not re.search(r"(?im)^upgrade:", rest):  # a request a connection: the server closes it after its answer
            rest = re.sub(r"(?im)^connection:.*\r\n", "", rest)
            rest = rest.removesuffix("\r\n") + "Connection: close\r\n\r\n"
        upstream = await asyncio.open_connection(there.hostname, there.port)
        upstream[1].write(f"{method} {path} {rest}".encode("latin-1"))
        await _join((reader, writer), upstream)

    with _serving(serve, tls) as port:
        yield f"http{'s' if tls else ''}://127.0.0.1:{port}"


@dataclass
class Forward:
    """A running forward proxy: its address, and the authorities that were asked of it."""

    url: str
    asked: list[str] = field(default_factory=list)


@contextmanager
def forward_proxy(target: str) -> Iterator[Forward]:
    """A proxy for CONNECT and for http:// addresses; whatever host is asked for, it connects to `target`."""
    there = urlsplit(target)
    proxy = Forward("")

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1")
        method, address, rest = head.split(" ", 2)
        upstream = await asyncio.open_connection(there.hostname, there.port)
        if method == "CONNECT":
            proxy.asked.append(address)
            writer.write(b"HTTP/1.1 200 Connected\r\n\r\n")
        else:
            parts = urlsplit(address)
            proxy.asked.append(parts.netloc)
            path = parts.path + (f"?{parts.query}" if parts.query else "")
            upstream[1].write(f"{method} {path} {rest}".encode("latin-1"))
        await _join((reader, writer), upstream)

    with _serving(serve, None) as port:
        proxy.url = f"http://127.0.0.1:{port}"
        yield proxy


async def _join(*ends: tuple[asyncio.StreamReader, asyncio.StreamWriter]) -> None:
    """Pass on what either end sends, until one has no more."""

    async def pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while data := await reader.read(1 << 16):
            writer.write(data)
            await writer.drain()

    (a, to_a), (b, to_b) = ends
    both = [asyncio.create_task(pass_on(a, to_b)), asyncio.create_task(pass_on(b, to_a))]
    try:
        await asyncio.wait(both, return_when=asyncio.FIRST_COMPLETED)
    finally:
        to_a.close()  # before anything is awaited: the proxy may be ending
        to_b.close()
        for task in both:
            task.cancel()
        await asyncio.gather(*both, return_exceptions=True)


@contextmanager
def _serving(serve: Serve, tls: ssl.SSLContext | None) -> Iterator[int]:
    """Serve connections in a thread; yields the port."""
    started = threading.Event()
    running: list[tuple[int, asyncio.AbstractEventLoop, asyncio.Event]] = []

    async def one(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.closing(writer), contextlib.suppress(OSError, EOFError, asyncio.CancelledError):
            await serve(reader, writer)

    async def main() -> None:
        async with await asyncio.start_server(one, "127.0.0.1", 0, ssl=tls) as server:
            stop = asyncio.Event()
            running.append((server.sockets[0].getsockname()[1], asyncio.get_running_loop(), stop))
            started.set()
            await stop.wait()

    thread = threading.Thread(target=lambda: asyncio.run(main()))
    thread.start()
    try:
        assert started.wait(HANG_S)
        yield running[0][0]
    finally:
        _, loop, stop = running[0]
        loop.call_soon_threadsafe(stop.set)
        thread.join(HANG_S)
        assert not thread.is_alive()
