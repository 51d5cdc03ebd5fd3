"""The FastAPI application with the routes of one service, and the server that runs it."""

from __future__ import annotations

import asyncio
import contextlib
import math
import os
import signal
import socket
import threading
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import asynccontextmanager, contextmanager
from importlib.resources import files
from pathlib import Path
from types import FrameType
from typing import Any

import uvicorn
from farside.engine.compiling.pool import Compiling
from farside.engine.live.core import Core, CoreLostError, Source, make_local_core
from farside.engine.live.core_process import ProcessCore, kill_all
from farside.engine.live.engine import Live
from farside.engine.live.interpreter import responsive
from farside.engine.live.update_priority import Patience
from fastapi import Depends, FastAPI, HTTPException, Request, Response, WebSocket
from fastapi.middleware.cors import CORSMiddleware
from fastapi.responses import FileResponse
from fastapi.staticfiles import StaticFiles

from .connection import Connection
from .effects import effect_router
from .export import MEDIA_TYPES, export_mesh, export_metrics
from .ingest import serve_source
from .origins import OriginCheck
from .poses import serve_viewer
from .protocol import MAX_CONTROL_BYTES
from .queries import answer_query
from .root_path import RootPath
from .service import Service
from .settings import ServerSettings

__all__ = ["create_app", "make_server"]

PAGE = Path(str(files("farside.server"))) / "page"
READ = ["GET", "HEAD"]  # health checks ask by HEAD
_FIRST_PICTURE_S = 4.0  # in which an engine on two cores starts and shows its first picture, if it has them alone
METHODS, HEADERS = [*READ, "POST", "PUT", "DELETE"], ["authorization", "content-type"]  # of pages of other origins


def create_app(
    settings: ServerSettings, make_core: Callable[[Source], Core] | None = None, compiling: Compiling | None = None,
    preparing: Callable[[], str] = str,
) -> FastAPI:  # fmt: skip
    """The application; `make_core` replaces the maker of the engine's process, which is called for each new rig.

    `compiling` replaces the kernels that are compiled at the start: those that the settings need. preparing: tells, for
    people, what a source's first frame is waiting for; "": nothing is known of it.
    """
    if compiling is None and make_core is None:
        compiling = Compiling(settings.needed)

    @asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        maker, workers = make_core or _engine_maker(settings, compiling), settings.render_workers
        patience = Patience(settings.longest_update_s)
        live = Live(maker, render_workers=workers, governor=settings.governor(), patience=patience)
        async with live, responsive(lambda: live.frames["updated"]):
            app.state.service = Service(live, settings, compiling, preparing)
            async with _going_on(compiling):
                yield

    app = FastAPI(
        title="Farside", lifespan=lifespan, docs_url=None, redoc_url=None, openapi_url=None, redirect_slashes=False
    )
    _add_middleware(app, settings)
    app.mount("/page", StaticFiles(directory=PAGE))
    _add_http(app)
    _add_effects(app)
    _add_sockets(app)
    return app


def _add_middleware(app: FastAPI, settings: ServerSettings) -> None:
    """What a request passes before it comes to a route; the last one that is added comes first."""
    origins = settings.origins
    app.add_middleware(RootPath, root=settings.root_path)
    if origins:  # their pages may also read what HTTP answers
        app.add_middleware(CORSMiddleware, allow_origins=origins, allow_methods=METHODS, allow_headers=HEADERS)
    app.add_middleware(OriginCheck, hosts=settings.names, origins=origins, token=bool(settings.token))


def _engine_maker(settings: ServerSettings, compiling: Compiling | None) -> Callable[[Source], Core]:
    def make(source: Source) -> Core:
        """An engine, when the kernels for the first picture are there: two processes would compile them twice.

        The others wait while the engine starts, and the background model waits for them. Raises ValueError for a source
        with another rig than that of the model that is kept.
        """
        if compiling is None:
            return ProcessCore(make_local_core, source.cameras, settings.engine(), True, settings.files)
        compiling.wait(settings.needed[:1])
        whole = compiling.wait(settings.needed_for_model, timeout=None if continues() else 0.0)
        compiling.rest(_FIRST_PICTURE_S)
        core = ProcessCore(make_local_core, source.cameras, settings.engine(), whole, settings.files)
        if not whole:
            threading.Thread(target=begin_model, args=(core,), daemon=True).start()
        return core

    def continues() -> bool:
        """Whether the model is a saved one, which the first picture needs all kernels for."""
        return bool(settings.model) and Path(settings.model).exists()

    def begin_model(core: Core) -> None:
        assert compiling is not None
        compiling.wait(settings.needed_for_model)
        with contextlib.suppress(CoreLostError):
            core.begin_model()

    return make


@asynccontextmanager
async def _going_on(compiling: Compiling | None) -> AsyncIterator[None]:
    """Kernels are compiled while the block runs."""
    if compiling is None:
        yield
        return
    await asyncio.to_thread(compiling.start)
    try:
        yield
    finally:
        await asyncio.to_thread(compiling.stop)


def _add_http(app: FastAPI) -> None:
    @app.api_route("/", methods=READ)
    def page() -> FileResponse:
        return FileResponse(PAGE / "index.html")

    @app.api_route("/status", methods=READ)
    async def status(seconds: float = math.inf) -> dict[str, Any]:
        return _service(app).status(seconds)

    @app.api_route("/metrics", methods=READ)
    async def metrics() -> Response:
        return Response(export_metrics(_service(app)), media_type="text/plain; version=0.0.4")

    @app.api_route("/mesh.{format_name}", methods=READ)
    async def mesh(format_name: str, request: Request) -> Response:
        _check_token(app, request)
        if format_name not in MEDIA_TYPES:
            raise HTTPException(404, f"format: {format_name}: expected glb or ply")
        return await export_mesh(_service(app), format_name, request.query_params.get("colours"))

    @app.post("/query")
    async def query(request: Request) -> Response:
        _check_token(app, request)
        return await answer_query(_service(app), request)


def _check_token(app: FastAPI, request: Request) -> None:
    if not _service(app).authorised(token := _token(request)):
        raise HTTPException(401, f"token: {'another' if token else 'none'}: expected the server's token")


def _add_effects(app: FastAPI) -> None:
    def allowed(request: Request) -> None:
        _check_token(app, request)

    app.include_router(effect_router(lambda: _service(app)), dependencies=[Depends(allowed)])


def _token(request: Request) -> str:
    """The token in a request's header, or in its address; clients write text in headers as UTF-8."""
    given = request.headers.get("authorization", "").removeprefix("Bearer ").encode("latin-1")
    return given.decode(errors="replace") or request.query_params.get("token", "")


def _add_sockets(app: FastAPI) -> None:
    @app.websocket("/viewer")
    async def viewer(socket: WebSocket) -> None:
        await serve_viewer(socket, _service(app))

    @app.websocket("/source")
    async def source(socket: WebSocket) -> None:
        await serve_source(socket, _service(app))

    @app.api_route("/viewer", methods=READ)
    @app.api_route("/source", methods=READ)
    async def no_socket() -> Response:
        text = "upgrade: none: expected a WebSocket; a proxy in between must pass on Upgrade and Connection"
        return Response(text, 426, {"Upgrade": "websocket"}, "text/plain")


def _service(app: FastAPI) -> Service:
    service: Service = app.state.service
    return service


def make_server(
    settings: ServerSettings, make_core: Callable[[Source], Core] | None = None, compiling: Compiling | None = None,
    preparing: Callable[[], str] = str,
) -> uvicorn.Server:  # fmt: skip
    """A server ready to run; other arguments as in `create_app`."""
    config = uvicorn.Config(
        create_app(settings, make_core, compiling, preparing),
        host=settings.host,
        port=settings.port,
        log_level=settings.log_level,
        workers=1,  # else WEB_CONCURRENCY, which platforms set for other servers
        ssl_certfile=settings.ssl_certfile or None,
        ssl_keyfile=settings.ssl_keyfile or None,
        ws=Connection,
        ws_max_size=MAX_CONTROL_BYTES,  # until a client has been greeted
        ws_per_message_deflate=False,  # pictures are compressed already and depth is large: it would only cost time
        ws_ping_timeout=120.0,  # at the first frame kernels may have to be compiled
    )
    return _Server(config, settings.shutdown_timeout_s, settings.ending_s)


class _Server(uvicorn.Server):
    """uvicorn's server, whose end does not wait for connections or an engine for more than some seconds in all."""

    def __init__(self, config: uvicorn.Config, shutdown_timeout_s: float, ending_s: float) -> None:
        super().__init__(config)
        self._ending_s = ending_s
        config.timeout_graceful_shutdown = math.ceil(shutdown_timeout_s)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End in order; when the time is over, connections are cut and the engine's process is killed."""
        killing = asyncio.get_running_loop().call_later(self._ending_s, self._end_all)
        try:
            await super().shutdown(sockets)
        finally:
            killing.cancel()

    def _end_all(self) -> None:
        for connection in list(self.server_state.connections):
            if connection.transport is not None:
                connection.transport.abort()
        kill_all()

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """uvicorn's signals, and that of a terminal that is closed, unless it is ignored."""
        with super().capture_signals():
            main = threading.current_thread() is threading.main_thread()
            before = signal.getsignal(signal.SIGHUP) if main else signal.SIG_IGN
            if before is not signal.SIG_IGN:
                signal.signal(signal.SIGHUP, self.handle_exit)
            try:
                yield
            finally:
                if before is not signal.SIG_IGN:
                    signal.signal(signal.SIGHUP, before)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """The first signal ends the server in order, the second one at once."""
        if self.should_exit:
            kill_all()
            signal.signal(sig, signal.SIG_DFL)
            os.kill(os.getpid(), sig)
        self.should_exit = True  # uvicorn would raise the signal again at the end, for a handler that it did not expect
