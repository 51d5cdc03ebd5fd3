"""TLS: by the server's own certificate, and by a proxy in front of it; clients that trust an authority of their own."""

from __future__ import annotations

import asyncio
import os
import shlex
import ssl
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from urllib.parse import quote, urlsplit

import pytest
from farside.clients.connection import RefusedError, connect, persist
from farside.clients.fetching import fetch
from farside.clients.trust import trust_certificate, trust_file
from farside.engine.io.tmiv import SequenceWriter
from farside.server.protocol import ViewerHello
from support.certificates import Certificates, make_certificates
from support.doubles import HANG_S, FakeCore
from support.proxy import reverse_proxy
from support.rooms import camera_row, frame
from support.serving import running
from websockets.asyncio.client import connect as raw_connect
from websockets.exceptions import InvalidStatus

VIEWER = ViewerHello.symmetric(32, 24, 1.5)


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Certificates:
    return make_certificates(tmp_path_factory.mktemp("certificates"))


@pytest.fixture(scope="module")
def url(files: Certificates) -> Iterator[str]:
    with running(FakeCore, ssl_certfile=str(files.certificate), ssl_keyfile=str(files.key)) as address:
        yield address


async def greet(url: str, tls: ssl.SSLContext | None = None) -> str:
    async with asyncio.timeout(HANG_S), connect(url, VIEWER, tls=tls) as (_, welcome):
        return welcome.client


def test_clients_of_an_own_authority_connect(url: str, files: Certificates) -> None:
    assert url.startswith("https://127.0.0.1:")
    trusted = trust_file(str(files.authority))
    for address in (url, url.replace("https", "wss"), url.replace("127.0.0.1", "localhost")):
        assert asyncio.run(greet(address, trusted)).startswith("viewer-")
        assert b"session" in fetch(address, "status", timeout_s=HANG_S, tls=trusted)


def test_certificate_and_key_may_be_in_one_file(files: Certificates) -> None:
    with running(FakeCore, ssl_certfile=str(files.both)) as address:
        assert asyncio.run(greet(address, trust_file(str(files.authority)))) == "viewer-1"


def test_a_program_trusts_the_certificate_of_its_own_server_whatever_its_name(
    url: str, files: Certificates, tmp_path: Path
) -> None:
    given = {"ssl_certfile": str(files.certificate), "ssl_keyfile": str(files.key)}
    with running(FakeCore, host="127.0.0.2", **given) as other_name:  # the certificate is not for it
        assert asyncio.run(greet(other_name, trust_certificate(str(files.certificate)))) == "viewer-1"
        with pytest.raises(RefusedError, match="IP address mismatch"):
            asyncio.run(greet(other_name, trust_file(str(files.authority))))
    another = make_certificates(tmp_path)
    with pytest.raises(RefusedError, match="unable to get local issuer certificate"):
        asyncio.run(greet(url, trust_certificate(str(another.certificate))))


def test_a_certificate_that_is_not_trusted_is_final_and_told(url: str) -> None:
    told: list[str] = []
    expected = r"url: 'https://127.*': expected a server with a certificate that is trusted here \(--ca-file adds an au"
    with pytest.raises(RefusedError, match=expected):
        asyncio.run(persist(lambda: greet(url), HANG_S, told.append))
    with pytest.raises(RefusedError, match=expected):
        fetch(url, "status", timeout_s=HANG_S)
    assert told == []


def test_plain_and_secure_addresses_are_not_mixed_up_in_silence(url: str, files: Certificates) -> None:
    with pytest.raises(ConnectionError, match="no server at http://"):
        asyncio.run(greet(url.replace("https", "http")))
    with running(FakeCore) as plain, pytest.raises(ConnectionError, match=r"no server at https://.*(?i:ssl|record)"):
        asyncio.run(greet(plain.replace("http", "https"), trust_file(str(files.authority))))


def test_the_file_of_an_authority_is_checked(files: Certificates) -> None:
    for name, reason in (("/no/such", "No such file"), ("/dev/null", ""), (str(files.key), "")):
        told = rf"^--ca-file: '{name}': expected a PEM file with certificates \({reason}"
        with pytest.raises(ValueError, match=told):
            trust_file(name)


def farside(environment: dict[str, str], *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "farside.clients.cli", *arguments],
        capture_output=True, text=True, timeout=120, env=os.environ | environment | {"NO_COLOR": "1"},
    )  # fmt: skip


@pytest.mark.parametrize("way", ["option", "variable", "openssl's variable"])
def test_commands_take_an_authority(url: str, files: Certificates, way: str) -> None:
    """There is no source: a headset that is let in waits; an export is told that there is no model."""
    given = ["--ca-file", str(files.authority)] if way == "option" else []
    name = {"variable": "FARSIDE_CA_FILE", "openssl's variable": "SSL_CERT_FILE"}.get(way)
    environment = {name: str(files.authority)} if name else {}
    done = farside(environment, "export", url, "/tmp/never-written.glb", *given)
    assert done.returncode == 2
    assert "before the first frame" in done.stderr


@pytest.mark.parametrize("proxied", [False, True])
def test_a_rig_a_headset_and_an_export_in_one_secure_run(proxied: bool, files: Certificates, tmp_path: Path) -> None:
    """Commands in a shell, with the link as it is printed; a rig's folder and a token that need care."""
    rig, token, path = tmp_path / "my rig #1 50%", "a b&c'\"é", "/far side" if proxied else ""
    cameras = camera_row(2, (24, 16))
    with SequenceWriter(rig, "[b]rig", 30.0, cameras, ("v0", "v1")) as writer:
        for index in range(4):
            for view in frame(index, cameras).views:
                writer.write(view.camera.name, view.texture, view.codes)
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(files.certificate, files.key)
    own = {} if proxied else {"ssl_certfile": str(files.certificate), "ssl_keyfile": str(files.key)}
    with ExitStack() as stack:
        address = stack.enter_context(running(FakeCore, token=token, **own))
        if proxied:
            address = stack.enter_context(reverse_proxy(address, quote(path), keep=False, tls=tls)) + path
        link = f"{address}/?token={quote(token, safe='')}"
        farside = f"{shlex.quote(sys.executable)} -m farside.clients.cli"
        command = (
            f"{farside} headset {shlex.quote(link)} --seconds 1 --size 32x24 > seen &\n"
            f"{farside} replay {shlex.quote(str(rig))} {shlex.quote(link)} --every-frame > sent && "
            f"{farside} export {shlex.quote(link)} room.ply && wait $! || {{ kill $!; exit 1; }}"
        )
        environment = os.environ | {"FARSIDE_CA_FILE": str(files.authority), "FARSIDE_TOKEN": "another"}
        done = subprocess.run(
            ["bash", "-c", command], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
        )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "sent").read_text() == (
        "4 frames sent, 0 skipped to keep the rate; the server took 4 and dropped 0\n"
    )
    assert "stereo pictures for" in (tmp_path / "seen").read_text()
    assert (tmp_path / "room.ply").read_bytes().startswith(b"ply")


def test_a_command_without_the_authority_ends_with_2(url: str) -> None:
    done = farside({}, "headset", url, "--patience", "1000")
    assert done.returncode == 2
    assert "farside: url: " in done.stderr
    assert "--ca-file" in done.stderr


@pytest.mark.parametrize(
    ("host", "allowed", "let_in"),
    [
        (None, "", True),  # Host is the client's
        ("farside.test:80", "", False),  # the proxy's own idea of the port
        ("127.0.0.1:8765", "", False),  # the upstream's address, as proxies send it without further settings
        ("farside.test:80", "https://farside.test", True),
        ("127.0.0.1:8765", "https://farside.test", True),
    ],
)
def test_pages_behind_a_proxy_with_tls(files: Certificates, host: str | None, allowed: str, let_in: bool) -> None:
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(files.certificate, files.key)

    async def come(port: int) -> None:
        there = {"host": "127.0.0.1", "port": port, "proxy": None, "ssl": trust_file(str(files.authority))}
        async with raw_connect("wss://farside.test/farside/viewer", origin="https://farside.test", **there):
            pass

    given = {"allowed_origins": allowed, "allowed_hosts": "farside.test"}
    with running(FakeCore, **given) as plain, reverse_proxy(plain, "/farside", keep=False, host=host, tls=tls) as proxy:
        port = urlsplit(proxy).port
        assert port
        if let_in:
            asyncio.run(come(port))
        else:
            with pytest.raises(InvalidStatus, match="403"):
                asyncio.run(come(port))
