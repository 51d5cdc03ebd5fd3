"""Captures: the farthest surfaces that a reference camera has seen from one pose. Surfaces of the PBS refer to captures
for their colours.

A capture is not its camera: a camera that has moved (section 4.2) may begin a newer capture, while the surfaces from
its older ones stay in the model with the colours of those captures.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..geometry.prepared_view import ViewTable
from ..kernels.background import standing
from ..kernels.background.captures import CAPTURE_SIZE, CB, CODES, CR, Y, sample_colours
from ..kernels.background.standing import FARTHEST
from ..kernels.base.memory import address_of
from ..rig.camera import Pose
from ..support.array_types import F32, F64, I64, U16
from .maximum_depth import MaximumDepthImage
from .tolerances import Tolerances

__all__ = ["Capture", "Captures", "Present"]


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """The farthest surfaces that a reference camera has seen from one pose, and their colours.

    number: the capture's identity, its row in `Captures.table`; camera: index of the reference camera; packed: float64
    [CAMERA_SIZE], the camera in that pose, relative to the scene origin.
    """

    number: int
    camera: int
    image: MaximumDepthImage
    packed: F64

    @property
    def pose(self) -> Pose:
        """The camera's pose."""
        return self.image.camera.pose


class Captures:
    """All captures of a rig, in the order in which they began; each reference camera has one current capture.

    table int64 [n, CAPTURE_SIZE]: the captures as `kernels.background.captures` reads them. No capture is ever dropped.
    """

    def __init__(self) -> None:
        self.current: list[Capture] = []  # by reference camera
        self.table = np.zeros((0, CAPTURE_SIZE), np.int64)
        self._all: list[Capture] = []

    def __len__(self) -> int:
        return len(self._all)

    def __iter__(self) -> Iterator[Capture]:
        return iter(self._all)

    def __getitem__(self, number: int) -> Capture:
        return self._all[number]

    def add(self, camera: int, image: MaximumDepthImage, packed: F64) -> Capture:
        """Begins a capture, which becomes its camera's current one. The first captures of all cameras must be added in
        the order of the cameras, before any second one."""
        capture = Capture(len(self._all), camera, image, np.array(packed))
        self._all.append(capture)
        if camera == len(self.current):
            self.current.append(capture)
        else:
            self.current[camera] = capture
        self.table = np.concatenate([self.table, np.array([image.table_row()], np.int64)])
        return capture

    def planes(self, cameras: Sequence[int]) -> I64:  # [n, 4]
        """Addresses of the codes, y, cb and cr planes of the current captures of `cameras`."""
        numbers = [self.current[c].number for c in cameras]
        return self.table[numbers][:, [CODES, Y, CB, CR]]

    def colours(self, number: int, uv: F32) -> F32:  # [n, 2] -> [n, 3]
        """Y'CbCr codes of the capture `number` at picture coordinates."""
        ycbcr = np.empty((len(uv), 3), np.float32)
        sample_colours(self.table[number], uv, ycbcr)
        return ycbcr

    def compare_by(self, tolerances: Tolerances) -> None:
        """Sets the nontrivial amount of the current captures; the older ones are never updated again."""
        for capture in self.current:
            capture.image.compare_by(tolerances)

    @property
    def memory(self) -> int:
        """Bytes of the images."""
        return sum(capture.image.memory for capture in self._all)


@dataclass(frozen=True, slots=True)
class Present:
    """The evidence on whether a surface stands: the newest frame's views, and the maximum depth images.

    near: surfaces nearer than this depth, metres, are not shown. views: the newest views, in the order of the reference
    cameras; None: no view is consulted, and the farthest surface is shown (as in the paper). memory: codes uint16
    [h, w] of the current maximum depth images by reference camera. A camera that has moved has none: only its present
    view counts.
    """

    near: float
    views: ViewTable | None
    memory: dict[int, U16]

    def packed(self) -> standing.Present:
        """The record for kernels; its addresses are valid while this object lives."""
        if self.views is None:
            return standing.Present(self.near, np.empty((0, 0)), np.empty((0, 2), np.int64))
        codes: npt.NDArray[np.int64] = np.repeat(self.views.addresses[:, :1], 2, axis=1)
        for camera, seen in self.memory.items():
            codes[camera, FARTHEST] = address_of(seen)
        return standing.Present(self.near, self.views.rows, codes)
