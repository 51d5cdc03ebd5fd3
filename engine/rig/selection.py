"""Choice of the views that render a picture (paper section 3.1: n_render views by direction and overlap)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from ..support.array_types import F64
from ..support.packed import KIND, PERSPECTIVE, POSITION_SLICE, ROTATION, ROTATION_SLICE, WIDTH
from .camera import Camera

__all__ = ["likely_views", "select_views", "view_shares"]

_GRID, _COARSE = 8, 2  # sample rays across and down a picture: for the choice, and for the first cut
# If the cameras see less than _FEW of the samples, about _MOST samples are taken from the cameras' own rays instead.
_FEW, _MOST = 0.25, 512
_ANGLE = 0.1  # angle between the rays of target and view to a point, radians, at which a view has lost half its worth
_NEAREST = 0.005  # smaller angles, radians, count as this one


def select_views(target: Camera, cameras: Sequence[Camera], count: int, depths: Sequence[float]) -> list[int]:
    """Indices of at most `count` cameras for rendering `target`, the most useful first (paper section 3.1).

    Sample points lie on the target's rays at the given scene `depths` (metres). If the cameras see few of them (the
    target is far away, or its picture is very wide), points on the cameras' own rays are taken instead. A camera is
    worth more to a point if it sees the point from a direction near the target's. Cameras are chosen greedily so that
    every point is seen well, and then also by a second camera, which may show what the first does not see. Cameras
    that see no sample are left out.
    """
    worth = _worth(target, cameras, depths)
    chosen: list[int] = []
    best, second = np.zeros(worth.shape[1]), np.zeros(worth.shape[1])
    while len(chosen) < min(count, len(cameras)):
        gain = np.maximum(worth - best, 0) + 0.5 * np.maximum(np.minimum(worth, best) - second, 0)
        total = gain.sum(axis=1) + 1e-3 * worth.sum(axis=1)
        total[chosen] = -1.0
        k = int(np.argmax(total))
        if total[k] <= 0.0:
            break
        chosen.append(k)
        second = np.maximum(second, np.minimum(best, worth[k]))
        best = np.maximum(best, worth[k])
    return chosen


def likely_views(target: Camera, packed: F64, count: int, depths: Sequence[float]) -> list[int]:
    """Indices of `count` of many cameras (packed [n, CAMERA_SIZE]) that `select_views` may choose for `target`.

    This is a first cut: by the cameras' worth to a few points on the target's rays (at `depths`, metres), and among
    cameras of equal worth by distance to the target. The indices are in ascending order, because `select_views` takes
    the first of equal cameras.
    """
    inside, angle = _looks(target, packed, _on_rays(target, depths, _COARSE))
    away = np.linalg.norm(packed[:, POSITION_SLICE] - target.pose.position, axis=1)
    order = np.lexsort((away, -_worth_at(inside, angle).sum(axis=1)))
    return sorted(order[:count].tolist())


def view_shares(target: Camera, cameras: Sequence[Camera], depths: Sequence[float]) -> F64:  # [cameras]
    """The cameras' shares of `target`'s picture if all were blended by nearness in direction; their sum is 1.

    They do not depend on the choice of views, so they change smoothly with the target. They are equal if no camera
    sees a sample point (on the target's rays at `depths`, metres).
    """
    inside, angle = _seen(target, tuple(cameras), tuple(depths))
    weight = inside / (angle * angle + _NEAREST * _NEAREST)
    total = weight.sum(axis=0)
    if not total.any():
        return np.full(len(cameras), 1.0 / len(cameras))
    shares: F64 = (weight[:, total > 0] / total[total > 0]).mean(axis=1)
    return shares


def _worth(target: Camera, cameras: Sequence[Camera], depths: Sequence[float]) -> F64:
    """Worth [cameras, samples] of cameras to points on the target's rays: 0 outside a camera's picture."""
    return _worth_at(*_seen(target, tuple(cameras), tuple(depths)))


def _worth_at(inside: npt.NDArray[np.bool_], angle: F64) -> F64:
    worth: F64 = inside / (1.0 + (angle / _ANGLE) ** 2)
    return worth


@lru_cache(maxsize=8)  # `select_views` and `view_shares` of a picture ask for the same
def _seen(
    target: Camera, cameras: tuple[Camera, ...], depths: tuple[float, ...]
) -> tuple[npt.NDArray[np.bool_], F64]:
    """Which cameras see sample points, and the angle between camera's and target's ray, radians; [cameras, samples]."""
    points, packed = _on_rays(target, depths), _packed(cameras)
    inside = _inside(packed, points - packed[:, None, POSITION_SLICE])
    if inside.any(axis=0).mean() < _FEW:
        points = np.concatenate([_on_rays(camera, depths) for camera in cameras])
        points = points[_inside(target.packed()[None], (points - target.pose.position)[None])[0]]
        points = points[:: max(1, len(points) // _MOST)]
    return _looks(target, packed, points)


def _looks(target: Camera, packed: F64, points: F64) -> tuple[npt.NDArray[np.bool_], F64]:
    """Which packed cameras see points [samples, 3], and the angle between their and the target's rays, radians."""
    to_points, from_target = points - packed[:, None, POSITION_SLICE], points - np.asarray(target.pose.position)
    inside = _inside(packed, to_points)
    lengths = np.linalg.norm(from_target, axis=-1) * np.linalg.norm(to_points, axis=-1)
    cosine = np.einsum("csk,sk->cs", to_points, from_target) / np.maximum(lengths, 1e-300)
    return inside, np.arccos(np.clip(cosine, -1.0, 1.0))


def _on_rays(camera: Camera, depths: Sequence[float], grid: int = _GRID) -> F64:  # [samples, 3]
    """World points on a grid of a camera's rays."""
    steps = (np.arange(grid) + 0.5) / grid
    u, v = np.meshgrid(steps * camera.width, steps * camera.height)
    uv = np.stack([u.ravel(), v.ravel()], axis=-1)
    return np.concatenate([camera.unproject(uv, np.full(len(uv), depth)) for depth in depths])


@lru_cache(maxsize=8)
def _packed(cameras: tuple[Camera, ...]) -> F64:  # [cameras, CAMERA_SIZE]
    return np.stack([camera.packed() for camera in cameras])


def _inside(cameras: F64, to_points: F64) -> npt.NDArray[np.bool_]:
    """Whether points, given relative to each packed camera [cameras, samples, 3], fall into its picture."""
    packed = cameras[:, None]
    local = to_points @ cameras[:, ROTATION_SLICE].reshape(-1, 3, 3)
    x, y, z = np.moveaxis(local, -1, 0)
    flat = packed[..., KIND] == PERSPECTIVE
    width, height, fx, fy, cx, cy = np.moveaxis(packed[..., WIDTH:ROTATION], -1, 0)
    phi_max, radians_a_column, theta_max, radians_a_row = fx, fy, cx, cy  # of an equirectangular camera
    with np.errstate(divide="ignore", invalid="ignore"):
        middle = 0.5 * width * radians_a_column
        azimuth = (phi_max - np.arctan2(y, x) - middle + math.pi) % (2 * math.pi) - math.pi + middle
        u = np.where(flat, cx - fx * y / x, azimuth / radians_a_column)
        v = np.where(flat, cy - fy * z / x, (theta_max - np.arctan2(z, np.hypot(x, y))) / radians_a_row)
        inside: npt.NDArray[np.bool_] = (u >= 0) & (v >= 0) & (u <= width) & (v <= height) & (~flat | (x > 0))
    return inside
