"""The rigs of the twins: cameras arranged as in the paper's sequences (Table 1, section 4), and three more."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from ..rig.camera import Camera, Equirectangular, Perspective, Pose, Projection
from ..rig.depth import DepthCoding
from ..support.array_types import F64

__all__ = ["Rig", "twin_cameras"]


HALF_TURN = (-math.pi / 2, math.pi / 2)
HALF_SPHERE = Equirectangular(2048, 2048, HALF_TURN, HALF_TURN)
SQUARE = Perspective.from_fov(1024, 1024, math.pi / 2)
EYE_HEIGHT = 1.65


@dataclass(frozen=True)
class Rig:
    """The cameras of a twin.

    cameras: the source cameras, then the virtual ones: the template `viewport`, and targets t0, t1 ... with ground
    truth. moving: for each camera that moves, a function from time in seconds to its pose. depth_noise: default
    strength of the errors in the depth.
    """

    cameras: tuple[Camera, ...]
    source_names: tuple[str, ...]
    moving: dict[str, Callable[[float], Pose]]
    frame_count: int
    depth_noise: float

    @property
    def target_names(self) -> tuple[str, ...]:
        """The virtual cameras with ground truth."""
        return tuple(c.name for c in self.cameras if c.name[0] == "t")

    def camera(self, name: str, time: float = 0.0) -> Camera:
        """The camera called `name` with its pose at `time` in seconds; raises ValueError for an unknown name."""
        for camera in self.cameras:
            if camera.name == name:
                pose = self.moving[name](time) if name in self.moving else camera.pose
                return Camera(name, camera.projection, pose, camera.depth, camera.texture_bits)
        raise ValueError(f"camera: {name!r}: expected one of {', '.join(c.name for c in self.cameras)}")


def twin_cameras(name: str, scale: float = 1.0) -> Rig:
    """The rig of the twin `name`, with pictures `scale` times as wide and high as the original's.

    Raises ValueError for an unknown name, or a scale that is not above 0 and at most 4.
    """
    rigs = {
        "museum": _museum,
        "hijack": _hijack,
        "painter": _painter,
        "frog": _frog,
        "gymnasium-a": _gymnasium,
        "gymnasium-b": _gymnasium,
        "doorway": _doorway,
        "street": _street,
        "museum-lamps": _museum,
        "gymnasium-lamps": _gymnasium,
        "lounge": _lounge,
    }
    if name not in rigs:
        raise ValueError(f"twin: {name!r}: expected one of {', '.join(rigs)}")
    if not 0.0 < scale <= 4.0:
        raise ValueError(f"scale: {scale!r}: expected 0 < scale <= 4")
    rig = rigs[name]()
    cameras = tuple(
        Camera(c.name, c.projection.scaled(scale), c.pose, c.depth, c.texture_bits) for c in rig.cameras
    )
    return Rig(cameras, rig.source_names, rig.moving, rig.frame_count, rig.depth_noise)


def _look(x: float, y: float, z: float, yaw_deg: float = 0.0, pitch_deg: float = 0.0) -> Pose:
    return Pose.from_euler((x, y, z), math.radians(yaw_deg), math.radians(pitch_deg), 0.0)


def _outward(direction: F64, radius: float) -> Pose:
    x, y, z = direction / np.linalg.norm(direction)
    yaw, pitch = math.atan2(y, x), -math.asin(z)
    return Pose.from_euler((radius * x, radius * y, EYE_HEIGHT + radius * z), yaw, pitch, 0.0)


def _snub_cube() -> Iterable[F64]:
    """The directions of the 24 cameras on the real ball: the corners of a snub cube, spread evenly over the sphere."""
    tribonacci = (1 + (19 + 3 * math.sqrt(33)) ** (1 / 3) + (19 - 3 * math.sqrt(33)) ** (1 / 3)) / 3
    base = np.array([1.0, 1.0 / tribonacci, tribonacci])
    for order in itertools.permutations(range(3)):
        parity = np.linalg.det(np.eye(3)[list(order)])
        for signs in itertools.product((1.0, -1.0), repeat=3):
            if np.prod(signs) * parity > 0:
                yield base[list(order)] * signs


def _rig(
    sources: Iterable[tuple[str, Projection, Pose]],
    targets: Iterable[tuple[Projection, Pose]],
    viewport: tuple[Projection, Pose],
    depth: DepthCoding,
    frame_count: int = 300,
    depth_noise: float = 0.0,
    moving: dict[str, Callable[[float], Pose]] | None = None,
) -> Rig:
    cameras = [Camera(name, projection, pose, depth) for name, projection, pose in sources]
    names = tuple(c.name for c in cameras)
    cameras.append(Camera("viewport", *viewport, depth))
    cameras += [Camera(f"t{k}", projection, pose, depth) for k, (projection, pose) in enumerate(targets)]
    return Rig(tuple(cameras), names, moving or {}, frame_count, depth_noise)


def _museum() -> Rig:
    poses = [_outward(direction, 0.3) for direction in _snub_cube()]
    targets: list[tuple[Projection, Pose]] = [
        (SQUARE, _look(0.1, 0.05, 1.65)),
        (SQUARE, _look(-0.08, -0.1, 1.6, 150, 5)),
        (HALF_SPHERE.scaled(0.5), _look(0.05, -0.08, 1.7, -60)),
        (SQUARE, _look(-0.8, 0.9, 1.7, -25, 5)),
        (SQUARE, _look(0.9, -1.3, 1.4, 75, -3)),
    ]
    sources = [(f"v{k}", HALF_SPHERE, pose) for k, pose in enumerate(poses)]
    viewport = (Perspective.from_fov(2048, 2048, math.pi / 2), _look(0, 0, EYE_HEIGHT))
    return _rig(sources, targets, viewport, DepthCoding(0.5, 25.0))


def _hijack() -> Rig:
    ring = [(0.3 * math.cos(a), -0.3 * math.sin(a), 0.0) for a in np.arange(5) * 0.4 * math.pi]
    upright = [(x, 0.0, z) for z in (-0.26, 0.26) for x in (-0.15, 0.15)]
    poses = [_look(x, y, EYE_HEIGHT + z) for x, y, z in [*ring, *upright, (0.0, 0.0, 0.0)]]
    targets: list[tuple[Projection, Pose]] = [
        (SQUARE, _look(0.05, 0.1, 1.7, 10)),
        (SQUARE, _look(-0.1, -0.12, 1.55, -35, 10)),
        (HALF_SPHERE.scaled(0.5), _look(0.1, 0.0, 1.6)),
        (SQUARE, _look(0.2, 1.0, 1.7, -15, 5)),
        (SQUARE, _look(0.5, -0.9, 1.35, 15)),
    ]
    sources = [(f"v{k}", HALF_SPHERE, pose) for k, pose in enumerate(poses)]
    viewport = (Perspective.from_fov(2048, 2048, math.pi / 2), _look(0, 0, EYE_HEIGHT))
    return _rig(sources, targets, viewport, DepthCoding(0.5, 25.0))


def _painter() -> Rig:
    lens = Perspective(2048, 1088, 2410.3, 2410.3, 1043.0, 480.5)
    grid = [(0.0, 0.07 * (1 - k % 4), 0.07 * (1 - k // 4)) for k in range(16)]
    targets = [
        (lens, _look(0.0, 0.035, 0.035)),
        (lens, _look(0.0, -0.1, -0.1)),
        (lens, _look(0.0, 0.35, 0.05, -5)),
        (lens, _look(0.1, -0.45, -0.1, 5)),
    ]
    sources = [(f"v{k}", lens, _look(*position)) for k, position in enumerate(grid)]
    viewport = (Perspective(1920, 1080, 2711.3, 2711.3, 960.0, 540.0), _look(0, 0, 0))
    return _rig(sources, targets, viewport, DepthCoding(1.0, 10.0), depth_noise=1.0)


def _frog() -> Rig:
    lens = Perspective(1920, 1080, 1546.7, 1547.8, 980.2, 534.7)
    # The real row is slightly toed out, by about a tenth of a degree at its ends.
    sources = [(f"v{k}", lens, _look(0, 0.0364 * (7 - k), 0, 0.015 * (7 - k))) for k in range(1, 14)]
    targets = [
        (lens, _look(0.0, 0.02, 0.0)),
        (lens, _look(0.0, -0.12, 0.01)),
        (lens, _look(0.02, 0.34, 0.03, -5)),
        (lens, _look(0.0, -0.32, 0.1, 5, 4)),
    ]
    viewport = (Perspective(1920, 1080, 1856.7, 1856.7, 960.0, 540.0), _look(0, 0, 0))
    return _rig(sources, targets, viewport, DepthCoding(0.3, 1.62), depth_noise=1.0)


def _gymnasium() -> Rig:
    sources = []
    for k in range(4):
        yaw = 90.0 * k
        x, y = 0.3 * math.cos(math.radians(yaw)), 0.3 * math.sin(math.radians(yaw))
        sources.append((f"v{k}", HALF_SPHERE, _look(x, y, EYE_HEIGHT, yaw)))
    seconds = 250 / 30.0

    def flight(time: float) -> Pose:
        share = min(max(time / seconds, 0.0), 1.0)
        return _look(-8.0 + 16.0 * share, -1.5 + 3.0 * share, 5.8, 0, 90)

    sources.append(("v4", HALF_SPHERE, flight(0.0)))
    targets: list[tuple[Projection, Pose]] = [
        (SQUARE, _look(0.1, 0.05, 1.65)),
        (SQUARE, _look(-0.1, -0.1, 1.6, 200)),
        (HALF_SPHERE.scaled(0.5), _look(0.0, 0.1, 1.7, 80)),
        (SQUARE, _look(-1.0, 0.6, 1.9, 15, 5)),
        (SQUARE, _look(0.8, -1.2, 2.2, 130, 10)),
    ]
    viewport = (Perspective.from_fov(2048, 2048, math.pi / 2), _look(0, 0, EYE_HEIGHT))
    return _rig(sources, targets, viewport, DepthCoding(0.5, 25.0), frame_count=250, moving={"v4": flight})


def _doorway() -> Rig:
    """Not in the paper: an arc of cameras in front of a wall with a doorway; the middle cameras look through it."""
    lens = Perspective.from_fov(2048, 1536, math.radians(80))
    places = [(0.35 - 0.09 * y * y, y) for y in np.linspace(-2.4, 2.4, 8)]
    sources = [(f"v{k}", lens, _look(x, y, 1.5 + 0.15 * (k % 2), -12.0 * y)) for k, (x, y) in enumerate(places)]
    targets = [
        (lens, _look(0.3, 0.7, 1.65)),  # in front of the doorway
        (lens, _look(0.2, -1.75, 1.6, 10)),  # to one side of it: the wall hides most of the second room
        (lens, _look(0.1, 1.5, 1.5, -15)),
        (lens, _look(1.2, 0.55, 1.6)),
        (lens, _look(-0.9, -0.6, 1.7, 5)),
    ]
    return _rig(sources, targets, (lens, _look(0, 0, EYE_HEIGHT)), DepthCoding(0.5, 25.0))


def _street() -> Rig:
    """Not in the paper: cameras on a beam of 4.2 m across a street, looking along it to hills 300 m away."""
    lens = Perspective.from_fov(1920, 1080, math.radians(80))
    sources = [
        (f"v{k}", lens, _look(0.0, 0.6 * (3.5 - k), 2.1 + 0.3 * (k % 2), 1.5 * (3.5 - k), 3.0)) for k in range(8)
    ]
    targets = [
        (lens, _look(0.05, 0.25, 2.2, 0, 2)),
        (lens, _look(-0.1, -1.35, 2.3, -3, 3)),
        (lens, _look(0.1, 1.75, 2.15, 4, 1)),
        (lens, _look(-1.5, 3.4, 2.5, -4, 3)),
        (lens, _look(0.8, -2.9, 1.9, 6)),
    ]
    return _rig(sources, targets, (lens, _look(0, 0, 2.2)), DepthCoding(2.0, 400.0))


def _lounge() -> Rig:
    """Not in the paper: three cameras along each of two heights at one end of a room, and one in each far corner of
    that end, which look at what stands in its middle from different sides."""
    lens = Perspective.from_fov(2048, 1536, math.radians(85))
    places = [(0.0, y, z, -8.0 * y, 8.0) for z in (1.4, 2.2) for y in (-1.2, 0.0, 1.2)]
    places += [(1.6, y, 2.4, -27.0 * y / 2.0, 16.0) for y in (-3.4, 3.4)]
    sources = [(f"v{k}", lens, _look(*place)) for k, place in enumerate(places)]
    targets = [
        (lens, _look(0.1, 0.2, 1.6, 0, 6)),
        (lens, _look(0.1, -0.9, 1.5, 8, 4)),
        (lens, _look(0.3, 0.9, 1.7, -10, 8)),
        (lens, _look(0.5, -2.2, 1.7, 18, 6)),
        (lens, _look(0.6, 2.1, 1.9, -20, 8)),
    ]
    return _rig(sources, targets, (lens, _look(0, 0, EYE_HEIGHT)), DepthCoding(0.3, 25.0))
