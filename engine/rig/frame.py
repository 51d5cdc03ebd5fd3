"""Views and frames: the cameras' pictures and depth at one instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .camera import Camera

__all__ = ["Frame", "Lent", "Texture", "View"]


@dataclass(frozen=True, slots=True)
class Texture:
    """Planar Y'CbCr 4:2:0 picture with 10-bit codes in uint16; colour matrix and range are those of the source.

    y is [h, w], cb and cr are [(h + 1) // 2, (w + 1) // 2]; raises ValueError for other shapes.
    """

    y: npt.NDArray[np.uint16]
    cb: npt.NDArray[np.uint16]
    cr: npt.NDArray[np.uint16]

    def __post_init__(self) -> None:
        h, w = self.y.shape
        for name in ("cb", "cr"):
            shape = getattr(self, name).shape
            if shape != ((h + 1) // 2, (w + 1) // 2):
                raise ValueError(f"{name}: shape {shape}: expected {((h + 1) // 2, (w + 1) // 2)} (4:2:0)")


@dataclass(frozen=True, slots=True)
class View:
    """One camera's texture and depth codes (uint16 [h, w], coded as in `camera.depth`) at one instant.

    The camera's pose belongs to the view: a moving camera has another pose in every frame. Raises ValueError where a
    shape does not fit the camera.
    """

    camera: Camera
    texture: Texture
    codes: npt.NDArray[np.uint16]

    def __post_init__(self) -> None:
        expected = (self.camera.height, self.camera.width)
        for name, shape in (("texture", self.texture.y.shape), ("codes", self.codes.shape)):
            if shape != expected:
                raise ValueError(f"view {self.camera.name}: {name}: shape {shape}: expected {expected}")


class Lent(NamedTuple):
    """Where another process finds a frame's planes: process id, file descriptor in it, and a name (`frame_memory`)."""

    process: int
    file: int
    name: str


@dataclass(frozen=True, slots=True)
class Frame:
    """All views of one instant, in the order of the sequence's source cameras."""

    index: int
    views: tuple[View, ...]
    lent: Lent | None = None  # None: in this process only
