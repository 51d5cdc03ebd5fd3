"""Where viewers look at the moment of asking."""

from __future__ import annotations

from collections.abc import Callable, ItemsView, Iterator, Mapping, ValuesView

from ..rig.viewer import StereoView

__all__ = ["Newest"]


class Newest(Mapping[str, StereoView]):
    """The views that `look` gives, by viewer, looked up anew each time; in any thread where `look` may be called."""

    def __init__(self, look: Callable[[], dict[str, StereoView]]) -> None:
        self._look = look

    def __getitem__(self, name: str) -> StereoView:
        return self._look()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._look())

    def __len__(self) -> int:
        return len(self._look())

    def items(self) -> ItemsView[str, StereoView]:
        """Names and views, all of one moment."""
        return self._look().items()

    def values(self) -> ValuesView[StereoView]:
        """Views, all of one moment."""
        return self._look().values()
