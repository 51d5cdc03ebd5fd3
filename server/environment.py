"""Environment variables FARSIDE_*: which of them are settings, and which only look like it.

Kubernetes gives every container variables that are named after the services around it, and so do Docker's links: a
service called `farside` makes FARSIDE_PORT=tcp://10.0.0.1:8765, FARSIDE_SERVICE_HOST and others.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

__all__ = ["PREFIX", "Variables", "read_variables"]

PREFIX = "FARSIDE_"
# The options' own names for fields that are called otherwise.
_ALIASES = {"ALLOW_HOST": "allowed_hosts", "ALLOW_ORIGIN": "allowed_origins"}
_OF_CLIENTS = ("CA_FILE",)  # options of other commands than `serve`
_SERVICE = re.compile(r"(\w+_)?(SERVICE_HOST|SERVICE_PORT(_\w+)?|PORT_\d+_(TCP|UDP|SCTP)(_\w+)?|ENV_\w+)", re.ASCII)
_ADDRESS = re.compile(r"(tcp|udp|sctp)://", re.ASCII)


@dataclass(frozen=True, slots=True)
class Variables:
    """What the environment holds: text for fields, the variables that it is from, and variables that are ignored."""

    values: dict[str, str]
    names: dict[str, str]  # of the variable, by field
    of_services: tuple[str, ...]  # made by an orchestrator
    unknown: dict[str, str]  # variable -> the nearest known one

    def remarks(self) -> Iterator[str]:
        """What a user should know about the ignored ones, in lines."""
        if self.of_services:
            which = ", ".join(self.of_services)
            yield f"{which}: ignored: an orchestrator made them for a service of this name"
        for name, nearest in self.unknown.items():
            yield f"{name}: ignored: expected the name of a setting, like {nearest}"


def read_variables(environment: Mapping[str, str], fields: Collection[str]) -> Variables:
    """Sort out the variables FARSIDE_* (in any case) for the given fields; an empty variable is not set."""
    known = {**{field.upper(): field for field in fields}, **_ALIASES}
    values: dict[str, str] = {}
    names: dict[str, str] = {}
    of_services, unknown = [], {}
    for name in sorted(environment, key=lambda name: (name.isupper(), name)):  # FARSIDE_PORT wins over farside_port
        key, value = name.upper().removeprefix(PREFIX), environment[name]
        if not name.upper().startswith(PREFIX) or not value:
            continue
        if _is_of_service(key, value):
            of_services.append(name)
        elif key in known:
            values[known[key]], names[known[key]] = value, name
        elif key not in _OF_CLIENTS:
            unknown[name] = PREFIX + difflib.get_close_matches(key, [*known, *_OF_CLIENTS], 1, 0.0)[0]
    return Variables(values, names, tuple(of_services), unknown)


def _is_of_service(key: str, value: str) -> bool:
    """Whether a variable is one that Kubernetes, or a link of Docker, makes for a service."""
    if _SERVICE.fullmatch(key):
        return True
    is_port, is_name = (re.fullmatch(rf"(\w+_)?{what}", key, re.ASCII) for what in ("PORT", "NAME"))
    return bool(is_port and _ADDRESS.match(value)) or bool(is_name and value.startswith("/"))
