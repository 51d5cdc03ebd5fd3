"""Moments of a room: a wall, and squares before it, furniture and people; models of them."""

from __future__ import annotations

import numpy as np
from farside.engine.geometry.prepared_view import PreparedView, ViewTable
from farside.engine.rig.frame import Frame, View
from farside.engine.settings import Settings
from support.models import model_of
from support.rooms import BOX_X, CODING, WALL_X, WALL_Y, camera_row, texture_of

LAYERS = Settings(n_init=5, cull_stale=True, middle_layers=1 << 20)
CAMERAS = camera_row(5, (96, 64), 0.6)
PERSON_X, PERSON_Y, TABLE_Y = 1.6, 900, 500  # distance, metres, and luma codes
TABLE = (BOX_X, 0.0, 0.25, TABLE_Y)


def person(y):
    return (PERSON_X, y, 0.2, PERSON_Y)


def look(camera, *squares):
    """A view of the wall and of squares: distance, place to the side, half a side (metres), luma."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    start, rays = np.array(camera.pose.position), camera.unproject(np.stack([u, v], -1), np.ones_like(u))
    rays = rays - start
    depth, luma = (WALL_X - start[0]) / rays[..., 0], np.full(u.shape, WALL_Y)
    for x, y, half, code in squares:
        at = (x - start[0]) / rays[..., 0]
        place = start + at[..., None] * rays
        on = (np.abs(place[..., 1] - y) < half) & (np.abs(place[..., 2]) < half) & (at < depth)
        depth, luma = np.where(on, at, depth), np.where(on, code, luma)
    return View(camera, texture_of(luma), camera.depth.codes(depth))


def moment(index, *squares):
    return Frame(index, tuple(look(camera, *squares) for camera in CAMERAS))


def play(settings, moments):
    model, _first = model_of(CAMERAS, moment(0, *moments[0]), settings)
    for index, squares in enumerate(moments[1:], 1):
        model.update(moment(index, *squares))
    return model


def shown(model, camera, now):
    """Depth in metres and luma of the nearest surfaces that stand, without the outermost pixels."""
    scene, settings = model.state().scene.scene(), model.settings
    views = [PreparedView(v, scene.triangulation(v.camera, settings), scene.origin) for v in now.views]
    view = model.render_pbi(camera, ViewTable(views)).view
    return CODING.depth(view.codes)[1:-1, 1:-1], view.texture.y[1:-1, 1:-1]


def triangles_at(model, x):
    """Middles of the model's triangles about `x` metres away."""
    mesh = model.mesh()
    middles = mesh.vertices[mesh.triangles].mean(axis=1)
    return middles[np.abs(middles[:, 0] - x) < 0.05]
