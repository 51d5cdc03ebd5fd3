"""Scales that follow from the rig and from what it sees; tolerances are derived from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .camera import Camera
from .depth import DepthCoding
from .frame import Frame
from .prepared import pixels_per_radian
from .settings import Settings
from .triangulation import TriangulationOptions

__all__ = ["Scene"]


@dataclass(frozen=True, slots=True)
class Scene:
    """The scene's origin (metres, world), how far viewers are from the cameras, and typical depths.

    baseline: the radius of the rig in metres, or the setting `baseline_m`. depths: 10th, 50th and 90th percentile
    of the depths of the first frame, metres.
    """

    origin: npt.NDArray[np.float64]
    baseline: float
    depths: tuple[float, float, float]
    coding: DepthCoding  # holds every camera's depth range

    @classmethod
    def of(cls, cameras: Sequence[Camera], settings: Settings, frame: Frame) -> Scene:
        """Measure a rig and its first frame."""
        positions = np.array([camera.pose.position for camera in cameras])
        origin = np.median(positions, axis=0)
        near = min(camera.depth.near for camera in cameras)
        far = max(camera.depth.far for camera in cameras)
        samples = [view.camera.depth.depth(view.codes[::16, ::16]).ravel() for view in frame.views]
        depths = np.concatenate(samples)
        depths = depths[np.isfinite(depths)]
        p10, p50, p90 = (float(d) for d in np.percentile(depths if len(depths) else [near], (10, 50, 90)))
        radius = float(np.median(np.linalg.norm(positions - origin, axis=1)))
        baseline = settings.baseline_m or max(radius, 0.02 * p50)
        return cls(origin, baseline, (p10, p50, p90), DepthCoding(near, far, 16, has_invalid=True))

    def triangulation(self, camera: Camera, settings: Settings) -> TriangulationOptions:
        """Bounds of a camera's triangulation: pixels of parallax at the baseline, turned into disparity."""
        pixel = 1.0 / (self.baseline * pixels_per_radian(camera))
        return TriangulationOptions(
            settings.tolerance_px * pixel, settings.edge_px * pixel, settings.max_block_px
        )
