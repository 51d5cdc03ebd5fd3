"""Pages of other origins, and names that somebody else's DNS points here, are refused unless they are allowed."""

from __future__ import annotations

import asyncio
import http.client
import socket
from typing import Any
from urllib.parse import urlsplit

import pytest
from farside.clients.connection import base_url
from farside.server.protocol import ViewerHello, Welcome, decode, encode
from support.doubles import HANG_S, FakeCore
from support.serving import running
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

VIEWER = ViewerHello.symmetric(32, 24, 1.5)


def get(url: str, host: str) -> tuple[int, str]:
    """What GET /status gives under a name."""
    parts = urlsplit(url)
    client = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=HANG_S)
    try:
        client.request("GET", "/status", headers={"Host": host})
        answer = client.getresponse()
        return answer.status, answer.read().decode()
    finally:
        client.close()


async def greet(url: str, path: str, headers: dict[str, str]) -> None:
    """Become a viewer, or see what stands in the way (InvalidStatus)."""
    parts = urlsplit(url)
    host = headers.pop("Host", parts.netloc)
    address = f"ws://{host}{path}"
    there = {"host": parts.hostname, "port": parts.port, "proxy": None}
    async with connect(address, additional_headers=headers, **there) as client:
        if path == "/viewer":
            await client.send(encode(VIEWER))
            decode(await client.recv(), Welcome)


def refused(url: str, path: str = "/viewer", **headers: str) -> str:
    """The answer's text of who is refused; empty for who is let in."""
    try:
        asyncio.run(greet(url, path, headers))
    except InvalidStatus as error:
        return (error.response.body or b"").decode() if error.response.status_code == 403 else "not with 403"
    return ""


@pytest.mark.parametrize("path", ["/viewer", "/source"])
@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "https://evil.example:8765", "null", "file://", "http://127.0.0.1", "http://[::1", "",
     "http://evil.example@127.0.0.1"],
)
def test_a_page_of_another_origin_is_refused_with_its_name(path: str, origin: str) -> None:
    with running(FakeCore) as url:
        assert refused(url, path, Origin=origin).startswith(f"origin: {origin!r}: expected a page of '127.0.0.1:")


@pytest.mark.parametrize(
    ("given", "origin"),
    [
        ({}, "http://{address}"),
        ({}, "HTTP://{address}"),
        ({"allowed_origins": "https://a.example, https://b.example"}, "https://b.example"),
        ({"allowed_origins": "https://a.example/"}, "https://A.example"),
        ({"allowed_origins": "https://a.example:443/"}, "https://a.example"),
        ({"allowed_origins": "null"}, "null"),
        ({"allowed_origins": "*"}, "https://whatever.example"),
        ({"token": ""}, None),
    ],
)
def test_our_own_page_and_those_that_are_allowed_are_let_in(given: dict[str, Any], origin: str | None) -> None:
    with running(FakeCore, **given) as url:
        headers = {} if origin is None else {"Origin": origin.format(address=urlsplit(url).netloc)}
        assert refused(url, **headers) == ""


def test_a_token_does_not_let_other_pages_in() -> None:
    with running(FakeCore, token="secret") as url:
        assert refused(url, Origin="http://evil.example").startswith("origin: ")


@pytest.mark.parametrize(
    "host",
    [
        "evil.example", "evil.example:80", "127.0.0.1.evil.example", "localhost.evil.example", ":",
        "evil.example@localhost", "localhost/evil.example", "[::1].evil.example", "127.0.0.1%evil.example", "1.2.3.4.5",
        "127.1.evil", "127.0.0.256", "evil.internal", "host.docker.internal.evil.example", "docker.internal",
        "evil.local",
    ],
)
def test_a_name_that_points_here_is_not_ours(host: str) -> None:
    with running(FakeCore) as url:
        status, text = get(url, host)
        assert status == 403
        assert text.startswith(f"host: {host!r}: expected an address as numbers, a name without dots or one of ")
        assert "localhost" in text
    assert base_url(url, "http") == url


def test_a_page_whose_name_is_made_to_point_here_is_refused_though_it_is_of_the_same_origin() -> None:
    with running(FakeCore) as url:
        port = urlsplit(url).port
        assert refused(url, Host=f"evil.example:{port}", Origin=f"http://evil.example:{port}").startswith("host: ")


@pytest.mark.parametrize(
    ("given", "host"),
    [
        ({}, "127.0.0.1:1"),
        ({}, "[::1]:8765"),
        ({}, "[fe80::1%25eth0]"),
        ({}, "[fe80::1%eth0]"),
        ({}, "127.1"),  # as some clients send what they were given; nobody can register it
        ({}, "127.1:8765"),
        ({}, "0x7f.0.0.1"),
        ({}, "2130706433"),
        ({}, "host.docker.internal:8765"),  # what containers call the machine that they run on
        ({}, "gateway.docker.internal"),
        ({}, "host.containers.internal"),
        ({}, "192.168.1.7"),
        ({}, "LocalHost:9"),
        ({}, "demo.localhost"),
        ({}, "farside:8765"),  # a service in a network of containers
        ({}, socket.gethostname()),
        ({}, ""),
        ({"allowed_hosts": "farside.example,other.example"}, "farside.example:443"),
        ({"allowed_hosts": " My.Example. , proxy.example:443"}, "my.example"),
        ({"allowed_hosts": " My.Example. , proxy.example:443"}, "proxy.example"),
        ({"allowed_hosts": "*"}, "whatever.example"),
        ({"token": "secret"}, "whatever.example"),  # a page that rebinds a name does not know it
    ],
)
def test_names_of_this_machine_and_those_that_are_allowed_are_ours(given: dict[str, Any], host: str) -> None:
    with running(FakeCore, **given) as url:
        assert get(url, host)[0] == 200


# Over HTTP


def ask(url: str, method: str, path: str, **headers: str) -> tuple[int, dict[str, str], bytes]:
    parts = urlsplit(url)
    client = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=HANG_S)
    try:
        client.request(method, path, headers=headers)
        answer = client.getresponse()
        return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
    finally:
        client.close()


def test_pages_of_allowed_origins_and_no_others_may_read_what_http_answers() -> None:
    allowed, other = "https://a.example", "https://b.example"
    with running(FakeCore, allowed_origins="https://A.example:443/") as url:
        for method in ("GET", "HEAD"):
            assert ask(url, method, "/status", Origin=allowed)[1]["access-control-allow-origin"] == allowed
            assert "access-control-allow-origin" not in ask(url, method, "/status", Origin=other)[1]
            assert "access-control-allow-origin" not in ask(url, method, "/status")[1]
        before = {"Access-Control-Request-Method": "GET", "Access-Control-Request-Headers": "authorization"}
        status, headers, _ = ask(url, "OPTIONS", "/mesh.glb", Origin=allowed, **before)
        assert (status, headers["access-control-allow-origin"]) == (200, allowed)
        assert "authorization" in headers["access-control-allow-headers"].lower()
        assert ask(url, "OPTIONS", "/mesh.glb", Origin=other, **before)[0] == 400
        assert ask(url, "OPTIONS", "/mesh.glb", Origin=allowed, Host="evil.example", **before)[0] == 403
    with running(FakeCore) as url:
        assert "access-control-allow-origin" not in ask(url, "GET", "/status", Origin=allowed)[1]
    with running(FakeCore, allowed_origins="*") as url:
        assert ask(url, "GET", "/status", Origin=other)[1]["access-control-allow-origin"] == "*"
