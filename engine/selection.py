"""Choice of the views that render a picture (paper section 3.1: n_render views by direction and overlap)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from .camera import Camera

__all__ = ["select_views"]

_GRID = 8  # sample rays across and down the virtual picture
_ANGLE = 0.1  # radians between two cameras' rays to a point at which a view has lost half its worth


def select_views(target: Camera, cameras: Sequence[Camera], count: int, depths: Sequence[float]) -> list[int]:
    """Indices of at most `count` cameras for rendering `target`, the most useful first.

    Sample points are put on the target's rays at the given scene depths (metres). A camera is worth more to a
    point that it sees from a direction near the target's; cameras are taken greedily so that every point is seen
    well, and then by a second camera: what one view hides another shows. Cameras that see no sample are left out.
    """
    worth = np.stack([_worth(target, camera, depths) for camera in cameras])  # [cameras, samples]
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


def _worth(target: Camera, camera: Camera, depths: Sequence[float]) -> npt.NDArray[np.float64]:
    """Worth [samples] of a camera to points on the target's rays: 0 outside its picture."""
    steps = (np.arange(_GRID) + 0.5) / _GRID
    u, v = np.meshgrid(steps * target.width, steps * target.height)
    uv = np.stack([u.ravel(), v.ravel()], axis=-1)
    points = np.concatenate([target.unproject(uv, np.full(len(uv), depth)) for depth in depths])
    seen, depth = camera.project(points)
    with np.errstate(invalid="ignore"):
        inside = (depth > 0) & (seen >= 0).all(-1) & (seen[:, 0] <= camera.width) & (seen[:, 1] <= camera.height)
    a, b = points - target.pose.position, points - camera.pose.position
    lengths = np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1)
    angle = np.arccos(np.clip((a * b).sum(-1) / np.maximum(lengths, 1e-300), -1.0, 1.0))
    worth: npt.NDArray[np.float64] = inside / (1.0 + (angle / _ANGLE) ** 2)
    return worth
