"""`farside serve`: run the live server."""

from __future__ import annotations

import contextlib
import os
import socket
import sys
from collections.abc import Sequence
from typing import Annotated, Any

import typer
import uvicorn
from farside.server.app import make_server
from farside.server.environment import read_variables
from farside.server.settings import ServerSettings
from pydantic import ValidationError

from .ending import set_patience
from .listening import addresses_of, listen
from .model_options import CullStale, LateRounds, Light, MiddleLayers, ViewingSpace

__all__ = ["command", "server_settings", "stop_within", "tell_variables"]

_OPTIONS = {"allowed_hosts": "--allow-host", "allowed_origins": "--allow-origin"}  # others are named after the field


def server_settings(**given: Any) -> ServerSettings:
    """Checked settings from the arguments that are not None, then from the environment.

    Raises ValueError for the first wrong value, with the option or variable that it comes from and what is expected.
    """
    fields = ServerSettings.model_fields
    variables = read_variables(os.environ, fields)
    arguments = {field: value for field, value in given.items() if value is not None}
    options = {field: _OPTIONS.get(field, "--" + field.replace("_", "-")) for field in fields}
    names = options | variables.names | {field: options[field] for field in arguments}
    values: dict[str, Any] = {**variables.values, **arguments}
    try:
        settings = ServerSettings(**values)
    except ValidationError as error:
        field = str(error.errors()[0]["loc"][0])
        raise ValueError(f"{names[field]}: {values[field]!r}: expected {fields[field].description}") from error
    settings.call(names)
    try:
        settings.check()
    except ValueError as error:
        field, _, rest = str(error).partition(":")
        raise ValueError(f"{settings.name_of(field)}:{rest}") from error
    return settings


def tell_variables() -> None:
    """Say on stderr which variables FARSIDE_* are ignored, and why."""
    for remark in read_variables(os.environ, ServerSettings.model_fields).remarks():
        print(f"farside: {remark}", file=sys.stderr)


def command(
    host: Annotated[
        str | None,
        typer.Option(
            help="Address or name to listen on (default 127.0.0.1; 0.0.0.0 or :: for all), or several with commas."
        ),
    ] = None,
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
    root_path: Annotated[
        str | None,
        typer.Option(metavar="PATH", help="Path under which a proxy shows the server, if it keeps it (/farside)."),
    ] = None,
    ssl_certfile: Annotated[
        str | None, typer.Option(metavar="FILE", help="Serve by TLS, with the certificate in this PEM file.")
    ] = None,
    ssl_keyfile: Annotated[
        str | None, typer.Option(metavar="FILE", help="PEM file with its key (default: in the same file).")
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
    draw_moving: Annotated[
        bool | None, typer.Option(help="Draw the views of moving cameras, too; else they only update the model.")
    ] = None,
    viewing_space: ViewingSpace = None,
    light: Light = None,
    cull_stale: CullStale = None,
    middle_layers: MiddleLayers = None,
    late_rounds: LateRounds = None,
    model: Annotated[
        str | None,
        typer.Option(
            metavar="FILE", help="Save the background model to this file every so often and at the end; continue it."
        ),
    ] = None,
    save_interval_s: Annotated[
        float | None, typer.Option(help="Time between two savings of the model, s (default 60).")
    ] = None,
    seed_model: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="An earlier model of the room that a new one begins with: GLB, or saved."),
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
    tell_variables()
    settings = server_settings(
        host=host, port=port, token=token, root_path=root_path, allowed_hosts=_joined(allow_host),
        allowed_origins=_joined(allow_origin), ssl_certfile=ssl_certfile, ssl_keyfile=ssl_keyfile,
        quality=quality, views=views, init=init, update=update,
        update_interval=update_interval, output_scale=output_scale, jpeg_quality=jpeg_quality, background=background,
        draw_moving=draw_moving, viewing_space=viewing_space, light=light, cull_stale=cull_stale,
        middle_layers=middle_layers, late_rounds=late_rounds, model=model, save_interval_s=save_interval_s,
        seed_model=seed_model, target_fps=target_fps, longest_update_s=longest_update_s,
        max_viewers=max_viewers, log_level=log_level,
    )  # fmt: skip
    stop_within(settings)
    with listen(settings) as listening:
        addresses = " and ".join(addresses_of(listening, settings, settings.token))
        print(f"serving at {addresses} (Ctrl-C stops)", flush=True)
        run(make_server(settings), listening)


def _joined(names: list[str] | None) -> str | None:
    return ",".join(names) if names else None


def stop_within(settings: ServerSettings) -> None:
    """Give the server the time after a signal that its settings allow, and a moment more."""
    set_patience(settings.ending_s + 1.0)


def run(server: uvicorn.Server, listening: Sequence[socket.socket]) -> None:
    """Serve until Ctrl-C."""
    with contextlib.suppress(KeyboardInterrupt):
        server.run(sockets=list(listening))
