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

__all__ = ["OriginCheck"]

_HOST = re.compile(r"([\w.-]+|\[[0-9a-fA-F:.]+(%25\w+)?\])(:\d+)?", re.ASCII)
_DEFAULT_PORTS = {"http": 80, "ws": 80, "https": 443, "wss": 443}


class OriginCheck:
    """ASGI middleware that refuses, with 403, what comes under a foreign name or from a foreign page.

    These names are taken: addresses written as numbers, names without a dot (nobody can register one; containers call
    each other so), names under localhost, the machine's host name, the name in `listens_on`, and those in `hosts` ("*"
    stands for any). With `token` any name is taken: a page that rebinds its name does not know the token. A page's
    origin must be the address that it asks for, or one of `origins` ("https://example.org", "null", "*" for any). A
    client that sends no Origin is not a page.
    """

    def __init__(
        self, app: ASGIApp, *, listens_on: str, hosts: Collection[str], origins: Collection[str], token: bool
    ) -> None:
        self._app, self._any_host = app, token or "*" in hosts
        own = socket.gethostname()
        names = (listens_on, own, f"{own}.local", "localhost", *hosts)
        self._hosts = {(_split(f"//{name}") or (name.lower(), None))[0] for name in names}
        self._origins = {_canonical(origin) for origin in origins}

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
        if origin is None or "*" in self._origins or _canonical(origin) in self._origins:
            return None
        if scope["type"] == "websocket" and not _is_same(origin, host):
            return f"origin: {origin!r}: expected a page of {host!r} (--allow-origin adds others)"
        return None

    def _is_own(self, host: str) -> bool:
        name = (_split(f"//{host}") or ("", None))[0] if _HOST.fullmatch(host) else ""
        if not name or name in self._hosts or name.endswith(".localhost"):
            return bool(name)
        return "." not in name or _is_address(name)


def _canonical(origin: str) -> str:
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
    try:
        ipaddress.ip_address(name.partition("%")[0])
    except ValueError:
        return False
    return True
