"""A server's answer over HTTP."""

from __future__ import annotations

import base64
import json
import ssl
import urllib.error
import urllib.request
from collections.abc import Callable
from http.client import HTTPException, HTTPResponse
from urllib.parse import unquote

from .address import parse_address, without_secrets
from .connection import RefusedError, distrusted
from .proxies import proxy_of

__all__ = ["fetch"]

_PIECE = 1 << 20  # bytes between two looks at the progress


def fetch(
    url: str, path: str, *, timeout_s: float, tls: ssl.SSLContext | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> bytes:  # fmt: skip
    """What a server at `url` answers under a path, like "status?seconds=1"; `tls`: whom to trust.

    `progress` is called with the bytes received and their total. Raises RefusedError for an error status or a
    certificate that is not trusted, ConnectionError if no server answers or its answer ends too early.
    """
    address, proxy = parse_address(url), proxy_of(url, "http")
    request = urllib.request.Request(f"{address.url('http', user=False)}/{path}")
    if address.user:
        user = unquote(address.user.removesuffix("@")).encode()
        request.add_unredirected_header("Authorization", f"Basic {base64.b64encode(user).decode()}")
    through = urllib.request.ProxyHandler({request.type: proxy} if proxy else {})
    opener = urllib.request.build_opener(through, urllib.request.HTTPSHandler(context=tls))
    try:
        with opener.open(request, timeout=timeout_s) as answer:
            return _received(answer, progress)
    except urllib.error.HTTPError as error:
        with error:
            raise RefusedError(f"refused by the server: {_detail(error.read())} (status {error.code})") from error
    except urllib.error.URLError as error:
        if isinstance(error.reason, ssl.SSLCertVerificationError):
            raise distrusted(url, error.reason) from error
        raise ConnectionError(f"no server at {without_secrets(url)}: {error.reason}") from error
    except HTTPException as error:  # what answers speaks another protocol, or has stopped in the middle
        said = f"{type(error).__name__}: {error}"
        raise ConnectionError(f"no whole answer from {without_secrets(url)}: {said}") from error


def _received(answer: HTTPResponse, progress: Callable[[int, int], None]) -> bytes:
    """The body of an answer. A proxy may leave out its length: then the total is what has come."""
    length, data = answer.headers["Content-Length"], bytearray()
    size = None if length is None else int(length)
    progress(0, size or 0)
    while piece := answer.read(_PIECE):
        data += piece
        progress(len(data), size or len(data))
    if size not in (None, len(data)):
        raise ConnectionError(f"the server's answer: {len(data)} bytes: expected {size}")
    return bytes(data)


def _detail(body: bytes) -> str:
    try:
        return str(json.loads(body)["detail"])
    except (ValueError, KeyError, TypeError):
        return body[:200].decode(errors="replace")
