"""A client's WebSocket connection as uvicorn has it, with an end for peers that do not take what is sent to them.

uvicorn closes a connection by writing what is left and then waiting, without limit, until the peer has read it. A peer
that has stopped reading would keep its place, and the memory of what it does not read, for ever.
"""

from __future__ import annotations

import asyncio
import math
import time
from typing import Any

from starlette.websockets import WebSocket
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.protocol import State

__all__ = ["Connection", "connection_of"]

STALL_S = 10.0  # a peer that reads nothing for this long, although data wait for it, is cut off
MAX_FRAGMENTS = 4096  # of a message; our source sends 256 for the longest one
_KEY = "farside.connection"


class Connection(WebSocketsSansIOProtocol):
    """A WebSocket connection that ends within a bounded time, however its peer behaves.

    The limit of messages is that of the server's configuration until `take_messages` raises it: what a client that
    nobody knows yet can make the server keep is small.
    """

    _cutting: asyncio.TimerHandle | None = None
    _stalling: asyncio.TimerHandle | None = None
    heard = -math.inf  # when the peer sent something for the last time, monotonic clock, s

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

    def data_received(self, data: bytes) -> None:
        """The peer has sent something."""
        self.heard = time.monotonic()
        super().data_received(data)

    def pause_writing(self) -> None:
        """More waits for the peer than it should: from now on it must take some of it."""
        super().pause_writing()
        self._expect_less(self.transport.get_write_buffer_size())

    def resume_writing(self) -> None:
        """The peer has taken most of it."""
        super().resume_writing()
        if self._stalling is not None:
            self._stalling.cancel()
            self._stalling = None
        if not self.read_paused:
            self.transport.resume_reading()

    def _expect_less(self, than: int) -> None:
        """Cut the peer off if no less than `than` bytes wait for it when STALL_S has passed."""

        def look() -> None:
            left = self.transport.get_write_buffer_size()
            if left >= than:
                self.transport.abort()
            else:
                self._expect_less(left)

        self._stalling = self.loop.call_later(STALL_S, look)

    def handle_ping(self) -> None:
        """Answer a ping; a peer that does not read the answers is not asked for more."""
        super().handle_ping()
        if not self.writable.is_set() and not self.transport.is_closing():
            self.transport.pause_reading()

    def handle_cont(self, event: Any) -> None:
        """A message goes on; one of too many fragments is no message, even if they are empty."""
        super().handle_cont(event)
        if len(self.frames) > MAX_FRAGMENTS:
            self.transport.abort()

    def eof_received(self) -> None:
        """The peer sends no more; asyncio closes the connection when the rest has been read."""
        self._cut_later()

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
        if self.close_sent or self.conn.state in (State.CONNECTING, State.OPEN):
            super().shutdown()
        else:  # the peer has closed, which uvicorn would answer once more: an error that keeps others from their end
            self.stop_keepalive()
            self.transport.close()
        self._cut_later()

    def connection_lost(self, exc: Exception | None) -> None:
        """The connection is gone."""
        for timer in (self._cutting, self._stalling):
            if timer is not None:
                timer.cancel()
        super().connection_lost(exc)

    def _cut_later(self) -> None:
        """What is left may still be read for a while."""
        if self._cutting is None and not self.disconnected:
            self._cutting = self.loop.call_later(STALL_S, self.transport.abort)


def connection_of(socket: WebSocket) -> Connection | None:
    """The connection under an application's socket; None where another server than ours runs the application."""
    extension: dict[str, Connection] = socket.scope.get("extensions", {}).get(_KEY, {})
    return extension.get("connection")
