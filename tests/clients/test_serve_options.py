"""Options of `serve` and variables FARSIDE_*: a wrong value is told at the start, with its name and what is right."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from farside.clients import cli, serve
from farside.clients.serve import server_settings
from farside.server.environment import read_variables
from farside.server.settings import ServerSettings
from support.certificates import Certificates, make_certificates

# Field: values that it cannot have, and a part of what is expected.
WRONG: dict[str, tuple[list[str], str]] = {
    "host": ([",", " ", "no such host", "nohost.invalid", "192.0.2.7", "300.1.1.1", "[::1"], "this machine"),
    "port": (["-1", "65536", "8e3", "http", "80.5", "tcp"], "65535"),
    "token": (["\udcff"], "text"),
    "root_path": (["farside", "//farside", "/a//b", "/a?b", "/a#b", "/a b", "https://b.org/farside"], "like /farside"),
    "allowed_hosts": (["http://a.example", "a/b", "a b", "a.example,b?", "@", "a:port"], "names like farside.example"),
    "allowed_origins": (
        ["a.example", "https://", "https://a.example/path", "https://a:b@c", "https://a.example,x", "https://*"],
        "origins like https://example.org",
    ),
    "ssl_certfile": (["/no/such/file", "/", "/dev/null", "\0"], "a PEM file"),
    "ssl_keyfile": (["/no/such/file"], "only with a certificate"),
    "quality": (["poor", "Fast", "paper "], "fast, balanced, best or paper"),
    "views": (["0", "-1", "2.5", "all", "1e3", "99999999999999999999"], "1 or more"),
    "init": (["0", "-1", "2.5", "all"], "1 or more"),
    "update": (["0", "-1", "2.5", "all"], "1 or more"),
    "update_interval": (["0", "-1", "0.5", "never"], "1 or more"),
    "output_scale": (["0", "-1", "4.1", "nan", "inf", "half"], "0.05 to 4"),
    "background": (["maybe", "2"], "true or false"),
    "draw_moving": (["maybe", "2"], "true or false"),
    "viewing_space": (["0 0 0 -1", "0 0 nan 1", "0 0 0 inf", "0 0 0", "0 0 0 1 1", "a b c d", "[0, 0", "{}"], "radius"),
    "light": (["-1", "nan", "inf", "slow"], "0 or more seconds"),
    "cull_stale": (["maybe", "2"], "true or false"),
    "middle_layers": (["-1", "2.5", "all"], "0 or more"),
    "late_rounds": (["-1", "101", "1.5", "none"], "0 to 100"),
    "model": (["/no/folder/room.farside", "/"], "a file in a folder that exists"),
    "save_interval_s": (["0", "-1", "nan", "inf", "1e9", "1min"], "seconds"),
    "seed_model": (["/no/such/file", "/"], "a file, a saved model or GLB"),
    "jpeg_quality": (["0", "101", "-1", "high", "90.5"], "1 to 100"),
    "target_fps": (["0", "-3", "1001", "nan", "inf", "fast"], "above 0 and at most 1000"),
    "longest_update_s": (["0", "-1", "nan", "inf", "1e9", "5s"], "seconds"),
    "render_workers": (["0", "65", "-1", "two"], "1 to 64"),
    "max_viewers": (["0", "-1", "2.5", "many"], "1 or more"),
    "max_message_bytes": (["0", "65535", "1e30", "1GB", str(1 << 64)], "65536 or more"),
    "max_queries": (["0", "-1", "2.5", "many"], "1 or more"),
    "max_query_bytes": (["0", "1023", "1e30", "1MB", str(1 << 31)], "1024 or more"),
    "hello_timeout_s": (["0", "-1", "nan", "inf", "1e9"], "seconds"),
    "shutdown_timeout_s": (["0", "-1", "nan", "inf", "1e9"], "seconds"),
    "log_level": (["loud", "INFO", "0"], "critical, error, warning, info or debug"),
}
PARAMETERS = {"allow_host": "allowed_hosts", "allow_origin": "allowed_origins"}  # of `serve`; others have fields' names
OPTIONS = [PARAMETERS.get(name, name) for name in inspect.signature(serve.command).parameters]
Said = tuple[int, str]


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Said]:
    """The exit code of `farside serve` with arguments, and what it says on stderr."""
    for name in [name for name in os.environ if name.upper().startswith("FARSIDE_")]:
        monkeypatch.delenv(name)
    monkeypatch.setattr(cli, "end_soon", lambda: None)  # the signals of this process stay as they are
    monkeypatch.setattr(serve, "run", lambda server, listening: None)
    monkeypatch.setenv("COLUMNS", "1000")
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setenv("TERM", "dumb")

    def start(*arguments: str) -> Said:
        monkeypatch.setattr(sys, "argv", ["farside", "serve", *arguments])
        with pytest.raises(SystemExit) as caught:
            cli.main()
        return caught.value.code, capsys.readouterr().err

    return start


def test_the_table_has_every_setting_and_every_option() -> None:
    assert WRONG.keys() == ServerSettings.model_fields.keys()
    assert set(OPTIONS) <= WRONG.keys()


def as_numbers(parts: list[str]) -> set[str]:
    """How Python writes what the command line makes of these arguments, where it takes numbers."""
    written = set()
    with suppress(ValueError):
        written.add(repr(tuple(map(float, parts))))
    for number in (int, float):
        with suppress(ValueError):
            written.add(repr(number(parts[0])))
    return written


@pytest.mark.parametrize("field", [field for field in OPTIONS if field != "background"])  # a flag has no value
def test_a_wrong_value_of_an_option_is_told_before_anything_starts(field: str, started: Callable[..., Said]) -> None:
    values, expected = WRONG[field]
    option = {"allowed_hosts": "--allow-host", "allowed_origins": "--allow-origin"}.get(
        field, "--" + field.replace("_", "-")
    )
    for value in values:
        parts = value.split() if field == "viewing_space" else [value]
        code, said = started("--port", "0", option, *parts)
        assert code == 2, (value, said)
        assert option in said or "unexpected extra argument" in said or "requires 4" in said, (value, said)
        if said.startswith("farside: "):  # our check; else it was no number
            shown = said.removeprefix(f"farside: {option}: ").partition(": expected ")[0]
            assert shown in {repr(value)} | as_numbers(parts), (value, said)
            assert said.count("\n") == 1
            assert expected in said
        else:
            assert "Usage: " in said or "Error" in said


@pytest.mark.parametrize("field", WRONG)
def test_a_wrong_value_of_a_variable_names_the_variable(
    field: str, started: Callable[..., Said], monkeypatch: pytest.MonkeyPatch
) -> None:
    values, expected = WRONG[field]
    variable = f"FARSIDE_{field.upper()}"
    if field != "port":
        monkeypatch.setenv("FARSIDE_PORT", "0")
    for value in values:
        if "\0" in value:
            continue  # no variable can hold it
        monkeypatch.setenv(variable, value)
        code, said = started()
        assert code == 2, (value, said)
        assert said == f"farside: {variable}: {value!r}: expected {said.partition(': expected ')[2]}"
        assert expected in said


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--quality", "paper", "--target-fps", "30"), "--quality: 'paper': expected one of fast, balanced, best"),
        (("--viewing-space", "1", "2", "3", "-4"), "--viewing-space: (1.0, 2.0, 3.0, -4.0): expected x, y, z and a "),
    ],
)
def test_values_that_do_not_go_together_are_told(
    arguments: tuple[str, ...], says: str, started: Callable[..., Said]
) -> None:
    code, said = started("--port", "0", *arguments)
    assert (code, said.startswith(f"farside: {says}")) == (2, True), said


RIGHT: dict[str, list[tuple[str, Any]]] = {
    "host": [("::1", "::1"), ("localhost,127.0.0.1", "localhost,127.0.0.1")],
    "port": [("0", 0), ("65535", 65535)],
    "token": [("a b&c#d%e'\"ü", "a b&c#d%e'\"ü")],
    "root_path": [("/farside", "/farside"), ("/a/b/", "/a/b"), ("/", ""), ("/gr%C3%B6%C3%9Fe", "/größe")],
    "allowed_hosts": [("a.example, b:80,[::1]:5", "a.example, b:80,[::1]:5"), ("*", "*")],
    "allowed_origins": [("https://a.example,http://b:80/,null", "https://a.example,http://b:80/,null"), ("*", "*")],
    "background": [("false", False), ("1", True)],
    "viewing_space": [("0 1 2 3", (0, 1, 2, 3)), ("0,1,2,0", (0, 1, 2, 0)), ("[0, 1, 2, 3.5]", (0, 1, 2, 3.5))],
    "target_fps": [("12.5", 12.5)],
}


@pytest.mark.parametrize("field", RIGHT)
def test_right_values_come_from_the_environment(field: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for value, expected in RIGHT[field]:
        monkeypatch.setenv(f"FARSIDE_{field.upper()}", value)
        assert getattr(server_settings(), field) == expected


def test_settings_come_from_arguments_then_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FARSIDE_VIEWS", "3")
    monkeypatch.setenv("FARSIDE_PORT", "1234")
    monkeypatch.setenv("FARSIDE_HOST", "")  # as compose files have it: not set
    settings = server_settings(port=99, quality="fast", token=None)
    assert (settings.host, settings.port, settings.views, settings.quality) == ("127.0.0.1", 99, 3, "fast")
    assert settings.engine().n_render == 3


# Variables that are none of ours

KUBERNETES = {
    "FARSIDE_SERVICE_HOST": "10.0.0.1",
    "FARSIDE_SERVICE_PORT": "8080",
    "FARSIDE_SERVICE_PORT_HTTP": "8080",
    "FARSIDE_PORT": "tcp://10.0.0.1:8080",
    "FARSIDE_PORT_8080_TCP": "tcp://10.0.0.1:8080",
    "FARSIDE_PORT_8080_TCP_PROTO": "tcp",
    "FARSIDE_PORT_8080_TCP_PORT": "8080",
    "FARSIDE_PORT_8080_TCP_ADDR": "10.0.0.1",
    "FARSIDE_PORT_9_UDP": "udp://10.0.0.1:9",
    "FARSIDE_WEB_SERVICE_HOST": "10.0.0.2",  # of a service called farside-web
    "FARSIDE_WEB_PORT": "tcp://10.0.0.2:80",
    "FARSIDE_HOST_PORT": "sctp://10.0.0.2:80",
}
LINKS = {
    "FARSIDE_NAME": "/web/farside",
    "FARSIDE_ENV_FARSIDE_PORT": "8765",
    "FARSIDE_PORT": "tcp://172.17.0.5:8765",
    "FARSIDE_PORT_8765_TCP_PORT_START": "8765",
}


@pytest.mark.parametrize("environment", [KUBERNETES, LINKS])
def test_variables_of_services_are_ignored_and_told_once(
    environment: dict[str, str], started: Callable[..., Said], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert server_settings().port == 8765
    code, said = started("--port", "0")
    assert code == 0
    assert said.count("\n") == 1
    assert all(name in said for name in environment)
    assert "an orchestrator made them" in said


def test_our_port_stays_ours_among_variables_of_services(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {**KUBERNETES, "FARSIDE_PORT": "9000"}.items():
        monkeypatch.setenv(name, value)
    assert server_settings().port == 9000


@pytest.mark.parametrize(
    ("name", "nearest"),
    [
        ("FARSIDE_PROT", "FARSIDE_PORT"),
        ("FARSIDE_TOKEM", "FARSIDE_TOKEN"),
        ("FARSIDE_ALLOWED_HOST", "FARSIDE_ALLOWED_HOSTS"),
        ("FARSIDE_TARGETFPS", "FARSIDE_TARGET_FPS"),
        ("farside_quallity", "FARSIDE_QUALITY"),
        ("FARSIDE_CAFILE", "FARSIDE_CA_FILE"),
    ],
)
def test_an_unknown_variable_is_told_with_the_nearest_name_and_does_not_stop_anything(
    name: str, nearest: str, started: Callable[..., Said], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, "tcp")
    code, said = started("--port", "0")
    assert (code, said) == (0, f"farside: {name}: ignored: expected the name of a setting, like {nearest}\n")


def test_nothing_is_told_of_what_is_right() -> None:
    ours = {f"FARSIDE_{field.upper()}": "1" for field in ServerSettings.model_fields}
    others = {"FARSIDE_CA_FILE": "x", "FARSIDE": "y", "_FARSIDE_TOLD": "1", "PATH": "/bin", "FARSIDE_": ""}
    found = read_variables(ours | others, ServerSettings.model_fields)
    assert list(found.remarks()) == []
    assert found.values == dict.fromkeys(ServerSettings.model_fields, "1")
    both = read_variables({"farside_port": "1", "FARSIDE_PORT": "2", "FARSIDE_ALLOW_HOST": "a"}, ["port"])
    assert both.values == {"port": "2", "allowed_hosts": "a"}


# TLS


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Certificates:
    return make_certificates(tmp_path_factory.mktemp("certificates"))


def test_a_certificate_and_its_key_are_checked(
    files: Certificates, started: Callable[..., Said], tmp_path: Path
) -> None:
    broken = tmp_path / "broken.pem"
    broken.write_text(files.certificate.read_text().replace("M", "N", 3))
    cut = tmp_path / "cut.pem"
    cut.write_text(files.certificate.read_text()[:200])
    certificate, key = ("--ssl-certfile", str(files.certificate)), "--ssl-keyfile"
    for arguments, says in [
        ((*certificate, key, str(files.other_key)), f"{key}: '{files.other_key}': expected the private key of"),
        ((*certificate, key, str(files.locked_key)), f"{key}: '{files.locked_key}': expected a key without a password"),
        ((*certificate, key, str(files.authority)), f"{key}: '{files.authority}': expected a PEM file with a private"),
        ((*certificate, key, "/no/such"), f"{key}: '/no/such': expected a PEM file with a private key (No such"),
        (certificate, f"{key}: '{files.certificate}': expected the private key of the certificate"),
        (("--ssl-certfile", str(files.key)), f"--ssl-certfile: '{files.key}': expected a PEM file with a certificate"),
        (("--ssl-certfile", str(broken)), f"--ssl-certfile: '{broken}': expected a PEM file with a certificate"),
        (("--ssl-certfile", str(cut)), f"--ssl-certfile: '{cut}': expected a PEM file with a certificate"),
    ]:
        code, said = started("--port", "0", *arguments)
        assert (code, said.startswith(f"farside: {says}")) == (2, True), said
    for arguments in [(*certificate, key, str(files.key)), ("--ssl-certfile", str(files.both))]:
        assert started("--port", "0", *arguments) == (0, "")


def test_a_process_ends_with_2_and_one_line() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "farside.clients.cli", "serve", "--viewing-space", "0", "0", "0", "-1"],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == (
        "farside: --viewing-space: (0.0, 0.0, 0.0, -1.0): expected x, y, z and a radius of 0 or more, metres\n"
    )
