"""Sources: views in, word of every frame's fate out."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from typing import NoReturn

from farside.engine.back_buffer import BackBuffer, OrderError
from farside.engine.camera import Camera
from farside.engine.frame import Frame, View
from farside.engine.live import Source
from starlette.websockets import WebSocket

from .pictures import decode_view
from .protocol import CloseCode, FrameDone, ProtocolError, SourceHello, ViewData, decode
from .service import CREDITS, Service, conversation, race, receive, send

__all__ = ["serve_source"]


async def serve_source(socket: WebSocket, service: Service) -> None:
    """One source's connection, from hello to close. It may leave and come back; one at a time."""
    async with conversation(socket):
        client, hello = await service.greet(socket, SourceHello)
        if service.source_client is not None:
            raise ProtocolError(CloseCode.BUSY, "source", service.source_client, "no other source at a time")
        service.source_client = client
        try:
            await _open(service, hello)
            await service.welcome(socket, client)
            ingest = _Ingest(service, socket, hello.cameras)
            await race(ingest.receive(), ingest.report())
        finally:
            service.source_client = None


async def _open(service: Service, hello: SourceHello) -> None:
    try:
        await service.live.open(Source(hello.name, hello.fps, hello.cameras))
    except ValueError as error:
        raise ProtocolError(CloseCode.VALUE, "cameras", str(error), "cameras that fit together") from error


class _Ingest:
    """Reads views, offers complete frames, reports what became of them."""

    def __init__(self, service: Service, socket: WebSocket, cameras: tuple[Camera, ...]) -> None:
        self._live, self._socket = service.live, socket
        self._cameras = {camera.name: camera for camera in cameras}
        self._back_buffer = BackBuffer(list(self._cameras))
        self._settled: asyncio.Queue[tuple[int, asyncio.Future[bool]]] = asyncio.Queue()
        self._credits = asyncio.Semaphore(CREDITS)  # a source that ignores its credits is read no further

    async def receive(self) -> NoReturn:
        while True:
            data = await receive(self._socket)
            start = time.perf_counter()
            index, view = await asyncio.to_thread(_decode, data, self._cameras)
            self._live.timings.add({"ingest": 1e3 * (time.perf_counter() - start)})
            try:
                frame = self._back_buffer.add(index, view)
            except OrderError as error:
                raise ProtocolError(CloseCode.ORDER, error.field, error.value, error.expected) from error
            if frame is not None:
                await self._credits.acquire()
                self._offer(frame)

    def _offer(self, frame: Frame) -> None:
        settled = self._live.offer(frame)
        settled.add_done_callback(lambda future: self._settled.put_nowait((frame.index, future)))

    async def report(self) -> NoReturn:
        while True:
            index, settled = await self._settled.get()
            if settled.cancelled() or settled.exception() is not None:
                error = "cancelled" if settled.cancelled() else str(settled.exception())
                raise ProtocolError(CloseCode.VALUE, f"frame {index}", error, "a frame that fits the engine")
            await send(self._socket, FrameDone(index, "updated" if settled.result() else "dropped"))
            self._credits.release()


def _decode(data: bytes, cameras: Mapping[str, Camera]) -> tuple[int, View]:
    message = decode(data, ViewData)
    return message.frame, decode_view(message, cameras)
