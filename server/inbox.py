"""Reading a client's connection, and finding out whether a source is still there."""

from __future__ import annotations

import asyncio
from contextlib import AbstractAsyncContextManager
from types import TracebackType
from typing import Self

from starlette.websockets import WebSocket, WebSocketDisconnect

from .protocol import CloseCode, ProtocolError

__all__ = ["Inbox", "receive"]

READ_S = 5.0  # a source whose messages are still unread after this time counts as being there


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
    """A source's messages, read a little ahead, so that the end of the connection is seen while a view is being taken.

    At most two messages wait, one of them in the queue. Then nothing more is read, and it is not known whether the
    source is still there. An async context manager, which reads while the block runs.
    """

    def __init__(self, client: str, socket: WebSocket) -> None:
        self.client, self._socket = client, socket
        self.ended = False  # no more messages arrive, or none are wanted any more
        self._messages: asyncio.Queue[bytes | Exception] = asyncio.Queue(1)
        self._known = asyncio.Event()  # set while the next message is awaited: then `ended` is up to date
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
        except Exception as error:  # mostly the end; `receive` raises it after the messages that came before
            self.end()
            await self._messages.put(error)

    def end(self) -> None:
        """Mark the source as gone, so that another may take its place although work for this one goes on."""
        self.ended = True
        self._known.set()

    async def receive(self) -> bytes:
        """The next message; after the last one raises what the module's `receive` raised."""
        message = await self._messages.get()
        if isinstance(message, Exception):
            raise message
        return message

    async def is_there(self) -> bool:
        """Whether the source is still there. Answers at once, or within READ_S if it has sent more than was read."""
        try:
            async with asyncio.timeout(READ_S):
                while not self._known.is_set():
                    await self._known.wait()
        except TimeoutError:
            pass
        return not self.ended
