"""The engine: renders stereo views of RGB-D video and builds its background model. Opens no socket.

The names that programs need most are here. Each is loaded when it is first used, so importing the package loads no
compiler.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .io.recording import open_recording
    from .pipeline.engine import Engine
    from .rig.camera import Camera
    from .rig.frame import Frame, View
    from .rig.viewer import StereoView
    from .settings import Settings

__all__ = ["Camera", "Engine", "Frame", "Settings", "StereoView", "View", "open_recording"]

_HOMES = {
    "Camera": "rig.camera",
    "Engine": "pipeline.engine",
    "Frame": "rig.frame",
    "Settings": "settings",
    "StereoView": "rig.viewer",
    "View": "rig.frame",
    "open_recording": "io.recording",
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOMES[name]}", __name__), name)
    globals()[name] = value  # found without this function from now on
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(_HOMES))
