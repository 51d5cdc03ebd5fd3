"""A client's WebSocket connection as uvicorn has it, with an end for peers that do not take what is sent to them.

uvicorn closes a connection by writing what is left and then waiting, without limit, until the peer has read it. A peer
that has stopped reading would keep its place, and the memory of what it does not read, for ever.
"""

from __future__ import annotations

import asyncio
from typing import Any

from starlette.websockets import WebSocket
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

__all__ = ["Connection", "connection_of"]

STALL_S = 10.0  # a peer that reads nothing for this long, although data wait for it, is cut off
_KEY = "farside.connection"


class Connection(WebSocketsSansIOProtocol):
    """A WebSocket connection that ends within a bounded time, however its peer behaves.

    The limit of messages is that of the server's configuration until `take_messages` raises it: what a client that
    nobody knows yet can make the server keep is small.
    """

    _cutting: asyncio.TimerHandle | None = None

    def take_messages(self, max_bytes: int) -> None:
        """From now on messages of up to `max_bytes` bytes are taken."""
        self.conn.max_message_size = max_bytes

    def expect_pongs(self, interval_s: float, timeout_s: float) -> None:
        """Before it is accepted: ping it `interval_s` seconds after its last pong, and cut it off where no pong comes
        for `timeout_s` seconds."""
        self.ping_interval, self.ping_timeout = interval_s, timeout_s

    async def run_asgi(self) -> None:
        """Run the application, which finds this object by `connection_of`."""
        self.scope["extensions"][_KEY] = {"connection": self}
        try:
            await super().run_asgi()
        finally:
            self._cut_later()

    async def send(self, message: Any) -> None:
        """Send a message of the application; cuts the peer off where it takes nothing."""
        left = self.transport.get_write_buffer_size()
        while not self.writable.is_set():
            try:
                async with asyncio.timeout(STALL_S):
                    await self.writable.wait()
            except TimeoutError:
                before, left = left, self.transport.get_write_buffer_size()
                if left >= before:
                    self.transport.abort()
                    break
        await super().send(message)

    def keepalive_timeout(self) -> None:
        """No pong came in time: nobody reads what is left to be sent."""
        super().keepalive_timeout()
        self.transport.abort()

    def handle_close(self, event: Any) -> None:
        """The peer closes, or answers that this side does."""
        super().handle_close(event)
        self._cut_later()

    def handle_parser_exception(self) -> None:
        """The peer broke WebSocket's rules, or its message is too large."""
        super().handle_parser_exception()
        self._cut_later()

    def shutdown(self) -> None:
        """The server ends."""
        super().shutdown()
        self._cut_later()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection is gone."""
        if self._cutting is not None:
            self._cutting.cancel()
        super().connection_lost(exc)

    def _cut_later(self) -> None:
        """What is left may still be read for a while."""
        if self._cutting is None and not self.disconnected:
            self._cutting = self.loop.call_later(STALL_S, self.transport.abort)


def connection_of(socket: WebSocket) -> Connection | None:
    """The connection under an application's socket; None where another server than ours runs the application."""
    extension: dict[str, Connection] = socket.scope.get("extensions", {}).get(_KEY, {})
    return extension.get("connection")
