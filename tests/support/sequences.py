"""Small TMIV sequences on disk: two source views of random codes, one of which moves, and a virtual camera."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from farside.engine.io.tmiv import SequenceWriter
from farside.engine.io.yuv import PixelFormat
from farside.engine.rig.camera import Camera, Equirectangular, Perspective, Pose
from farside.engine.rig.depth import DepthCoding
from farside.engine.rig.frame import Texture

FRAMES = 3


def cameras(bits: int = 16) -> list[Camera]:
    flat = Perspective(10, 6, -8.0, 9.0, 5.25, 2.0)
    ball = Equirectangular(12, 8, (-math.pi, math.pi), (-math.pi / 2, math.pi / 2))
    pose = Pose.from_euler((0.1, -2.0, 3e5), 0.5, -0.25, 3.0)
    coding = DepthCoding(0.3, math.inf, bits)
    return [
        Camera("viewport", flat, Pose(), coding),
        Camera("v0", flat, pose, coding),
        Camera("v1", ball, pose, DepthCoding(0.5, 25.0, bits, has_invalid=True)),
        Camera("t0", flat, Pose(), coding),
    ]


def pictures(camera: Camera, seed: int, bits: int = 16, step: int = 1) -> tuple[Texture, Any]:
    rng = np.random.default_rng(seed)
    h, w = camera.height, camera.width
    planes = [
        (rng.integers(0, 1024 // step, shape) * step).astype(np.uint16)
        for shape in ((h, w), (h // 2, w // 2), (h // 2, w // 2))
    ]
    return Texture(*planes), rng.integers(0, 1 << bits, (h, w)).astype(np.uint16)


def write(
    folder: Path, *, depth: str = "yuv420p16le", texture: str = "yuv420p10le", json_name: str | None = None
) -> Path:
    """Write three frames of v0, v1 (sources) and t0 (truth); v1 moves."""
    bits = PixelFormat(depth).bits
    step = 1 << max(0, 10 - PixelFormat(texture).bits)
    rig = cameras(bits)
    with SequenceWriter(
        folder, "Made", 25.0, rig, ("v0", "v1"), depth_format=depth, texture_format=texture, json_name=json_name
    ) as writer:
        for frame in range(FRAMES):
            for index, camera in enumerate(rig[1:]):
                pose = Pose((frame, 1.0, 2.0)) if camera.name == "v1" else None
                writer.write(camera.name, *pictures(camera, 10 * frame + index, bits, step), pose=pose)
    return folder


def edit(folder: Path, **changes: Any) -> None:
    """Change top-level fields of the JSON, or with v0__Focal=... a camera's; None removes a field."""
    file = folder / f"{folder.name}.json"
    document = json.loads(file.read_text())
    for key, value in changes.items():
        name, _, field = key.rpartition("__")
        target = next(c for c in document["cameras"] if c["Name"] == name) if name else document
        target[field] = value
        if value is None:
            del target[field]
    file.write_text(json.dumps(document))
