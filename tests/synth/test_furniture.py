"""What scenes are furnished with: pieces are as large as they are said to be and stand on the floor, people walk on it,
and no camera is inside of anything."""

from __future__ import annotations

import numpy as np
import pytest
from farside.engine.kernels.synth.solids import BOX, CAPSULE, CYLINDER, ELLIPSOID
from farside.engine.synth import furniture, make_twin
from farside.engine.synth.parts import Group, Part
from farside.engine.synth.people import Clothes, Path, ball, carton, person, walker
from farside.engine.synth.scenes import TWINS, make_scene

THICK = furniture.THICKNESS
CLOTHES = Clothes(0, 1, 2, 3, 4)


def half_extent(part: Part) -> np.ndarray:
    """How far a part reaches from its centre along the axes, by its support function."""
    turned, (a, _, c) = part.rotation, part.size
    if part.kind == BOX:
        return np.abs(turned) @ part.size
    if part.kind == ELLIPSOID:
        return np.sqrt(turned**2 @ np.square(part.size))
    upright = np.abs(turned[:, 2]) * c
    if part.kind == CAPSULE:
        return upright + a
    assert part.kind == CYLINDER
    return upright + a * np.sqrt(1 - turned[:, 2] ** 2)


def bounds(group: Group) -> np.ndarray:
    """Lowest and highest x, y and z."""
    low = np.min([part.centre - half_extent(part) for part in group], axis=0)
    return np.array([low, np.max([part.centre + half_extent(part) for part in group], axis=0)])


def holds(part: Part, points: np.ndarray) -> np.ndarray:
    """Whether points [n, 3] are inside of a part."""
    local = (points - part.centre) @ part.rotation
    a, _, c = part.size
    if part.kind == BOX:
        return np.all(np.abs(local) < part.size, axis=1)
    if part.kind == ELLIPSOID:
        return np.sum((local / part.size) ** 2, axis=1) < 1
    if part.kind == CYLINDER:
        return (np.hypot(local[:, 0], local[:, 1]) < a) & (np.abs(local[:, 2]) < c)
    along = np.clip(local[:, 2], -c, c)
    return np.linalg.norm(local - np.stack([0 * along, 0 * along, along], axis=1), axis=1) < a


@pytest.mark.parametrize(
    ("piece", "size"),
    [
        (furniture.column(0, 3.0, 0.2), (0.6, 0.6, 3.0)),
        (furniture.bench(0, 1, 1.5), (None, 1.5, None)),
        (furniture.table(0, 1.6, 0.8, 0.75), (0.8, 1.6, 0.75)),
        (furniture.armchair(0, 1), (None, None, None)),
        (furniture.bookcase(0, [1, 2], 1.2, 2.0), (0.32, 1.2 + 0.04, 2.0 + 0.02)),  # its boards lie outside
        (furniture.plant(0, 1), (None, None, None)),
        *((furniture.statue(0, 1, kind), (None, None, None)) for kind in range(3)),
    ],
)
def test_pieces_stand_on_the_floor_and_are_as_large_as_was_asked_for(
    piece: Group, size: tuple[float | None, float | None, float | None]
) -> None:
    low, high = bounds(piece)
    assert low[2] == pytest.approx(0.0, abs=1e-9)
    for found, wanted in zip(high - low, size, strict=True):
        assert wanted is None or found == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("kind", range(3))
def test_statues_are_about_two_metres_tall(kind: int) -> None:
    assert bounds(furniture.statue(0, 1, kind))[1, 2] == pytest.approx(2.0, abs=0.5)


def test_a_picture_hangs_before_its_wall_in_its_frame() -> None:
    low, high = bounds(furniture.picture(0, 1, 1.2, 0.8))
    np.testing.assert_allclose(low, (0.0, -0.66, -0.46))
    np.testing.assert_allclose(high[1:], (0.66, 0.46))
    canvas = [part for part in furniture.picture(0, 1, 1.2, 0.8) if part.material == 0]
    np.testing.assert_allclose(np.ptp(bounds(canvas), axis=0)[1:], (1.2, 0.8))


def test_a_room_is_closed_and_empty() -> None:
    low, high = (-1.0, -2.0, 0.0), (3.0, 2.5, 2.8)
    walls = [part for group in furniture.room(low, high, [0, 1, 2, 3], 4, 5) for part in group]
    rng = np.random.default_rng(0)
    inside = rng.uniform(low, high, (2000, 3))
    assert not any(holds(part, inside).any() for part in walls)
    # From the middle outwards everything is wall, as far as walls are thick.
    side, axis, sign = inside.copy(), rng.integers(0, 3, 2000), rng.integers(0, 2, 2000)
    depth = rng.uniform(1e-6, THICK - 1e-6, 2000)
    side[np.arange(2000), axis] = np.where(sign == 0, np.take(low, axis) - depth, np.take(high, axis) + depth)
    found = np.array([holds(part, side) for part in walls])
    assert found.any(axis=0).all()
    material = np.array([part.material for part in walls])[found.argmax(axis=0)]
    expected = np.array([[1, 0], [3, 2], [4, 5]])  # x, y, z: the low side, the high one
    np.testing.assert_array_equal(material, expected[axis, sign])


@pytest.mark.parametrize("height", [1.5, 1.8])
def test_people_are_as_tall_as_they_are(height: float) -> None:
    standing = bounds(person(CLOTHES, height, 0.0, 0.0, 0.0, 0.0))
    assert standing[0, 2] == pytest.approx(0.0, abs=1e-3)
    assert standing[1, 2] == pytest.approx(height, rel=0.005)
    taller = bounds(person(CLOTHES, 1.1 * height, 0.0, 0.0, 0.0, 0.0))
    np.testing.assert_allclose(taller, 1.1 * standing, atol=1e-3)


@pytest.mark.parametrize("time", [0.0, 0.7, 2.0, 5.3])
def test_walkers_are_on_their_way_and_balls_and_cartons_on_the_floor(time: float) -> None:
    path = Path([(0.0, 1.0), (3.0, 1.0)], 0.9)
    middle = (path.at(time)[0]).tolist()
    low, high = bounds(walker(CLOTHES, 1.7, path)(time))
    assert low[2] >= -1e-6
    assert np.abs(0.5 * (low + high)[:2] - middle).max() < 0.2
    for actor, size in ((ball(0, 0.12, path), 0.24), (carton(0, 0.3, path), None)):
        low, high = bounds(actor(time))
        assert low[2] == pytest.approx(0.0, abs=1e-9)
        if size is not None:
            np.testing.assert_allclose(high - low, size)
            np.testing.assert_allclose(0.5 * (low + high)[:2], middle)


@pytest.mark.parametrize("name", list(TWINS))
def test_scenes_hold_their_actors_on_their_floors_and_no_camera_in_anything(name: str) -> None:
    scene, twin = make_scene(name), make_twin(name, 0.02)
    static = [part for group in scene.static for part in group]
    low, high = bounds(static)
    # The floor is what the lowest foot of all stands on.
    floor = min(bounds(actor(0.0))[0, 2] for actor in scene.actors)
    for time in (0.0, 1.3, 4.0):
        acting = [actor(time) for actor in scene.actors]
        for actor in acting:
            its_low, its_high = bounds(actor)
            assert its_low[2] >= floor - 1e-3
            assert its_high[2] - floor < 2.0
            assert (its_low[:2] > low[:2]).all()
            assert (its_high < high).all()
        solids = [*static, *(part for actor in acting for part in actor)]
        assert {0 <= part.material < len(scene.materials) for part in solids} == {True}
        eyes = np.array([twin.camera(camera.name, round(30 * time)).pose.position for camera in twin.cameras])
        assert not any(holds(part, eyes).any() for part in solids)
    beneath = np.array([*(bounds(scene.actors[0](0.0)).mean(axis=0)[:2]), floor - 0.02])
    assert any(holds(part, beneath[None]).any() for part in static)
