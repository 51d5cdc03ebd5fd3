"""Laying the backdrop (section 3.4.2), a pixel at a time and in float64."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from oracle.projection import project, unproject
from oracle.rays import delta_at

NEARER = 0.03  # by which share of its depth what was drawn must lie behind the backdrop, besides delta
STEPS = 4  # of a search for a view's surface on a ray
CROSSES = 0.125  # of the codes within which views agree: as near as that a guess is a crossing


@dataclass(frozen=True)
class Seen:
    """A view: its camera, depth codes [h, w], the code step that is an edge, and the codes within which it agrees."""

    camera: object
    codes: np.ndarray
    edge: float
    tolerance: float

    def code_of(self, depth):
        """As a real number."""
        coding = self.camera.depth
        return (1 / depth - 1 / coding.far) / (1 / coding.near - 1 / coding.far) * (2**coding.bits - 1)

    def depth_of(self, code):
        coding = self.camera.depth
        return 1 / (1 / coding.far + code / (2**coding.bits - 1) * (1 / coding.near - 1 / coding.far))

    def texels(self, u, v):
        """The four codes round a position, and where in between it is; None beyond the picture."""
        h, w = self.codes.shape
        if not (0.5 <= u <= w - 0.5 and 0.5 <= v <= h - 0.5):
            return None
        x, y = min(int(u - 0.5), w - 2), min(int(v - 0.5), h - 2)
        return self.codes[y : y + 2, x : x + 2].astype(float), u - 0.5 - x, v - 0.5 - y

    def looks_past(self, point, delta, texels):
        """Whether it sees farther than the point, by more than delta, on so many of the four texels."""
        u, v, depth = project(self.camera, point)
        if not depth > delta_at(delta, depth) or (found := self.texels(u, v)) is None:
            return False
        codes, invalid = found[0], self.camera.depth.has_invalid
        depths = np.where((codes == 0) & invalid, np.nan, self.depth_of(codes))
        return np.count_nonzero(depths > depth + delta_at(delta, depth)) >= texels

    def depth_on_ray(self, eye, x, y, depth):
        """The depth, of the eye, of its surface on a pixel's ray, searched from a guess on; 0: not found."""
        for _ in range(STEPS):
            u, v, depth_here = project(self.camera, unproject(eye, x + 0.5, y + 0.5, depth))
            found = self.texels(u, v) if depth_here > 0 else None
            if found is None:
                return 0.0
            codes, right, down = found
            if codes.min() == 0 and self.camera.depth.has_invalid:
                return 0.0
            one_surface = np.ptp(codes) <= self.edge
            code = np.array([1 - down, down]) @ codes @ [1 - right, right] if one_surface else codes.max()
            depth = project(eye, unproject(self.camera, u, v, self.depth_of(code)))[2]
            if not depth > 0:
                return 0.0
            if one_surface and abs(self.code_of(depth_here) - code) <= CROSSES * self.tolerance:
                return depth
        return 0.0


def lay(eye, backdrop, drawn, views, order, push, delta, number):
    """(disparity, number of the view) of every pixel; backdrop [h, w]: disparity; drawn: disparity and winner [h, w];
    order: rows of `views` that were not drawn."""
    disparity, winner = (plane.astype(float) for plane in drawn)
    for y, x in np.ndindex(backdrop.shape):
        if backdrop[y, x] > 0:
            depth = 1 / backdrop[y, x] + delta_at(push, 1 / backdrop[y, x])
            disparity[y, x], winner[y, x] = _pixel(
                eye, x, y, depth, (disparity[y, x], winner[y, x]), views, order, delta, number
            )
    return disparity, winner


def _pixel(eye, x, y, depth, live, views, order, delta, number):
    hole, around = live[0] == 0, delta_at(delta, depth)
    if not hole and depth + around > (1 - NEARER) / live[0]:
        return live
    point = unproject(eye, x + 0.5, y + 0.5, depth)
    ghost = any(view.looks_past(point, delta, 4 if hole else 1) for view in views)
    farthest = math.inf if ghost and hole else depth + around
    found = ((k, views[k].depth_on_ray(eye, x, y, depth)) for k in order)
    k, now = next(((k, now) for k, now in found if 0 < now <= farthest), (None, 0.0))
    if hole and k is not None:
        return 1 / now, number + 1 + k
    if not hole and len(order):
        ghost |= k is None or now < depth - around
    return live if ghost else (1 / depth, number)
