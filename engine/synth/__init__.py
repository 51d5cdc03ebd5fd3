"""Twins of the paper's test sequences: ray-traced scenes with ground truth for any virtual camera."""

from .rigs import Rig, twin_cameras
from .scenes import TWINS, Scene, check_twin, make_scene
from .twin import FPS, Twin, make_twin, render_view, twin_frame, write_twin

__all__ = [
    "FPS",
    "TWINS",
    "Rig",
    "Scene",
    "Twin",
    "check_twin",
    "make_scene",
    "make_twin",
    "render_view",
    "twin_cameras",
    "twin_frame",
    "write_twin",
]
