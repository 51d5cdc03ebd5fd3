"""3D effects as clients describe them: in messages of viewers, and in the JSON of HTTP requests."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Self

from farside.engine.rig.effects import BLENDS

from .fields import Quaternion, Reader, Vector

__all__ = ["KINDS", "MAX_NAME", "EffectRemoval", "EffectUpdate"]

KINDS = ("projector", "mesh")
MAX_NAME = 100  # characters
_FOV = 0.01, math.radians(170.0)
_SCALE = 1e-6, 1e6


@dataclass(frozen=True, slots=True)
class EffectUpdate:
    """Add a projector or a mesh, or change the one of that name. Position and orientation are in the client's axes.

    fov (radians), strength, blend and camera are of a projector, scale is of a mesh.
    """

    TYPE: ClassVar[str] = "effect"
    name: str
    kind: str
    position: Vector
    orientation: Quaternion
    fov: float = 1.0
    strength: float = 1.0
    blend: str = "mix"
    camera: str = ""
    scale: float = 1.0

    def _fields(self) -> dict[str, Any]:
        used = ("scale",) if self.kind == "mesh" else ("fov", "strength", "blend", "camera")
        return {key: getattr(self, key) for key in ("name", "kind", "position", "orientation", *used)}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        name, kind = reader.label("name", MAX_NAME), reader.choice("kind", KINDS)
        if not name or "\ufffd" in name:  # U+FFFD: an address had bytes that are no UTF-8
            raise reader.fail("name", name, f"1 to {MAX_NAME} characters in UTF-8")
        placed = name, kind, reader.vector("position"), reader.quaternion("orientation")
        if kind == "mesh":
            return cls(*placed, scale=reader.number("scale", *_SCALE) if reader.has("scale") else 1.0)
        return cls(
            *placed,
            fov=reader.number("fov", *_FOV),
            strength=reader.number("strength", 0.0, 1.0) if reader.has("strength") else 1.0,
            blend=reader.choice("blend", BLENDS) if reader.has("blend") else "mix",
            camera=reader.text("camera", MAX_NAME) if reader.has("camera") else "",
        )


@dataclass(frozen=True, slots=True)
class EffectRemoval:
    """Remove an effect, if it is there."""

    TYPE: ClassVar[str] = "remove_effect"
    name: str

    def _fields(self) -> dict[str, Any]:
        return {"name": self.name}

    @classmethod
    def _read(cls, reader: Reader) -> Self:
        return cls(reader.label("name", MAX_NAME))
