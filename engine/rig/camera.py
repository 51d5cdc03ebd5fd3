"""Cameras: projections, 6DoF poses and the packed form that kernels read.

Axes are OMAF's, for the world and for cameras alike: x forward, y left, z up. Image coordinates are u right
and v down, the corner of the picture is (0, 0) and pixel centres are at +0.5. A perspective camera's depth is
the x coordinate (z-depth in the usual naming), an equirectangular camera's depth is the ray length (range).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from ..support.array_types import F64
from ..support.packed import (
    CAMERA_SIZE,
    EQUIRECTANGULAR,
    HEIGHT,
    KIND,
    PERSPECTIVE,
    POSITION_SLICE,
    PROJECTION_SLICE,
    ROTATION_SLICE,
    WIDTH,
    WRAPS,
)
from .depth import DepthCoding

__all__ = ["Camera", "Equirectangular", "Perspective", "Pose", "Projection"]


_SHORTEST_FOCAL_PX = 1e-9  # what is computed with its square and its inverse stays finite
_LEAST_SPAN_RAD = 1e-9


@dataclass(frozen=True, slots=True)
class Perspective:
    """Pinhole projection; lengths in pixels. Two negative focal lengths turn the picture by 180 degrees, a single one
    mirrors it.

    u = cx - fx y / x and v = cy - fy z / x; the principal point may lie outside the picture. Raises ValueError for a
    size below 1, a number that is not finite, or a focal length of 0.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    def __post_init__(self) -> None:
        _check_size(self.width, self.height)
        for name in ("fx", "fy", "cx", "cy"):
            value, least = getattr(self, name), _SHORTEST_FOCAL_PX if name[0] == "f" else 0.0
            if not math.isfinite(value) or abs(value) < least:
                expected = f"a finite number of at least {least:g} in magnitude" if least else "a finite number"
                raise ValueError(f"{name}: {value!r}: expected {expected}")

    @classmethod
    def from_tangents(
        cls, width: int, height: int, left: float, right: float, top: float, bottom: float
    ) -> Perspective:
        """Projection from the tangents of a headset's half angles, all positive outwards (asymmetric frusta).

        Raises ValueError where left + right or top + bottom is not positive.
        """
        if not (left + right > 0 and top + bottom > 0):
            raise ValueError(f"tangents: {(left, right, top, bottom)!r}: expected an opening frustum")
        fx, fy = width / (left + right), height / (top + bottom)
        return cls(width, height, fx, fy, fx * left, fy * top)

    @classmethod
    def from_fov(cls, width: int, height: int, horizontal_rad: float) -> Perspective:
        """Symmetric projection with square pixels from the horizontal field of view, in radians.

        Raises ValueError for a field of view outside 0 .. pi.
        """
        if not 0 < horizontal_rad < math.pi:
            raise ValueError(f"field of view: {math.degrees(horizontal_rad)!r} degrees: expected 0 < fov < 180")
        focal = 0.5 * width / math.tan(0.5 * horizontal_rad)
        return cls(width, height, focal, focal, 0.5 * width, 0.5 * height)

    def scaled(self, scale: float) -> Perspective:
        """The same picture at another resolution (sizes rounded to even numbers)."""
        width, height = _even(self.width * scale), _even(self.height * scale)
        sx, sy = width / self.width, height / self.height
        return Perspective(width, height, self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy)

    def directions(self, uv: npt.ArrayLike) -> F64:  # [..., 2] -> [..., 3]
        """Camera-frame directions with x = 1 of pixel coordinates: direction times z-depth is the point."""
        uv = np.asarray(uv, np.float64)
        y, z = (self.cx - uv[..., 0]) / self.fx, (self.cy - uv[..., 1]) / self.fy
        return np.stack([np.ones_like(y), y, z], axis=-1)

    def project(self, points: npt.ArrayLike) -> tuple[F64, F64]:  # [..., 3] -> [..., 2], [...]
        """Pixel coordinates and z-depth of camera-frame points; nan where the depth is not positive."""
        points = np.asarray(points, np.float64)
        x = np.where(points[..., 0] > 0, points[..., 0], np.nan)
        uv = np.stack(
            [self.cx - self.fx * points[..., 1] / x, self.cy - self.fy * points[..., 2] / x], axis=-1
        )
        return uv, points[..., 0]


@dataclass(frozen=True, slots=True)
class Equirectangular:
    """Equirectangular projection, partial or full; ranges in radians, [min, max] of azimuth and elevation.

    u = width (phi_max - phi) / (phi_max - phi_min), v likewise from the elevation: the left edge is phi_max. Raises
    ValueError for a size below 1, or a range that is empty or wider than the full sphere.
    """

    width: int
    height: int
    hor_range: tuple[float, float]
    ver_range: tuple[float, float]

    def __post_init__(self) -> None:
        _check_size(self.width, self.height)
        for name, (low, high), limit in (
            ("hor_range", self.hor_range, 2 * math.pi),
            ("ver_range", self.ver_range, math.pi),
        ):
            if not (high - low >= _LEAST_SPAN_RAD and high <= low + limit + 1e-9):
                raise ValueError(
                    f"{name}: {(math.degrees(low), math.degrees(high))!r} degrees: "
                    f"expected min < max, spanning {math.degrees(_LEAST_SPAN_RAD):.2g} to {math.degrees(limit):g}"
                )

    @property
    def wraps(self) -> bool:
        """Whether the picture closes on itself: columns 0 and width - 1 are neighbours."""
        return self.hor_range[1] - self.hor_range[0] > 2 * math.pi - 1e-6

    def scaled(self, scale: float) -> Equirectangular:
        """The same picture at another resolution (sizes rounded to even numbers)."""
        return dataclasses.replace(self, width=_even(self.width * scale), height=_even(self.height * scale))

    def directions(self, uv: npt.ArrayLike) -> F64:  # [..., 2] -> [..., 3]
        """Camera-frame unit directions of pixel coordinates: direction times range is the point."""
        uv = np.asarray(uv, np.float64)
        phi = self.hor_range[1] - uv[..., 0] * (self.hor_range[1] - self.hor_range[0]) / self.width
        theta = self.ver_range[1] - uv[..., 1] * (self.ver_range[1] - self.ver_range[0]) / self.height
        return np.stack(
            [np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), np.sin(theta)], axis=-1
        )

    def project(self, points: npt.ArrayLike) -> tuple[F64, F64]:  # [..., 3] -> [..., 2], [...]
        """Pixel coordinates and range of camera-frame points, the azimuth wrapped about the picture's middle."""
        points = np.asarray(points, np.float64)
        middle = 0.5 * (self.hor_range[0] + self.hor_range[1])
        phi = np.arctan2(points[..., 1], points[..., 0])
        phi = middle + np.mod(phi - middle + math.pi, 2 * math.pi) - math.pi
        theta = np.arctan2(points[..., 2], np.hypot(points[..., 0], points[..., 1]))
        u = self.width * (self.hor_range[1] - phi) / (self.hor_range[1] - self.hor_range[0])
        v = self.height * (self.ver_range[1] - theta) / (self.ver_range[1] - self.ver_range[0])
        return np.stack([u, v], axis=-1), np.linalg.norm(points, axis=-1)


Projection = Perspective | Equirectangular


@dataclass(frozen=True, slots=True)
class Pose:
    """A 6DoF pose: position in metres and orientation as a unit quaternion (w, x, y, z), world from camera.

    Raises ValueError for a position that is not finite, or a quaternion whose length is not 1 (within 0.001).
    """

    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    orientation: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if len(self.position) != 3 or not all(map(math.isfinite, self.position)):
            raise ValueError(f"position: {self.position!r}: expected three finite numbers")
        norm = math.sqrt(sum(c * c for c in self.orientation)) if len(self.orientation) == 4 else math.nan
        if not abs(norm - 1.0) < 1e-3:
            raise ValueError(f"orientation: {self.orientation!r}: expected a unit quaternion (w, x, y, z)")
        object.__setattr__(self, "orientation", tuple(c / norm for c in self.orientation))

    @classmethod
    def from_euler(cls, position: Any, yaw: float, pitch: float, roll: float) -> Pose:
        """Pose from angles in radians: R = Rz(yaw) Ry(pitch) Rx(roll); a positive pitch looks down."""
        cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
        cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
        cr, sr = math.cos(roll / 2), math.sin(roll / 2)
        quaternion = (
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        )
        x, y, z = (float(c) for c in position)
        return cls((x, y, z), quaternion)

    @classmethod
    def from_matrix(cls, world_from_camera: npt.ArrayLike) -> Pose:
        """Pose from a rigid [3, 4] or [4, 4] matrix; raises ValueError if its 3x3 part is not a rotation."""
        m = np.asarray(world_from_camera, np.float64)
        r = m[:3, :3]
        if not np.allclose(r @ r.T, np.eye(3), atol=1e-3) or np.linalg.det(r) < 0:
            raise ValueError("world_from_camera: expected a rotation in its 3x3 part")
        # Shepperd's method: the largest of the four squared components is the stable divisor.
        squares = np.array([1 + np.trace(r), *(1 + 2 * np.diag(r) - np.trace(r))])
        k = int(np.argmax(squares))
        skew = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]])
        q = np.empty(4)
        if k == 0:
            q[0], q[1:] = squares[0], skew
        else:
            i = k - 1
            q[0] = skew[i]
            q[1:] = r[i, :] + r[:, i]
            q[k] = squares[k]
        q /= np.linalg.norm(q)
        x, y, z = (float(c) for c in m[:3, 3])
        return cls((x, y, z), (float(q[0]), float(q[1]), float(q[2]), float(q[3])))

    def rotation(self) -> F64:  # [3, 3]
        """The rotation matrix, world from camera."""
        w, x, y, z = self.orientation
        return np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )

    def translated(self, offset_in_camera: npt.ArrayLike) -> Pose:
        """The pose moved by an offset given in its own axes, metres."""
        p = np.asarray(self.position) + self.rotation() @ np.asarray(offset_in_camera, np.float64)
        return dataclasses.replace(self, position=(float(p[0]), float(p[1]), float(p[2])))


@dataclass(frozen=True, slots=True)
class Camera:
    """A named camera: projection, pose and how its depth and texture are coded."""

    name: str
    projection: Projection
    pose: Pose
    depth: DepthCoding
    texture_bits: int = 10

    @property
    def width(self) -> int:
        """Picture width, pixels."""
        return self.projection.width

    @property
    def height(self) -> int:
        """Picture height, pixels."""
        return self.projection.height

    def project(self, points_in_world: npt.ArrayLike) -> tuple[F64, F64]:
        """[..., 3] world points, metres -> [..., 2] pixels and [...] depth (z-depth or range, see the projection)."""
        local = (np.asarray(points_in_world, np.float64) - self.pose.position) @ self.pose.rotation()
        return self.projection.project(local)

    def unproject(self, uv: npt.ArrayLike, depth: npt.ArrayLike) -> F64:
        """[..., 2] pixels and [...] depth in metres -> [..., 3] world points."""
        local = self.projection.directions(uv) * np.asarray(depth, np.float64)[..., None]
        return local @ self.pose.rotation().T + self.pose.position

    @property
    def wraps(self) -> bool:
        """Whether the first and the last column of its picture are neighbours."""
        return isinstance(self.projection, Equirectangular) and self.projection.wraps

    def packed(self, origin: npt.ArrayLike = (0.0, 0.0, 0.0)) -> F64:  # [CAMERA_SIZE]
        """The camera as kernels read it (layout: `support.packed`), positions relative to `origin`, metres."""
        out = np.zeros(CAMERA_SIZE)
        p = self.projection
        out[WIDTH], out[HEIGHT] = p.width, p.height
        if isinstance(p, Perspective):
            out[KIND] = PERSPECTIVE
            out[PROJECTION_SLICE] = p.fx, p.fy, p.cx, p.cy
        else:
            out[KIND] = EQUIRECTANGULAR
            (h0, h1), (v0, v1) = p.hor_range, p.ver_range
            out[PROJECTION_SLICE] = h1, (h1 - h0) / p.width, v1, (v1 - v0) / p.height
            out[WRAPS] = p.wraps
        out[ROTATION_SLICE] = self.pose.rotation().ravel()
        out[POSITION_SLICE] = np.asarray(self.pose.position, np.float64) - np.asarray(origin, np.float64)
        return out


def _check_size(width: int, height: int) -> None:
    if width < 1 or height < 1:
        raise ValueError(f"resolution: {(width, height)!r}: expected positive width and height")


def _even(size: float) -> int:
    return max(2, 2 * round(size / 2))
