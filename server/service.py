"""The state that all connections share: the live engine, the server's settings, the current source."""

from __future__ import annotations

import asyncio
import dataclasses
import hmac
import logging
import math
import secrets
import time
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from itertools import count
from typing import Any, TypeVar

from farside.engine.compiling.pool import Compiling
from farside.engine.live.core import CoreLostError
from farside.engine.live.engine import Live
from farside.engine.live.governor import Rung
from farside.engine.rig.questions import NoModelError
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from .connection import connection_of
from .inbox import Inbox, receive
from .protocol import (
    MAX_CONTROL_BYTES,
    MAX_HELLO_BYTES,
    CloseCode,
    Error,
    Message,
    ProtocolError,
    SharedMemory,
    SourceHello,
    ViewerHello,
    Welcome,
    agreed,
    decode,
    encode,
)
from .settings import ServerSettings

__all__ = ["CREDITS", "Service", "conversation", "race", "send"]

_log = logging.getLogger(__name__)
CREDITS = 2  # frames of a source: one is being taken, one arrives or waits; more would only be overtaken
Hello = TypeVar("Hello", ViewerHello, SourceHello)


@dataclass(slots=True)
class Service:
    """The state of one run of the server."""

    live: Live
    settings: ServerSettings
    compiling: Compiling | None = None  # kernels on their way
    preparing: Callable[[], str] = str  # what a source's first frame is waiting for, for people; "": nothing known
    session: str = field(default_factory=lambda: secrets.token_hex(4))
    started: float = field(default_factory=time.monotonic)
    source: Inbox | None = None  # the source that has the place; after its end it stays here until another comes
    _numbers: Any = field(default_factory=lambda: count(1))

    def authorised(self, token: str) -> bool:
        """Whether a client with this token may take part."""
        return hmac.compare_digest(token.encode(), self.settings.token.encode()) or not self.settings.token

    async def greet(self, socket: WebSocket, kind: type[Hello]) -> tuple[str, Hello]:
        """Await a client's hello; returns the client's id in this session and the hello. Raises ProtocolError."""
        try:
            async with asyncio.timeout(self.settings.hello_timeout_s):
                data = await receive(socket)
        except TimeoutError as error:
            waited = f"nothing for {self.settings.hello_timeout_s:g} s"
            raise ProtocolError(CloseCode.TIMEOUT, "hello", waited, "a hello") from error
        hello = decode(data, kind, limit=MAX_CONTROL_BYTES if kind is ViewerHello else MAX_HELLO_BYTES)
        if not self.authorised(hello.token):
            raise ProtocolError(CloseCode.TOKEN, "token", "another" if hello.token else "none", "the server's token")
        agreed(hello.features, hello.ROLE)  # raises for a required one that is not known here
        if (connection := connection_of(socket)) is not None:
            # What is a little too long for a viewer is still read, so that it is told what is wrong.
            connection.take_messages(4 * MAX_CONTROL_BYTES if kind is ViewerHello else self.settings.max_message_bytes)
        return f"{kind.ROLE}-{next(self._numbers)}", hello

    @asynccontextmanager
    async def place(self, source: Inbox) -> AsyncIterator[None]:
        """Hold the place of the only source while the block runs; raises ProtocolError if another source is there.

        A source that has ended does not delay the next one, although work for it may still go on.
        """
        while self.source is not None and not self.source.ended:
            if await (other := self.source).is_there():
                raise ProtocolError(CloseCode.BUSY, "source", other.client, "no other source at a time")
        self.source = source
        try:
            yield
        finally:
            if self.source is source:
                self.source = None

    async def welcome(
        self, socket: WebSocket, client: str, hello: ViewerHello | SourceHello, memory: SharedMemory | None = None
    ) -> None:
        """Answer a valid hello; `memory` is the shared memory that a source may write into."""
        settings = dataclasses.asdict(self.settings.engine())
        limit = self.settings.max_message_bytes
        common = agreed(hello.features, hello.ROLE)
        await send(socket, Welcome(self.session, client, settings, CREDITS, limit, memory, common))

    @property
    def rung(self) -> Rung:
        """The settings with which pictures are rendered and encoded now; without a name if no frame rate is held."""
        governor = self.live.governor
        return governor.rung if governor else Rung("", 1.0, self.settings.engine())

    def status(self, seconds: float = math.inf) -> dict[str, Any]:
        """Figures for people and monitors; the longest stalls and pictures are those of the last `seconds`."""
        return {
            "session": self.session,
            "uptime_s": time.monotonic() - self.started,
            "source_connected": self.source is not None and not self.source.ended,
            "preparing": self.preparing(),
            "kernels": self._kernels(),
            **self.live.status(seconds),
        }

    def no_model(self, error: NoModelError) -> str:
        """Why there is no model that could be asked."""
        progress = None if self.compiling is None else self.compiling.progress
        if progress is None or progress.done == progress.total or self.live.shown is None:
            return str(error)
        done = f"kernels for it are being compiled: {progress.done} of {progress.total}"
        return f"model: there is none yet: {done}: expected a request after that"

    def _kernels(self) -> dict[str, int] | None:
        """How many kernels are ready, of how many that the server's settings need, and of those that the first picture
        needs; None: another program sees to it."""
        if self.compiling is None:
            return None
        all_, first = self.compiling.progress, self.compiling.first
        return {
            "ready": all_.done, "of": all_.total, "failed": all_.failed, "first_ready": first.done,
            "first_of": first.total,
        }  # fmt: skip


async def send(socket: WebSocket, message: Message) -> None:
    """Send a message."""
    await socket.send_bytes(encode(message))


@asynccontextmanager
async def conversation(socket: WebSocket) -> AsyncIterator[None]:
    """Accept a client. An error is reported to this client and ends this connection, and no other."""
    await socket.accept()
    try:
        yield
    except WebSocketDisconnect:
        pass
    except ProtocolError as error:
        await _refuse(socket, error)
    except Exception as error:  # a boundary: the client is told, the service goes on
        if not isinstance(error, CoreLostError):  # which says all; where it was noticed says nothing
            _log.exception("connection failed")
        message = f"{type(error).__name__}: {error}"
        await _refuse(socket, ProtocolError(CloseCode.INTERNAL, "server", message, "no such error"))


async def _refuse(socket: WebSocket, error: ProtocolError) -> None:
    _log.warning("client refused: %s", error)
    if socket.client_state is not WebSocketState.CONNECTED:
        return
    reason = str(error).encode()[:120].decode(errors="ignore")  # a close frame holds 123 bytes
    try:
        await send(socket, Error.of(error))
        await socket.close(int(error.code), reason)
    except (WebSocketDisconnect, RuntimeError):
        _log.info("the client left before it received the error")


async def race(*coroutines: Coroutine[Any, Any, None]) -> None:
    """Run all coroutines until one ends or fails; then cancel and await the others."""
    tasks = [asyncio.create_task(coroutine) for coroutine in coroutines]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
