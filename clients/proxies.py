"""Through which proxy a server is reached: the environment's, but none for addresses of this machine."""

from __future__ import annotations

import importlib.util
import ipaddress
import socket
import urllib.request
from urllib.parse import urlsplit

from websockets.exceptions import InvalidProxy
from websockets.proxy import parse_proxy

from .address import parse_address

__all__ = ["is_local", "proxy_of", "without_password"]


def proxy_of(url: str, scheme: str) -> str | None:
    """The proxy for a server at `url` that is spoken to by `scheme` (ws or http); None: connect directly.

    It is the first one that the environment names (http_proxy, https_proxy, socks_proxy, all_proxy; ws_proxy and
    wss_proxy for WebSockets), unless no_proxy names the server or the server is on this machine (`is_local`). Raises
    ValueError for a proxy that cannot be used.
    """
    address = parse_address(url)
    if is_local(address.host) or _is_excepted(address.host, address.authority):
        return None
    web_socket = [scheme + "s" if address.secure else scheme, "socks"] if scheme == "ws" else []
    plain = [] if address.secure else ["http"]
    kinds = [*web_socket, "https", *plain, "all"] if scheme == "ws" or address.secure else [*plain, "all"]
    given = urllib.request.getproxies()
    for kind in kinds:
        if proxy := given.get(kind, ""):
            return _usable(kind, proxy, web_socket=scheme == "ws")
    return None


def is_local(host: str) -> bool:
    """Whether a host, without brackets, is this machine or its link: nobody else's proxy can reach it.

    That are loopback, unspecified and link-local addresses, addresses of this machine's interfaces, names under
    localhost, the machine's name, and names without a dot, which only this network knows (other containers).
    """
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        name = host.lower().rstrip(".")
        return "." not in name or name.endswith(".localhost") or name == socket.gethostname().lower()
    if isinstance(address, ipaddress.IPv6Address) and address.ipv4_mapped:
        address = address.ipv4_mapped
    return address.is_loopback or address.is_unspecified or address.is_link_local or _is_interface(address)


def _is_interface(address: ipaddress.IPv4Address | ipaddress.IPv6Address) -> bool:
    """Whether an interface of this machine has the address: only then a socket can have it."""
    family = socket.AF_INET if address.version == 4 else socket.AF_INET6
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.bind((str(address), 0))
    except OSError:
        return False
    return True


def _is_excepted(host: str, authority: str) -> bool:
    """Whether no_proxy names the host: as Python reads it, or by a network that its address is in (10.0.0.0/8)."""
    if urllib.request.proxy_bypass(authority):
        return True
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return False
    return any(_is_in(address, entry.strip()) for entry in urllib.request.getproxies().get("no", "").split(","))


def _is_in(address: ipaddress.IPv4Address | ipaddress.IPv6Address, network: str) -> bool:
    try:
        return address in ipaddress.ip_network(network, strict=False)
    except ValueError:
        return False


def _usable(kind: str, proxy: str, *, web_socket: bool) -> str:
    """A proxy as websockets and urllib take it; raises ValueError, with the variable's name."""
    url = proxy if "://" in proxy else f"{'socks5h' if kind == 'socks' else 'http'}://{proxy}"
    url = f"socks5h{url[5:]}" if url.startswith("socks:") else url
    try:
        scheme = parse_proxy(url).scheme
    except (InvalidProxy, ValueError) as error:
        reason = getattr(error, "msg", error)  # its text has the whole address
        expected = f"a proxy like http://proxy.example:3128 ({reason})"
        raise ValueError(f"{kind}_proxy: {without_password(url)!r}: expected {expected}") from error
    if scheme.startswith("socks") and not (web_socket and importlib.util.find_spec("python_socks")):
        expected = "a proxy by http or https" + (", or the package python-socks" if web_socket else "")
        raise ValueError(f"{kind}_proxy: {without_password(url)!r}: expected {expected}")
    return url


def without_password(url: str) -> str:
    """A proxy's address, for messages."""
    parts = urlsplit(url)
    return f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}"
