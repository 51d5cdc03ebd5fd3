"""A look at all frames of a sequence: views that show nothing, and are therefore left out of their frames."""

from __future__ import annotations

from pathlib import Path

from ..rig.camera import Camera
from ..rig.left_out import Shown, empty_views
from .tmiv_json import Description
from .video_files import find_video
from .yuv import RawVideo

__all__ = ["look_for_empty_views"]


def look_for_empty_views(folder: Path, description: Description) -> list[str]:
    """The source views that show nothing (`rig.left_out.empty_views`) in some frames, one line for each camera and
    reason.

    `folder`: that of the video files. Cameras whose files are missing are passed over (`tmiv_check.check_sequence`
    reports them), as are frames that some file does not hold.
    """
    cameras = [description.cameras[name] for name in description.source_names if name in description.cameras]
    videos = {camera.name: _videos(folder, camera, description) for camera in cameras}
    whole = {camera.name: pair for camera in cameras if (pair := videos[camera.name])}
    count = min((video.frame_count for pair in whole.values() for video in pair), default=0)
    frames: dict[tuple[str, str], list[int]] = {}
    for frame in range(count):
        shown = [
            Shown(texture.plane(frame, 0), texture.format.bits, depth.plane(frame, 0), description.cameras[name].depth)
            for name, (texture, depth) in whole.items()
        ]
        for name, fault in zip(whole, empty_views(shown), strict=True):
            if fault:
                frames.setdefault((name, str(fault)), []).append(frame)
    return [
        f"camera {name}: {fault} in {len(found)} of {count} frames, of which it is left out (the first is {found[0]})"
        for (name, fault), found in frames.items()
    ]


def _videos(folder: Path, camera: Camera, description: Description) -> tuple[RawVideo, RawVideo] | None:
    try:
        texture, depth = (find_video(folder, camera, kind, description.cameras) for kind in ("texture", "depth"))
    except ValueError:
        return None  # several files could be meant: check_sequence names them
    return (texture, depth) if texture and depth else None
