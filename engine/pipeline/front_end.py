"""The front end (paper Fig. 3), once per pose: select views, then let the renderer draw from the front buffer.

It reads only the front buffer, so the back end may work on the next frame meanwhile.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

from ..background.exposure import to_picture
from ..io.images import encode_picture
from ..rendering.renderer import PictureTask
from ..rig.camera import Camera
from ..rig.selection import view_shares
from ..rig.viewer import EncodedPair, PairReport, RenderedPicture, StereoPicture, StereoView
from ..support.array_types import F64
from ..support.stages import Stages, timed
from .front_buffer import FrontBuffer
from .viewpoint import Viewer, head_camera, scaled, selected

__all__ = ["render_camera", "render_encoded", "render_pair"]

T = TypeVar("T")


def render_pair(
    front: FrontBuffer, view: StereoView, viewer: str | None, finish: Callable[[RenderedPicture], T]
) -> tuple[T, T, Stages]:
    """Both eyes' pictures, each passed to `finish` in the thread that drew it (`PreparedFrame.render`), and the time of
    the stage `select`."""
    view, stages = scaled(view, front.settings), Stages()
    with timed(stages, "select"):
        task = _task(front, view, view.eyes(front.content.scene.coding), viewer)
    left, right = front.prepared.render(task, finish)
    return left, right, stages


def render_encoded(front: FrontBuffer, view: StereoView, viewer: str | None, encoding: str) -> EncodedPair:
    """Both eyes' pictures as bytes (`io.images.encode_picture`), each encoded in the thread that drew it."""
    start, quality = time.perf_counter(), front.settings.jpeg_quality

    def encode(picture: RenderedPicture) -> tuple[RenderedPicture, bytes, float]:
        begun = time.perf_counter()
        data = encode_picture(picture.texture, encoding, quality)
        return picture, data, 1e3 * (time.perf_counter() - begun)

    (left, left_data, left_ms), (right, right_data, right_ms), selecting = render_pair(front, view, viewer, encode)
    pair, (height, width) = StereoPicture(left, right, front.frame_index), left.texture.y.shape
    total_ms = 1e3 * (time.perf_counter() - start)
    report = PairReport(
        front.frame_index, width, height, pair.holes, pair.stages | selecting, left_ms + right_ms, total_ms
    )
    return EncodedPair(left_data, right_data, report)


def render_camera(front: FrontBuffer, camera: Camera, viewer: str | None) -> RenderedPicture:
    """The picture of one virtual camera of any projection."""
    camera = scaled(camera, front.settings)
    (picture,) = front.prepared.render(_task(front, camera, (camera,), viewer), lambda picture: picture)
    return picture


def _task(front: FrontBuffer, shown: Viewer, targets: tuple[Camera, ...], viewer: str | None) -> PictureTask:
    cameras = [prepared.view.camera for prepared in front.content.views]
    chosen = selected(shown, cameras, front.content.drawn, front.content.scene, front.settings)
    return PictureTask(targets, viewer, tuple(chosen), _tones(front, shown), front.settings, front.effects)


def _tones(front: FrontBuffer, shown: Viewer) -> F64 | None:
    """The packed tones that convert the colours of each view, and of the model, to a picture's tone [n + 1, TONE_SIZE].
    """
    if front.tones is None:
        return None
    target = head_camera(shown, front.content.scene)
    cameras = [prepared.view.camera for prepared in front.content.views]
    return to_picture(front.tones, view_shares(target, cameras, front.content.scene.depths_for(target)))
