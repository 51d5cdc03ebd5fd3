"""Maximum depth images: for each camera and pixel, the farthest surface seen so far (section 3.3.3)."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from ..geometry.mesh import Mesh
from ..kernels.background.flags import KEPT, UPDATED, mark_provisional
from ..kernels.background.fusion import fuse_maximum_depth, settle_points
from ..kernels.background.maximum_depth import PHASES, TILE, update_maximum_depth
from ..kernels.background.nontrivial import Rules, prepare_limits
from ..kernels.background.picture import Picture
from ..kernels.background.surfaces import Triangles
from ..kernels.base.memory import address_of
from ..kernels.base.tone import IDENTITY
from ..rig.camera import Camera
from ..rig.depth import DepthCoding
from ..rig.frame import Texture, View
from ..rig.texture import toned_texture
from .light import FollowedLight
from .state import CaptureState
from .tolerances import Tolerances

__all__ = ["BLOCK", "MaximumDepthImage"]

BLOCK = (2 * PHASES, TILE)  # rows and columns of the blocks by which changes are searched


class MaximumDepthImage:
    """Depth codes and colour of the farthest surface per pixel, and flags for the P-PBS.

    codes uint16 [h, w]; texture: 10 bits, 4:2:0. flags uint8 [h, w], bits: changed since the camera's last turn
    (UPDATED), belongs to the P-PBS (KEPT), the colour was seen at the rim of something nearer (PROVISIONAL). fused
    uint8 [h, w]: the number of views whose mean depth and colour are; empty while that is one everywhere. `edge`: the
    disparity step of a depth edge, 1/m; `tone`: the tone that is applied to the view's colours, packed
    (`kernels.base.tone`). Without `refine` no colour is provisional. Codes and texture keep their addresses for life.
    """

    def __init__(
        self, view: View, tolerances: Tolerances, edge: float, tone: npt.ArrayLike = IDENTITY, *, refine: bool = True
    ) -> None:
        self.camera = view.camera
        self.codes = np.array(view.codes, np.uint16, order="C")  # kernels take addresses
        self.texture = toned_texture(view.texture, tone)
        self.flags = np.zeros(self.codes.shape, np.uint8)
        self.fused = np.empty((0, 0), np.uint8)
        self._light: FollowedLight | None = None  # until light is followed
        self._edge = min(round(edge / view.camera.depth.step), view.camera.depth.max_code)  # in codes
        self._refine = refine
        self._number = 0  # views taken so far
        self._turn = 0  # views that were compared whole so far
        self.compare_by(tolerances)
        blocks = [-(-size // step) for size, step in zip(self.codes.shape, BLOCK, strict=True)]
        self.pending = np.zeros(blocks, bool)  # blocks with updates since the camera's last turn
        self.lone = np.zeros(blocks, bool)  # blocks in which updated pixels wait for neighbours since then
        self._counts = np.zeros((2, *blocks), np.int64)

    def compare_by(self, tolerances: Tolerances) -> None:
        """Sets the nontrivial amount (section 3.3.3) by which a new depth must be farther."""
        self._compare_by(tolerances.margin_m, tolerances.margin_disparity(self.camera.depth))
        mark_provisional(self.codes, self._rules, self.flags)

    def _compare_by(self, margin_m: float, margin_disparity: float) -> None:
        coding = self.camera.depth
        edge = self._edge if self._refine else coding.max_code  # no neighbour is nearer by more than that
        self._rules = _comparison(coding, margin_m, margin_disparity, edge)

    def state(self) -> dict[str, Any]:
        """All its data except the camera, by the names of `state.CaptureState`; copies."""
        arrays = {name: getattr(self, name).copy() for name in ("codes", "flags", "fused", "pending", "lone")}
        y, cb, cr = (plane.copy() for plane in _planes(self.texture))
        rules = self._rules
        return {
            **arrays, "y": y, "cb": cb, "cr": cr, "counts": self._counts.copy(), "number": self._number,
            "turn": self._turn, "edge": self._edge, "refine": self._refine, "margin_m": rules.margin_m,
            "margin_disparity": rules.margin_disparity, "light": None if self._light is None else self._light.state(),
        }  # fmt: skip

    @classmethod
    def from_state(cls, camera: Camera, state: CaptureState) -> MaximumDepthImage:
        """An image with this state; arrays are copied."""
        view = View(camera, Texture(state.y, state.cb, state.cr), state.codes)
        image = cls(view, Tolerances(0.0, 0.0), 0.0, refine=state.refine)
        image._edge = state.edge
        for name in ("flags", "fused", "pending", "lone"):
            setattr(image, name, getattr(state, name).copy())
        image._counts = state.counts.copy()
        image._light = None if state.light is None else FollowedLight.from_state(state.light)
        image._number, image._turn = state.number, state.turn
        image._compare_by(state.margin_m, state.margin_disparity)
        return image

    def update(self, view: View, tone: npt.ArrayLike = IDENTITY, *, whole: bool = True) -> int:
        """Takes over the pixels where the camera's new view is farther by a nontrivial amount; returns their number.

        Without `whole`, only a sample of the rows is compared in blocks without changes: some changes are then found
        later, but all within PHASES views. `tone` as in the class.
        """
        self._number += 1
        self._turn += whole
        before, counts = self._counts[self._number % 2], self._counts[1 - self._number % 2]
        update_maximum_depth(
            Picture(view.codes, *_planes(view.texture)), Picture(self.codes, *_planes(self.texture)), self.flags,
            self.fused, self._rules, np.asarray(tone), before, counts, self._number, self._turn if whole else -1,
        )  # fmt: skip
        self.pending |= counts > 0
        return int(counts.sum())

    def fuse(self, view: View, tone: npt.ArrayLike = IDENTITY) -> None:
        """Averages with the view that `update` took, where both show the same surface. Each call covers one of PHASES
        groups of rows."""
        if self.fused.size == 0:
            self.fused = np.ones(self.codes.shape, np.uint8)
        fuse_maximum_depth(
            Picture(view.codes, *_planes(view.texture)), Picture(self.codes, *_planes(self.texture)), self.flags,
            self.fused, self._rules, np.asarray(tone), self._number,
        )  # fmt: skip

    def follow_light(self, view: View, tone: npt.ArrayLike, share: float, *, first: int = 0) -> None:
        """Moves colours by `share` of the way to those of the view that `update` took, where the light has changed and
        both show the same surface (`light`). Each call covers one of PHASES groups of rows, the first call number
        `first`."""
        if self._light is None:
            self._light = FollowedLight(self.codes.shape, first)
        self._light.follow(
            Picture(view.codes, *_planes(view.texture)), Picture(self.codes, *_planes(self.texture)), self.flags,
            self._rules, np.asarray(tone), share,
        )  # fmt: skip

    @property
    def memory(self) -> int:
        """Bytes of the arrays of pixels."""
        seen = sum(array.nbytes for array in (self.codes, *_planes(self.texture)))
        return seen + self.flags.nbytes + self.fused.nbytes

    def suggest(self, which: npt.NDArray[np.uint8]) -> None:  # [h, w]
        """Makes the pixels that have a depth and for which `which` is not 0 candidates for the P-PBS, as if they were
        updated."""
        self.flags |= np.where((which != 0) & (self.codes >= self._rules.lowest), np.uint8(UPDATED), np.uint8(0))
        self.pending |= self._blocks_of(UPDATED)

    def postpone(self) -> None:
        """Makes the pixels that belong to the P-PBS candidates again."""
        self.flags[self.flags & KEPT != 0] ^= np.uint8(KEPT | UPDATED)
        self.pending |= self._blocks_of(UPDATED)

    def settled_codes(self) -> npt.NDArray[np.uint16]:  # [h, w]
        """The codes, but 0 for candidates for the P-PBS; other codes are at least 1."""
        known = self.codes if self._rules.lowest else np.maximum(self.codes, np.uint16(1))
        waiting = self.flags & UPDATED != 0
        return np.where(waiting, np.uint16(0), known) if waiting.any() else known

    def _blocks_of(self, bits: int) -> npt.NDArray[np.bool_]:
        """The blocks in which a pixel has one of the flags `bits`."""
        found = self.flags & np.uint8(bits) != 0
        rows = np.logical_or.reduceat(found, np.arange(0, found.shape[0], BLOCK[0]), axis=0)
        blocks: npt.NDArray[np.bool_] = np.logical_or.reduceat(rows, np.arange(0, found.shape[1], BLOCK[1]), axis=1)
        return blocks

    @property
    def kept(self) -> npt.NDArray[np.uint8]:  # [h, w]
        """Not 0 where a pixel belongs to the P-PBS; a copy."""
        return self.flags & np.uint8(KEPT)

    @property
    def rules(self) -> Rules:
        """The rules by which it compares codes, as kernels take them."""
        return self._rules

    @property
    def edge(self) -> int:
        """The step between codes that is a depth edge."""
        return self._edge

    @property
    def rounds(self) -> int:
        """How often `fuse` has covered all pixels."""
        return self._number // PHASES

    def settled(self, mesh: Mesh, packed: npt.NDArray[np.float64]) -> npt.NDArray[np.float32]:  # [n, 3]
        """The points of a mesh of this image at the image's present depths, metres; `packed`: the camera."""
        points = np.empty_like(mesh.points)
        settle_points(Triangles(mesh.points, mesh.uv, mesh.triangles), packed, self._rules, self.codes, points)
        return points

    def table_row(self) -> list[int]:
        """The image as `kernels.background.captures` reads it."""
        addresses = [address_of(plane) for plane in (*_planes(self.texture), self.codes)]
        return [*addresses, self.camera.width, self.camera.height, int(self.camera.wraps), self._edge, 0, 0]


@lru_cache(maxsize=1)
def _comparison(
    coding: DepthCoding, margin_m: float, margin_disparity: float, edge: int
) -> Rules:
    """The rules by which a maximum depth image compares. The cameras of a rig mostly share them."""
    packed = coding.packed()
    rules = Rules(
        packed.offset, packed.step, packed.least, margin_m, margin_disparity, edge, 0, 0, 0,
        np.empty(1 << 16, np.uint16),
    )  # fmt: skip
    least, bend, shift = prepare_limits(rules)
    return rules._replace(least=least, bend=bend, shift=shift)


def _planes(texture: Texture) -> tuple[npt.NDArray[np.uint16], ...]:
    return texture.y, texture.cb, texture.cr
