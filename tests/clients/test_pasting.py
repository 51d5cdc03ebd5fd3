"""Links and commands that are printed work when they are pasted, whatever the values in them hold."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import urllib.request
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
from farside.clients.address import base_url, parse_address, token_of, without_secrets
from farside.clients.listening import addresses_of, listen
from farside.server.settings import ServerSettings

ODD = [
    "a b", "a&b=c", "#x", "100%", "%41", "a+b", "\"it's\"", "größe", "a/b?c", "$(touch x)`y`;z", "[red]x[/]", "a\\b",
    "~",
]  # fmt: skip
HANG_S = 60


@pytest.mark.parametrize("token", ODD)
def test_a_link_holds_its_token(token: str) -> None:
    settings = ServerSettings(port=0, token=token)
    with listen(settings) as sockets:
        (link,) = addresses_of(sockets, settings, token)
    assert re.fullmatch(r"[!-~]+", link)
    assert not set(link) & set("'\"`$;&|<>()[] \\#")  # a shell takes it as it is
    assert parse_qs(urlsplit(link).query) == {"token": [token]}
    assert token_of(link, "another") == token
    assert base_url(link, "ws") == f"ws://127.0.0.1:{urlsplit(link).port}"


@pytest.mark.parametrize(
    ("url", "base", "token"),
    [
        ("http://a/?token=x%26y&other=1", "http://a", "x&y"),
        ("https://b.org/a b/größe/?token=", "https://b.org/a%20b/gr%C3%B6%C3%9Fe", ""),
        ("http://a/b%20c//#top", "http://a/b%20c", ""),
        (" http://a:1/ ", "http://a:1", ""),
        ("http://bücher.example/", "http://xn--bcher-kva.example", ""),
        ("[::1]:8765/?token=t", "http://[::1]:8765", "t"),
        ("http://[fe80::1%25eth0]:1/", "http://[fe80::1%25eth0]:1", ""),
        ("https://me:p%40ss w@b.org/x", "https://me:p%40ss%20w@b.org/x", ""),
        ("WSS://B.org/X/", "https://b.org/X", ""),
    ],
)
def test_addresses_are_taken_as_people_write_them(url: str, base: str, token: str) -> None:
    assert parse_address(url).url("http") == base
    assert token_of(url, "") == token


def test_messages_show_neither_token_nor_password() -> None:
    assert without_secrets("https://me:pass@b.org/x?token=t") == "https://b.org/x"
    assert without_secrets("localhost:8765") == "localhost:8765"


def bash(command: str, **given: object) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(["bash", "-c", command], capture_output=True, timeout=HANG_S * 2, check=False, **given)  # type: ignore[call-overload,no-any-return]


@pytest.fixture
def command(tmp_path: Path) -> str:
    """The folder of a `farside` that is this one."""
    program = tmp_path / "bin" / "farside"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m farside.clients.cli "$@"\n')
    program.chmod(0o755)
    return str(program.parent)


def test_the_link_that_serve_prints_opens_and_lets_commands_in(command: str, tmp_path: Path) -> None:
    token = "".join(ODD)
    environment = os.environ | {"PATH": f"{command}:{os.environ['PATH']}"}
    serving = subprocess.Popen(
        ["farside", "serve", "--port", "0", "--token", token], env=environment, stdout=subprocess.PIPE, text=True
    )
    try:
        assert serving.stdout is not None
        said = re.fullmatch(r"serving at (\S+) \(Ctrl-C stops\)\n", serving.stdout.readline())
        assert said
        link = said[1]
        direct = urllib.request.build_opener(urllib.request.ProxyHandler({}))
        with direct.open(link, timeout=HANG_S) as page:
            assert b"<title>Farside</title>" in page.read()
        done = bash(f"farside export {link} x.glb", env=environment, cwd=tmp_path)
        assert b"before the first frame" in done.stderr  # let in
        done = bash(f"farside export {link.partition('?')[0]} x.glb", env=environment, cwd=tmp_path)
        assert b"token: none: expected the server's token" in done.stderr
    finally:
        serving.terminate()
        serving.communicate(timeout=HANG_S)
    assert [path.name for path in tmp_path.iterdir()] == ["bin"]  # nothing of the token was run


NAMES = [*(name for name in ODD if "/" not in name), "-rf", "new\nline", "*", "-- x", os.fsdecode(b"\xff\xfe")]


def test_the_commands_that_remove_twins_remove_them(tmp_path: Path) -> None:
    """In folders with all those names, given from the root or from where the command runs."""
    code = (
        "import sys; from contextlib import suppress; from pathlib import Path\n"
        "from farside.clients import cli, demo\n"
        "def all_of_them():\n"
        "    for name in sys.argv[1:]:\n"
        "        with suppress(ValueError): demo._twin(Path(name), 0.25, 60)  # the folders are empty\n"
        "        print(end='\\0')\n"
        "cli.app = all_of_them\n"
        "cli.main()\n"
    )
    (tmp_path / "other").mkdir()
    given = [*NAMES, *(str(tmp_path / f"{name} too") for name in NAMES)]
    for name in given:
        (tmp_path / name / "museum-0.25-60").mkdir(parents=True)
    done = subprocess.run([sys.executable, "-c", code, *given], capture_output=True, cwd=tmp_path, timeout=HANG_S)
    assert done.returncode == 0, done.stderr
    said = done.stdout.split(b"\0")[:-1]
    assert len(said) == len(given)
    for name, text in zip(given, said, strict=True):
        removing = text.partition(b"to remove it: ")[2]
        assert removing.startswith(b"rm -r -- ")
        ran = subprocess.run(["bash", "-c", removing], capture_output=True, cwd=tmp_path, timeout=HANG_S)
        assert (ran.returncode, ran.stderr) == (0, b"")
        assert list((tmp_path / name).iterdir()) == []
    assert len(list(tmp_path.iterdir())) == len(given) + 1


def test_names_of_a_sequence_are_no_markup(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    from farside.clients import replay

    class Named:
        name, fps, source_names, frame_count = "[red]a[/] [/b] 100%", 30.0, ("v0",), 1

    async def ask(*given: object) -> None:
        return None

    monkeypatch.setattr(replay, "open_recording", lambda *_: Named())
    monkeypatch.setattr(replay, "persist", ask)
    monkeypatch.setenv("COLUMNS", "200")
    replay.command(Path("x"), "http://127.0.0.1:1")
    assert "[red]a[/] [/b] 100%" in capsys.readouterr().err
