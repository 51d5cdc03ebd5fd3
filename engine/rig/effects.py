"""3D effects as those who add them describe them: projectors and added meshes (the paper's Fig. 1h)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .camera import Pose

__all__ = ["BLENDS", "AddedMesh", "Effect", "Projector"]

BLENDS = ("mix", "add")  # how a projected picture joins the colours of the background
_WIDEST_RAD = math.radians(170.0)
_SCALES = 1e-6, 1e6


@dataclass(frozen=True, slots=True)
class Projector:
    """Throws a picture onto the background.

    pose: world from projector, which looks along its x axis. fov_rad: horizontal field of view, radians; pixels of the
    picture are square. strength: from 0 (invisible) to 1. blend: "mix" puts the picture in the place of the
    background's colours, "add" adds it to them, as light. camera: the reference camera whose live video is the picture;
    empty: the picture is put by itself. Raises ValueError for a number out of range or an unknown blend.
    """

    pose: Pose
    fov_rad: float
    strength: float = 1.0
    blend: str = "mix"
    camera: str = ""

    def __post_init__(self) -> None:
        if not 0.0 < self.fov_rad <= _WIDEST_RAD:
            raise ValueError(f"fov: {self.fov_rad!r}: expected more than 0 and at most {_WIDEST_RAD:.4f} radians")
        if not 0.0 <= self.strength <= 1.0:
            raise ValueError(f"strength: {self.strength!r}: expected a number from 0 to 1")
        if self.blend not in BLENDS:
            raise ValueError(f"blend: {self.blend!r}: expected one of {', '.join(BLENDS)}")


@dataclass(frozen=True, slots=True)
class AddedMesh:
    """Puts a mesh into the scene.

    pose: world from mesh, whose axes are the world's (x forward, y left, z up); scale: metres for each of its metres.
    Raises ValueError for a scale that is not positive, or absurd.
    """

    pose: Pose
    scale: float = 1.0

    def __post_init__(self) -> None:
        least, most = _SCALES
        if not least <= self.scale <= most:
            raise ValueError(f"scale: {self.scale!r}: expected a number from {least:g} to {most:g}")


Effect = Projector | AddedMesh
