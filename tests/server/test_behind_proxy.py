"""The service under a path of another host: behind a reverse proxy that keeps the path, or strips it untold."""

from __future__ import annotations

import asyncio
import http.client
import re
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urljoin, urlsplit

import pytest
from farside.clients.connection import RefusedError, connect
from farside.clients.fetching import fetch
from farside.clients.serve import server_settings
from farside.server.app import PAGE, create_app
from farside.server.protocol import ViewerHello
from farside.server.settings import ServerSettings
from support.doubles import HANG_S, FakeCore
from support.proxy import reverse_proxy
from support.serving import running

VIEWER = ViewerHello.symmetric(32, 24, 1.5)
WAYS = pytest.mark.parametrize(
    ("keep", "told"), [(True, True), (False, True), (False, False)], ids=["keeps", "strips", "strips untold"]
)
PREFIX = pytest.mark.parametrize("prefix", ["/farside", "/a/b", "/gr%C3%B6%C3%9Fe"])


@contextmanager
def behind(prefix: str, keep: bool, told: bool) -> Iterator[str]:
    """The service's address behind a proxy, without a slash at its end."""
    root = server_settings(root_path=prefix if told else None).root_path
    with running(FakeCore, root_path=root) as url, reverse_proxy(url, prefix, keep=keep) as proxy:
        yield proxy + prefix


def ask(url: str, method: str = "GET") -> tuple[int, dict[str, str], bytes]:
    """Status, headers and body of an answer; redirects are not followed."""
    parts = urlsplit(url)
    client = http.client.HTTPConnection(parts.hostname or "", parts.port, timeout=HANG_S)
    try:
        client.request(method, parts.path + (f"?{parts.query}" if parts.query else ""))
        answer = client.getresponse()
        return answer.status, {name.lower(): value for name, value in answer.getheaders()}, answer.read()
    finally:
        client.close()


@PREFIX
@WAYS
def test_the_page_and_all_that_it_names_are_found(prefix: str, keep: bool, told: bool) -> None:
    with behind(prefix, keep, told) as url:
        status, _, page = ask(f"{url}/")
        assert (status, page) == (200, (PAGE / "index.html").read_bytes())
        named = re.findall(r'(?:href|src)="([^"]+\.\w+)"', page.decode())
        assert len(named) == 2
        seen = set()
        for script in re.findall(r'from "([^"]+)"', (PAGE / "viewer.js").read_text()):
            named.append(urljoin("page/viewer.js", script))
        for name in named:
            assert ask(urljoin(f"{url}/", name))[2] == (PAGE / name.removeprefix("page/")).read_bytes()
            seen.add(name.removeprefix("page/"))
        assert seen | {"index.html"} == {file.name for file in PAGE.iterdir()}


@PREFIX
@WAYS
def test_clients_reach_the_service(prefix: str, keep: bool, told: bool) -> None:
    async def greet(url: str) -> str:
        async with asyncio.timeout(HANG_S), connect(url, VIEWER) as (_, welcome):
            return welcome.client

    with behind(prefix, keep, told) as url:
        assert asyncio.run(greet(url)) == "viewer-1"
        assert asyncio.run(greet(url + "/")) == "viewer-2"
        assert b'"source_connected":false' in fetch(url, "status", timeout_s=HANG_S)


def test_clients_say_who_they_are_to_a_proxy_that_asks() -> None:
    async def greet(url: str) -> str:
        async with asyncio.timeout(HANG_S), connect(url, VIEWER) as (_, welcome):
            return welcome.client

    proxied = {"keep": False, "user": "me:p@ss wörd"}
    with running(FakeCore) as url, reverse_proxy(url, "/farside", **proxied) as proxy:  # type: ignore[arg-type]
        named = proxy.replace("://", "://me:p%40ss%20w%C3%B6rd@") + "/farside"
        assert asyncio.run(greet(named)) == "viewer-1"
        assert b"session" in fetch(named, "status", timeout_s=HANG_S)
        other = named.replace("ss%20", "")
        told = rf"no server at {re.escape(proxy)}/farside: who\? \(status 401\)"
        with pytest.raises(ConnectionError, match=told):
            asyncio.run(greet(other))
        with pytest.raises(RefusedError, match=r"refused by the server: who\? \(status 401\)"):
            fetch(other, "status", timeout_s=HANG_S)


@WAYS
def test_an_address_without_its_last_slash_leads_to_the_page(keep: bool, told: bool) -> None:
    with behind("/farside", keep, told) as url:
        status, headers, body = ask(f"{url}?token=a%20b")
        if keep:
            assert (status, headers["location"]) == (307, "/farside/?token=a%20b")
        else:  # the server can't know; the page's script goes there
            assert (status, body) == (200, (PAGE / "index.html").read_bytes())


@WAYS
def test_a_slash_too_many_is_no_redirect_to_an_address_that_only_the_proxy_knows(keep: bool, told: bool) -> None:
    with behind("/farside", keep, told) as url:
        assert ask(f"{url}/status/")[0] == 200


def test_who_asks_the_server_itself_needs_no_prefix() -> None:
    with running(FakeCore, root_path="/farside") as url:
        assert [ask(f"{url}{path}")[0] for path in ("/", "/status", "/farside/", "/farside/status")] == [200] * 4
        assert [ask(f"{url}{path}")[0] for path in ("/farsidestatus", "/other/", "/farside/farside/")] == [404] * 3


def test_a_proxy_that_does_not_pass_on_upgrades_is_told() -> None:
    with running(FakeCore) as url:
        for path in ("/viewer", "/source"):
            for method in ("GET", "HEAD"):
                status, headers, body = ask(url + path, method)
                assert (status, headers["upgrade"]) == (426, "websocket")
                assert (b"a proxy in between must pass on Upgrade" in body) is (method == "GET")


# Health checks


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("/", "text/html; charset=utf-8"),
        ("/status", "application/json"),
        ("/status?seconds=2", "application/json"),
        ("/metrics", "text/plain; version=0.0.4"),
        ("/page/style.css", "text/css; charset=utf-8"),
        ("/page/viewer.js", "text/javascript; charset=utf-8"),
        ("/mesh.glb", "application/json"),  # 409 before there is a model
        ("/mesh.obj", "application/json"),  # 404
        ("/nothing", "application/json"),
    ],
)
def test_head_gives_what_get_gives_without_a_body(path: str, kind: str) -> None:
    with running(FakeCore) as url:
        status, headers, body = ask(url + path)
        assert body
        status_of_head, headers_of_head, nothing = ask(url + path, "HEAD")
        assert (status_of_head, nothing) == (status, b"")
        varying = {"date", "content-length"} if path.startswith(("/status", "/metrics")) else {"date"}
        assert {k: v for k, v in headers.items() if k not in varying} == {
            k: v for k, v in headers_of_head.items() if k not in varying
        }
        assert int(headers_of_head["content-length"]) > 0
        assert re.fullmatch(re.escape(kind) + "(; charset=utf-8)?", headers["content-type"])


def test_every_route_that_is_read_takes_head() -> None:
    methods = [getattr(route, "methods", None) for route in create_app(ServerSettings()).routes]
    assert [found for found in methods if found and "GET" in found] == [{"GET", "HEAD"}] * 6


def test_variables_for_other_servers_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WEB_CONCURRENCY", "auto")
    monkeypatch.setenv("PORT", "tcp://10.0.0.1:80")
    with running(FakeCore) as url:
        assert ask(f"{url}/status")[0] == 200
