"""Views and frames: the cameras' pictures and depth at one instant."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
import numpy.typing as npt

from .camera import Camera

__all__ = ["Fault", "Frame", "Lent", "Texture", "View"]


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


class Fault(NamedTuple):
    """Why a view is left out of its frame: a short reason, by which such views are counted, and the detail for
    people."""

    reason: str
    detail: str = ""

    def __str__(self) -> str:
        return f"{self.reason}: {self.detail}" if self.detail else self.reason


@dataclass(frozen=True, slots=True)
class View:
    """One camera's texture and depth codes (uint16 [h, w], coded as in `camera.depth`) at one instant.

    The camera's pose belongs to the view: a moving camera has another pose in every frame. A view with a `fault` is
    left out of its frame: its arrays have the right shapes and any content, and nobody reads them. Raises ValueError
    where a shape does not fit the camera.
    """

    camera: Camera
    texture: Texture
    codes: npt.NDArray[np.uint16]
    fault: Fault | None = None

    def __post_init__(self) -> None:
        expected = (self.camera.height, self.camera.width)
        for name, shape in (("texture", self.texture.y.shape), ("codes", self.codes.shape)):
            if shape != expected:
                raise ValueError(f"view {self.camera.name}: {name}: shape {shape}: expected {expected}")

    @classmethod
    def blank(cls, camera: Camera, fault: Fault | None = None) -> Self:
        """A view that shows nothing: grey, with codes 0."""
        luma, chroma = (camera.height, camera.width), ((camera.height + 1) // 2, (camera.width + 1) // 2)
        planes = (np.full(shape, 512, np.uint16) for shape in (luma, chroma, chroma))
        return cls(camera, Texture(*planes), np.zeros(luma, np.uint16), fault)

    @property
    def there(self) -> bool:
        """Whether the view is part of its frame."""
        return self.fault is None


class Lent(NamedTuple):
    """Where another process finds a frame's planes: process id, file descriptor in it, and a name (`frame_memory`)."""

    process: int
    file: int
    name: str


@dataclass(frozen=True, slots=True)
class Frame:
    """A view of each of the sequence's source cameras at one instant, in their order; some may be left out (`View`)."""

    index: int
    views: tuple[View, ...]
    lent: Lent | None = None  # None: in this process only

    @property
    def there(self) -> list[int]:
        """The indices of the views that are part of the frame."""
        return [index for index, view in enumerate(self.views) if view.there]

    @property
    def faults(self) -> dict[str, Fault]:
        """Why views are left out, by camera."""
        return {view.camera.name: view.fault for view in self.views if view.fault is not None}
