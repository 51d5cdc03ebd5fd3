"""Sources: receives views, and reports the outcome of every frame."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import ipaddress
import os
import time
from functools import partial
from typing import NoReturn

from farside.engine.live.back_buffer import BackBuffer, OrderError
from farside.engine.live.core import CoreLostError, Source
from farside.engine.live.frame_memory import FrameBuffer, FrameBuffers
from farside.engine.live.left_out import Settled
from farside.engine.rig.frame import Frame, View
from starlette.websockets import WebSocket, WebSocketDisconnect

from .connection import connection_of
from .inbox import Inbox
from .left_out import Arrivals
from .protocol import (
    MAX_HELLO_BYTES,
    BufferFree,
    CloseCode,
    FrameDone,
    ProtocolError,
    SharedMemory,
    SourceHello,
    ViewData,
    decode,
)
from .service import CREDITS, Service, conversation, race, send

__all__ = ["serve_source"]

BUFFERS = CREDITS + 1  # frames in memory: the one on show, and those of the source that are not settled yet
PATIENCE_S = 2.0  # a frame that lacks views is closed if the source sends nothing for so long, or for two frames


async def serve_source(socket: WebSocket, service: Service) -> None:
    """One source's connection, from hello to close. One source at a time; it may leave and come back."""
    if (connection := connection_of(socket)) is not None:
        connection.take_messages(MAX_HELLO_BYTES)
    async with conversation(socket):
        client, hello = await service.greet(socket, SourceHello)
        async with Inbox(client, socket) as inbox, service.place(inbox):
            await _open(service, hello)
            ingest = _Ingest(service, socket, inbox, hello)
            try:
                await service.welcome(socket, client, hello, ingest.memory)
                await race(ingest.receive(), ingest.grant(), ingest.report())
            finally:
                inbox.end()  # the next source does not wait for what follows
                await asyncio.to_thread(ingest.close)  # freeing gigabytes takes a while


async def _open(service: Service, hello: SourceHello) -> None:
    try:
        await service.live.open(Source(hello.name, hello.fps, hello.cameras))
    except ValueError as error:
        said, _, expected = str(error).rpartition(": expected ")
        field, _, value = said.rpartition(": ")
        if not field:
            field, value, expected = "cameras", str(error), "cameras that fit together"
        raise ProtocolError(CloseCode.VALUE, field, value, expected) from error


class _Ingest:
    """Reads views into buffers, offers complete frames to the engine, and reports their outcomes.

    A buffer that nobody reads any more is granted to the source. A source that shares memory is told so, and says which
    buffer it has filled. Frames that arrive in messages are written into granted buffers here. A frame may come without
    some of its views (`left_out`).
    """

    def __init__(self, service: Service, socket: WebSocket, inbox: Inbox, hello: SourceHello) -> None:
        self._service, self._live = service, service.live
        self._socket, self._inbox = socket, inbox
        self._connection, self._patience_s = connection_of(socket), max(PATIENCE_S, 2.0 / hello.fps)
        self._arrivals = Arrivals(hello.cameras, hello.fps)
        self._back_buffer = BackBuffer(list(self._arrivals.cameras))
        self._freed, self._granted_one = asyncio.Event(), asyncio.Event()
        loop, name = asyncio.get_running_loop(), f"farside-{service.session}-{inbox.client}"
        # Not a method of this object: who waits for a buffer to be given back must not keep what has it.
        self._buffers = FrameBuffers(hello.cameras, BUFFERS, name, partial(_wake, loop, self._freed))
        self._granted: dict[int, FrameBuffer] = {}
        self._arriving: FrameBuffer | None = None
        self._settled: asyncio.Queue[tuple[int, asyncio.Future[Settled]]] = asyncio.Queue()
        self._credits = asyncio.Semaphore(CREDITS)  # nothing more is read from a source that ignores its credits
        shares = hello.shares and _on_this_machine(socket)
        self.memory = SharedMemory(os.getpid(), name, tuple(self._buffers.files)) if shares else None

    def close(self) -> None:
        """Release the buffers; memory that is still in use stays until its last use ends."""
        self._buffers.close()
        self._granted.clear()
        self._arriving = None
        self._back_buffer.clear()  # the frame that will not be complete any more

    async def grant(self) -> NoReturn:
        """Give the source every buffer that is free."""
        while True:
            while (buffer := self._buffers.take()) is not None:
                number = buffer.number
                self._granted[number] = buffer
                del buffer  # a reference kept here would prevent it from ever becoming free again
                self._granted_one.set()
                if self.memory is not None:
                    await send(self._socket, BufferFree(number))
            await self._freed.wait()
            self._freed.clear()

    async def receive(self) -> NoReturn:
        """Read views and offer every frame to the engine: complete, or as it is when no more of it comes."""
        while True:
            await self._take(await self._next())

    async def _next(self) -> bytes:
        """The next message. A frame that lacks views is closed if the source sends nothing for a while: it may be
        waiting for the frame's outcome."""
        while self._back_buffer.missing:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(self._patience_s):
                    return await self._inbox.receive()
            if self._connection is None or time.monotonic() - self._connection.heard >= self._patience_s:
                await self._close_frame()
        return await self._inbox.receive()

    async def _take(self, data: bytes) -> None:
        start = time.perf_counter()
        await self._have_memory()
        message, view = await asyncio.to_thread(self._receive_view, data)
        if view is None and self._back_buffer.is_next(message.frame):
            await self._close_frame()
            await self._have_memory()
            view = await asyncio.to_thread(self._view_of, message)
        if view is None:
            return  # late: its frame went without it
        self._live.timings.add({"ingest": 1e3 * (time.perf_counter() - start)})
        try:
            frame = self._back_buffer.add(message.frame, view)
        except OrderError as error:
            raise ProtocolError(CloseCode.ORDER, error.field, error.value, error.expected) from error
        del message, view
        if frame is not None:
            await self._finish(frame)

    async def _have_memory(self) -> None:
        """Wait, where a frame begins, until its views have memory."""
        while self._arriving is None and not self._granted:
            self._granted_one.clear()
            await self._granted_one.wait()

    async def _close_frame(self) -> None:
        """Go on without the views that the frame still lacks."""
        if self._arriving is not None:
            planes = self._arriving.planes
            frame = self._back_buffer.close(lambda name: self._arrivals.left_out(name, planes))
            await self._finish(frame)

    async def _finish(self, frame: Frame) -> None:
        if self._arriving is not None:
            frame = dataclasses.replace(frame, lent=self._buffers.lent(self._arriving.number))
            self._arriving = None
            await self._credits.acquire()
            self._offer(frame)

    def _receive_view(self, data: bytes) -> tuple[ViewData, View | None]:
        """A message and its view, which is put into the frame's buffer; no view if it is late or of a later frame than
        the one that is incomplete. In a worker thread."""
        message = decode(data, ViewData)
        late = self._back_buffer.is_late(message.frame, message.camera)
        return message, None if late or self._back_buffer.is_next(message.frame) else self._view_of(message)

    def _view_of(self, message: ViewData) -> View:
        """The view in a message, in the frame's buffer; left out if anything but frame, camera or buffer is wrong."""
        self._arrivals.check(message)
        if self._arriving is None:
            self._arriving = self._granted_for(message)
        elif message.buffer not in (None, self._arriving.number):
            expected = f"{self._arriving.number} for all views of the frame"
            raise ProtocolError(CloseCode.ORDER, "buffer", message.buffer, expected)
        return self._arrivals.view(message, self._arriving.planes)

    def _granted_for(self, message: ViewData) -> FrameBuffer:
        """The buffer for a frame that begins. Meanwhile the event loop may grant more buffers, but takes none."""
        if message.buffer is None:
            return self._granted.popitem()[1]
        if self.memory is None or message.buffer not in self._granted:
            expected = "a free buffer: " + ", ".join(map(str, self._granted.copy())) if self.memory else "none"
            raise ProtocolError(CloseCode.ORDER, "buffer", message.buffer, expected)
        return self._granted.pop(message.buffer)

    def _offer(self, frame: Frame) -> None:
        if self._service.source is not self._inbox:
            raise WebSocketDisconnect  # this source has ended, and its frame need not fit the next source's cameras
        settled, index = self._live.offer(frame), frame.index
        settled.add_done_callback(lambda future: self._settled.put_nowait((index, future)))

    async def report(self) -> NoReturn:
        """Tell the source the outcome of each of its frames."""
        while True:
            index, settled = await self._settled.get()
            error = None if settled.cancelled() else settled.exception()
            if isinstance(error, CoreLostError):
                raise error
            if settled.cancelled() or error is not None:
                said = str(error or "cancelled")
                raise ProtocolError(CloseCode.VALUE, f"frame {index}", said, "a frame that fits the engine")
            outcome = settled.result()
            left_out = {camera: str(fault)[:200] for camera, fault in outcome.left_out.items()}
            await send(self._socket, FrameDone(index, "updated" if outcome else "dropped", left_out))
            self._credits.release()


def _wake(loop: asyncio.AbstractEventLoop, event: asyncio.Event) -> None:
    loop.call_soon_threadsafe(event.set)


def _on_this_machine(socket: WebSocket) -> bool:
    """Whether the peer's address is a loopback address; one of IPv4 may come through a socket of both families."""
    try:
        address = ipaddress.ip_address(socket.client.host if socket.client else "")
    except ValueError:
        return False
    mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return (mapped or address).is_loopback
