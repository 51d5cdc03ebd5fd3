"""Answers over HTTP as proxies pass them on: without a length, in chunks, cut short, or in another protocol."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from farside.clients.fetching import fetch

HANG_S = 30.0
OK = b"HTTP/1.1 200 OK\r\n"


@contextmanager
def answering(answer: bytes) -> Iterator[str]:
    """The address of what answers one request with these bytes, whatever it is asked."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve() -> None:
            with listening.accept()[0] as client:
                client.recv(1 << 16)
                client.sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        yield f"http://127.0.0.1:{listening.getsockname()[1]}"
        thread.join(HANG_S)


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        (OK + b"Content-Length: 5\r\n\r\nabcde", [(0, 5), (5, 5)]),
        (OK + b"Content-Length: 0\r\n\r\n", [(0, 0)]),
        (OK + b"Connection: close\r\n\r\nabcde", [(0, 0), (5, 5)]),
        (OK + b"Transfer-Encoding: chunked\r\n\r\n2\r\nab\r\n3\r\ncde\r\n0\r\n\r\n", [(0, 0), (5, 5)]),
    ],
    ids=["length", "empty", "no length", "chunks"],
)
def test_a_body_is_whole_with_or_without_a_length(answer: bytes, told: list[tuple[int, int]]) -> None:
    seen: list[tuple[int, int]] = []
    with answering(answer) as url:
        body = fetch(url, "mesh.glb", timeout_s=HANG_S, progress=lambda done, total: seen.append((done, total)))
    assert body == (b"" if told == [(0, 0)] else b"abcde")
    assert seen == told


@pytest.mark.parametrize(
    "answer",
    [
        OK + b"Content-Length: 6\r\n\r\nabcde",
        OK + b"Transfer-Encoding: chunked\r\n\r\n9\r\nabcde",
        b"\x15\x03\x03\x00\x02\x02\x46",  # TLS
        b"",
    ],
    ids=["cut", "cut chunk", "another protocol", "nothing"],
)
def test_what_is_no_whole_answer_is_told(answer: bytes) -> None:
    with answering(answer) as url, pytest.raises(ConnectionError):
        fetch(url, "mesh.glb", timeout_s=HANG_S)
