"""The command line: `farside NAME ...`. A command's module is imported only when that command runs."""

from __future__ import annotations

import importlib
import io
import os
import sys
from importlib.metadata import version
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperCommand, TyperGroup

from .ending import end_soon

__all__ = ["COMMANDS", "app", "main"]

# Each command is the function `command` of farside.clients.<name>.
COMMANDS = {
    "demo": "Show everything at once: a twin sequence, the server, a replay and the viewer's address.",
    "synth": "Make a twin of one of the known sequences, with ground truth.",
    "info": "List what a sequence holds and what is wrong with it.",
    "render": "Render virtual cameras or a head-pose trace from a sequence.",
    "compare": "Compare two raw videos: PSNR, WS-PSNR, IV-PSNR, SSIM, MS-SSIM, IV-SSIM.",
    "bench": "Measure speed and quality.",
    "serve": "Run the live server.",
    "replay": "Send a sequence to a live server, as a camera rig would.",
    "headset": "Send head poses to a live server and receive stereo pictures.",
    "export": "Write the background model as a mesh.",
    "warm": "Compile the kernels now, on all cores, so that later starts take seconds.",
}


class _LazyGroup(TyperGroup):
    """Lists the commands from COMMANDS and imports only the one that is called."""

    def list_commands(self, ctx: Any) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        return TyperCommand(cmd_name, help=COMMANDS[cmd_name]) if cmd_name in COMMANDS else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        name, command, rest = super().resolve_command(ctx, args)
        return name, command and _load(str(name)), rest


def _load(name: str) -> Any:
    module = importlib.import_module(f"farside.clients.{name}")
    if name == "bench":
        return module.command_group()
    function = module.command
    single = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    single.command(name, help=function.__doc__ or COMMANDS[name])(function)
    return typer.main.get_command(single)


app = typer.Typer(
    cls=_LazyGroup, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)


def _tell_version(wanted: bool) -> None:
    if wanted:
        print(f"farside {version('farside')}")
        raise typer.Exit


@app.callback()
def _farside(
    version: Annotated[
        bool, typer.Option("--version", callback=_tell_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """Farside: live stereo rendering of immersive video with a progressive 3D background model."""


def _check_threads() -> None:
    """Raises ValueError for a number of threads that Numba would refuse without its name."""
    wanted = os.environ.get("NUMBA_NUM_THREADS")
    if wanted is not None and not (wanted.isdecimal() and int(wanted) > 0):
        raise ValueError(f"NUMBA_NUM_THREADS: {wanted!r}: expected a whole number above 0, or that it is not set")


def main() -> NoReturn:
    """Run the command line; bad input (ValueError, OSError) becomes one line on stderr and exit code 2."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="surrogateescape")  # names of files that are no text are printed as they are
    try:
        end_soon()
        _check_threads()
        app()
    except KeyboardInterrupt:
        sys.exit(130)
    except (ValueError, OSError) as error:
        print(f"farside: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2)
    sys.exit(0)


if __name__ == "__main__":
    main()
