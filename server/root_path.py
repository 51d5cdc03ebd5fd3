"""The service under a path of another host: behind a proxy that keeps the path in its requests, or strips it."""

from __future__ import annotations

from urllib.parse import quote

from starlette.responses import RedirectResponse
from starlette.types import ASGIApp, Receive, Scope, Send

__all__ = ["RootPath"]


class RootPath:
    """ASGI middleware that takes requests with and without `root` in front of their paths.

    `root` is the path under which clients see the service ("" or like "/farside", percent-decoded). A proxy that
    strips it need not tell, because the page's links are relative. For them its address must end in a slash: the
    address without one is redirected, here where the proxy keeps the path, and by the page itself where it does not.
    A slash at the end of any other path is ignored: a redirect would have to name the address that the client sees.
    """

    def __init__(self, app: ASGIApp, root: str) -> None:
        self._app, self._root = app, root

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on with its path relative to `root` (ASGI's `root_path`)."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
        elif self._root and scope["type"] == "http" and scope["path"] == self._root:
            query = scope["query_string"].decode("latin-1")
            address = f"{quote(self._root)}/" + (f"?{query}" if query else "")
            await RedirectResponse(address, 307)(scope, receive, send)
        else:
            below = scope["path"]
            if below.startswith(f"{self._root}/"):
                below = below[len(self._root) :]
            path = self._root + (below.rstrip("/") or "/")
            await self._app({**scope, "root_path": self._root, "path": path}, receive, send)
