"""Which reference views may be drawn where cameras move (paper section 4.2: the views of a moving camera may serve
updates of the background model only)."""

from __future__ import annotations

from ..rig.camera import Pose
from ..rig.frame import Frame

__all__ = ["MovingViews"]


class MovingViews:
    """Notices which cameras have moved in any frame so far."""

    def __init__(self) -> None:
        self._poses: list[Pose] = []  # in the frame before
        self._moving: set[int] = set()

    def note(self, frame: Frame) -> None:
        """Takes the poses of a frame."""
        poses = [view.camera.pose for view in frame.views]
        self._moving |= {k for k, pose in enumerate(self._poses) if pose != poses[k]}
        self._poses = poses

    def drawn(self, *, moving: bool) -> tuple[int, ...]:
        """The indices of the views that may be drawn: all, or those of cameras that stand still if there are any."""
        everything = tuple(range(len(self._poses)))
        still = tuple(k for k in everything if k not in self._moving)
        return everything if moving or not still else still
