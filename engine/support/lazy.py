"""Attributes that are computed on first use, without a lock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

__all__ = ["lazy"]

T = TypeVar("T")


class lazy(Generic[T]):  # noqa: N801 (used as functools.cached_property is)
    """Like functools.cached_property, which before Python 3.12 has one lock for all objects of a class.

    With that lock, pictures would wait while an update computes the attribute for another frame, even if the update
    was suspended in their favour. Here two threads that ask at the same time both compute the value, and one of the
    equal values is kept.
    """

    def __init__(self, make: Callable[[Any], T]) -> None:
        self._make, self.__doc__ = make, make.__doc__

    def __get__(self, owner: Any, kind: type | None = None) -> T:
        kept: dict[str, T] = owner.__dict__
        return kept.setdefault(self._make.__name__, self._make(owner))
