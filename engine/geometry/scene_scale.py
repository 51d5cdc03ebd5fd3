"""Scales that are measured on the rig and its first frame; tolerances are derived from them."""

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

# A depth edge is a disparity step of _EDGE_PX reprojected pixels between neighbours. In coarse pictures, however, that
# can be the step from the median depth to infinity, and a person before a wall would be connected with it. There,
# _EDGE_SHARE of the median disparity (from the median depth to a third farther) is an edge too, but never less than
# _LEAST_EDGE_PX: smaller steps occur on near, slanted surfaces, which would be torn.
_EDGE_PX = 4.0
_LEAST_EDGE_PX = 2.0
_EDGE_SHARE = 0.25  # of the median disparity
_AFAR = 4.0  # baselines: from a camera farther away from the rig's middle, steps look as large as from the middle


@dataclass(frozen=True, slots=True)
class Scene:
    """The scene's origin (metres, world), how far viewers are from the cameras, and typical depths.

    origin: the middle of the rig. baseline: the radius of the rig in metres, or the setting `baseline_m`. depths: 10th,
    50th and 90th percentile of the depths of the first frame, metres. None of these depends on the world's axes.
    """

    origin: npt.NDArray[np.float64]
    baseline: float
    depths: tuple[float, float, float]
    coding: DepthCoding  # holds every camera's depth range

    @classmethod
    def of(cls, cameras: Sequence[Camera], settings: Settings, frame: Frame) -> Scene:
        """Measure a rig and its first frame; raises ValueError if the frame has no valid depth."""
        depths = _depths(frame, 16)
        if not len(depths):
            depths = _depths(frame, 1)
        if not len(depths):
            raise ValueError(f"frame {frame.index}: no view has a valid depth: expected some in the first frame")
        p10, p50, p90 = (float(d) for d in np.percentile(depths, (10, 50, 90)))
        return cls._with(cameras, settings, (p10, p50, p90))

    @classmethod
    def unseen(cls, cameras: Sequence[Camera], settings: Settings) -> Scene:
        """A rig none of whose views has shown a depth yet: the depths are only what the depth codings allow."""
        near = min(camera.depth.near for camera in cameras)
        return cls._with(cameras, settings, (near, 2.0 * near, 4.0 * near))

    @classmethod
    def _with(cls, cameras: Sequence[Camera], settings: Settings, depths: tuple[float, float, float]) -> Scene:
        positions = np.array([camera.pose.position for camera in cameras])
        origin = _middle(positions)
        near = min(camera.depth.near for camera in cameras)
        far = max(camera.depth.far for camera in cameras)
        radius = float(np.median(np.linalg.norm(positions - origin, axis=1)))
        baseline = settings.baseline_m or max(radius, 0.02 * depths[1])
        return cls(origin, baseline, depths, DepthCoding(near, far, 16, has_invalid=True))

    def coding_at(self, position: npt.ArrayLike) -> DepthCoding:
        """A depth coding for a camera at `position` (metres, world) that can hold all that the cameras see."""
        away = float(np.linalg.norm(np.asarray(position, np.float64) - self.origin))
        return dataclasses.replace(self.coding, far=self.coding.far + away)

    def depths_for(self, viewer: Camera) -> tuple[float, float]:
        """10th and 50th percentile of the depths for a viewer, metres; they are larger for a viewer behind the rig."""
        behind = self._behind(viewer)
        return self.depths[0] + behind, self.depths[1] + behind

    def disparity_shrink(self, viewer: Camera) -> float:
        """The approximate ratio of a disparity difference as a viewer sees it to the same as the cameras see it.

        It is 1, or less for a viewer behind the rig: disparity is 1 / z, so from b metres farther away a difference of
        d / z^2 becomes d / (z + b)^2.
        """
        return (self.depths[1] / self.depths_for(viewer)[1]) ** 2

    def _behind(self, viewer: Camera) -> float:
        """How far a viewer is behind the rig, metres; 0 inside the rig and in front of it."""
        to_rig = self.origin - viewer.pose.position
        away = float(np.linalg.norm(to_rig)) - self.baseline
        if isinstance(viewer.projection, Perspective):
            away = min(away, float(to_rig @ viewer.pose.rotation()[:, 0]))
        return max(away, 0.0)

    def triangulation(self, camera: Camera, settings: Settings, *, afar: bool = False) -> TriangulationOptions:
        """Bounds of a camera's triangulation: the settings' pixels of parallax at the baseline, as disparities.

        afar: viewers are about the rig's middle, wherever this camera is. If it is far from there, they see the two
        sides of a depth edge that much farther apart: a surface across it would be a curtain before what is behind.
        """
        pixel = 1.0 / (self.baseline * pixels_per_radian(camera))
        away = float(np.linalg.norm(np.asarray(camera.pose.position) - self.origin)) if afar else 0.0
        step = pixel * self.baseline / away if away > _AFAR * self.baseline else pixel
        if settings.edge_px is None:
            edge = min(_EDGE_PX * step, max(_EDGE_SHARE / self.depths[1], _LEAST_EDGE_PX * step))
        else:
            edge = settings.edge_px * step
        return TriangulationOptions(settings.tolerance_px * pixel, edge, settings.max_block_px)


def _depths(frame: Frame, stride: int) -> npt.NDArray[np.float64]:  # [n]
    """The valid depths of every stride-th pixel in both directions, metres."""
    views = [frame.views[c] for c in frame.there]
    sampled = [view.camera.depth.depth(view.codes[::stride, ::stride]).ravel() for view in views]
    depths = np.concatenate([np.empty(0), *sampled])
    valid: npt.NDArray[np.float64] = depths[np.isfinite(depths)]
    return valid


def _middle(positions: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:  # [n, 3] -> [3]
    """The geometric median (Weiszfeld 1937). A few cameras far from the others do not move it and, unlike medians of
    coordinates, it turns with the rig."""
    local = positions - positions[0]
    spread, middle = float(np.abs(local).max()), local.mean(axis=0)
    for _ in range(100 if spread > 0 else 0):
        weights = 1.0 / np.maximum(np.linalg.norm(local - middle, axis=1), 1e-9 * spread)
        before, middle = middle, weights @ local / weights.sum()
        if np.abs(middle - before).max() < 1e-9 * spread:
            break
    result: npt.NDArray[np.float64] = positions[0] + middle
    return result
