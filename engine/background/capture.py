"""Captures: the farthest surfaces that a reference camera has seen from one pose. Surfaces of the PBS refer to captures
for their colours.

A capture is not its camera: a camera that has moved (section 4.2) begins a newer capture, while the surfaces from its
older ones stay in the model with the colours of those captures. Of an older capture only the parts of pictures remain
that its surfaces use (`older_captures`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..geometry.prepared_view import ViewTable
from ..kernels.background import standing
from ..kernels.background.captures import CAPTURE_SIZE, CB, CODES, CR, HEIGHT, WIDTH, WRAPS, Y, sample_colours
from ..kernels.background.standing import FARTHEST, NOW
from ..kernels.base.memory import address_of
from ..rig.camera import Pose
from ..rig.frame import Texture
from ..support.array_types import F32, F64, I64, U16
from .atlas import Atlas
from .maximum_depth import MaximumDepthImage
from .tolerances import Tolerances

__all__ = ["Capture", "Captures", "Present", "Remains"]


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

    @property
    def memory(self) -> int:
        """Bytes of its pictures."""
        return self.image.memory

    def table_row(self) -> list[int]:
        """Its pictures as `kernels.background.captures` reads them."""
        return self.image.table_row()


@dataclass(frozen=True, slots=True, eq=False)
class Remains:
    """What is left of older captures of a reference camera: the parts of their pictures that surfaces use, side by side
    in one picture.

    number, camera: as in `Capture`. codes uint16 [h, w], texture: 10 bits, 4:2:0. edge: the step between codes that is
    a depth edge; reach: pixels that are farther apart in a row or a column may belong to different parts. late: of a
    late layer (`late_layers`), not of older captures.
    """

    number: int
    camera: int
    codes: U16
    texture: Texture
    edge: int
    reach: int
    late: bool = False

    @property
    def memory(self) -> int:
        """Bytes of its pictures."""
        return sum(plane.nbytes for plane in (self.codes, self.texture.y, self.texture.cb, self.texture.cr))

    def table_row(self) -> list[int]:
        """Its pictures as `kernels.background.captures` reads them."""
        planes = (self.texture.y, self.texture.cb, self.texture.cr, self.codes)
        height, width = self.codes.shape
        return [*map(address_of, planes), width, height, 0, self.edge, self.reach, 0]


class Captures:
    """All captures of a rig, by number; each reference camera has one current capture. Atlases have numbers among them:
    surfaces from an earlier model refer to them for their colours.

    table int64 [n, CAPTURE_SIZE]: both as `kernels.background.captures` reads them; it is replaced, never written to.
    The number of a capture that was dropped is given to a newer one; an atlas keeps its number.
    """

    def __init__(self) -> None:
        self.current: list[Capture] = []  # by reference camera
        self.table = np.zeros((0, CAPTURE_SIZE), np.int64)
        self.atlases: dict[int, Atlas] = {}  # by number
        self._all: dict[int, Capture | Remains] = {}

    def __len__(self) -> int:
        return len(self._all)

    def __iter__(self) -> Iterator[Capture | Remains]:
        return iter([self._all[number] for number in sorted(self._all)])

    def __getitem__(self, number: int) -> Capture | Remains:
        return self._all[number]

    @property
    def free(self) -> int:
        """The number of the next capture or atlas: the least one that none of them has."""
        count = len(self._all) + len(self.atlases)
        return next(n for n in range(count + 1) if n not in self._all and n not in self.atlases)

    def add(self, camera: int, image: MaximumDepthImage, packed: F64) -> Capture:
        """Begins a capture, which becomes its camera's current one. The first captures of all cameras must be added in
        the order of the cameras, before any second one."""
        capture = Capture(self.free, camera, image, np.array(packed))
        self.put(capture)
        if camera == len(self.current):
            self.current.append(capture)
        else:
            self.current[camera] = capture
        return capture

    def put(self, capture: Capture | Remains) -> None:
        """Takes in a capture under its number."""
        self._all[capture.number] = capture
        self._note(capture.number, capture.table_row())

    def add_atlas(self, atlas: Atlas) -> int:
        """Adds an atlas and returns its number."""
        number = self.free
        self.put_atlas(number, atlas)
        return number

    def put_atlas(self, number: int, atlas: Atlas) -> None:
        """Takes in an atlas under a number that nothing else has."""
        self.atlases[number] = atlas
        self._note(number, atlas.table_row())

    def _note(self, number: int, row: list[int]) -> None:
        table = np.zeros((max(*self._all, *self.atlases, number) + 1, CAPTURE_SIZE), np.int64)
        table[: len(self.table)] = self.table[: len(table)]
        table[number] = row
        self.table = table

    def drop(self, number: int) -> None:
        """Removes a capture to which no surface refers; its memory is freed when nobody holds it any more."""
        del self._all[number]

    def snapshot(self) -> Captures:
        """The captures and atlases as they are now, for readers in other threads: it keeps them alive."""
        copy = Captures()
        copy.current, copy.table, copy._all = list(self.current), self.table, dict(self._all)
        copy.atlases = dict(self.atlases)
        return copy

    def extent(self, number: int) -> tuple[int, int, bool]:
        """Width and height of the picture of a capture or atlas, pixels, and whether its left and right sides meet."""
        width, height, wraps = self.table[number, [WIDTH, HEIGHT, WRAPS]].tolist()
        return width, height, bool(wraps)

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
        """Bytes of the pictures."""
        return sum(picture.memory for pictures in (self._all, self.atlases) for picture in pictures.values())


@dataclass(frozen=True, slots=True)
class Present:
    """The evidence on whether a surface stands: the newest frame's views, and the maximum depth images.

    near: surfaces nearer than this depth, metres, are not shown. views: the newest views, in the order of the reference
    cameras; None: no view is consulted, and the farthest surface is shown (as in the paper). memory: codes uint16
    [h, w] of the current maximum depth images by reference camera. A camera that has moved has none: only its present
    view counts. Of a camera whose view is left out, only the memory counts.
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
        # The row of a view that is left out has no pixels, so what its camera remembers gets a row of its own.
        views = self.views.views
        absent = [camera for camera in self.memory if not views[camera].view.there]
        rows = [self.views.rows, *(views[camera].camera_row()[None] for camera in absent)]
        remembered = codes[absent]
        remembered[:, NOW] = 0
        return standing.Present(self.near, np.concatenate(rows), np.concatenate([codes, remembered]))
