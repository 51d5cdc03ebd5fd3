"""Other programs that read glTF: three.js in Debian's chromium, and Khronos' validator, both fetched by npm."""

from __future__ import annotations

import atexit
import base64
import functools
import io
import json
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from farside.engine.rig.camera import Camera, Perspective
from PIL import Image

__all__ = ["Viewer", "complaints", "viewer"]

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = (
    "--headless --no-sandbox --use-angle=swiftshader --enable-unsafe-swiftshader --disable-quic --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync"
)
PACKAGES = ("three@0.187.0", "gltf-validator@2.0.0-dev.3.10")
LOAD_MS = 120_000
SITE = "http://model.test"  # nothing is asked of a network: all of it is answered here

PAGE = """<!doctype html><html><head><meta charset="utf-8"><style>body { margin: 0 }</style>
<script type="importmap">{"imports": {"three": "/three/build/three.module.js"}}</script>
<script type="module">
import * as THREE from "three";
import { GLTFLoader } from "/three/examples/jsm/loaders/GLTFLoader.js";
const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
document.body.append(renderer.domElement);
const data = await (await fetch("/model.glb")).arrayBuffer();
const model = await new GLTFLoader().parseAsync(data, "");
const scene = new THREE.Scene();
scene.background = new THREE.Color(1, 0, 1);
scene.add(model.scene);
globalThis.show = ({ width, height, matrix, frustum, background }) => {
  scene.background.setRGB(...background);
  renderer.setSize(width, height, false);
  const camera = new THREE.PerspectiveCamera();
  new THREE.Matrix4().fromArray(matrix).decompose(camera.position, camera.quaternion, camera.scale);
  camera.projectionMatrix.makePerspective(...frustum);
  camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
  renderer.render(scene, camera);
  return renderer.domElement.toDataURL("image/png").split(",")[1];
};
globalThis.ready = true;
</script></head><body></body></html>"""

CHECK = """
const validator = require("gltf-validator"), fs = require("fs");
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1])), { maxIssues: 0 })
  .then((report) => console.log(JSON.stringify(report)), (error) => { console.error(error); process.exit(1); });
"""


@functools.cache
def fetched() -> Path | str:
    """The folder of the fetched packages, or why there is none."""
    if shutil.which("npm") is None:
        return "there is no npm (apt-get install npm)"
    folder = Path(tempfile.mkdtemp(prefix="farside-three-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    options = "--no-save --no-package-lock --no-audit --no-fund --ignore-scripts --fetch-retries=0"
    command = ["npm", "install", *options.split(), "--prefix", folder, *PACKAGES]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        return f"npm cannot fetch {', '.join(PACKAGES)}: {done.stderr.strip().splitlines()[0]}"
    return folder / "node_modules"


def node_modules() -> Path:
    """The folder of the fetched packages; skips the test where npm is missing or cannot fetch them."""
    found = fetched()
    if isinstance(found, str):
        pytest.skip(found)
    return found


def complaints(glb: bytes, folder: Path) -> list[dict[str, Any]]:
    """All that Khronos' validator says about a file: errors, warnings, information and hints."""
    path = folder / "checked.glb"
    path.write_bytes(glb)
    done = subprocess.run(
        ["node", "-e", CHECK, str(path)], capture_output=True, text=True, check=True, cwd=node_modules().parent
    )
    issues = json.loads(done.stdout)["issues"]
    assert not issues["truncated"]
    messages: list[dict[str, Any]] = issues["messages"]
    return messages


class Viewer:
    """A model on a canvas of three.js."""

    def __init__(self, page: Any) -> None:
        self._page = page

    def picture(self, camera: Camera, background: tuple[float, float, float] = (1.0, 0.0, 1.0)) -> np.ndarray:
        """What a perspective camera sees, uint8 [h, w, 3], as the canvas holds it; `background`: linear light."""
        lens = camera.projection
        assert isinstance(lens, Perspective)
        near, far = 0.02, 200.0  # metres
        left_right = [-lens.cx / lens.fx, (lens.width - lens.cx) / lens.fx]
        sides = [*left_right, lens.cy / lens.fy, (lens.cy - lens.height) / lens.fy]
        gltf_from_world = np.array([[0, -1, 0], [0, 0, 1], [-1, 0, 0.0]])
        forward, left, up = camera.pose.rotation().T
        matrix = np.eye(4)
        matrix[:3, :3] = gltf_from_world @ np.stack([-left, up, -forward], axis=-1)
        matrix[:3, 3] = gltf_from_world @ np.array(camera.pose.position)
        data = self._page.evaluate("show", {
            "width": lens.width, "height": lens.height, "matrix": matrix.T.reshape(-1).tolist(),
            "frustum": [*(near * side for side in sides), near, far], "background": list(background),
        })  # fmt: skip
        with Image.open(io.BytesIO(base64.b64decode(data))) as image:
            return np.asarray(image.convert("RGB"))


@contextmanager
def viewer(glb: bytes) -> Iterator[Viewer]:
    """three.js with a model, in a browser; skips the test where there is no browser."""
    sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if not CHROMIUM.exists():
        pytest.skip(f"there is no {CHROMIUM} (apt-get install chromium)")
    modules, problems = node_modules(), []

    def answer(route: Any) -> None:
        path = route.request.url.removeprefix(SITE)
        if path == "/":
            route.fulfill(body=PAGE, content_type="text/html")
        elif path == "/model.glb":
            route.fulfill(body=glb, content_type="model/gltf-binary")
        elif path.startswith("/three/"):
            route.fulfill(path=modules / path[1:], content_type="text/javascript")
        else:
            route.fulfill(status=404)

    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS.split())
        page = browser.new_page()
        page.set_default_timeout(LOAD_MS)
        page.on("pageerror", lambda error: problems.append(str(error)))
        page.on("console", lambda message: problems.append(message.text))  # three.js is silent if nothing is wrong
        page.route("**/*", answer)
        page.goto(SITE + "/")
        page.wait_for_function("globalThis.ready")
        yield Viewer(page)
        browser.close()
    assert problems == []
