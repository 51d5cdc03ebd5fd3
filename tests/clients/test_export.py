"""What `farside export` receives from a server is whole, or an error."""

from __future__ import annotations

import io
from email.message import Message

import pytest
from farside.clients.export import _received
from rich.progress import Progress


class Answer(io.BytesIO):
    """A server's answer of a length that it announced."""

    def __init__(self, data: bytes, announced: int) -> None:
        super().__init__(data)
        self.headers = Message()
        self.headers["Content-Length"] = str(announced)


def test_an_answer_that_ends_too_early_is_an_error() -> None:
    data = bytes(3 << 20)
    bar = Progress(disable=True)
    task = bar.add_task("", total=None)
    assert _received(Answer(data, len(data)), bar, task) == data
    assert (bar.tasks[0].completed, bar.tasks[0].total) == (len(data), len(data))
    with pytest.raises(ConnectionError, match=f"the server's answer: {len(data)} bytes: expected {len(data) + 5}"):
        _received(Answer(data, len(data) + 5), bar, task)
