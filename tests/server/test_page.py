"""The page in a browser: it shows the stream, keys move the head, a lost server is told."""

from __future__ import annotations

import asyncio
import base64
import io
import math
import ssl
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar
from urllib.parse import quote

import numpy as np
import pytest
from farside.clients.connection import connect
from farside.engine.compiling.pool import Progress
from farside.engine.live.core import Updated
from farside.engine.rig.camera import Pose
from farside.engine.rig.viewer import StereoView
from farside.server.pictures import encode_view
from farside.server.protocol import FrameDone, SourceHello
from PIL import Image
from support.certificates import make_certificates
from support.doubles import CAMERAS, Cores, FakeCore, a_frame
from support.proxy import reverse_proxy
from support.serving import running

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync"
)
HANG_MS, POLL_MS = 60_000, 5
sync_api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
pytestmark = pytest.mark.skipif(not CHROMIUM.exists(), reason=f"there is no {CHROMIUM} (apt-get install chromium)")


FORWARD_M = 0.2  # that the head is moved by, at least
RADIANS_A_PIXEL = 0.004  # that the mouse turns it by
BRIGHTER = 255 / 876  # of a screen, for a luma code


def shade(pose: Pose) -> float:
    """Luma in the middle of a picture: the farther forward and the more to the left, the brighter."""
    ahead = pose.rotation()[:, 0]
    return 500 + 200 * math.tanh(2 * pose.position[0]) + 100 * math.atan2(ahead[1], ahead[0])


class Ramp(FakeCore):
    """Pictures whose brightness follows the head: the page's picture tells where the head is."""

    def paint(self, view: StereoView):
        eyes = super().paint(view)
        for eye in eyes:
            ramp = np.linspace(-60, 60, view.left.width).astype(np.int64)
            eye.y[:] = np.clip(int(shade(view.pose)) + ramp, 64, 940)
        return eyes


@contextmanager
def playing(url: str, token: str = "") -> Iterator[None]:
    """A source that sent one frame and stays."""
    ready, stop = threading.Event(), threading.Event()

    async def source() -> None:
        async with connect(url, SourceHello("walls", 30.0, CAMERAS, token)) as (peer, _):
            for view in a_frame(6).views:
                await peer.send(encode_view(view, 6))
            await peer.receive(FrameDone)
            ready.set()
            await asyncio.to_thread(stop.wait, HANG_MS / 1000)

    thread = threading.Thread(target=lambda: asyncio.run(source()))
    thread.start()
    try:
        assert ready.wait(HANG_MS / 1000)
        yield
    finally:
        stop.set()
        thread.join()


@pytest.fixture
def page() -> Iterator[sync_api.Page]:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS.split())
        page = browser.new_page(viewport={"width": 800, "height": 600}, ignore_https_errors=True)
        page.set_default_timeout(HANG_MS)
        yield page
        browser.close()


def shot(page: sync_api.Page) -> np.ndarray:
    """The canvas' content, as the page holds it."""
    data = page.evaluate("document.getElementById('picture').toDataURL().split(',')[1]")

    with Image.open(io.BytesIO(base64.b64decode(data))) as image:
        return np.asarray(image.convert("L")).astype(int)


def wait_shown(page: sync_api.Page, pictures: int) -> None:
    page.wait_for_function(f"globalThis.farside?.seen >= {pictures}")


def test_it_shows_the_stream_and_keys_and_mouse_move_the_head(page: sync_api.Page) -> None:
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    cores = Cores(Ramp)
    with running(cores) as url, playing(url):
        page.goto(url)
        wait_shown(page, 3)
        wait_size(page)
        first = settled(page)
        size = shown_size(page)
        assert first.shape == size
        assert first.std() > 5  # a ramp, not a blank
        assert "frame 6" in page.text_content("#figures")
        assert page.text_content("#message") == ""

        (core,) = cores.made
        start = core.rendered[-1].pose

        page.keyboard.down("KeyW")
        for _ in range(HANG_MS // POLL_MS):  # the page's events are handled meanwhile
            if core.rendered[-1].pose.position[0] >= start.position[0] + FORWARD_M:
                break
            page.wait_for_timeout(POLL_MS)
        page.keyboard.up("KeyW")
        forward = settled(page)
        there = core.rendered[-1].pose
        assert there.position[0] >= start.position[0] + FORWARD_M
        assert there.position[1:] == pytest.approx(start.position[1:], abs=1e-9)
        assert forward.mean() - first.mean() == pytest.approx(BRIGHTER * (shade(there) - shade(start)), abs=1.5)

        page.click("#home")
        assert abs(settled(page).mean() - first.mean()) < 1
        page.mouse.move(400, 300)
        page.mouse.down()
        page.mouse.move(500, 300, steps=5)  # the scene is dragged to the right: the head turns to the left
        page.mouse.up()
        turned = settled(page)
        ahead = core.rendered[-1].pose.rotation()[:, 0]
        assert math.atan2(ahead[1], ahead[0]) == pytest.approx(100 * RADIANS_A_PIXEL, abs=1e-6)
        brighter = BRIGHTER * (shade(core.rendered[-1].pose) - shade(start))
        assert turned.mean() - first.mean() == pytest.approx(brighter, abs=1.5)

        page.select_option("#eyes", "both")
        wait_size(page)
        assert shown_size(page) == size  # side by side in the same place
        page.set_viewport_size({"width": 500, "height": 700})
        wait_size(page)
        page.set_viewport_size({"width": 2400, "height": 1800})  # more pixels than are worth their time
        page.wait_for_function("farside.size.split('x').reduce((a, b) => a * b) > 1.2e6")
        rows, columns = settled(page).shape
        assert rows * columns <= 2 * 1280 * 960 * 1.01
        assert columns / rows == pytest.approx(2400 / shown_size(page)[0], rel=0.01)
        assert page.text_content("#message") == ""
    assert problems == []


def shown_size(page: sync_api.Page) -> tuple[int, int]:
    """Rows and columns of the place where pictures are shown, rounded as pictures are (an eye's to even numbers)."""
    box = page.evaluate("(({width, height}) => [width, height])(farside.canvas.getBoundingClientRect())")
    eyes = 2 if page.evaluate("document.getElementById('eyes').value") == "both" else 1
    return 2 * round(box[1] / 2), eyes * 2 * round(box[0] / eyes / 2)


def wait_size(page: sync_api.Page) -> None:
    """Returns when pictures have the size of the place where they are shown."""
    for _ in range(HANG_MS // POLL_MS):
        if shot(page).shape == shown_size(page):
            return
        page.wait_for_timeout(POLL_MS)
    assert shot(page).shape == shown_size(page)


def settled(page: sync_api.Page) -> np.ndarray:
    """The canvas after a few more pictures: no older pose is under way."""
    wait_shown(page, page.evaluate("farside.seen") + 4)
    return shot(page)


def test_a_server_that_goes_is_told_and_found_again(page: sync_api.Page) -> None:
    with running(Ramp) as url, playing(url):
        page.goto(url)
        wait_shown(page, 1)
    page.wait_for_function("document.getElementById('message').textContent.includes('no connection')")
    assert page.get_attribute("#message", "class") == "problem"
    port = int(url.rsplit(":", 1)[1])
    with running(Ramp, port=port) as again, playing(again):
        page.wait_for_function("document.getElementById('message').textContent === ''")
        wait_shown(page, 2)


def test_a_refusal_is_shown(page: sync_api.Page) -> None:
    with running(Ramp, token="sesame") as url:
        page.goto(f"{url}/?token=wrong")
        message = "token: another: expected the server's token"
        page.wait_for_function(f"document.getElementById('message').textContent.includes(\"{message}\")")
        page.goto(f"{url}/?token=sesame")
        page.wait_for_function("document.getElementById('message').textContent === 'waiting for a source'")


TOKEN = "a b&c#d%e+f\"'ü"


@pytest.mark.parametrize(("keep", "told"), [(True, True), (False, False)], ids=["keeps", "strips untold"])
@pytest.mark.parametrize("slash", ["/", ""])
@pytest.mark.parametrize("secure", [False, True], ids=["http", "https"])
def test_it_works_under_a_path_of_a_proxy(
    page: sync_api.Page, keep: bool, told: bool, slash: str, secure: bool, tmp_path: Path
) -> None:
    problems: list[str] = []
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("requestfailed", lambda request: problems.append(f"{request.url}: {request.failure}"))
    page.on("response", lambda answer: problems.extend([f"{answer.url}: {answer.status}"] * (answer.status >= 400)))
    tls = None
    if secure:
        files, tls = make_certificates(tmp_path), ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        tls.load_cert_chain(files.certificate, files.key)
    given = {"token": TOKEN} | ({"root_path": "/far/side"} if told else {})
    with (
        running(Ramp, **given) as url,
        playing(url, TOKEN),
        reverse_proxy(url, "/far/side", keep=keep, tls=tls) as proxy,
    ):
        page.goto(f"{proxy}/far/side{slash}?token={quote(TOKEN, safe='')}")
        wait_shown(page, 3)
        assert page.evaluate("location.pathname") == "/far/side/"
        assert page.text_content("#message") == ""
        assert shot(page).std() > 5
        page.goto("about:blank")
    if not slash and not told:  # the browser has asked for what the page names before the page has gone on
        problems = [problem for problem in problems if not problem.startswith(f"{proxy}/far/page/")]
    assert problems == []


CONNECTS = """address => new Promise(end => {
    const socket = new WebSocket(address.replace("http", "ws") + "/viewer");
    socket.onopen = () => end(true);
    socket.onerror = () => end(false);
})"""
READS = "address => fetch(address + '/status').then(answer => answer.ok, () => false)"


@pytest.mark.parametrize("allowed", [True, False])
def test_a_page_of_another_origin_connects_and_reads_only_if_it_is_allowed(page: sync_api.Page, allowed: bool) -> None:
    with running(Ramp) as other, running(Ramp, allowed_origins=other if allowed else "https://a.example") as url:
        page.goto(f"{other}/page/style.css")
        assert page.evaluate(CONNECTS, url) is allowed
        assert page.evaluate(READS, url) is allowed
        assert page.evaluate(CONNECTS, other)
        assert page.evaluate(READS, other)


def test_it_is_served_with_a_certificate(page: sync_api.Page, tmp_path: Path) -> None:
    files = make_certificates(tmp_path)
    given = {"ssl_certfile": str(files.certificate), "ssl_keyfile": str(files.key)}
    with running(Ramp, **given) as url:
        page.goto(url)
        page.wait_for_function("document.getElementById('message').textContent === 'waiting for a source'")


class Kernels:
    """Kernels on their way, as far as a test says; the first picture needs eight of them."""

    def __init__(self) -> None:
        self.progress, self.first, self.ended = Progress(3, 20), Progress(3, 8), 0

    def start(self) -> None:
        self.ended -= 1

    def stop(self) -> None:
        self.ended += 1


def test_until_the_first_picture_it_says_what_it_waits_for(page: sync_api.Page) -> None:
    def wait_said(text: str) -> None:
        page.wait_for_function("text => document.getElementById('message').textContent === text", arg=text)

    kernels, told = Kernels(), ["making the sequence: 3 of 8 views"]
    with running(Cores(Ramp), kernels, lambda: told[0]) as url:
        page.goto(url)
        wait_said("compiling kernels for the first picture: 3 of 8 (the first time only)")
        kernels.first = Progress(7, 8)
        wait_said("compiling kernels for the first picture: 7 of 8 (the first time only)")
        kernels.first = Progress(8, 8)
        wait_said("making the sequence: 3 of 8 views")
        told[0] = ""
        wait_said("waiting for a source")
        with playing(url):
            wait_shown(page, 1)
            wait_said("")
    assert kernels.ended == 0


class Unmodelled(Ramp):
    """A core whose model begins when a test says so."""

    triangles: ClassVar[dict[str, int]] = {}

    def update(self, *given: Any) -> Updated:
        updated = super().update(*given)
        return replace(updated, status=updated.status | {"background": self.triangles})


def test_until_there_is_a_model_it_says_what_that_waits_for(page: sync_api.Page) -> None:
    kernels = Kernels()
    kernels.first, kernels.progress = Progress(8, 8), Progress(9, 20)
    with running(Cores(Unmodelled), kernels) as url, playing(url):
        page.goto(url)
        for ready in (9, 19):
            kernels.progress = Progress(ready, 20)
            text = f"no background model yet: compiling kernels, {ready} of 20"
            page.wait_for_function("text => document.getElementById('message').textContent === text", arg=text)
        kernels.progress = Progress(20, 20)
        page.wait_for_function("document.getElementById('message').textContent === ''")
    wait_shown(page, 1)
