"""A client's side of the protocol: connect, say hello, send and receive messages, reconnect."""

from __future__ import annotations

import asyncio
import ssl
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any, TypeVar, overload
from urllib.parse import unquote

from farside.server.protocol import (
    Error,
    M,
    Message,
    SourceHello,
    ViewerHello,
    Welcome,
    decode,
    encode,
)
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as open_socket
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException

from .address import base_url, parse_address, without_secrets
from .proxies import proxy_of, without_password

__all__ = ["Peer", "RefusedError", "base_url", "connect", "distrusted", "persist"]

T = TypeVar("T")
PRIVATE_CODES = range(4400, 4500)  # the client is at fault: trying again changes nothing


class RefusedError(ValueError):
    """The server refused what the client sent; the message says why."""


# A large message is sent in fragments: each time that asyncio has sent a part of a write, it moves the rest, so that
# the time grows with the square of the length.
FRAGMENT_BYTES = 1 << 18


class Peer:
    """An open connection after the greeting."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket

    async def send(self, message: Message) -> None:
        """Send a message."""
        await self.send_bytes(encode(message))

    async def send_bytes(self, data: bytes) -> None:
        """Send a message that is already encoded."""
        try:
            if len(data) <= FRAGMENT_BYTES:
                await self._socket.send(data)
            else:
                view = memoryview(data)
                await self._socket.send([view[i : i + FRAGMENT_BYTES] for i in range(0, len(data), FRAGMENT_BYTES)])
        except ConnectionClosed as error:
            raise await self._closed(error) from error

    @overload
    async def receive(self, kind: type[M], /) -> M: ...
    @overload
    async def receive(self, *allowed: type[Message]) -> Message: ...
    async def receive(self, *allowed: type[Any]) -> Any:
        """Receive the next message, one of `allowed`.

        Raises RefusedError if the server refuses this client, ConnectionError when the connection has ended.
        """
        try:
            data = await self._socket.recv(decode=False)
        except ConnectionClosed as error:
            raise await self._closed(error) from error
        message = decode(data, *allowed, Error, limit=len(data))
        if isinstance(message, Error):
            raise _refused(message)
        return message

    async def _closed(self, error: ConnectionClosed) -> Exception:
        """The exception that says why the connection ended: the server's refusal may still be unread."""
        try:
            while True:
                message = decode(await self._socket.recv(decode=False))
                if isinstance(message, Error):
                    return _refused(message)
        except (ConnectionClosed, ValueError):
            pass
        code = error.rcvd.code if error.rcvd else 1006
        reason = (error.rcvd.reason if error.rcvd else "") or "no reason given"
        if code in PRIVATE_CODES:
            return RefusedError(f"refused by the server: {reason} (code {code})")
        return ConnectionError(f"the server closed the connection: {reason} (code {code})")


def _refused(error: Error) -> Exception:
    text = f"{error.field}: {error.value}: expected {error.expected} (code {error.code})"
    kind = RefusedError if error.code in PRIVATE_CODES else ConnectionError
    return kind(f"refused by the server: {text}")


@asynccontextmanager
async def connect(
    url: str, hello: ViewerHello | SourceHello, *, tls: ssl.SSLContext | None = None
) -> AsyncIterator[tuple[Peer, Welcome]]:
    """Connect and greet; `tls`: whom to trust (default: as the machine).

    The wait for the welcome has no limit as long as the server answers pings: a source is welcome when kernels are
    compiled, which takes minutes on a busy machine.

    Raises RefusedError if the server refuses or its certificate is not trusted, ConnectionError if no server answers,
    ValueError for an address, or a proxy in the environment, that cannot be used.
    """
    socket = await _open(url, hello.ROLE, tls)
    async with socket:
        peer = Peer(socket)
        await peer.send(hello)
        yield peer, await peer.receive(Welcome)


async def _open(url: str, role: str, tls: ssl.SSLContext | None) -> ClientConnection:
    """A WebSocket that the server, or a proxy in between, has accepted."""
    address, proxy = parse_address(url), proxy_of(url, "ws")
    options: dict[str, Any] = {"ssl": tls} if tls is not None and address.secure else {}
    if "%" in address.host:  # an interface, RFC 6874
        options["host"] = unquote(address.host)
    through = f" through the proxy {without_password(proxy)}" if proxy else ""
    where = f"{address.url('ws')}/{role}"
    try:
        return await open_socket(
            where, proxy=proxy, max_size=None, compression=None, ping_timeout=120, **options
        )
    except ssl.SSLCertVerificationError as error:
        raise distrusted(url, error) from error
    except InvalidStatus as error:
        said = (error.response.body or b"")[:200].decode(errors="replace").strip()
        said = f"{said or error.response.reason_phrase} (status {error.response.status_code})"
        if error.response.status_code == 403:  # the server, or who stands before it, does not want this client
            raise RefusedError(f"refused by the server: {said}") from error
        raise ConnectionError(f"no server at {without_secrets(url)}{through}: {said}") from error
    except (OSError, WebSocketException, TimeoutError) as error:
        raise ConnectionError(f"no server at {without_secrets(url)}{through}: {error}") from error


def distrusted(url: str, error: ssl.SSLCertVerificationError) -> RefusedError:
    """What to say about a server whose certificate is not trusted."""
    expected = "a server with a certificate that is trusted here (--ca-file adds an authority)"
    return RefusedError(f"url: {without_secrets(url)!r}: expected {expected}: {error.verify_message}")


async def persist(
    session: Callable[[], Awaitable[T]], patience_s: float, tell: Callable[[str], None], pause_s: float = 0.5
) -> T:
    """Run `session`; after a lost connection run it again, `pause_s` later. Returns what a session that ends returns.

    Raises the last ConnectionError after `patience_s` seconds without a connection. `tell` is called with each failure
    that is not the same as the last one.
    """
    told = ""
    while True:
        started = time.monotonic()
        try:
            return await session()
        except ConnectionError as error:
            lived = time.monotonic() - started
            if patience_s <= 0:
                raise
            if told != str(error):
                tell(f"{error}; trying again")
            told = str(error) if lived <= 5.0 else ""
            # A session that lasted more than five seconds renews the patience; failures in a row use it up.
            patience_s = patience_s if lived > 5.0 else patience_s - lived - pause_s
            await asyncio.sleep(pause_s)
