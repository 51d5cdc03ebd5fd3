"""Sockets on which a server listens, and the addresses that they have for clients."""

from __future__ import annotations

import contextlib
import errno
import socket
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple
from urllib.parse import quote

from farside.server.settings import ServerSettings, listed

__all__ = ["addresses_of", "listen"]

_ATTEMPTS = 10  # to find a port that is free on all addresses
_NOT_HERE = (errno.EADDRNOTAVAIL, errno.EAFNOSUPPORT, errno.ENODEV)  # ENODEV: another machine's interface


class _Place(NamedTuple):
    """Where a socket can listen, without the port."""

    family: int
    address: str
    more: tuple[Any, ...]  # IPv6: flow and the interface of a link-local address


@contextlib.contextmanager
def listen(settings: ServerSettings) -> Iterator[list[socket.socket]]:
    """Sockets that listen on all hosts of the settings, on one port, closed after the block.

    A host's name may stand for several addresses (`localhost`: 127.0.0.1 and ::1); those that this machine has are
    taken. `::` takes IPv4, too. Raises ValueError for a host that cannot be resolved, OSError for an address of another
    machine and for a port that is taken or forbidden.
    """
    with contextlib.ExitStack() as stack:
        sockets = _open_all(settings)
        for each in sockets:
            stack.enter_context(each)
        yield sockets


def _open_all(settings: ServerSettings) -> list[socket.socket]:
    hosts = {host: _resolve(settings, host) for host in dict.fromkeys(listed(settings.host))}
    for attempt in range(_ATTEMPTS):
        sockets: list[socket.socket] = []
        try:
            for host, places in hosts.items():
                sockets += _open(settings, host, places, sockets[0].getsockname()[1] if sockets else settings.port)
            return sockets
        except BaseException as error:
            for each in sockets:
                each.close()
            first_is_free = isinstance(error, OSError) and error.errno == errno.EADDRINUSE and sockets
            if settings.port or not first_is_free or attempt == _ATTEMPTS - 1:
                raise
    raise AssertionError  # the last attempt has raised


def _resolve(settings: ServerSettings, host: str) -> list[_Place]:
    """The places of a host; an IPv6 address may be in brackets."""
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    try:
        found = socket.getaddrinfo(bare, None, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError) as error:
        reason = getattr(error, "strerror", None) or error
        expected = f"an address of this machine, or a name of one ({reason})"
        raise ValueError(f"{settings.name_of('host')}: {host!r}: expected {expected}") from error
    return list(dict.fromkeys(_Place(family, str(at[0]), tuple(at[2:])) for family, *_, at in found))


def _open(
    settings: ServerSettings, host: str, places: Sequence[_Place], port: int
) -> list[socket.socket]:
    """Sockets on those addresses of a host that this machine has."""
    sockets: list[socket.socket] = []
    missing: OSError | None = None
    for place in places:
        both = place.address == "::" and "0.0.0.0" not in listed(settings.host) and socket.has_dualstack_ipv6()
        try:
            sockets.append(_bind(place, sockets[0].getsockname()[1] if sockets else port, both))
        except OSError as error:
            if error.errno in _NOT_HERE:
                missing = error
                continue
            for each in sockets:
                each.close()
            raise _blame(settings, error, place.address, port) from error
    if not sockets and missing is not None:
        expected = f"an address of this machine ({missing.strerror})"
        raise _NamedError(missing.errno, f"{settings.name_of('host')}: {host!r}: expected {expected}") from missing
    return sockets


def _bind(place: _Place, port: int, dualstack: bool) -> socket.socket:
    listening = socket.socket(place.family, socket.SOCK_STREAM)
    try:
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if place.family == socket.AF_INET6:
            listening.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, not dualstack)
        listening.bind((place.address, port, *place.more))
        listening.listen()
    except BaseException:
        listening.close()
        raise
    return listening


def _blame(settings: ServerSettings, error: OSError, address: str, port: int) -> OSError:
    expected = "one above 1023, or the right to use it" if error.errno == errno.EACCES else "a free one"
    text = f"{settings.name_of('port')}: {port} on {address}: expected {expected} ({error.strerror})"
    return _NamedError(error.errno, text)


class _NamedError(OSError):
    """An error whose text names the setting."""

    def __str__(self) -> str:
        return str(self.strerror)


def addresses_of(sockets: Sequence[socket.socket], settings: ServerSettings, token: str = "") -> list[str]:
    """The server's addresses for a browser on this machine; `token` is quoted as an address has to be."""
    scheme = "https" if settings.secure else "http"
    query = f"?token={quote(token, safe='')}" if token else ""
    return [f"{scheme}://{_authority(each)}/{query}" for each in sockets]


def _authority(listening: socket.socket) -> str:
    host, port, *more = listening.getsockname()
    host = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    if more and more[1]:
        host = f"{host.partition('%')[0]}%25{socket.if_indextoname(more[1])}"  # RFC 6874
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
