"""The image's install steps, run as they stand in the Dockerfile, in a fresh copy of the project.

No Docker engine is needed: the steps are the README's, and use nothing of the image but Python.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import urlsplit

import pytest
from farside.clients.cli import COMMANDS
from farside.engine.compiling.pool import Progress
from farside.engine.support.cpu_level import cpu_level
from farside.server.settings import ServerSettings
from support.certificates import make_certificates
from support.checkout import ROOT, copy_checkout
from support.doubles import FakeCore
from support.serving import running

DOCKERFILE = (ROOT / "docker" / "Dockerfile").read_text()
COMPOSE = (ROOT / "docker" / "compose.yaml").read_text()


def steps(instruction: str) -> list[str]:
    """The arguments of all instructions of this kind, with continued lines joined."""
    text = re.sub(r"\\\n\s*", " ", DOCKERFILE)
    return re.findall(rf"^{instruction} (.*)$", text, re.MULTILINE)


@pytest.fixture(scope="module")
def image(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder in the state of the image's WORKDIR after its RUN steps."""
    assert steps("COPY") == [". ."]
    folder = copy_checkout(tmp_path_factory.mktemp("image") / "farside")
    assert steps("RUN")
    few = {"LEVELS": cpu_level(), "USES": "synth"}  # all kernels of both levels take minutes
    for step in steps("RUN"):
        done = subprocess.run(
            ["sh", "-c", step], cwd=folder, env=os.environ | few, capture_output=True, text=True, timeout=600
        )
        assert done.returncode == 0, f"{step}\n{done.stdout}\n{done.stderr}"
    yield folder
    shutil.rmtree(folder)  # an environment with all its packages is large


def in_image(image: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    (entry,) = map(json.loads, steps("ENTRYPOINT"))
    return subprocess.run([*entry, *arguments], cwd=image, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize("secure", [False, True])
@pytest.mark.parametrize("state", ["ready", "compiling", "absent"])
def test_the_health_check_waits_for_a_server_that_is_ready_and_asks_no_proxy(
    state: str, secure: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (check,) = steps("HEALTHCHECK")
    python, script = json.loads(check.partition("CMD ")[2])
    assert python == ".venv/bin/python"
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
    progress = Progress(2, 2 + (state == "compiling"))
    kernels = SimpleNamespace(progress=progress, first=progress, start=list, stop=list)
    given = {"host": "localhost"}
    if secure:
        files = make_certificates(tmp_path)
        given |= {"ssl_certfile": str(files.certificate), "ssl_keyfile": str(files.key)}
        monkeypatch.setenv("FARSIDE_SSL_CERTFILE", str(files.certificate))
    with running(FakeCore, kernels, **given) as url:
        monkeypatch.setenv("FARSIDE_PORT", "9" if state == "absent" else str(urlsplit(url).port))
        done = subprocess.run([sys.executable, ROOT / script], capture_output=True, timeout=60)
    assert (done.returncode == 0) is (state == "ready"), done.stderr


def test_install_steps_are_the_readmes() -> None:
    assert steps("RUN")[0] in (ROOT / "README.md").read_text()


def test_kernels_are_in_the_image_and_nothing_is_written_there(image: Path, tmp_path: Path) -> None:
    """As the compose file runs it: nothing but a volume is writable, and there is no home."""
    assert "read_only: true" in COMPOSE
    code = (
        "from farside.engine.compiling.pool import Compiling as C; c = C(['synth']); c.start(); print(c.finished)\n"
        "from farside.engine.support.kernel_folders import base_folder; print(base_folder())"
    )
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("NUMBA_", "XDG_", "_FARSIDE"))}
    nowhere = kept | {"HOME": "/dev/null/x"}
    done = subprocess.run([".venv/bin/python", "-c", code], cwd=image, env=nowhere, capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("True\nNone\n", "")
    made = subprocess.run(
        [".venv/bin/farside", "synth", "museum", tmp_path / "museum", "--scale", "0.02", "--frames", "1"],
        cwd=image, env=nowhere, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert made.returncode == 0, made.stderr


def test_only_this_machine_reaches_the_composed_server_by_default() -> None:
    assert re.findall(r'ports: \["(.*)"\]', COMPOSE) == ["${FARSIDE_PUBLISH:-127.0.0.1}:8765:8765"]
    assert steps("USER") == ["1000:1000"]
    assert steps("STOPSIGNAL") == ["SIGTERM"]


def test_a_composed_server_has_time_to_save_its_model() -> None:
    *others, server = [int(seconds) for seconds in re.findall(r"stop_grace_period: (\d+)s", COMPOSE)]
    assert server >= ServerSettings(model="room.farside").ending_s + 1.0  # `serve.stop_within` adds a second
    assert min(others) >= ServerSettings().ending_s + 1.0
    assert f"--stop-timeout {server}" in DOCKERFILE


def test_the_composed_twin_is_made_once(image: Path) -> None:
    (entry,) = re.findall(r"entrypoint: (\[.*\])", COMPOSE)
    shell, option, line = json.loads(entry)
    quick = line.replace("--scale 0.25 --frames 60", "--scale 0.02 --frames 1")
    assert quick != line
    for made in ("24 source views", ""):
        done = subprocess.run([shell, option, quick], cwd=image, capture_output=True, text=True, timeout=300)
        assert done.returncode == 0, done.stderr
        assert made in done.stdout
        assert bool(made) == bool(done.stdout)


def test_entry_point_runs(image: Path) -> None:
    done = in_image(image, "--help")
    assert done.returncode == 0, done.stderr
    for name in COMMANDS:
        assert f" {name} " in done.stdout


def test_kernels_run_on_tbb_there(image: Path, tmp_path: Path) -> None:
    """A parallel kernel works after the install, so the threading layer has been installed, too."""
    video = tmp_path / "a.yuv"
    video.write_bytes(bytes(range(96)))
    done = in_image(image, "compare", str(video), str(video), "--size", "8x8", "--format", "yuv420p")
    assert done.returncode == 0, done.stderr
    assert "66.19" in done.stdout  # 10 log10(64 255^2)


def test_commands_of_image_and_compose_file_exist(image: Path) -> None:
    commands = [json.loads(match) for match in re.findall(r"command: (\[.*\])", COMPOSE)]
    commands += [json.loads(step) for step in steps("CMD")]
    assert {command[0] for command in commands} >= {"serve", "replay"}
    for name, *arguments in commands:
        done = in_image(image, name, "--help")
        assert done.returncode == 0, done.stderr
        for option in arguments:
            assert not option.startswith("--") or option in done.stdout, (name, option)
