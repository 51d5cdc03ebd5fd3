"""`POST /query`: questions about the background model, as JSON or, for many at once, as msgpack.

A body is read only as far as it may reach, decoded and checked in a worker thread, and answered by the engine's
process, while pictures come first.
"""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np
from farside.engine.live.core import CoreLostError
from farside.engine.rig.questions import NoModelError, Points, Rays, Spheres
from fastapi import HTTPException, Request, Response

from .body import read_body
from .service import Service
from .unpack import unpack

__all__ = ["JSON_BYTES", "answer_query"]

JSON, MSGPACK = "application/json", "application/x-msgpack"
JSON_BYTES = 1 << 18  # of a request: to read more of them as text would hold up pictures


@dataclass(frozen=True, slots=True)
class _Kind:
    """A question: the record that checks its arguments; arrays of three coordinates; lengths, and whether they must be
    there; and its other options, with their types and defaults."""

    check: Callable[..., Any]
    places: tuple[str, ...]
    length: str
    needed: bool = False
    options: Mapping[str, tuple[type, Any]] = field(default_factory=dict)


_KINDS = {
    "rays": _Kind(Rays.of, ("origins", "directions"), "far", options={"farthest": (bool, False)}),
    "free": _Kind(Rays.of, ("origins", "directions"), "far"),
    "closest": _Kind(Points.of, ("points",), "within"),
    "overlaps": _Kind(Spheres.of, ("centres",), "radii", needed=True, options={"listed": (int, 0)}),
}
_LISTED = 4  # triangles listed in an answer, as a multiple of the most spheres that may be asked for
_FLOATS: dict[str, np.dtype[Any]] = {"float32": np.dtype("<f4"), "float64": np.dtype("<f8")}


async def answer_query(service: Service, request: Request) -> Response:
    """The answer to a request. Raises HTTPException: 413 for too much at once, 415 for another type of content, 422 for
    what cannot be asked, 409 before there is a model, 503 when the engine has been lost."""
    kind = request.headers.get("content-type", "").partition(";")[0].strip().lower()
    if kind not in (JSON, MSGPACK):
        raise HTTPException(415, f"content-type: {kind or 'none'}: expected {JSON} or {MSGPACK}")
    most = service.settings.max_query_bytes
    longest = min(most, JSON_BYTES) if kind == JSON else most
    announced = request.headers.get("content-length", "")
    if announced.isdecimal() and int(announced) > longest:
        raise HTTPException(413, f"body: {announced} bytes: expected at most {longest}")
    body = await read_body(request, longest)
    try:
        question, arguments, floats = await asyncio.to_thread(_read, body, kind, service.settings.max_queries)
        answer = await service.live.model.query(question, arguments)
    except NoModelError as error:
        raise HTTPException(409, service.no_model(error)) from error
    except ValueError as error:
        raise HTTPException(422, str(error)) from error
    except CoreLostError as error:
        raise HTTPException(503, str(error)) from error
    return Response(await asyncio.to_thread(_write, answer, kind, floats), media_type=kind)


def _read(body: bytes, kind: str, most: int) -> tuple[str, dict[str, Any], str]:
    """Question, arguments and type of floats of a request. Raises ValueError, which names the field, and HTTPException
    (413) for more than `most` items."""
    fields = _fields(body, kind)
    question, floats = fields.pop("query", None), fields.pop("floats", "float32")
    if not isinstance(question, str) or question not in _KINDS:
        raise ValueError(f"query: {_shown(question)}: expected one of {', '.join(_KINDS)}")
    if not isinstance(floats, str) or floats not in _FLOATS:
        raise ValueError(f"floats: {_shown(floats)}: expected float32 or float64")
    asked, arguments = _KINDS[question], dict[str, Any]()
    names = (*asked.places, asked.length, *asked.options)
    for name in fields:
        if name not in names:
            raise ValueError(f"{_shown(name)}: unknown: expected one of query, floats, {', '.join(names)}")
    for name in asked.places:
        arguments[name] = _array(name, fields.get(name), 3, floats, most)
    length = fields.get(asked.length)
    if length is not None or asked.needed:
        arguments[asked.length] = _lengths(asked.length, length, floats, most)
    for name, (type_, default) in asked.options.items():
        value = fields.get(name, default)
        if type(value) is not type_:
            expected = "true or false" if type_ is bool else "an integer"
            raise ValueError(f"{name}: {_shown(value)}: expected {expected}")
        arguments[name] = value
    corners = arguments.get("listed", 0) * max(len(arguments[name]) for name in asked.places)
    if corners > _LISTED * most:
        raise HTTPException(413, f"listed: {corners} triangles in all: expected at most {_LISTED * most}")
    asked.check(**{name: value for name, value in arguments.items() if name != "farthest"})
    return question, arguments, floats


def _fields(body: bytes, kind: str) -> dict[str, Any]:
    try:
        fields = json.loads(body) if kind == JSON else unpack(body)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"body: {type(error).__name__}: {error}: expected {kind}") from error
    if not isinstance(fields, dict):
        raise ValueError(f"body: {type(fields).__name__}: expected a map")
    return fields


def _array(name: str, value: Any, width: int, floats: str, most: int) -> Any:
    """An array [n, width] (of width 1: [n]) of numbers that were sent as a list or as binary data."""
    shape = f"[n, {width}]" if width > 1 else "[n]"
    if isinstance(value, bytes | memoryview):
        each = width * _FLOATS[floats].itemsize
        if len(value) % each:
            raise ValueError(f"{name}: {len(value)} bytes: expected a multiple of {each}, {floats} {shape}")
        array = np.frombuffer(value, _FLOATS[floats])
        array = array.reshape(-1, width) if width > 1 else array
    elif isinstance(value, list):
        array = _listed(name, value, width, shape)
    else:
        raise ValueError(f"{name}: {'missing' if value is None else _shown(value)}: expected {shape}")
    if len(array) > most:
        raise HTTPException(413, f"{name}: {len(array)} items: expected at most {most}")
    return array


def _listed(name: str, value: list[Any], width: int, shape: str) -> Any:
    """An array of a list of numbers, or of lists of `width` numbers; nothing else becomes a number by itself."""
    for index, row in enumerate(value):
        items = row if width > 1 else [row]
        if not isinstance(items, list) or len(items) != width or not all(type(item) in (int, float) for item in items):
            raise ValueError(f"{name}[{index}]: {_shown(row)}: expected {width} numbers, in all {shape}")
    try:
        return np.array(value, np.float64).reshape((-1, width) if width > 1 else -1)
    except OverflowError as error:
        raise ValueError(f"{name}: {error}: expected numbers") from error


def _lengths(name: str, value: Any, floats: str, most: int) -> Any:
    """One number, or an array [n] of them."""
    if type(value) in (int, float) and abs(value) < math.inf:
        return float(value) if abs(value) < 1e300 else math.copysign(1e300, value)
    if isinstance(value, list | bytes | memoryview):
        return _array(name, value, 1, floats, most)
    shown = "missing" if value is None else _shown(value)
    raise ValueError(f"{name}: {shown}: expected a number above 0, or [n] of them")


def _shown(value: Any) -> str:
    """A value as errors show it: not all of it, if it is long."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _write(answer: Mapping[str, Any], kind: str, floats: str) -> bytes:
    """An answer as JSON, where null stands for what is not finite, or as msgpack, with arrays as binary data."""
    if "distances" in answer:
        answer = {"hit": np.isfinite(answer["distances"]), **answer}
    if kind == JSON:
        return json.dumps({name: _plain(value) for name, value in answer.items()}, allow_nan=False).encode()
    return bytes(msgpack.packb({name: _binary(value, floats) for name, value in answer.items()}))


def _plain(value: Any) -> Any:
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.kind != "f":
        return value.tolist()
    plain = value.astype(object)
    plain[~np.isfinite(value)] = None
    return plain.tolist()


def _binary(value: Any, floats: str) -> Any:
    """Places in the world in the precision that was asked for; flags as a byte each; little-endian."""
    if not isinstance(value, np.ndarray):
        return value
    stored: dict[str, np.dtype[Any]] = {
        "f8": _FLOATS[floats], "f4": _FLOATS["float32"], "i4": np.dtype("<i4"), "b1": np.dtype(np.uint8),
    }  # fmt: skip
    return np.ascontiguousarray(value, stored[value.dtype.str[1:]]).tobytes()
