"""Who may address the server: pages of other origins, and names that somebody else's DNS points here, may not.

A browser lets any page open WebSockets to any address, this machine's included, and tells where the page came from
(Origin, RFC 6455 section 10.2). A page whose own name is made to point here after it was loaded (DNS rebinding) counts
as of the same origin: it is told by the name that it asks for (Host).
"""

from __future__ import annotations

import ipaddress
import re
import socket
from collections.abc import Collection
from urllib.parse import urlsplit

from starlette.datastructures import Headers
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Receive, Scope, Send

__all__ = ["OriginCheck", "canonical", "is_name", "is_origin"]

_HOST = re.compile(r"([\w.-]+|\[[0-9a-fA-F:.]+(%(25)?\w+)?\])(:\d+)?", re.ASCII)
# What containers call the machine that they run on. Nobody can register a name under .internal, but a network's owner
# may give others out: they are not taken.
_MACHINE = ("host.docker.internal", "gateway.docker.internal", "host.containers.internal")
_READING = ("GET", "HEAD", "OPTIONS")  # a browser keeps the answers from other pages, these change nothing
_DEFAULT_PORTS = {"http": 80, "ws": 80, "https": 443, "wss": 443}


class OriginCheck:
    """ASGI middleware that refuses, with 403, what comes under a foreign name or from a foreign page.

    These names are taken: addresses written as numbers, also short ones (127.1), names without a dot (nobody can
    register one; containers call each other so), names under localhost, the names that container engines give to the
    machine (`_MACHINE`), the machine's host name, and those in `hosts` ("*" stands for any). With `token` any name is
    taken: a page that rebinds its name does not know the token. A page's origin must be the address that it asks for,
    or one of `origins` ("https://example.org", "null", "*" for any). A client that sends no Origin is not a page.
    """

    def __init__(self, app: ASGIApp, *, hosts: Collection[str], origins: Collection[str], token: bool) -> None:
        self._app, self._any_host = app, token or "*" in hosts
        own = socket.gethostname()
        names = (own, f"{own}.local", "localhost", *_MACHINE, *hosts)
        self._hosts = {(_split(f"//{name}") or (name.lower(), None))[0] for name in names}
        self._origins = {canonical(origin) for origin in origins}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        refusal = self._refusal(scope) if scope["type"] in ("http", "websocket") else None
        if refusal is None:
            await self._app(scope, receive, send)
        else:
            await PlainTextResponse(refusal, 403)(scope, receive, send)

    def _refusal(self, scope: Scope) -> str | None:
        """What is wrong with a request, if anything."""
        headers = Headers(scope=scope)
        host, origin = ", ".join(headers.getlist("host")), headers.get("origin")
        if host and not self._any_host and not self._is_own(host):
            names = ", ".join(sorted(self._hosts))
            expected = f"an address as numbers, a name without dots or one of {names} (--allow-host adds others)"
            return f"host: {host!r}: expected {expected}"
        if origin is None or "*" in self._origins or canonical(origin) in self._origins:
            return None
        reads = scope["type"] == "http" and scope["method"] in _READING
        if not reads and not _is_same(origin, host):
            return f"origin: {origin!r}: expected a page of {host!r} (--allow-origin adds others)"
        return None

    def _is_own(self, host: str) -> bool:
        name = (_split(f"//{host}") or ("", None))[0] if _HOST.fullmatch(host) else ""
        if not name or name in self._hosts or name.endswith(".localhost"):
            return bool(name)
        return "." not in name or _is_address(name)


def canonical(origin: str) -> str:
    """An origin as browsers spell it: in lower case, without the port that its scheme has anyway."""
    origin = origin.lower().rstrip("/")
    scheme, _, rest = origin.partition("://")
    return origin.removesuffix(f":{_DEFAULT_PORTS[scheme]}") if rest and scheme in _DEFAULT_PORTS else origin


def _split(url: str) -> tuple[str, int | None] | None:
    """Host and port of a URL; None where it is none."""
    try:
        parts = urlsplit(url)
        return (parts.hostname or "").rstrip("."), parts.port or _DEFAULT_PORTS.get(parts.scheme)
    except ValueError:
        return None


def _is_same(origin: str, host: str) -> bool:
    """Whether a page's origin is the address that it asked for."""
    scheme, _, address = origin.partition("://")
    scheme, page = scheme.lower(), _split(origin)
    return _HOST.fullmatch(address) is not None and scheme in _DEFAULT_PORTS and page is not None and page == _split(f"{scheme}://{host}")


def _is_address(name: str) -> bool:
    """Whether a name is an address written as numbers; nobody can register one that ends in a number."""
    try:
        ipaddress.ip_address(name.partition("%")[0])
    except ValueError:
        return _is_short_address(name)
    return True


def _is_short_address(name: str) -> bool:
    """Whether a name is an IPv4 address with fewer than four numbers, or with hexadecimal ones."""
    try:
        return bool(socket.inet_aton(name))
    except (OSError, UnicodeError):
        return False


def is_name(host: str) -> bool:
    """Whether a setting is a host's name or address, with or without a port; or "*"."""
    return host == "*" or (_HOST.fullmatch(host) is not None and bool((_split(f"//{host}") or ("", None))[0]))


def is_origin(origin: str) -> bool:
    """Whether a setting is an origin as browsers send it (RFC 6454 section 6): scheme, host and port; or "null", "*".
    """
    scheme, _, address = origin.rstrip("/").partition("://")
    if origin in ("*", "null"):
        return True
    return re.fullmatch(r"[A-Za-z][A-Za-z0-9+.-]*", scheme) is not None and address != "*" and is_name(address)
