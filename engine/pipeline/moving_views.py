"""Which reference views may be drawn where cameras move (paper section 4.2: the views of a moving camera may serve
updates of the background model only)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..rig.camera import Pose
from ..rig.frame import Frame

__all__ = ["MovingViews"]


class MovingViews:
    """Notices which cameras have moved in any frame so far."""

    def __init__(self) -> None:
        self._poses: dict[int, Pose] = {}  # of each camera, where it was seen last
        self._moving: set[int] = set()
        self._there: tuple[int, ...] = ()

    def note(self, frame: Frame) -> None:
        """Takes the poses of a frame."""
        self._there = tuple(frame.there)
        poses = {k: frame.views[k].camera.pose for k in self._there}
        moved = {k for k, pose in poses.items() if pose != self._poses.get(k, pose)}
        self._moving = self._moving | moved  # another thread may be reading the set before
        self._poses |= poses

    @property
    def moving(self) -> tuple[int, ...]:
        """The cameras that have moved."""
        return tuple(sorted(self._moving))

    @property
    def some_stand(self) -> bool:
        """Whether a camera that was seen has never moved."""
        return len(self._moving) < len(self._poses)

    def put_back(self, poses: Mapping[int, Pose], moving: Sequence[int]) -> None:
        """Continues: poses: of the cameras that were seen, where each was last; moving: those that have moved."""
        self._poses, self._moving = dict(poses), set(moving)

    def drawn(self, *, moving: bool) -> tuple[int, ...]:
        """The indices of the views that may be drawn: all that are not left out, or those of cameras that stand still
        if there are any."""
        still = tuple(k for k in self._there if k not in self._moving)
        return self._there if moving or not still else still
