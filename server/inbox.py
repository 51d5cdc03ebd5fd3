"""What comes over a client's connection, and whether a source is still there."""

from __future__ import annotations

import asyncio
from contextlib import AbstractAsyncContextManager
from types import TracebackType
from typing import Self

from starlette.websockets import WebSocket, WebSocketDisconnect

from .protocol import CloseCode, ProtocolError

__all__ = ["Inbox", "receive"]

READ_S = 5.0  # then a source that is so far behind counts as being there


async def receive(socket: WebSocket) -> bytes:
    """The next binary message; raises WebSocketDisconnect at the end and ProtocolError for text."""
    event = await socket.receive()
    if event["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(event.get("code", 1005))
    data: bytes | None = event.get("bytes")
    if data is None:
        raise ProtocolError(CloseCode.MALFORMED, "message", "text", "a binary message")
    return data


class Inbox(AbstractAsyncContextManager["Inbox"]):
    """What a source sends, read a little ahead of who takes it: its end is seen while a view is still being taken.

    No more than two messages wait, one of them in the queue; then nothing is read, and it is not known whether the
    source is still there. Used as an async context manager, which reads while the block runs.
    """

    def __init__(self, client: str, socket: WebSocket) -> None:
        self.client, self._socket = client, socket
        self.ended = False  # no more comes, or no more is wanted
        self._messages: asyncio.Queue[bytes | Exception] = asyncio.Queue(1)
        self._known = asyncio.Event()  # whether it is still there: set while the next message is awaited
        self._known.set()

    async def __aenter__(self) -> Self:
        self._reading = asyncio.create_task(self._read())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.end()
        self._reading.cancel()
        await asyncio.gather(self._reading, return_exceptions=True)

    async def _read(self) -> None:
        try:
            while True:
                self._known.set()
                data = await receive(self._socket)
                self._known.clear()
                await self._messages.put(data)
        except Exception as error:  # the end, mostly: raised where what came before it has been taken
            self.end()
            await self._messages.put(error)

    def end(self) -> None:
        """Nothing that is still done for the source keeps another from its place."""
        self.ended = True
        self._known.set()

    async def receive(self) -> bytes:
        """The next message; raises what `receive` of the connection does, after all messages that came before."""
        message = await self._messages.get()
        if isinstance(message, Exception):
            raise message
        return message

    async def is_there(self) -> bool:
        """Whether the source is still there; at once, unless it has sent more than was read."""
        try:
            async with asyncio.timeout(READ_S):
                while not self._known.is_set():
                    await self._known.wait()
        except TimeoutError:
            pass
        return not self.ended
