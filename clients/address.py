"""A server's address as a user writes it: taken apart, and put together for WebSockets and HTTP."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import SplitResult, parse_qs, quote, unquote, urlsplit

__all__ = ["Address", "base_url", "parse_address", "token_of", "without_secrets"]

_IN_PATHS = "/%:@!$&'()*+,;=~"  # what RFC 3986 lets stand there


@dataclass(frozen=True, slots=True)
class Address:
    """Where a server is: like https://name:password@host:port/path?token=..."""

    secure: bool  # TLS
    host: str  # without brackets; ASCII
    authority: str  # host and port as in a URL, without user information
    user: str  # "name:password@", quoted; or empty
    path: str  # quoted, without a slash at its end
    token: str

    def url(self, scheme: str, user: bool = True) -> str:
        """The address with `scheme` (ws or http; wss or https if it is secure), without token; with `user`, with user
        information."""
        return f"{scheme}{'s' if self.secure else ''}://{self.user if user else ''}{self.authority}{self.path}"


def parse_address(url: str) -> Address:
    """Take an address apart, with or without a scheme; raises ValueError for one that is none."""
    try:
        parts = urlsplit(url.strip() if "://" in url else f"http://{url.strip()}")
        if parts.scheme not in ("http", "https", "ws", "wss") or not parts.hostname:
            raise ValueError
        host = parts.hostname if parts.hostname.isascii() else parts.hostname.encode("idna").decode()
        authority = f"[{host}]" if ":" in host else host
        authority += "" if parts.port is None else f":{parts.port}"
    except ValueError as error:
        raise ValueError(f"url: {url!r}: expected an address like http://127.0.0.1:8765") from error
    token = parse_qs(parts.query).get("token", [""])[0]
    path = quote(parts.path.rstrip("/"), safe=_IN_PATHS)
    return Address(parts.scheme in ("https", "wss"), host, authority, _user(parts), path, token)


def _user(parts: SplitResult) -> str:
    """User information, for a proxy in front of the server that asks for it."""
    if parts.username is None:
        return ""
    name, password = (quote(unquote(text or ""), safe="") for text in (parts.username, parts.password))
    return f"{name}:{password}@"


def without_secrets(url: str) -> str:
    """An address for messages: as it was given, but without token and user information."""
    address = parse_address(url)
    return address.url("http", user=False) if address.token or address.user else url


def base_url(url: str, scheme: str) -> str:
    """The server's address with `scheme` (ws or http; wss or https if `url` is secure); raises ValueError."""
    return parse_address(url).url(scheme)


def token_of(url: str, given: str) -> str:
    """The token in an address as `serve` prints it; else the one that was `given` otherwise. Raises ValueError."""
    return parse_address(url).token or given
