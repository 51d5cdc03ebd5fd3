"""The image's install steps, run as they stand in the Dockerfile, in a fresh copy of the project.

No Docker engine is needed: the steps are the README's, and use nothing of the image but Python.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from farside.clients.cli import COMMANDS
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
    for step in steps("RUN"):
        done = subprocess.run(["sh", "-c", step], cwd=folder, capture_output=True, text=True, timeout=600)
        assert done.returncode == 0, f"{step}\n{done.stdout}\n{done.stderr}"
    yield folder
    shutil.rmtree(folder)  # an environment with all its packages is large


def in_image(image: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    (entry,) = map(json.loads, steps("ENTRYPOINT"))
    return subprocess.run([*entry, *arguments], cwd=image, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize("healthy", [True, False])
def test_the_health_check_asks_the_server_and_no_proxy(healthy: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    (found,) = re.findall(r"test: (\[.*\])", COMPOSE)
    kind, python, *arguments = json.loads(found)
    assert (kind, python) == ("CMD", ".venv/bin/python")
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
    with running(FakeCore, host="localhost") as url:
        port = str(urlsplit(url).port) if healthy else "9"
        code = arguments[1].replace("8765", port)
        done = subprocess.run([sys.executable, arguments[0], code], capture_output=True, timeout=60)
    assert (done.returncode == 0) is healthy, done.stderr


def test_install_steps_are_the_readmes() -> None:
    readme = (ROOT / "README.md").read_text()
    for step in steps("RUN"):
        assert step in readme


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
