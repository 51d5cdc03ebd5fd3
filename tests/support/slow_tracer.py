"""A ray tracer that tests every triangle against every ray, in float64: a second implementation of the same interface.

It works on surfaces, captures and views, not on addresses, and uses neither Embree nor the
kernels that call Embree. For perspective cameras only.
"""

from __future__ import annotations

import ctypes

import numpy as np
from farside.engine.kernels.background.complementary_rays import OFFSETS
from farside.engine.kernels.background.culling import SAMPLES, SMALL_PX
from farside.engine.kernels.background.flags import KEPT, UPDATED
from farside.engine.kernels.background.hidden import CELL
from farside.engine.kernels.background.queried import COLUMNS, ROWS, STAMPS, STEP
from farside.engine.kernels.background.query_rays import NEAREST
from farside.engine.kernels.background.triangle_filter import ACCEPTED, CANDIDATES, CHANGED, COUNTS_SIZE, LONE, RAYS
from farside.engine.kernels.base.view_table import EDGE
from farside.engine.support.packed import CX, CY, FX, FY, HEIGHT, POSITION, ROTATION, WIDTH
from oracle import standing
from oracle.closest import closest_places
from oracle.rays import delta_at, hit_distances


def place_of(packed):
    return packed[POSITION : POSITION + 3]


def direction_of(packed, u, v):
    """The vector from a packed perspective camera to the point at depth 1 behind (u, v)."""
    rotation = packed[ROTATION : ROTATION + 9].reshape(3, 3)
    return rotation @ [1.0, (packed[CX] - u) / packed[FX], (packed[CY] - v) / packed[FY]]


def image_of(packed, point):
    """u, v and depth of a point."""
    x, y, z = packed[ROTATION : ROTATION + 9].reshape(3, 3).T @ (point - place_of(packed))
    return packed[CX] - packed[FX] * y / x, packed[CY] - packed[FY] * z / x, x


class SlowTracer:
    """See `engine.background.ray_tracer.RayTracer`."""

    def __init__(self):
        self._waiting, self._surfaces = {}, {}
        self.memory = 0

    def set(self, geometry, surface, *, lasting):
        self._waiting[geometry] = surface

    def commit(self):
        self._surfaces = dict(sorted({**self._surfaces, **self._waiting}.items()))
        self._waiting = {}

    def _hits(self, start, direction):
        """(distance in lengths of the direction, surface, triangle) of all hits, nearest first."""
        hits = []
        for surface in self._surfaces.values():
            t = hit_distances(start, direction, surface.mesh.points, surface.mesh.triangles)
            t[surface.invalid != 0] = np.nan
            hits += [(t[i], surface, i) for i in np.flatnonzero(~np.isnan(t))]
        return sorted(hits, key=lambda hit: hit[0])

    def mark_by_pixel(self, camera, packed, stride, delta):
        rays = 0
        for row in range(0, int(packed[HEIGHT]), stride):
            for column in range(0, int(packed[WIDTH]), stride):
                v = min(row + stride // 2, packed[HEIGHT] - 1) + 0.5
                u = min(column + stride // 2, packed[WIDTH] - 1) + 0.5
                for du, dv in OFFSETS:
                    direction = direction_of(packed, u + du, v + dv)
                    hits = self._hits(place_of(packed), direction / np.linalg.norm(direction))
                    rays += 1 + (len(hits) > 0)
                    for t, surface, triangle in hits:
                        if t >= hits[-1][0] - 0.5 * delta_at(delta, hits[-1][0]):
                            surface.marks[triangle, camera // 64] |= np.uint64(1 << (camera % 64))
        return rays

    def mark_by_triangle(self, cameras, order, surface, triangles, delta, *, share):
        rays = 0
        for n, i in enumerate(triangles):
            turn = np.roll(order, -(n // 64)) if share else order
            corners, uv = (a[surface.mesh.triangles[i]].astype(float) for a in (surface.mesh.points, surface.mesh.uv))
            samples = SAMPLES if np.ptp(uv, axis=0).max() > SMALL_PX else SAMPLES[:1]
            for point in (np.array([p, q, 1 - p - q]) @ corners for p, q in samples):
                inside = [c for c in turn if self._has(cameras[c], point)]
                behind = [self._is_foreground(cameras[c], point, delta) for c in inside]
                rays += len(inside)
                if not all(behind):
                    found = int(inside[behind.index(False)])
                    surface.marks[i, found // 64] |= np.uint64(1 << (found % 64))
                    break
        return rays

    def _has(self, packed, point):
        u, v, depth = image_of(packed, point)
        return depth > 0 and 0 <= u < packed[WIDTH] and 0 <= v < packed[HEIGHT]

    def _is_foreground(self, packed, point, delta):
        way = point - place_of(packed)
        distance = np.linalg.norm(way)
        limit = distance + max(0.5 * delta_at(delta, distance), 1e-4 * distance)
        return any(t > limit for t, _surface, _triangle in self._hits(place_of(packed), way / distance))

    def filter_pixels(self, capture, delta, neighbours, blocks, size):
        image, packed = capture.image, capture.packed
        flags, depth = image.flags, image.camera.depth.depth(image.codes)
        h, w = flags.shape
        counts = np.zeros((len(blocks), COUNTS_SIZE), np.int64)
        block_of = {tuple(block): k for k, block in enumerate(blocks)}
        accepted, confirmed = np.zeros((h, w), bool), np.zeros((h, w), bool)
        kept, updated = flags & KEPT != 0, flags & UPDATED != 0
        for y, x in np.argwhere(updated):
            k = block_of[y // size[0], x // size[1]]
            counts[k, CANDIDATES] += 1
            if kept[y, x]:
                counts[k, CHANGED] += 1
                continue
            direction = direction_of(packed, np.clip(x + 0.5, 0.51, w - 0.51), np.clip(y + 0.5, 0.51, h - 0.51))
            length = np.linalg.norm(direction)
            hits = self._hits(place_of(packed), direction / length)
            counts[k, RAYS] += 1
            confirmed[y, x] = not hits
            accepted[y, x] = not hits or depth[y, x] * length > hits[-1][0] + delta_at(delta, hits[-1][0])
        there = np.pad(kept | accepted, 1).astype(int)
        around = sum(there[y : y + h, x : x + w] for y in range(3) for x in range(3)) - there[1:-1, 1:-1]
        confirmed |= accepted & (around >= neighbours)
        for mask, column in ((confirmed, ACCEPTED), (accepted & ~confirmed, LONE)):
            for y, x in np.argwhere(mask):
                counts[block_of[y // size[0], x // size[1]], column] += 1
        flags[updated & ~(accepted & ~confirmed)] &= ~np.uint8(UPDATED)
        flags[confirmed] |= KEPT
        return counts

    def _shown(self, start, direction, near, present, delta):
        """(distance, surface, triangle) of the surface shown along a unit direction, None if there is none."""
        hits = self._hits(start, direction)
        if present.views is None:
            return hits[-1] if hits else None
        hits = [hit for hit in hits if hit[0] > near]
        views = [(view.view.camera, view.view.codes) for view in present.views.views]
        for t, surface, triangle in hits:
            point = start + t * direction
            camera, codes = views[surface.camera]
            if standing.shows(camera, present.views.rows[surface.camera, EDGE], codes, point, delta):
                return t, surface, triangle
            if t >= hits[-1][0] - delta_at(delta, hits[-1][0]):
                return hits[-1]
            seen = {} if surface.late else present.memory
            memory = [(camera, seen.get(c, codes)) for c, (camera, codes) in enumerate(views)]
            if not any(standing.looks_through(camera, codes, point, delta) for camera, codes in memory):
                return t, surface, triangle
        return hits[-1] if hits else None

    def mark_seen(self, eyes, surface, present, delta, wraps, cells, seen):
        rays = 0
        for i in np.flatnonzero(surface.invalid == 0):
            corners, uv = (a[surface.mesh.triangles[i]].astype(float) for a in (surface.mesh.points, surface.mesh.uv))
            (left, top), (right, bottom) = (np.floor(f(axis=0) / CELL).astype(int) for f in (uv.min, uv.max))
            if cells[max(top, 0) : bottom + 1, max(left, 0) : right + 1].any():
                continue
            samples = SAMPLES if np.ptp(uv, axis=0).max() > SMALL_PX else SAMPLES[:1]
            points = (np.array([p, q, 1 - p - q]) @ corners for p, q in samples)
            seen[i] = any(self._is_shown(place_of(eye), point, present, delta) for point in points for eye in eyes)
            rays += len(samples)
        return rays

    def _is_shown(self, start, point, present, delta):
        distance = np.linalg.norm(point - start)
        limit = distance - max(delta_at(delta, distance), 1e-4 * distance)
        shown = self._shown(start, (point - start) / distance, present.near, present, delta)
        return limit <= 0 or shown is None or shown[0] >= limit

    def render_pbi(self, view, packed, captures, present, delta, *, sparse, wanted):
        camera, texture = view.camera, view.texture
        view.codes[:], texture.y[:], texture.cb[:], texture.cr[:] = 0, 0, 512, 512
        for y, x in np.ndindex(view.codes.shape):
            direction = direction_of(packed, x + 0.5, y + 0.5)
            length = np.linalg.norm(direction)
            shown = self._shown(place_of(packed), direction / length, present.near * length, present, delta)
            if shown is None:
                continue
            t, surface, triangle = shown
            view.codes[y, x] = camera.depth.codes(np.array(t / length))
            point = place_of(packed) + t * direction / length
            corners = surface.mesh.points[surface.mesh.triangles[triangle]].astype(float)
            weights = np.linalg.lstsq(np.vstack([corners.T, np.ones(3)]), np.append(point, 1.0), rcond=None)[0]
            uv = (weights @ surface.mesh.uv[surface.mesh.triangles[triangle]]).astype(np.float32)
            colour = np.rint(captures.colours(surface.capture, uv[None])[0])
            texture.y[y, x], texture.cb[y // 2, x // 2], texture.cr[y // 2, x // 2] = colour
        return view.codes.size

    def surface(self, geometry):
        return self._surfaces[geometry]

    def _found(self, asked, k, distance, point, surface, triangle, back, found):
        """Writes answer k: a place, relative to the scene origin, on a triangle of a surface."""
        corners = surface.mesh.triangles[triangle]
        a, b, c = surface.mesh.points[corners].astype(float)
        normal = np.cross(b - a, c - a)
        normal *= np.sign(normal @ back) / np.linalg.norm(normal)
        found.distances[k], found.points[k], found.normals[k] = distance, point + asked.origin, normal
        found.ages[k] = -1
        if surface.capture < len(asked.seen) and asked.seen[surface.capture, STAMPS]:
            weights = np.linalg.lstsq(np.array([b - a, c - a]).T, point - a, rcond=None)[0]
            u, v = np.array([1 - weights.sum(), *weights]) @ surface.mesh.uv[corners]
            rows, columns = asked.seen[surface.capture, [ROWS, COLUMNS]].tolist()
            stamps = np.ctypeslib.as_array(
                (ctypes.c_int32 * (rows * columns)).from_address(int(asked.seen[surface.capture, STAMPS]))
            ).reshape(rows, columns)
            stamp = stamps[min(max(int(v // STEP), 0), rows - 1), min(max(int(u // STEP), 0), columns - 1)]
            found.ages[k] = max(asked.frame - stamp, 0) if stamp else -1

    def cast_rays(self, asked, rays, which, found):
        for k in range(len(rays.far)):
            start, way = rays.origins[k] - asked.origin, rays.directions[k] / np.linalg.norm(rays.directions[k])
            hits = [hit for hit in self._hits(start, way) if hit[0] <= rays.far[k]]
            if hits:
                t, surface, triangle = hits[0 if which == NEAREST else -1]
                self._found(asked, k, t, start + t * way, surface, triangle, -way, found)

    def mark_free(self, asked, rays, free):
        for k in range(len(rays.far)):
            start, way = rays.origins[k] - asked.origin, rays.directions[k] / np.linalg.norm(rays.directions[k])
            free[k] = all(hit[0] > rays.far[k] for hit in self._hits(start, way))

    def _distances(self, point):
        """(distance, place, geometry, triangle) for all valid triangles, nearest first."""
        near = []
        for geometry, surface in self._surfaces.items():
            places = closest_places(point, surface.mesh.points[surface.mesh.triangles].astype(float))
            distances = np.linalg.norm(places - point, axis=1)
            near += [(distances[i], places[i], geometry, i) for i in np.flatnonzero(surface.invalid == 0)]
        return sorted(near, key=lambda each: each[0])

    def find_closest(self, asked, points, within, found):
        for k, point in enumerate(points - asked.origin):
            near = self._distances(point)
            if near and near[0][0] < within[k]:
                distance, place, geometry, i = near[0]
                self._found(asked, k, distance, place, self._surfaces[geometry], i, point - place, found)

    def count_touched(self, asked, centres, radii, counts, triangles):
        for k, centre in enumerate(centres - asked.origin):
            touched = [(geometry, i) for distance, _, geometry, i in self._distances(centre) if distance <= radii[k]]
            counts[k] = len(touched)
            listed = touched[: triangles.shape[1]]
            triangles[k, : len(listed)] = np.reshape(listed, (-1, 2))
