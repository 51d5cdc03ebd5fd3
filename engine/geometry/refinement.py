"""Triangles divided until they are seen as small."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ..support.array_types import F32, F64, I32, I64

__all__ = ["refined"]

_MOST = 1 << 22  # triangles: with more, none is divided any further
_ROUNDS = 24


def refined(
    points: F64, triangles: I32, uv: F32, side_rad: float, nearest: float, side_px: float
) -> tuple[F64, I32, F32]:
    """Triangles of the same surface that are seen as small: points [n, 3], triangles [m, 3], uv [n, 2].

    A side is divided in the middle while it is longer than `side_rad`, as seen from the zero point (where a point's
    distance counts as `nearest` at least), or longer than `side_px` in uv. Whether it is depends on the side alone, so
    triangles that share it stay together.
    """
    corners, whole = triangles.astype(np.int64), np.concatenate([points, uv], axis=1)
    for _ in range(_ROUNDS):
        ends = np.stack([corners, corners[:, [1, 2, 0]]], axis=-1)  # [m, 3, 2]: sides ab, bc, ca
        keys = np.sort(ends.reshape(-1, 2), axis=1)
        sides, numbers = np.unique(keys[:, 0] * len(whole) + keys[:, 1], return_inverse=True)
        first, last = whole[sides // len(whole)], whole[sides % len(whole)]
        long = np.linalg.norm(_directions(last, nearest) - _directions(first, nearest), axis=1) > side_rad
        long |= np.abs(last[:, 3:] - first[:, 3:]).max(axis=1, initial=0.0) > side_px
        if not long.any() or len(corners) + 2 * int(long.sum()) > _MOST:
            break
        middles = np.full(len(sides), -1, np.int64)
        middles[long] = len(whole) + np.arange(int(long.sum()))
        whole = np.concatenate([whole, 0.5 * (first[long] + last[long])])
        corners = _divided(corners, middles[numbers.reshape(-1, 3)])
    return whole[:, :3], corners.astype(np.int32), whole[:, 3:].astype(np.float32)


def _directions(points: F64, nearest: float) -> F64:
    """Directions of points [n, 3 and more]: unit vectors, shorter ones for those within `nearest`."""
    distances = np.linalg.norm(points[:, :3], axis=1, keepdims=True)
    directions: F64 = points[:, :3] / np.maximum(distances, nearest)
    return directions


def _divided(corners: I64, middles: I64) -> I64:
    """Triangles [m, 3] divided at the middles [m, 3] of their sides ab, bc and ca; -1: a side that is not divided."""
    count = (middles >= 0).sum(axis=1)
    out: list[npt.NDArray[np.int64]] = [corners[count == 0]]
    turned, cuts = corners[count == 3], middles[count == 3]
    if len(turned):
        (a, b, c), (ab, bc, ca) = turned.T, cuts.T
        out += [_rows(a, ab, ca), _rows(ab, b, bc), _rows(ca, bc, c), _rows(ab, bc, ca)]
    for k in range(3):  # k: the only side that is divided, or the only one that is not
        turn = [k, (k + 1) % 3, (k + 2) % 3]
        one = (count == 1) & (middles[:, k] >= 0)
        (a, b, c), ab = corners[one][:, turn].T, middles[one, k]
        out += [_rows(a, ab, c), _rows(ab, b, c)]
        two = (count == 2) & (middles[:, k] < 0)
        (a, b, c), (_, bc, ca) = corners[two][:, turn].T, middles[two][:, turn].T
        out += [_rows(ca, bc, c), _rows(a, b, bc), _rows(a, bc, ca)]
    return np.concatenate(out)


def _rows(*columns: I64) -> I64:
    return np.stack(columns, axis=-1)
