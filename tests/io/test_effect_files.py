"""Pictures and meshes for 3D effects from bytes: sizes, formats, light, and what is refused."""

from __future__ import annotations

import io
from contextlib import suppress

import numpy as np
import pytest
from farside.engine.io import effect_files
from farside.engine.io.effect_files import read_mesh, read_picture
from PIL import ExifTags, Image
from support.effects import FACES, cube_glb, discs, png


def test_a_png_keeps_its_alpha_and_a_jpeg_is_opaque():
    np.testing.assert_array_equal(read_picture(png(discs())), discs())
    file = io.BytesIO()
    Image.fromarray(discs()[..., :3]).save(file, "JPEG")
    picture = read_picture(file.getvalue())
    assert picture.shape == discs().shape
    assert (picture[..., 3] == 255).all()


def test_a_large_picture_is_reduced():
    assert read_picture(png(np.zeros((100, 4096, 4), np.uint8))).shape == (50, 2048, 4)


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_a_picture_is_turned_as_its_exif_says_and_damaged_exif_does_no_harm(kind):
    shown, exif, file = Image.fromarray(discs()[..., :3]), Image.Exif(), io.BytesIO()
    exif.update({ExifTags.Base.Orientation: 6, ExifTags.Base.Make: "camera", ExifTags.Base.XResolution: 72.0})
    shown.save(file, kind, exif=exif, quality=100)
    data, sides = file.getvalue(), {discs().shape[:2], discs().shape[1::-1]}
    assert read_picture(data).shape[:2] == discs().shape[1::-1]
    start, rng = data.index(b"MM\0*" if b"MM\0*" in data else b"II*\0"), np.random.default_rng(1)
    for _ in range(300):
        damaged = bytearray(data)
        for place in rng.integers(start, start + 90, 3):
            damaged[place] ^= int(rng.integers(1, 256))
        with suppress(ValueError):  # and nothing else
            assert read_picture(bytes(damaged)).shape[:2] in sides


def test_what_is_no_picture_is_refused():
    for data in (b"", b"no picture", png(discs())[:200], cube_glb()):
        with pytest.raises(ValueError, match=rf"picture: {len(data)} bytes: expected a whole PNG or JPEG picture"):
            read_picture(data)
    file = io.BytesIO()
    Image.fromarray(discs()[..., :3]).save(file, "BMP")
    with pytest.raises(ValueError, match="expected a whole PNG or JPEG"):
        read_picture(file.getvalue())


def test_a_refusal_has_no_address_of_memory():
    with pytest.raises(ValueError, match=r"\(cannot identify image file\)$"):
        read_picture(b"no picture")


def test_what_is_too_large_is_refused(monkeypatch):
    monkeypatch.setattr(effect_files, "MOST_BYTES", 1000)
    with pytest.raises(ValueError, match="picture: 1001 bytes: expected at most 1000"):
        read_picture(bytes(1001))
    with pytest.raises(ValueError, match="mesh: 1001 bytes: expected at most 1000"):
        read_mesh(bytes(1001))
    monkeypatch.undo()
    monkeypatch.setattr(effect_files, "_MOST_PIXELS", 100)
    with pytest.raises(ValueError, match="picture: 200 x 120 pixels: expected at most 100"):
        read_picture(png(discs()))
    monkeypatch.setattr(effect_files, "MOST_TRIANGLES", 11)
    with pytest.raises(ValueError, match="12 triangles or more: expected at most 33 and 11"):
        read_mesh(cube_glb())


def test_a_mesh_with_colours_keeps_them_and_one_of_one_colour_is_lit():
    (part,) = read_mesh(cube_glb())
    assert len(part.vertices) == 8
    (lit,) = read_mesh(cube_glb(np.full((8, 3), 0.8)))
    assert len(lit.vertices) == 3 * len(FACES)
    luma = lit.colours.reshape(-1, 3, 3)
    assert (luma == luma[:, :1]).all()  # flat triangles
    tops = [k for k, face in enumerate(lit.triangles) if np.allclose(lit.vertices[face, 2], 1.0)]
    bottoms = [k for k, face in enumerate(lit.triangles) if np.allclose(lit.vertices[face, 2], -1.0)]
    assert len(tops) == len(bottoms) == 2
    assert luma[tops].min() > 1.3 * luma[bottoms].max()


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "mesh: first bytes: b'': expected b'glTF'"),
        (png(discs()), "mesh: first bytes"),
        (cube_glb()[:-40], "mesh: length: .* it is cut short"),
        (cube_glb()[:11], "mesh: size: 11 bytes"),
    ],
)
def test_what_is_no_mesh_is_refused(data, said):
    with pytest.raises(ValueError, match=said):
        read_mesh(data)
