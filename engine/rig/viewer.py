"""A viewer's request and the answer to it: stereo views and stereo pictures."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..support.stages import Stages
from .camera import Camera, Perspective, Pose
from .depth import DepthCoding
from .frame import Texture

__all__ = [
    "EncodedPair",
    "PairReport",
    "PictureReport",
    "RenderedPicture",
    "StereoPicture",
    "StereoView",
    "home_pose",
]


@dataclass(frozen=True, slots=True)
class StereoView:
    """A head: its pose (between the eyes), interpupillary distance in metres, and each eye's projection.

    The eyes are offset by (0, +-ipd / 2, 0) in the head's axes, left = +y; they look along the head's x axis. Raises
    ValueError for an ipd that is negative or not finite.
    """

    pose: Pose
    ipd: float
    left: Perspective
    right: Perspective

    def __post_init__(self) -> None:
        if not (math.isfinite(self.ipd) and self.ipd >= 0):
            raise ValueError(f"ipd: {self.ipd!r}: expected a distance in metres, at least 0")

    @classmethod
    def symmetric(cls, pose: Pose, width: int, height: int, fov_rad: float, ipd: float = 0.063) -> StereoView:
        """Two equal eyes with the given picture size and horizontal field of view."""
        eye = Perspective.from_fov(width, height, fov_rad)
        return cls(pose, ipd, eye, eye)

    def eyes(self, depth: DepthCoding) -> tuple[Camera, Camera]:
        """The left and right eye as cameras with the depth coding `depth`."""
        left, right = (self.pose.translated((0.0, side * self.ipd / 2, 0.0)) for side in (1, -1))
        return Camera("left", self.left, left, depth), Camera("right", self.right, right, depth)

    def moved(self, pose: Pose) -> StereoView:
        """The same head in another pose."""
        return dataclasses.replace(self, pose=pose)

    def scaled(self, scale: float) -> StereoView:
        """The same eyes with pictures of another resolution (`Perspective.scaled`)."""
        return dataclasses.replace(self, left=self.left.scaled(scale), right=self.right.scaled(scale))


@dataclass(slots=True)
class PictureReport:
    """How a picture was made: fractions of holes, triangles and milliseconds per stage."""

    views: tuple[str, ...] = ()
    holes_warped: float = 0.0  # before the backdrop
    holes_backdrop: float = 0.0  # after it
    holes_filled: float = 0.0  # after filling
    warped: int = 0  # triangles
    stages: Stages = dataclasses.field(default_factory=Stages)


@dataclass(frozen=True, slots=True)
class RenderedPicture:
    """One virtual camera's picture.

    disparity float32 [h, w] in 1/m, 0 where nothing was seen and only filling gave a colour. winner uint8 [h, w]: the
    index in `report.views` of the view that drew the pixel; len(report.views) is the backdrop, higher values are other
    present views.
    """

    camera: Camera
    texture: Texture
    disparity: npt.NDArray[np.float32]
    winner: npt.NDArray[np.uint8]
    report: PictureReport

    def holes(self, *, warped: bool = False) -> npt.NDArray[np.bool_]:
        """Pixels [h, w] where nothing was drawn; with `warped`, also those that none of `report.views` drew."""
        empty: npt.NDArray[np.bool_] = self.disparity <= 0
        return empty | (self.winner >= len(self.report.views)) if warped else empty

    def codes(self) -> npt.NDArray[np.uint16]:
        """Depth codes [h, w], coded as in `camera.depth`; 0 for holes."""
        with np.errstate(divide="ignore"):
            depth = np.where(self.disparity > 0, 1.0 / self.disparity, np.nan)
        return self.camera.depth.codes(depth)


@dataclass(frozen=True, slots=True)
class StereoPicture:
    """Both eyes' pictures, and the video frame that they show."""

    left: RenderedPicture
    right: RenderedPicture
    frame_index: int

    @property
    def stages(self) -> dict[str, float]:
        """Milliseconds by stage, both eyes together."""
        names = dict.fromkeys((*self.left.report.stages, *self.right.report.stages))
        eyes = (self.left.report.stages, self.right.report.stages)
        return {name: sum(eye.get(name, 0.0) for eye in eyes) for name in names}

    @property
    def holes(self) -> float:
        """Fraction of pixels that only filling could colour, both eyes together."""
        return 0.5 * (self.left.report.holes_backdrop + self.right.report.holes_backdrop)


@dataclass(frozen=True, slots=True)
class PairReport:
    """How a stereo pair was made.

    frame_index: the video frame that it shows; width, height: an eye's size, pixels; holes: fraction of pixels that
    only filling could colour; stages: milliseconds of rendering per stage, and encode_ms of encoding, both eyes
    together; total_ms: milliseconds from the request to the encoded pair.
    """

    frame_index: int
    width: int
    height: int
    holes: float
    stages: dict[str, float]
    encode_ms: float
    total_ms: float


@dataclass(frozen=True, slots=True)
class EncodedPair:
    """Both eyes' pictures as bytes (`io.images.encode_picture`)."""

    left: bytes
    right: bytes
    report: PairReport


def home_pose(cameras: Sequence[Camera]) -> Pose:
    """Where a viewer starts: at the cameras' mean position, level, in their mean direction, upright as most of them."""
    position = np.mean([camera.pose.position for camera in cameras], axis=0)
    ahead = np.mean([camera.pose.rotation()[:, 0] for camera in cameras], axis=0)
    yaw = math.atan2(ahead[1], ahead[0]) if math.hypot(ahead[0], ahead[1]) > 0.1 else 0.0
    upright = sum(float(camera.pose.rotation()[2, 2]) for camera in cameras) >= 0
    return Pose.from_euler(position, yaw, 0.0, 0.0 if upright else math.pi)
