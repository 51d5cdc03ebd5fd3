"""The measures as sub-commands of `farside bench`, and as the flags that they had before: `--trade` for `trade`."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

__all__ = ["MEASURES", "BenchGroup", "command_group", "old_calls"]


class Measure(NamedTuple):
    """What `farside bench NAME` measures; `named`: whether its old flag took what to measure it on."""

    help: str
    named: bool = True


# Each is the function `command` of farside.clients.bench.<name>.
MEASURES = {
    "paper": Measure("What the defaults gain over the published algorithm, on twins.", named=False),
    "accuracy": Measure("All quality figures over sequences and twins, with a report.", named=False),
    "trade": Measure("Every knob's cost and worth over sequences and twins, with a report.", named=False),
    "tolerances": Measure("Automatic tolerances next to smaller and larger ones, over twins.", named=False),
    "extremes": Measure("Errors against oracles at the extremes of every number; 1 if any fails.", named=False),
    "stages": Measure("Time and work of every stage, on a sequence or a twin."),
    "targets": Measure("Speed and loss next to what is wanted, on a twin."),
    "scaling": Measure("Cost of a pair over pixels out and pixels in, on a twin."),
    "pairs": Measure("Stereo pairs a second of a twin while the model is updated."),
    "live": Measure("Server, replay and headset over localhost: rates, stalls, pauses, memory."),
    "spared": Measure("Work and memory that twins do not need, and are spared."),
    "peers": Measure("Sequences whose README has the figures of other renderers."),
    "model": Measure("Few views with the model against few and all without it, by truth."),
    "ghosts": Measure("Ghosts and holes of the background model over a twin."),
    "noise": Measure("Every frame of a twin with and without the model, and the model's error."),
    "backdrop": Measure("The backdrop's surfaces, farthest or standing, over a twin."),
    "fill": Measure("Kinds of filling against the truth, inside holes only."),
    "flicker": Measure("Change from frame to frame, for a still head, of what is still in truth."),
    "sparse": Measure("Depth punched as by time of flight: completed, not, and whole, by truth."),
    "exposure": Measure("A twin whose views have random exposures and white balances."),
    "minified": Measure("A twin in pictures coarser than its views, prefiltered or not."),
    "all": Measure("Every table and plot that the documents show, kept in a folder and resumed.", named=False),
}
_SWITCHES = ("--background", "--no-background", "--help")  # all other options take a value


class BenchGroup(TyperGroup):
    """Lists the measures from MEASURES and imports the one that is asked for; understands the old flags."""

    def list_commands(self, ctx: Any) -> list[str]:
        """The measures' names."""
        return list(MEASURES)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A stand-in with its help, which needs no module."""
        return TyperCommand(cmd_name, help=MEASURES[cmd_name].help) if cmd_name in MEASURES else None

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """The command that runs."""
        name, command, rest = super().resolve_command(ctx, args)
        return name, command and load(str(name)), rest

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """Takes the old flags apart; raises ValueError where nothing is asked for."""
        calls = old_calls(args)
        if not calls and not args:
            raise ValueError(f"bench: nothing to measure: expected one of {', '.join(MEASURES)}")
        ctx.meta[__name__] = calls
        return super().parse_args(ctx, [calls[0][0]] if calls else args)

    def invoke(self, ctx: Any) -> Any:
        """Runs the sub-command, or those that the old flags stand for, one after the other."""
        calls = ctx.meta[__name__]
        if not calls:
            return super().invoke(ctx)
        for name, rest in calls:
            command = load(name)
            with command.make_context(name, rest, parent=ctx) as child:
                command.invoke(child)
        return None


def command_group() -> BenchGroup:
    """The group, as the command line wants it."""
    return BenchGroup(name="bench", help="Measure speed and quality: a sub-command each.", no_args_is_help=False)


def load(name: str) -> Any:
    """A measure's command; its module is imported only now."""
    function = importlib.import_module(f"{__package__}.{name}").command
    single = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    single.command(name, help=function.__doc__ or MEASURES[name].help)(function)
    return typer.main.get_command(single)


def old_calls(args: Sequence[str]) -> list[tuple[str, list[str]]]:
    """Arguments with measures as flags -> the sub-commands that they stand for, each with its own arguments.

    Empty where there is no such flag. As it was, options are for those measures that know them; one that no measure
    knows is left to all, who refuse it.
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
    """Whether any measure has the option: their modules are imported until one has."""
    return any(flag in _options(name) for name in MEASURES)


def _options(name: str) -> set[str]:
    parameters = load(name).params
    return {"--help", *(option for p in parameters for option in (*p.opts, *p.secondary_opts))}
