"""Where `serve` listens: addresses, names, both families, several; and who is blamed where it cannot."""

from __future__ import annotations

import asyncio
import errno
import http.client
import socket
from contextlib import suppress
from urllib.parse import urlsplit

import pytest
from farside.clients.connection import connect
from farside.clients.listening import addresses_of, listen
from farside.clients.serve import server_settings
from farside.server.protocol import ViewerHello
from farside.server.settings import ServerSettings
from support.doubles import HANG_S, FakeCore
from support.serving import running


def has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return False
    return True


needs_ipv6 = pytest.mark.skipif(not has_ipv6(), reason="this machine has no IPv6")


def status(host: str, port: int) -> int:
    """The status code of GET /status at an address, under that address' own name."""
    client = http.client.HTTPConnection(host, port, timeout=HANG_S)
    try:
        client.request("GET", "/status")
        return client.getresponse().status
    finally:
        client.close()


@pytest.mark.parametrize(
    ("host", "answering", "printed"),
    [
        ("127.0.0.1", ["127.0.0.1"], ["127.0.0.1"]),
        ("0.0.0.0", ["127.0.0.1", "127.0.0.2"], ["127.0.0.1"]),
        pytest.param("::1", ["::1"], ["[::1]"], marks=needs_ipv6),
        pytest.param("[::1]", ["::1"], ["[::1]"], marks=needs_ipv6),
        pytest.param("::", ["::1", "127.0.0.1"], ["[::1]"], marks=needs_ipv6),
        pytest.param("0.0.0.0,::", ["::1", "127.0.0.1"], ["127.0.0.1", "[::1]"], marks=needs_ipv6),
        pytest.param("127.0.0.1, ::1", ["::1", "127.0.0.1"], ["127.0.0.1", "[::1]"], marks=needs_ipv6),
        ("127.0.0.1,127.0.0.2,127.0.0.1", ["127.0.0.1", "127.0.0.2"], ["127.0.0.1", "127.0.0.2"]),
    ],
)
def test_it_answers_at_all_its_addresses_on_one_port(host: str, answering: list[str], printed: list[str]) -> None:
    with running(FakeCore, host=host) as url:
        port = urlsplit(url).port
        assert port
        assert url == f"http://{printed[0]}:{port}"
        assert [status(address, port) for address in answering] == [200] * len(answering)
    settings = ServerSettings(host=host, port=0)
    with listen(settings) as sockets:
        addresses = addresses_of(sockets, settings)
        assert addresses == [f"http://{each}:{sockets[0].getsockname()[1]}/" for each in printed]


@needs_ipv6
def test_clients_take_the_address_of_ipv6_that_is_printed() -> None:
    async def greet(url: str) -> str:
        async with asyncio.timeout(HANG_S), connect(url, ViewerHello.symmetric(32, 24, 1.5)) as (_, welcome):
            return welcome.client

    for host in ("::1", *link_local()):
        with running(FakeCore, host=host) as url:
            assert url.startswith("http://[")
            assert asyncio.run(greet(url)) == "viewer-1"


def link_local() -> list[str]:
    """An address of this machine like fe80::1%eth0, if there is one."""
    found = []
    for _, interface in socket.if_nameindex():
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe, suppress(OSError):
            probe.connect(("ff02::1", 9, 0, socket.if_nametoindex(interface)))  # sends nothing
            if (own := str(probe.getsockname()[0])).startswith("fe80:"):
                found.append(f"{own.partition('%')[0]}%{interface}")
    return found[:1]


def test_the_name_localhost_stands_for_all_its_addresses() -> None:
    expected = {info[4][0] for info in socket.getaddrinfo("localhost", None, type=socket.SOCK_STREAM)}
    if not has_ipv6():
        expected.discard("::1")
    with running(FakeCore, host="localhost") as url:
        port = urlsplit(url).port
        assert port
        assert {address: status(address, port) for address in expected} == dict.fromkeys(expected, 200)


def test_one_family_does_not_take_the_others_port() -> None:
    with running(FakeCore, host="127.0.0.1") as url, pytest.raises(ConnectionRefusedError):
        status("127.0.0.2", urlsplit(url).port or 0)


@needs_ipv6
def test_a_free_port_is_free_on_all_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    """The system gives the first address a port that is taken on the second one; then it tries another."""
    ports = iter((0, 0))
    with socket.create_server(("::1", 0), family=socket.AF_INET6) as taken:
        wanted = taken.getsockname()[1]
        real = socket.socket.bind

        def bind(self: socket.socket, address: tuple[str, int]) -> None:
            first = address[:2] == ("127.0.0.1", 0) and next(ports, None) is not None
            real(self, ("127.0.0.1", wanted) if first else address)

        monkeypatch.setattr("socket.socket.bind", bind)
        settings = ServerSettings(host="127.0.0.1,::1", port=0)
        with listen(settings) as sockets:
            one, other = (each.getsockname()[1] for each in sockets)
            assert one == other != wanted
    assert next(ports, None) is None


def test_a_link_local_address_is_printed_with_its_interface() -> None:
    index, name = socket.if_nameindex()[0]

    class Listening:
        def getsockname(self) -> tuple[str, int, int, int]:
            return ("fe80::1", 8765, 0, index)

    assert addresses_of([Listening()], ServerSettings()) == [f"http://[fe80::1%25{name}]:8765/"]  # type: ignore[list-item]


# What cannot be


def test_a_port_that_is_taken_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        for host in ("127.0.0.1", "127.0.0.2,127.0.0.1", "0.0.0.0"):
            told = rf"^--port: {port} on {host.rpartition(',')[2]}: expected a free one \(Address already in use\)$"
            with pytest.raises(OSError, match=told), listen(server_settings(port=port, host=host)):
                pass


@pytest.mark.parametrize("host", ["192.0.2.7", pytest.param("2001:db8::1", marks=needs_ipv6)])
def test_an_address_of_another_machine_is_blamed_on_the_host(host: str) -> None:
    told = rf"^--host: '{host}': expected an address of this machine \(Cannot assign requested address\)$"
    with pytest.raises(OSError, match=told), listen(server_settings(host=host, port=0)):
        pass


@pytest.mark.parametrize("host", ["nohost.invalid", "no host", "256.1.1.1", "a" * 300, "::g"])
def test_a_name_that_is_none_is_blamed_on_the_host(host: str, monkeypatch: pytest.MonkeyPatch) -> None:
    told = rf"^--host: '{host}': expected an address of this machine, or a name of one \(.+\)$"
    with pytest.raises(ValueError, match=told), listen(server_settings(host=host)):
        pass
    monkeypatch.setenv("FARSIDE_HOST", host)
    with pytest.raises(ValueError, match=f"^FARSIDE_HOST: '{host}': "), listen(server_settings()):
        pass


def test_a_port_that_needs_a_right_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def bind(self: socket.socket, address: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr("socket.socket.bind", bind)  # root may have any port
    told = r"^--port: 80 on 127.0.0.1: expected one above 1023, or the right to use it \(Permission denied\)$"
    with pytest.raises(OSError, match=told), listen(server_settings(port=80)):
        pass


def test_an_address_that_this_machine_lacks_is_left_out_where_the_name_has_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stream = (socket.SOCK_STREAM, 6, "")
    real = socket.getaddrinfo

    def look_up(host: str, *rest: object, **given: object) -> object:
        if host != "both.test":
            return real(host, *rest, **given)  # type: ignore[arg-type]
        return [(socket.AF_INET, *stream, ("192.0.2.7", 0)), (socket.AF_INET, *stream, ("127.0.0.1", 0))]

    monkeypatch.setattr(socket, "getaddrinfo", look_up)
    with listen(ServerSettings(host="both.test", port=0)) as (listening,):
        assert listening.getsockname()[0] == "127.0.0.1"
