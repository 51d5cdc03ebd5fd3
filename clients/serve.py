"""`farside serve`: run the live server."""

from __future__ import annotations

import contextlib
import socket
from typing import Annotated, Any

import typer
import uvicorn
from farside.server.app import make_server
from farside.server.settings import ServerSettings
from pydantic import ValidationError

from .ending import set_patience

__all__ = ["command", "listen", "server_settings", "stop_within", "url_of"]


def server_settings(**given: Any) -> ServerSettings:
    """Settings from the arguments that are not None, then from the environment; a ValueError names the wrong field."""
    try:
        return ServerSettings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(map(str, first["loc"]))
        raise ValueError(f"{name}: {first['input']!r}: expected another value: {first['msg']}") from error


def listen(settings: ServerSettings) -> socket.socket:
    """The listening socket; raises OSError if the port is taken."""
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        return socket.create_server((settings.host, settings.port), family=family)
    except OSError as error:
        reason = error.strerror or error
        raise OSError(f"port: {settings.port} on {settings.host}: expected a free one ({reason})") from error


def url_of(listening: socket.socket, token: str = "") -> str:
    """The server's address for a browser on this machine."""
    host, port = listening.getsockname()[:2]
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    host = f"[{host}]" if ":" in host else host
    return f"http://{host}:{port}/" + (f"?token={token}" if token else "")


def command(
    host: Annotated[str | None, typer.Option(help="Address to listen on (default 127.0.0.1).")] = None,
    port: Annotated[int | None, typer.Option(help="Port (default 8765; 0: any free one).")] = None,
    token: Annotated[str | None, typer.Option(help="Token that clients must send (default: none).")] = None,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Another name of this server, as a proxy passes it on; * for any name."),
    ] = None,
    allow_origin: Annotated[
        list[str] | None,
        typer.Option(metavar="URL", help="Pages of this origin may connect, too (https://example.org); * for all."),
    ] = None,
    quality: Annotated[str | None, typer.Option(help="fast, balanced, best, or paper (as published).")] = None,
    views: Annotated[int | None, typer.Option(help="Views warped for each picture (n_render).")] = None,
    init: Annotated[int | None, typer.Option(help="Views that build the S-PBS (n_init).")] = None,
    update: Annotated[
        int | None, typer.Option(help="Views that update the P-PBS in each frame (n_update).")
    ] = None,
    update_interval: Annotated[
        int | None, typer.Option(metavar="N", help="The model takes every N-th frame (default 1: all).")
    ] = None,
    output_scale: Annotated[
        float | None,
        typer.Option(help="Factor on the width and height that viewers ask for; they enlarge the pictures."),
    ] = None,
    jpeg_quality: Annotated[int | None, typer.Option(help="1 to 100.")] = None,
    background: Annotated[bool | None, typer.Option(help="Build and render the background model.")] = None,
    viewing_space: Annotated[
        tuple[float, float, float, float] | None,
        typer.Option(
            metavar="X Y Z R",
            help="Ball in which heads stay, metres: background that cannot be seen from it is not kept.",
        ),
    ] = None,
    target_fps: Annotated[
        float | None,
        typer.Option(help="Stereo pairs a second to hold: quality follows the load, --quality is the upper limit."),
    ] = None,
    longest_update_s: Annotated[
        float | None,
        typer.Option(help="Longest time that an update of the background gives way to pictures, s (default 5)."),
    ] = None,
    max_viewers: Annotated[int | None, typer.Option(help="Most viewers at a time (default 8).")] = None,
    log_level: Annotated[
        str | None, typer.Option(help="critical, error, warning (default), info or debug.")
    ] = None,
) -> None:
    """Run the live server. Every option can also be set in the environment, as FARSIDE_PORT and so on."""
    settings = server_settings(
        host=host, port=port, token=token, allowed_hosts=_joined(allow_host), allowed_origins=_joined(allow_origin),
        quality=quality, views=views, init=init, update=update,
        update_interval=update_interval, output_scale=output_scale, jpeg_quality=jpeg_quality, background=background,
        viewing_space=viewing_space, target_fps=target_fps, longest_update_s=longest_update_s,
        max_viewers=max_viewers, log_level=log_level,
    )  # fmt: skip
    stop_within(settings)
    with listen(settings) as listening:
        print(f"serving at {url_of(listening, settings.token)} (Ctrl-C stops)", flush=True)
        run(make_server(settings), listening)


def _joined(names: list[str] | None) -> str | None:
    return ",".join(names) if names else None


def stop_within(settings: ServerSettings) -> None:
    """Give the server the time after a signal that its settings allow, and a moment more."""
    set_patience(settings.shutdown_timeout_s + 0.4)


def run(server: uvicorn.Server, listening: socket.socket) -> None:
    """Serve until Ctrl-C."""
    with contextlib.suppress(KeyboardInterrupt):
        server.run(sockets=[listening])
