"""Attributes that are made when first asked for, without a lock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

__all__ = ["lazy"]

T = TypeVar("T")


class lazy(Generic[T]):  # noqa: N801 (used as functools.cached_property is)
    """As functools.cached_property; but before Python 3.12 that has one lock for all objects of a class.

    With it, pictures wait for an update that makes something of another frame, and may have been put aside for them.
    Here two threads that ask at the same time both make the value, and one of the equal values is kept.
    """

    def __init__(self, make: Callable[[Any], T]) -> None:
        self._make, self.__doc__ = make, make.__doc__

    def __get__(self, owner: Any, kind: type | None = None) -> T:
        kept: dict[str, T] = owner.__dict__
        return kept.setdefault(self._make.__name__, self._make(owner))
