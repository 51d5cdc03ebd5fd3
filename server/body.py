"""Bodies of HTTP requests, which are read only as far as they may be long."""

from __future__ import annotations

from fastapi import HTTPException, Request

__all__ = ["read_body"]


async def read_body(request: Request, most: int) -> bytes:
    """A request's body; HTTPException 413 where it is longer than `most` bytes, of which no more is read."""
    parts, size = [], 0
    async for part in request.stream():
        size += len(part)
        if size > most:
            raise HTTPException(413, f"body: more than {most} bytes: expected at most {most}")
        parts.append(part)
    return b"".join(parts)
