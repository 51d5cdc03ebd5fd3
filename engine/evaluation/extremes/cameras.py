"""Extreme cameras and viewers, compared with the room itself."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from ...io.tmiv_json import Description, parse_json, to_json
from ...pipeline.engine import Engine
from ...rig.camera import Camera, Equirectangular, Perspective, Pose, Projection
from ...rig.viewer import StereoView
from .case import Case, Measured
from .pictures import Shot, against_truth, take
from .room import CODING, Room, rig, turned

__all__ = ["camera_cases"]

_PLAIN = Room(Room().boxes[:1])
_HOME = turned((0.05, 0.11, 0.02), 4, 2, -3)
_FLAT = Perspective.from_fov(80, 60, 1.4)
_SOURCE = rig()[0].projection


def camera_cases() -> list[Case]:
    """Cases of unusual projections of viewers and cameras, picture sizes, places of viewers, and rigs."""
    return [*_fields_of_view(), *_spheres(), *_odd_projections(), *_sizes(), *_places(), *_rigs()]


def _target(projection: Projection = _FLAT, pose: Pose = _HOME) -> Camera:
    return Camera("target", projection, pose, CODING)


def _sources(projection: Projection) -> list[Camera]:
    return [dataclasses.replace(camera, projection=projection) for camera in rig()]


def _truth(target: Camera, cameras: Sequence[Camera] | None = None, room: Room | None = None) -> list[Measured]:
    shot = Shot(target, cameras or rig(), room or Room())
    picture, _engine = take(shot)
    return against_truth(shot, picture)


def _fields_of_view() -> list[Case]:
    cases = []
    for degrees in (1, 5, 30, 90, 120, 150, 179):
        # A picture this wide shows the rig's 90 degrees in few of its pixels, so it is made larger.
        size = (80, 60) if degrees < 150 else (2400, 40)
        target = _target(Perspective.from_fov(*size, math.radians(degrees)))
        cases.append(Case("viewer's field of view", f"{degrees} degrees", partial(_truth, target, None, _PLAIN)))
    for degrees in (1, 5, 30, 120, 150, 179):
        cameras = rig(fov_deg=degrees)
        target = dataclasses.replace(cameras[0], name="target")
        cases.append(Case("cameras' field of view", f"{degrees} degrees", partial(_truth, target, cameras)))
    return cases


def _spheres() -> list[Case]:
    sources = _sources(_sphere(192, 96))
    looks = {"ahead": (4, 2), "at the seam": (180, 0), "at a pole": (0, -90), "at the other pole": (20, 90)}
    flat = [
        Case("360 x 180 degrees", f"flat, {name}", partial(_truth, _target(pose=turned(_HOME.position, *at)), sources))
        for name, at in looks.items()
    ]
    around = Equirectangular(96, 48, (math.radians(100), math.radians(460)), (-math.pi / 2, math.pi / 2))
    tilted = turned(_HOME.position, 90, 45, 80)
    return [
        *flat,
        Case("360 x 180 degrees", "both", partial(_truth, _target(_sphere(96, 48)), sources)),
        Case("360 x 180 degrees", "both, poles across", partial(_truth, _target(_sphere(96, 48), tilted), sources)),
        Case("360 x 180 degrees", "both, from 100 to 460 degrees", partial(_truth, _target(around), sources)),
    ]


def _odd(p: Perspective, cy: float, flatter: float) -> dict[str, Perspective]:
    """Unusual variants of a projection: mirrored, turned, with the principal point at (-9, cy), with oblong pixels.

    `flatter` is the factor by which fy is reduced for the oblong pixels, while fx is doubled.
    """
    return {
        "mirrored": dataclasses.replace(p, fx=-p.fx),
        "upside down and mirrored": dataclasses.replace(p, fy=-p.fy),
        "turned by 180 degrees": dataclasses.replace(p, fx=-p.fx, fy=-p.fy),
        "principal point outside": dataclasses.replace(p, cx=-9.0, cy=cy),
        f"pixels 1 : {2.0 * flatter:g}": dataclasses.replace(p, fx=2.0 * p.fx, fy=p.fy / flatter),
    }


def _odd_projections() -> list[Case]:
    assert isinstance(_SOURCE, Perspective)
    viewers, sources = _odd(_FLAT, 66.0, 3.0), _odd(_SOURCE, 120.0, 2.0)
    there = _target(viewers["principal point outside"])
    return [
        *(Case("viewer", name, partial(_truth, _target(p))) for name, p in viewers.items()),
        *(
            Case("cameras", name, partial(_truth, there if "outside" in name else _target(), _sources(p)))
            for name, p in sources.items()
        ),
    ]


def _sizes() -> list[Case]:
    strip = Perspective(8192, 64, 4096.0, 40.0, 4096.0, 32.0)
    return [
        *(Case("picture of", f"{w} x {h} pixels", partial(_small, w, h)) for w, h in ((1, 1), (2, 2), (3, 5))),
        *(
            Case("picture of", f"{w} x {h} pixels", partial(_truth, _target(_square(w, h)), None, _PLAIN))
            for w, h in ((33, 31), (31, 129))
        ),
        Case("picture of", "8192 x 64 pixels", partial(_truth, _target(strip), None, _PLAIN)),
        Case("views of", "8192 x 64 pixels", partial(_truth, _target(), _sources(strip), _PLAIN)),
        *(
            Case("views of", f"{w} x {h} pixels", partial(_truth, _target(_square(w, h)), _sources(_square(w, h))))
            for w, h in ((67, 45), (33, 129))
        ),
        Case(
            "views of", "2 x 2 pixels", partial(_truth, _target(), _sources(_square(2, 2))),
            refused=r"camera v0: 2 x 2 pixels: expected at least 4 x 4",
        ),
    ]  # fmt: skip


def _places() -> list[Case]:
    far = Perspective.from_fov(80, 60, 0.006)
    places = {
        "exactly at a camera": _target(_SOURCE, rig()[2].pose),
        "inside a box": _target(pose=turned((2.6, 1.0, -0.5), 10)),
        "behind a wall": _target(pose=turned((-9.0, 0.0, 0.0), 0)),
        "upside down": _target(pose=turned(_HOME.position, 4, 2, 177)),
        "1 km away": _target(far, turned((-1000.0, 0.0, 0.0), 0)),
    }
    return [
        *(Case("viewer", name, partial(_truth, target)) for name, target in places.items()),
        Case("viewer", "2 cm before a wall", partial(_truth, _target(pose=turned((8.98, 0.2, 0.1), 0)), None, _PLAIN)),
        Case("viewer", "2 cm before a box", partial(_truth, _target(pose=turned((1.78, -1.3, 0.0), 0)))),
        Case("viewer", "looks where nothing was seen", partial(_nothing, _target(pose=turned((0, 0, 0), 180)))),
        Case("viewer", "beyond the room, looks away", partial(_nothing, _target(pose=turned((12.0, 0, 0), 0)))),
        Case("eyes apart by", "0 m", partial(_eyes, 0.0)),
        Case("eyes apart by", "1 m", partial(_eyes, 1.0)),
    ]


def _rigs() -> list[Case]:
    cameras = rig()
    twice = [cameras[0], dataclasses.replace(cameras[0], name="again"), *cameras[1:]]
    heap = [dataclasses.replace(cameras[1], name=f"v{i}") for i in range(4)]
    return [
        Case("cameras", "two at one place", partial(_truth, _target(), twice)),
        Case("cameras", "all at one place", partial(_truth, dataclasses.replace(heap[0], name="target"), heap)),
        Case("cameras", "one", partial(_truth, dataclasses.replace(cameras[1], name="target"), cameras[1:2])),
        Case("cameras", "1000", partial(_truth, _target(Perspective.from_fov(80, 60, 0.9)), _crowd(1000))),
        Case("rig", "JSON of a thousand cameras", _described),
        *_orientations(),
    ]


def _crowd(count: int) -> list[Camera]:
    """`count` small cameras in a cube that look roughly ahead, so that all pictures hold what the viewer sees."""
    rng, projection = np.random.default_rng(6), Perspective.from_fov(64, 48, math.radians(90))
    places = rng.uniform(-0.1, 0.1, (count, 3)).tolist()
    angles = rng.uniform(-6.0, 6.0, (count, 3)).tolist()
    return [
        Camera(f"v{i}", projection, turned((x, y, z), *turn), CODING)
        for i, ((x, y, z), turn) in enumerate(zip(places, angles, strict=True))
    ]


def _described() -> list[Measured]:
    """Errors of the positions and axes of a rig that was written as JSON and read again."""
    rng = np.random.default_rng(4)
    cameras = {
        f"v{i}": Camera(f"v{i}", _FLAT, turned((x, y, z), *rng.uniform(-180, 180, 3)), CODING)
        for i, (x, y, z) in enumerate(rng.uniform(-1e6, 1e6, (1000, 3)).tolist())
    }
    written = Description("rig", cameras=cameras, source_names=tuple(cameras))
    read, problems = parse_json(to_json(written), "rig")
    if problems or tuple(read.cameras) != tuple(cameras):
        raise ValueError(f"problems: {problems[:1]}: expected none, and {len(cameras)} cameras")
    pairs = [(read.cameras[name], camera) for name, camera in cameras.items()]
    place = max(float(np.abs(np.subtract(a.pose.position, b.pose.position)).max()) for a, b in pairs)
    axes = max(float(np.abs(a.pose.rotation() - b.pose.rotation()).max()) for a, b in pairs)
    # Angles are converted to degrees and back: the bound is three roundings of an angle of half a turn.
    return [Measured(place, 0.0, "m"), Measured(axes, 3 * 8 * 2.0**-52 * math.pi, "of an axis")]


def _orientations() -> list[Case]:
    w, x, y, z = _HOME.orientation
    says = r"orientation: .*expected a unit quaternion"
    refused = {"twice a unit": 2.0, "tiny": 1e-9, "zero": 0.0, "huge": 1e200}
    return [
        Case("quaternion", "negated", partial(_turned_as, (-w, -x, -y, -z))),
        Case("quaternion", "off by 0.09 %", partial(_turned_as, (1.0009 * w, 1.0009 * x, 1.0009 * y, 1.0009 * z))),
        *(
            Case("quaternion", name, partial(_turned_as, (k * w, k * x, k * y, k * z)), refused=says)
            for name, k in refused.items()
        ),
    ]


def _turned_as(orientation: tuple[float, float, float, float]) -> list[Measured]:
    return _truth(_target(pose=Pose(_HOME.position, orientation)))


def _sphere(width: int, height: int) -> Equirectangular:
    return Equirectangular(width, height, (-math.pi, math.pi), (-math.pi / 2, math.pi / 2))


def _square(width: int, height: int) -> Perspective:
    """A perspective projection with square pixels and a field of view of at least 90 degrees in both directions."""
    focal = 0.5 * min(width, height)
    return Perspective(width, height, focal, focal, 0.5 * width, 0.5 * height)


def _small(width: int, height: int) -> list[Measured]:
    """Errors of a picture that shows a single wall and is too small for any pixel to be solid (see `pictures`).

    Each pixel must show the wall's luma, up to the variation of the luma within the pixel, and the wall's depth.
    """
    shot = Shot(_target(Perspective.from_fov(width, height, 0.02)), rig(), _PLAIN)
    picture, _engine = take(shot)
    truth = _PLAIN.look(shot.target)
    beside = _PLAIN.look(_target(Perspective.from_fov(64, 64, 0.08)))  # a field of view four times as wide
    luma = np.abs(picture.texture.y - truth.luma).max()
    disparity = np.abs(picture.disparity * truth.depth - 1.0).max()
    return [
        Measured(float(luma), 1.0 + float(np.ptp(beside.luma)), "codes"),
        Measured(float(disparity), float(np.ptp(beside.depth) / beside.depth.min()) + 1e-3, "of the depth"),
    ]


def _nothing(target: Camera) -> list[Measured]:
    """The number of pixels that are neither grey nor holes, where the viewer sees nothing."""
    picture, _engine = take(Shot(target, rig()))
    seen = (picture.texture.y != 512) | (picture.disparity > 0)
    return [Measured(int(seen.sum()), 0.0, "pixels")]


def _eyes(apart: float) -> list[Measured]:
    """Both eyes of a head, `apart` metres from each other, against the room."""
    cameras, head = rig(), StereoView(_HOME, apart, _FLAT, _FLAT)
    engine, frame = Engine(cameras), Room().frame(cameras)
    for index in range(2):
        engine.update(dataclasses.replace(frame, index=index), {"viewer": head})
    pair = engine.render(head, "viewer")
    eyes = [(picture, dataclasses.replace(picture.camera, depth=CODING)) for picture in (pair.left, pair.right)]
    found = [
        measured
        for picture, camera in eyes
        for measured in against_truth(Shot(camera, cameras, settings=engine.settings), picture)
    ]
    shift = np.subtract(pair.left.camera.pose.position, pair.right.camera.pose.position)
    off = abs(float(np.linalg.norm(shift)) - apart)
    return [*found, Measured(off, 4 * float(np.spacing(1.0)), "m")]
