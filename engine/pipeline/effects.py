"""The 3D effects of a scene: projectors with their shadow maps, and added meshes, by name (the paper's Fig. 1h)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..background.model import BackgroundModel
from ..background.seed import Seed
from ..background.seed_files import seed_of_parts
from ..io.effect_files import EffectContent
from ..kernels.background.uncovered import CELL
from ..kernels.base.tolerance import Delta
from ..kernels.rendering.added_mesh import ColouredTriangles
from ..kernels.rendering.projector import ProjectedPicture
from ..rendering.effects import Effects, PictureLevels, levels_of_rgba, levels_of_texture
from ..rendering.renderer import FrameContent
from ..rig.camera import Camera, Perspective
from ..rig.depth import DepthCoding
from ..rig.effects import AddedMesh, Effect, Projector
from ..rig.frame import View
from ..support.array_types import F64

__all__ = ["SceneEffects"]

_MAP_PX = 640  # the longer side of a shadow map
_BANDS = 8  # parts of a shadow map, of which one follows the background in each frame
_NEAR = 0.02  # share of the depth range's near end; nothing nearer to a projector has a shadow


@dataclass(slots=True, eq=False)
class _Projector:
    effect: Projector
    picture: PictureLevels | None = None
    shadow_map: View | None = None

    def camera(self) -> Camera:
        """The projector as a camera with the pixels of its picture."""
        assert self.picture is not None
        projection = Perspective.from_fov(*self.picture.size, self.effect.fov_rad)
        return Camera("projector", projection, self.effect.pose, DepthCoding(0.1, 10.0, 16, has_invalid=True))

    def map_camera(self, content: FrameContent) -> Camera:
        """The camera of its shadow map, which has the same frustum."""
        p = self.camera().projection
        assert isinstance(p, Perspective)
        scale = min(1.0, _MAP_PX / max(p.width, p.height))
        w, h = (max(4, 2 * round(0.5 * scale * size)) for size in (p.width, p.height))
        sx, sy = w / p.width, h / p.height
        projection = Perspective(w, h, p.fx * sx, p.fy * sy, p.cx * sx, p.cy * sy)
        return Camera("projector", projection, self.effect.pose, content.scene.coding_at(self.effect.pose.position))

    def thrown(self, content: FrameContent) -> ProjectedPicture | None:
        """What pictures are drawn with; None as long as there is no picture, or no background to throw it onto."""
        tolerance = _tolerance(content)
        if self.picture is None or self.shadow_map is None or tolerance is None:
            return None
        coding = self.shadow_map.camera.depth
        return ProjectedPicture(
            self.picture.texels, self.picture.levels, self.camera().packed(content.scene.origin), self.shadow_map.codes,
            float(coding.offset), float(coding.step), tolerance, float(self.effect.strength),
            self.effect.blend == "add",
        )  # fmt: skip


@dataclass(slots=True, eq=False)
class _Mesh:
    effect: AddedMesh
    seed: Seed | None = None
    placed: tuple[ColouredTriangles, ...] | None = None

    def place(self, origin: F64) -> tuple[ColouredTriangles, ...]:
        """The mesh in its pose, relative to the scene's origin."""
        if self.placed is None:
            turned = self.effect.scale * self.effect.pose.rotation().T
            shift = np.asarray(self.effect.pose.position) - origin
            self.placed = tuple(
                ColouredTriangles(
                    np.ascontiguousarray(part.vertices @ turned + shift), np.ascontiguousarray(part.triangles),
                    np.ascontiguousarray(part.uv), part.atlas.y, part.atlas.cb, part.atlas.cr,
                )
                for part in (self.seed.parts if self.seed is not None else ())
            )  # fmt: skip
        return self.placed


class SceneEffects:
    """The effects of a scene. Only one thread may use it at a time.

    cameras: names of the rig's reference cameras.
    """

    def __init__(self, cameras: Sequence[str]) -> None:
        self._cameras = tuple(cameras)
        self._held: dict[str, _Projector | _Mesh] = {}
        self._turn = 0

    def __bool__(self) -> bool:
        return bool(self._held)

    def put(self, name: str, effect: Effect, content: EffectContent | None = None) -> None:
        """Add an effect, or change the one of that name.

        content: the picture of a projector or the parts of a mesh (`io.effect_files`); None: it stays as it is, or
        comes later. Raises ValueError for a camera that the rig does not have, and for a part whose
        picture is damaged; then nothing changes.
        """
        held = self._held.get(name)
        if isinstance(effect, Projector):
            if effect.camera and effect.camera not in self._cameras:
                raise ValueError(f"camera: {effect.camera!r}: expected one of {', '.join(self._cameras)}")
            self._held[name] = _changed(held if isinstance(held, _Projector) else None, effect, content)
        else:
            seed = held.seed if isinstance(held, _Mesh) else None
            if content is not None and not isinstance(content, np.ndarray):
                seed = seed_of_parts(content)
            self._held[name] = _Mesh(effect, seed)

    def remove(self, name: str) -> None:
        """Remove an effect, if it is there."""
        self._held.pop(name, None)

    def follow(self, model: BackgroundModel | None, content: FrameContent) -> Effects:
        """The effects for a new frame: pictures of live video are its views, and a part of one of the shadow maps, in
        turn, follows the background."""
        projectors = [held for held in self._held.values() if isinstance(held, _Projector)]
        for held in projectors:
            self._look_at(held, content)
        if projectors and model is not None:
            self._turn += 1
            band, number = divmod(self._turn, len(projectors))
            held = projectors[number]
            if held.shadow_map is not None:
                held.shadow_map = _followed(held.shadow_map, band % _BANDS, model, content)
        return self.shown(model, content)

    def shown(self, model: BackgroundModel | None, content: FrameContent) -> Effects:
        """The effects as they are now, for the frame on show. Shadow maps that are missing are rendered."""
        thrown: list[ProjectedPicture] = []
        meshes: list[ColouredTriangles] = []
        for held in self._held.values():
            if isinstance(held, _Mesh):
                meshes += held.place(content.scene.origin)
                continue
            if held.picture is None:
                self._look_at(held, content)
            if held.shadow_map is None and held.picture is not None and model is not None:
                held.shadow_map = _shadow_map(held, model, content)
            if (one := held.thrown(content)) is not None:
                thrown.append(one)
        return Effects(tuple(thrown), tuple(meshes))

    def _look_at(self, held: _Projector, content: FrameContent) -> None:
        """Take the live video of a projector's reference camera; one that is left out keeps its last picture."""
        if held.effect.camera:
            view = content.views[self._cameras.index(held.effect.camera)].view
            if view.there:
                held.picture = levels_of_texture(view.texture)


def _changed(old: _Projector | None, effect: Projector, content: EffectContent | None) -> _Projector:
    """A projector after a change; what stays the same is kept."""
    new = _Projector(effect)
    if isinstance(content, np.ndarray) and not effect.camera:
        new.picture = levels_of_rgba(content)
    elif old is not None and effect.camera == old.effect.camera:
        new.picture = old.picture
        if (effect.pose, effect.fov_rad) == (old.effect.pose, old.effect.fov_rad):
            new.shadow_map = old.shadow_map
    return new


def _tolerance(content: FrameContent) -> Delta | None:
    """How far from the background a drawn surface still counts as the background: delta, or half of the error that the
    triangles of views may have, as in the corners of a room, where that is more. None: there is no background."""
    if content.delta is None:
        return None
    error = max(prepared.options.tolerance for prepared in content.views)
    return content.delta[0], max(content.delta[1], 0.5 * error)


def _shadow_map(held: _Projector, model: BackgroundModel, content: FrameContent) -> View:
    """The background as the projector sees it: the nearest surfaces that stand, whatever the PBI shows."""
    near = _NEAR * content.scene.coding.near
    return model.render_pbi(held.map_camera(content), content.present, near=near).view


def _followed(before: View, band: int, model: BackgroundModel, content: FrameContent) -> View:
    """A shadow map with one of its bands of rows as the background is now."""
    rows, columns = (math.ceil(size / CELL) for size in before.codes.shape)
    first, last = band * rows // _BANDS, (band + 1) * rows // _BANDS
    wanted = np.zeros((rows, columns), np.uint8)
    wanted[first:last] = 1
    near = _NEAR * content.scene.coding.near
    now = model.render_pbi(before.camera, content.present, near=near, wanted=wanted).view
    codes = before.codes.copy()
    codes[first * CELL : last * CELL] = now.codes[first * CELL : last * CELL]
    return View(before.camera, now.texture, codes)
