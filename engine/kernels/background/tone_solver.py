"""The least-squares tones of a rig's views, from the normal equations of pairs (`exposure`)."""

from __future__ import annotations

import math

import numba
import numpy as np

from ...support.array_types import F64, I64
from ..base.jit import parallel, serial

__all__ = ["solve_tones"]

# Conjugate gradients end when the square of the residual has fallen to the share _SOLVED, or after _TURNS times the
# number of iterations that would be enough without rounding.
_SOLVED, _TURNS = 1e-24, 4


@parallel
def solve_tones(
    information: F64, evidence: F64, nodes: I64, weights: F64, precision: F64, off: F64
) -> None:
    """Least squares over all pairs: the differences `off` [n, 3, 3] of the tones from the neutral tone.

    information, evidence, nodes [p, 2]: see `exposure.weigh_samples`; a node of n or more is not an unknown. weights
    [p]: of the pairs; precision [3]: of gain, offset and tint about the expected values, which `off` holds at first.
    The solver is conjugate gradients (Hestenes and Stiefel 1952), preconditioned by the block of each tone: a view has
    few pairs, so the work grows with the number of views, not with its cube.
    """
    count = off.shape[0]
    for channel_ in numba.prange(3):
        channel = np.int64(channel_)
        told, tones, blocks = information[:, channel], off[:, channel], np.empty((count, 3, 3))
        step, towards = np.empty((count + 1, 3)), np.empty((count, 3))
        rest, pulled = np.empty((count, 3)), np.empty((count, 3))
        for k in range(count + 1):
            for i in range(3):  # the expected tones: the residual then has only the pairs' part of the normal equations
                step[k, i] = tones[k, i] if k < count else 0.0
        _pull(told, nodes, weights, step, pulled)
        _set_up(told, evidence[:, channel], nodes, weights, precision, pulled, rest, blocks)
        first = length = 0.0
        for turn in range(_TURNS * 3 * count):
            _solve_blocks(blocks, rest, towards)
            before, length = length, _product(rest, towards)
            first = max(first, length)
            if length <= _SOLVED * first:
                break
            for k in range(count):
                for i in range(3):
                    step[k, i] = towards[k, i] + (length / before) * step[k, i] if turn > 0 else towards[k, i]
            _pull(told, nodes, weights, step, pulled)
            for k in range(count):
                for i in range(3):
                    pulled[k, i] += precision[i] * step[k, i]
            share = length / _product(step, pulled)
            for k in range(count):
                for i in range(3):
                    tones[k, i] += share * step[k, i]
                    rest[k, i] -= share * pulled[k, i]


@serial
def _set_up(
    information: F64, evidence: F64, nodes: I64, weights: F64, precision: F64, pulled: F64, rest: F64, blocks: F64
) -> None:
    """The residual rest [n, 3] of the normal equations, and each tone's block [n, 3, 3] of their matrix; pulled: the
    product of the pairs' matrix with the expected tones."""
    for n in range(rest.shape[0]):
        for i in range(3):
            rest[n, i] = -pulled[n, i]
            for j in range(3):
                blocks[n, i, j] = 0.0
    for p in range(nodes.shape[0]):
        for side in range(2):
            node, sign = nodes[p, side], weights[p] * (1 - 2 * side)
            if node < rest.shape[0]:
                for i in range(3):
                    rest[node, i] += sign * evidence[p, i]
                    for j in range(3):
                        blocks[node, i, j] += weights[p] * information[p, i, j]
    for n in range(rest.shape[0]):
        for i in range(3):
            blocks[n, i, i] += precision[i]


@serial
def _product(a: F64, b: F64) -> float:
    """The sum of products of the numbers of b [n, 3] with those of a [n or more, 3]."""
    total = 0.0
    for n in range(b.shape[0]):
        for i in range(3):
            total += a[n, i] * b[n, i]
    return total


@serial
def _pull(information: F64, nodes: I64, weights: F64, tones: F64, pulled: F64) -> None:
    """pulled [n + 1, 3]: the product of the pairs' matrix (information [p, 3, 3]) with tones [n + 1, 3]. The last row
    is of all nodes n or more, and is 0."""
    count = tones.shape[0] - 1
    for n in range(pulled.shape[0]):
        for i in range(3):
            pulled[n, i] = 0.0
    for p in range(nodes.shape[0]):
        a, b = min(nodes[p, 0], count), min(nodes[p, 1], count)
        for i in range(3):
            total = 0.0
            for j in range(3):
                total += information[p, i, j] * (tones[a, j] - tones[b, j])
            if a < count:
                pulled[a, i] += weights[p] * total
            if b < count:
                pulled[b, i] -= weights[p] * total


@serial
def _solve_blocks(blocks: F64, vectors: F64, out: F64) -> None:
    """out [n, 3]: the solutions of systems [n, 3, 3], symmetric and positive definite, by Cholesky's method."""
    factor = np.empty((3, 3))
    for n in range(blocks.shape[0]):
        for i in range(3):
            out[n, i] = vectors[n, i]
            for j in range(i + 1):
                rest = blocks[n, i, j]
                for k in range(j):
                    rest -= factor[i, k] * factor[j, k]
                factor[i, j] = rest / factor[j, j] if j < i else math.sqrt(rest)
            for k in range(i):
                out[n, i] -= factor[i, k] * out[n, k]
            out[n, i] /= factor[i, i]
        for i in range(2, -1, -1):
            for k in range(i + 1, 3):
                out[n, i] -= factor[k, i] * out[n, k]
            out[n, i] /= factor[i, i]
