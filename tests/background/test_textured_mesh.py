"""The model with pictures: the same triangles as with coloured vertices, and the captures' colours at every pixel."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from farside.engine.background.model import BackgroundModel
from farside.engine.background.texture_pages import PAGE_SIDE, Part, arrange, paint
from farside.engine.geometry.scene_scale import Scene
from farside.engine.io.coloured_meshes import srgb_from_ycbcr
from farside.engine.kernels.base.tone import IDENTITY
from farside.engine.rig.camera import Camera, Equirectangular, Pose
from farside.engine.rig.frame import Frame, Texture, View
from farside.engine.settings import Settings
from support.models import picture_of
from support.rooms import CODING, camera_row, see, wall_with_window
from support.texels import at

LOSS = 3  # codes of 255 that the JPEG may differ by from the picture, in smooth places


def smooth(camera, view):
    """The view with colours that change slowly, and differ from place to place."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    luma = 500 + 150 * np.sin(u / 9.0) * np.cos(v / 11.0)
    half = np.mgrid[0 : (camera.height + 1) // 2, 0 : (camera.width + 1) // 2]
    cb, cr = 450 + half[0], 560 - half[1] // 2
    return View(camera, Texture(*(plane.astype(np.uint16) for plane in (luma, cb, cr))), view.codes)


def model_of(cameras, views, **options):
    settings = Settings(n_init=len(cameras), **options)
    first = Frame(0, tuple(views))
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, first))
    model.update(first)
    return model


def corners_of(mesh):
    """Positions of triangles' corners, one triangle a row, in an order that does not depend on the mesh."""
    corners = mesh.vertices[mesh.triangles].reshape(-1, 9)
    return corners[np.lexsort(corners.T)]


def whole(mesh):
    """Positions of triangles' corners of all parts, in the same order as `corners_of`."""
    corners = np.concatenate([part.vertices[part.triangles].reshape(-1, 9) for part in mesh.parts])
    return corners[np.lexsort(corners.T)]


def test_the_triangles_are_those_of_the_mesh_with_coloured_vertices():
    cameras = camera_row()
    model = model_of(cameras, [wall_with_window(camera, post=True) for camera in cameras])
    textured, coloured = model.textured_mesh(), model.mesh()
    assert len(coloured.triangles) > 100
    np.testing.assert_array_equal(whole(textured), corners_of(coloured))
    for part in textured.parts:
        assert set(np.unique(part.triangles)) == set(range(len(part.vertices)))  # none without a use


def test_every_place_of_a_triangle_has_the_pictures_colour():
    (camera,) = camera_row(1, size=(400, 300))
    view = smooth(camera, see(camera))
    model = model_of([camera], [view])
    (part,) = model.textured_mesh().parts
    weights = np.random.default_rng(1).dirichlet((1, 1, 1), len(part.triangles))
    found = at(picture_of(part.picture), np.einsum("ij,ijk->ik", weights, part.uv[part.triangles]))
    places = np.einsum("ij,ijk->ik", weights, part.vertices[part.triangles])
    uv, _depth = camera.project(places)
    assert len(uv) > 50
    expected = srgb_from_ycbcr(model._captures.colours(0, uv.astype(np.float32)))
    assert expected.min() > 0.0  # nothing is clipped: then both interpolate the same codes
    assert expected.max() < 1.0
    np.testing.assert_allclose(found, 255 * expected, atol=LOSS)


def test_no_colour_crosses_a_depth_edge():
    """Two walls, the nearer one with a window: white and black. Each vertex has the colour of its own wall."""
    cameras, views, grey = camera_row(3, size=(200, 150)), [], np.full((75, 100), 512, np.uint16)
    for camera in cameras:
        codes = wall_with_window(camera).codes
        luma = np.where(camera.depth.depth(codes) > 4.5, 940, 64).astype(np.uint16)
        views.append(View(camera, Texture(luma, grey, grey), codes))
    model = model_of(cameras, views)
    rims = [(surface.mesh.uv % 1 != 0.5).any(axis=1) for surface in model._pbs.surfaces()]
    assert sum(map(np.count_nonzero, rims)) > 100  # vertices at which a filter would take half of each wall
    (part,) = model.textured_mesh().parts
    found = at(picture_of(part.picture), part.uv)[:, 1]
    far = part.vertices[:, 0] > 4.5
    assert min(far.sum(), (~far).sum()) > 100
    np.testing.assert_allclose(found, np.where(far, 255, 0), atol=25)  # a JPEG swings at such edges


def test_a_picture_that_wraps_is_continued_on_its_other_side():
    camera = Camera(
        "round", Equirectangular(256, 128, (-math.pi, math.pi), (-math.pi / 2, math.pi / 2)), Pose(), CODING
    )
    assert camera.wraps
    codes = CODING.codes(np.full((128, 256), 3.0))
    luma = np.full((128, 256), 300, np.uint16)
    luma[:, :20] = 800
    grey = np.full((64, 128), 512, np.uint16)
    model = model_of([camera], [View(camera, Texture(luma, grey, grey), codes)])
    (part,) = model.textured_mesh().parts
    picture = picture_of(part.picture)
    uv, _ = camera.project(part.vertices)
    found = at(picture, part.uv)[:, 1]
    column = uv[:, 0] % 256
    at_seam = part.vertices[abs(column - 0.5) < 0.1]
    assert len(np.unique(at_seam.round(4), axis=0)) < len(at_seam)  # the same places from either side of the picture
    expected = np.where(column < 20, 255 * (800 - 64) / 876, 255 * (300 - 64) / 876)
    np.testing.assert_allclose(found, expected, atol=10)  # a JPEG swings at such edges


def test_surfaces_of_an_older_capture_keep_its_picture():
    first = camera_row(1)[0]
    plain = see(first)
    codes = plain.codes.copy()
    codes[24:40, 36:60] = 0

    def flat(camera, luma, codes):
        half = np.full((32, 48), 512, np.uint16)
        return View(camera, Texture(np.full(codes.shape, luma, np.uint16), half, half), codes)

    model = model_of([first], [flat(first, 300, codes)])
    model.update(Frame(1, (flat(first, 300, codes),)))
    second = dataclasses.replace(first, pose=Pose((0.0, 0.02, 0.0)))
    model.recapture(0, flat(second, 700, codes), np.array(IDENTITY))
    model.update(Frame(2, (flat(second, 700, plain.codes),)))
    mesh = model.textured_mesh()
    np.testing.assert_array_equal(whole(mesh), corners_of(model.mesh()))
    found = np.concatenate([at(picture_of(part.picture), part.uv)[:, 1] for part in mesh.parts])
    vertices = np.concatenate([part.vertices for part in mesh.parts])
    inside = (np.abs(vertices[:, 1] - 0.01) < 0.3) & (np.abs(vertices[:, 2]) < 0.2)
    outside = (np.abs(vertices[:, 1]) > 1.2) | (np.abs(vertices[:, 2]) > 0.8)
    assert min(inside.sum(), outside.sum()) > 0
    np.testing.assert_allclose(found[inside], 255 * (700 - 64) / 876, atol=LOSS)
    np.testing.assert_allclose(found[outside], 255 * (300 - 64) / 876, atol=LOSS)


def test_a_model_of_nothing_has_no_pages():
    (camera,) = camera_row(1)
    model = model_of([camera], [see(camera)])
    for surface in model._pbs.surfaces():
        surface.invalid[:] = 1
    assert model.textured_mesh().parts == ()
    assert len(model.mesh().triangles) == 0


# Pages


def parts_of(seed, count, largest=144):
    rng = np.random.default_rng(seed)
    return [Part(int(k), 0, 0, *(8 * rng.integers(1, largest // 8 + 1, 2)).tolist()) for k in range(count)]


@pytest.mark.parametrize(("count", "side"), [(0, 4096), (1, 4096), (7, 256), (300, 512), (5000, 4096)])
def test_parts_lie_in_pages_without_touching_each_other(count, side):
    parts = parts_of(count, count)
    pages = arrange(parts, side)
    for width, height in pages.sizes:
        assert width & (width - 1) == height & (height - 1) == 0  # powers of two
        assert max(width, height) <= side
    taken = [np.zeros((height, width), bool) for width, height in pages.sizes]
    for part, (page, x, y) in zip(parts, pages.places.tolist(), strict=True):
        assert x % 8 == y % 8 == 0
        place = taken[page][y : y + part.height, x : x + part.width]
        assert place.shape == (part.height, part.width)
        assert not place.any()
        place[:] = True
    assert all(used.any() for used in taken)
    full = taken[:-1]  # where parts are small to the page, little stays empty
    assert sum(used.sum() for used in full) >= (1 - 1.5 * 144 / side) * sum(used.size for used in full)


def test_a_part_larger_than_a_page_is_refused():
    with pytest.raises(ValueError, match=r"part: Part\(.*width=520.*\): expected at most 512 x 512 pixels"):
        arrange([Part(0, 0, 0, 520, 8)], 512)


def test_a_part_is_the_picture_and_beyond_its_border_the_nearest_pixel():
    (camera,) = camera_row(1)
    view = smooth(camera, see(camera))
    model = model_of([camera], [view])
    part = Part(0, -8, -8, camera.width + 16, camera.height + 16)
    (page,) = paint([part], arrange([part]), model._captures)
    picture = picture_of(page)[: part.height, : part.width]
    grown = np.pad(picture[8:-8, 8:-8], ((8, 8), (8, 8), (0, 0)), mode="edge")
    np.testing.assert_allclose(picture, grown, atol=2 * LOSS)
    luma = 255 * (view.texture.y.astype(float) - 64) / 876
    found = picture[8:-8, 8:-8] @ [0.2126, 0.7152, 0.0722]
    np.testing.assert_allclose(found, luma, atol=LOSS)


def test_the_largest_page_is_what_graphics_cards_take():
    assert PAGE_SIDE == 4096
    assert arrange([]).sizes == ()
