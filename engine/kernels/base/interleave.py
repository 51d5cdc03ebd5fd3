"""Dealing out rows to threads, which get neighbouring indices of a parallel loop."""

from __future__ import annotations

from .jit import inlined

__all__ = ["interleaved"]


@inlined
def interleaved(index: int, count: int, stride: int) -> int:
    """Which of `count` rows is at a place in the order 0, stride, 2 stride, ..., 1, stride + 1, ...: each thread gets a
    part of every region of a picture, where costly rows lie together."""
    short, longer = count // stride, count % stride  # rows of a group; groups that have one more
    before = longer * (short + 1)
    if index < before:
        return index % (short + 1) * stride + index // (short + 1)
    return (index - before) % short * stride + longer + (index - before) // short
