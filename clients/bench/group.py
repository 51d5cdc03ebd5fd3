"""The measures as sub-commands of `farside bench`, and as the earlier flags: `--trade` stands for `trade`."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

__all__ = ["MEASURES", "BenchGroup", "command_group", "old_calls"]


class Measure(NamedTuple):
    """The help of `farside bench NAME`; `named`: whether its earlier flag took a value, the sequence or twin."""

    help: str
    named: bool = True


# Each is the function `command` of farside.clients.bench.<name>.
MEASURES = {
    "paper": Measure("Gain of the defaults over the published algorithm; its experiments repeated.", named=False),
    "accuracy": Measure("All quality figures over sequences and twins, with a report.", named=False),
    "trade": Measure("Cost and benefit of every setting over sequences and twins, with a report.", named=False),
    "tolerances": Measure("Automatic tolerances next to smaller and larger ones, on twins.", named=False),
    "extremes": Measure("Errors against oracles at the extremes of every number; exit code 1 on failure.", named=False),
    "compile": Measure("CPU time of compiling, by kernel, from nothing.", named=False),
    "startup": Measure("From nothing to the demo's first picture in a browser.", named=False),
    "stages": Measure("Time and work of every stage, on a sequence or a twin."),
    "against": Measure("Time of every stage next to that of another commit, measured in turns."),
    "targets": Measure("Speed and loss of quality next to their targets, on a twin."),
    "scaling": Measure("Cost of a stereo pair by pixels of pictures and of views, on a twin."),
    "pairs": Measure("Stereo pairs a second while the model is updated, on a twin."),
    "queries": Measure("Rays, closest points and spheres a second against the model, in the library and by HTTP."),
    "saving": Measure("Pictures and updates while the model is copied and written to a file, on a twin."),
    "live": Measure("Server, replay and headset over localhost: rates, stalls, pauses, memory."),
    "spared": Measure("Work and memory that scenes do not need and that is saved, on twins."),
    "peers": Measure("Quality next to other renderers' figures from a folder's README."),
    "model": Measure("Few views with the model against few and all views without it, by ground truth."),
    "ghosts": Measure("Ghosts and holes of the background model, on a twin."),
    "layers": Measure("Stale foreground and middle layers of the model, on a twin."),
    "noise": Measure("Every frame of a twin with and without the model, and the model's error."),
    "moving": Measure("What cameras that move add to the background model, on twins and walks."),
    "backdrop": Measure("The backdrop's surface, farthest or standing, on a twin."),
    "fill": Measure("Kinds of filling against the truth, inside holes only."),
    "flicker": Measure("Change of a still head's pictures where the truth does not change."),
    "sparse": Measure("Depth with a sensor's holes: whole, with holes, and completed, by ground truth."),
    "exposure": Measure("A twin whose views have random exposures and white balances."),
    "light": Measure("A twin whose lamps change, with and without following of the light in the background model."),
    "minified": Measure("Pictures coarser than the views, prefiltered or not, on a twin."),
    "all": Measure("Every table and plot of the document of results, kept in a folder, resumable.", named=False),
}
_SWITCHES = ("--background", "--no-background", "--help")  # all other options take a value


class BenchGroup(TyperGroup):
    """Lists the measures from MEASURES and imports only the one that is called; also understands the earlier flags."""

    def list_commands(self, ctx: Any) -> list[str]:
        """The measures' names."""
        return list(MEASURES)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A placeholder with the measure's help, for which no module is imported."""
        return TyperCommand(cmd_name, help=MEASURES[cmd_name].help) if cmd_name in MEASURES else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that runs."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, command and load(str(name)), rest

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """Parse the earlier flags, if there are any; raises ValueError if no measure is named."""
        calls = old_calls(args)
        if not calls and not args:
            raise ValueError(f"bench: nothing to measure: expected one of {', '.join(MEASURES)}")
        ctx.meta[__name__] = calls
        return super().parse_args(ctx, [calls[0][0]] if calls else args)

    def invoke(self, ctx: Any) -> Any:
        """Run the sub-command, or one after the other those that the earlier flags stand for."""
        calls = ctx.meta[__name__]
        if not calls:
            return super().invoke(ctx)
        for name, rest in calls:
            command = load(name)
            with command.make_context(name, rest, parent=ctx) as child:
                command.invoke(child)
        return None


def command_group() -> BenchGroup:
    """The group of all measures for the command line."""
    return BenchGroup(
        name="bench", help="Measure speed and quality: one sub-command for each measure.", no_args_is_help=False
    )


def load(name: str) -> Any:
    """A measure's command; its module is imported only now."""
    function = importlib.import_module(f"{__package__}.{name}").command
    single = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    single.command(name, help=function.__doc__ or MEASURES[name].help)(function)
    return typer.main.get_command(single)


def old_calls(args: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Translate arguments with measures as flags into the sub-commands that they stand for, with their arguments.

    Returns an empty list if there is no such flag. As before, an option goes to those measures that have it. An option
    that no measure has goes to all of them, so that they refuse it.
    """
    flags = {f"--{name}": name for name in MEASURES}
    chosen: list[tuple[str, list[str]]] = []
    folders, options = list[str](), list[tuple[str, list[str]]]()
    rest = iter(args)
    for arg in rest:
        flag, equals, value = arg.partition("=")
        name = flags.get(flag)
        if not arg.startswith("--"):
            folders.append(arg)
        elif name is None:
            takes = flag not in _SWITCHES and not equals
            options.append((flag, [arg, *([next(rest, "")] if takes else [])]))
        elif MEASURES[name].named:
            chosen.append((name, [value if equals else next(rest, "")]))
        else:
            chosen.append((name, []))
    if not chosen or (folders and folders[0] in MEASURES):
        return []
    return [
        (name, [*own, *([] if MEASURES[name].named else folders), *_wanted(options, _options(name))])
        for name, own in chosen
    ]


def _wanted(options: Sequence[tuple[str, list[str]]], own: set[str]) -> list[str]:
    return [text for flag, texts in options if flag in own or not _is_known(flag) for text in texts]


def _is_known(flag: str) -> bool:
    """Whether any measure has the option `flag`; imports the measures' modules until one has."""
    return any(flag in _options(name) for name in MEASURES)


def _options(name: str) -> set[str]:
    parameters = load(name).params
    return {"--help", *(option for p in parameters for option in (*p.opts, *p.secondary_opts))}
