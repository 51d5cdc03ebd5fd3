"""Scales that follow from the rig and from what it sees; tolerances are derived from them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..rig.camera import Camera, Perspective
from ..rig.depth import DepthCoding
from ..rig.frame import Frame
from ..settings import Settings
from .prepared_view import pixels_per_radian
from .triangulation import TriangulationOptions

__all__ = ["Scene"]

# A step of disparity between neighbours that is a depth edge: four reprojected pixels. In coarse pictures these are a
# step from the median depth to infinity, and whoever stands before a wall would be tied to it: from there to a third
# farther is an edge, if it is two pixels, below which what is near and slanted would be torn.
_EDGE_PX = 4.0
_LEAST_EDGE_PX = 2.0
_EDGE_SHARE = 0.25  # of the median disparity


@dataclass(frozen=True, slots=True)
class Scene:
    """The scene's origin (metres, world), how far viewers are from the cameras, and typical depths.

    The origin is amid the rig. baseline: the radius of the rig in metres, or the setting `baseline_m`. depths: 10th,
    50th and 90th percentile of the depths of the first frame, metres. None depends on the world's axes.
    """

    origin: npt.NDArray[np.float64]
    baseline: float
    depths: tuple[float, float, float]
    coding: DepthCoding  # holds every camera's depth range

    @classmethod
    def of(cls, cameras: Sequence[Camera], settings: Settings, frame: Frame) -> Scene:
        """Measure a rig and its first frame; raises ValueError where that has no depth at all."""
        positions = np.array([camera.pose.position for camera in cameras])
        origin = _middle(positions)
        near = min(camera.depth.near for camera in cameras)
        far = max(camera.depth.far for camera in cameras)
        depths = _depths(frame, 16)
        if not len(depths):
            depths = _depths(frame, 1)
        if not len(depths):
            raise ValueError(f"frame {frame.index}: no view has a valid depth: expected some in the first frame")
        p10, p50, p90 = (float(d) for d in np.percentile(depths, (10, 50, 90)))
        radius = float(np.median(np.linalg.norm(positions - origin, axis=1)))
        baseline = settings.baseline_m or max(radius, 0.02 * p50)
        return cls(origin, baseline, (p10, p50, p90), DepthCoding(near, far, 16, has_invalid=True))

    def coding_at(self, position: npt.ArrayLike) -> DepthCoding:
        """Depth codes that hold what the cameras see as it is seen from another place (metres, world)."""
        away = float(np.linalg.norm(np.asarray(position, np.float64) - self.origin))
        return dataclasses.replace(self.coding, far=self.coding.far + away)

    def depths_for(self, viewer: Camera) -> tuple[float, float]:
        """Lesser and median depth of what a viewer looks at, metres: farther away from behind the rig."""
        behind = self._behind(viewer)
        return self.depths[0] + behind, self.depths[1] + behind

    def disparity_shrink(self, viewer: Camera) -> float:
        """About what a difference of disparities that the cameras measure becomes for a viewer: less from behind them.

        Disparity is 1 / z: b metres farther away, a difference of d / z^2 is d / (z + b)^2.
        """
        return (self.depths[1] / self.depths_for(viewer)[1]) ** 2

    def _behind(self, viewer: Camera) -> float:
        """How far a viewer is behind the rig, metres; 0 in it and before it."""
        to_rig = self.origin - viewer.pose.position
        away = float(np.linalg.norm(to_rig)) - self.baseline
        if isinstance(viewer.projection, Perspective):
            away = min(away, float(to_rig @ viewer.pose.rotation()[:, 0]))
        return max(away, 0.0)

    def triangulation(self, camera: Camera, settings: Settings) -> TriangulationOptions:
        """Bounds of a camera's triangulation: pixels of parallax at the baseline, turned into disparity."""
        pixel = 1.0 / (self.baseline * pixels_per_radian(camera))
        if settings.edge_px is None:
            edge = min(_EDGE_PX * pixel, max(_EDGE_SHARE / self.depths[1], _LEAST_EDGE_PX * pixel))
        else:
            edge = settings.edge_px * pixel
        return TriangulationOptions(settings.tolerance_px * pixel, edge, settings.max_block_px)


def _depths(frame: Frame, stride: int) -> npt.NDArray[np.float64]:  # [n]
    """The valid depths of every stride-th pixel both ways, metres."""
    depths = np.concatenate([view.camera.depth.depth(view.codes[::stride, ::stride]).ravel() for view in frame.views])
    valid: npt.NDArray[np.float64] = depths[np.isfinite(depths)]
    return valid


def _middle(positions: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:  # [n, 3] -> [3]
    """The geometric median (Weiszfeld 1937): a few cameras far from the others do not move it, and it turns with the
    rig, as medians of coordinates do not."""
    local = positions - positions[0]
    spread, middle = float(np.abs(local).max()), local.mean(axis=0)
    for _ in range(100 if spread > 0 else 0):
        weights = 1.0 / np.maximum(np.linalg.norm(local - middle, axis=1), 1e-9 * spread)
        before, middle = middle, weights @ local / weights.sum()
        if np.abs(middle - before).max() < 1e-9 * spread:
            break
    result: npt.NDArray[np.float64] = positions[0] + middle
    return result
