"""A server on this machine is never reached through a proxy; others are, as the environment says."""

from __future__ import annotations

import asyncio
import importlib.util
import os
import socket
import subprocess
import sys
from urllib.parse import urlsplit

import pytest
from farside.clients.connection import connect
from farside.clients.fetching import fetch
from farside.clients.proxies import is_local, proxy_of
from farside.server.protocol import ViewerHello
from support.doubles import HANG_S, FakeCore
from support.proxy import forward_proxy
from support.serving import running

VIEWER = ViewerHello.symmetric(32, 24, 1.5)
NOBODY = "http://127.0.0.1:9"  # nothing listens there: who goes through it fails
VARIABLES = ("http_proxy", "https_proxy", "all_proxy", "socks_proxy", "ws_proxy", "wss_proxy", "no_proxy")


@pytest.fixture(autouse=True)
def no_proxies(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
        monkeypatch.delenv(name.upper(), raising=False)


def own_address() -> str:
    """An address of this machine that is no loopback address; 127.0.0.1 without a network."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing
        except OSError:
            return "127.0.0.1"
        return str(probe.getsockname()[0])


@pytest.mark.parametrize(
    ("host", "local"),
    [
        ("127.0.0.1", True), ("127.9.9.9", True), ("::1", True), ("::ffff:127.0.0.1", True), ("0.0.0.0", True),
        ("::", True), ("169.254.1.1", True), ("fe80::1", True), ("fe80::1%25eth0", True), ("localhost", True),
        ("LOCALHOST.", True), ("a.localhost", True), ("server", True), (socket.gethostname(), True),
        (own_address(), True), ("192.0.2.7", False), ("2001:db8::1", False), ("::ffff:192.0.2.7", False),
        ("localhost.example", False), ("farside.test", False), ("127.0.0.1.example", False),
    ],
)  # fmt: skip
def test_which_hosts_are_of_this_machine(host: str, local: bool) -> None:
    assert is_local(host) is local


P, Q = "http://p.example:1", "https://user:pass@q.example:2"


@pytest.mark.parametrize(
    ("variables", "url", "of_sockets", "of_http"),
    [
        ({}, "http://farside.test", None, None),
        ({"http_proxy": P}, "http://farside.test", P, P),
        ({"http_proxy": P}, "ws://farside.test", P, P),
        ({"http_proxy": P}, "https://farside.test", None, None),
        ({"https_proxy": P}, "https://farside.test", P, P),
        ({"https_proxy": P}, "http://farside.test", P, None),
        ({"HTTPS_PROXY": Q}, "wss://farside.test", Q, Q),
        ({"http_proxy": P, "https_proxy": Q}, "http://farside.test", Q, P),
        ({"all_proxy": P}, "http://farside.test", P, P),
        ({"ALL_PROXY": P}, "https://farside.test", P, P),
        ({"all_proxy": P, "http_proxy": Q}, "http://farside.test", Q, Q),
        ({"ws_proxy": P, "http_proxy": Q}, "http://farside.test", P, Q),
        ({"wss_proxy": P, "https_proxy": Q}, "https://farside.test", P, Q),
        ({"http_proxy": "p.example:1"}, "http://farside.test", P, P),
        ({"http_proxy": P, "no_proxy": "farside.test"}, "http://farside.test:8765", None, None),
        ({"http_proxy": P, "no_proxy": ".test"}, "http://farside.test:8765", None, None),
        ({"http_proxy": P, "no_proxy": "*"}, "http://farside.test", None, None),
        ({"http_proxy": P, "no_proxy": "other.test"}, "http://farside.test", P, P),
        ({"http_proxy": P, "NO_PROXY": "10.0.0.0/8,192.0.2.0/24"}, "http://192.0.2.7:8765", None, None),
        ({"http_proxy": P, "no_proxy": "2001:db8::/32"}, "http://[2001:db8::7]:8765", None, None),
        ({"http_proxy": P, "no_proxy": "10.0.0.0/8"}, "http://192.0.2.7:8765", P, P),
        ({"http_proxy": P, "https_proxy": P, "all_proxy": P}, "http://localhost:8765", None, None),
        ({"http_proxy": P, "https_proxy": P, "all_proxy": P}, "[::1]:8765", None, None),
        ({"all_proxy": "socks5://p.example:1", "socks_proxy": "p.example"}, "https://127.0.0.1", None, None),
    ],
)
def test_the_proxy_is_decided_by_address(
    variables: dict[str, str], url: str, of_sockets: str | None, of_http: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    assert (proxy_of(url, "ws"), proxy_of(url, "http")) == (of_sockets, of_http)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("all_proxy", "socks5://me:secret@p.example:1", "all_proxy: 'socks5://p.example:1': expected a proxy by http "),
        ("https_proxy", "socks5h://p.example", "https_proxy: 'socks5h://p.example': expected a proxy by http or https"),
        ("socks_proxy", "p.example:1", "socks_proxy: 'socks5h://p.example:1': expected a proxy by http or https"),
        ("http_proxy", "ftp://me:secret@p.example", "http_proxy: 'ftp://p.example': expected a proxy like http://proxy"),
        ("http_proxy", "http://p.example:many", "http_proxy: 'http://p.example:many': expected a proxy like http://p"),
    ],
)
def test_a_proxy_that_cannot_be_used_is_named_without_its_password(
    name: str, value: str, says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)  # python-socks is not installed
    monkeypatch.setenv(name, value)
    with pytest.raises(ValueError, match=r"expected a proxy") as caught:
        proxy_of("http://farside.test", "ws")
    assert str(caught.value).startswith(says)
    assert "secret" not in str(caught.value)


async def greet(url: str) -> str:
    async with asyncio.timeout(HANG_S), connect(url, VIEWER) as (_, welcome):
        return welcome.client


def test_a_server_on_this_machine_is_reached_directly(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in VARIABLES[:-1]:
        monkeypatch.setenv(name, "socks5://127.0.0.1:9" if name in ("all_proxy", "socks_proxy") else NOBODY)
    with running(FakeCore, host="localhost") as url:
        port = urlsplit(url).port
        for address in (url, f"http://localhost:{port}", f"ws://127.0.0.1:{port}"):
            assert asyncio.run(greet(address)).startswith("viewer-")
            assert b"session" in fetch(address, "status", timeout_s=HANG_S)


@pytest.mark.parametrize("variable", ["http_proxy", "all_proxy"])
def test_another_server_is_reached_through_the_proxy(variable: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with running(FakeCore, allowed_hosts="farside.test") as url, forward_proxy(url) as proxy:
        monkeypatch.setenv(variable, proxy.url)
        assert asyncio.run(greet("http://farside.test:8765")) == "viewer-1"
        assert b"session" in fetch("http://farside.test:8765", "status", timeout_s=HANG_S)
        assert proxy.asked == ["farside.test:8765"] * 2


def test_a_proxy_that_is_gone_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("http_proxy", "http://me:secret@127.0.0.1:9")
    with pytest.raises(ConnectionError, match=r"no server at http://farside.test through the proxy http://127.0.0.1:9:"):
        asyncio.run(greet("http://farside.test"))


def test_commands_say_what_is_wrong_with_a_proxy_at_once() -> None:
    environment = os.environ | {"all_proxy": "ftp://127.0.0.1:9", "NO_COLOR": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "farside.clients.cli", "headset", "http://farside.test", "--patience", "1000"],
        capture_output=True, text=True, timeout=120, env=environment,
    )  # fmt: skip
    assert done.returncode == 2
    assert "farside: all_proxy: 'ftp://127.0.0.1:9': expected a proxy like http://proxy.example:3128" in done.stderr
