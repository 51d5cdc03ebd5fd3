"""Viewers, for both halves of the pipeline: stereo heads, or single cameras."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

from ..geometry.scene_scale import Scene
from ..rig.camera import Camera
from ..rig.selection import select_views
from ..rig.viewer import StereoView
from ..settings import Settings

__all__ = ["Look", "Viewer", "head_camera", "scaled", "selected"]

Viewer = StereoView | Camera
V = TypeVar("V", StereoView, Camera, StereoView | Camera)
Look = Callable[[], Mapping[str, Viewer]]  # returns the present viewers by name; called in any thread


def head_camera(viewer: Viewer, scene: Scene) -> Camera:
    """One camera that stands for all of a viewer's pictures."""
    return viewer if isinstance(viewer, Camera) else Camera("head", viewer.left, viewer.pose, scene.coding)


def selected(
    viewer: Viewer, cameras: Sequence[Camera], drawn: Sequence[int], scene: Scene, settings: Settings
) -> list[int]:
    """Indices of the n_render reference views for a viewer (section 3.1), of those that may be drawn, the most useful
    first."""
    if not drawn:
        return []
    target = head_camera(viewer, scene)
    chosen = select_views(target, [cameras[k] for k in drawn], settings.n_render, scene.depths_for(target))
    return [drawn[k] for k in chosen]


def scaled(viewer: V, settings: Settings) -> V:
    """A viewer with the rendered size of pictures (`Settings.output_scale`)."""
    if settings.output_scale == 1.0:
        return viewer
    if isinstance(viewer, StereoView):
        return viewer.scaled(settings.output_scale)
    return dataclasses.replace(viewer, projection=viewer.projection.scaled(settings.output_scale))
