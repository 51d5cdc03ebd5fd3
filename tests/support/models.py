"""Background models of the small rooms, and meshes for tests of rays."""

from __future__ import annotations

import io

import numpy as np
from farside.engine.background.model import BackgroundModel
from farside.engine.geometry.mesh import Mesh
from farside.engine.geometry.scene_scale import Scene
from farside.engine.settings import Settings
from PIL import Image
from support.rooms import WALL_X

SETTINGS = Settings(n_init=3, n_update=1)


def model_of(cameras, first, settings=SETTINGS):
    model = BackgroundModel(cameras, settings, Scene.of(cameras, settings, first))
    return model, model.update(first)


def pbi_of(model, camera):
    """Depth in metres (nan: a hole) and luma of the background seen from a camera, without the outermost pixels,
    because a view's triangles end at the centres of its outermost pixels."""
    view = model.render_pbi(camera).view
    return view.camera.depth.depth(view.codes)[1:-1, 1:-1], view.texture.y[1:-1, 1:-1]


def picture_of(page):
    """The pixels of a page of textures, int [h, w, 3]."""
    with Image.open(io.BytesIO(page.jpeg)) as image:
        assert image.size == (page.width, page.height)
        return np.asarray(image).astype(int)


def near_points(model, limit=WALL_X - 0.5):
    """Corners of valid triangles in front of the wall."""
    mesh = model.mesh()
    return mesh.vertices[mesh.vertices[:, 0] < limit]


def sheets(seed):
    """Three rough sheets before cameras that look in direction x, the middle one with a gap."""
    rng = np.random.default_rng(seed)
    meshes = []
    for x in (2.0, 2.5, 3.0):
        y, z = np.meshgrid(np.linspace(1.5, -1.5, 7), np.linspace(1.5, -1.5, 7))
        points = np.stack([x + 0.3 * rng.random(y.shape), y, z], axis=-1).reshape(-1, 3).astype(np.float32)
        k = np.arange(49).reshape(7, 7)
        a, b, c, d = (q.ravel() for q in (k[:-1, :-1], k[:-1, 1:], k[1:, :-1], k[1:, 1:]))
        triangles = np.concatenate([np.stack([a, c, b], -1), np.stack([b, c, d], -1)]).astype(np.int32)
        meshes.append(Mesh(points, np.zeros((49, 2), np.float32), triangles[rng.random(len(triangles)) < 0.7]))
    return meshes
