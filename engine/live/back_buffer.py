"""The back buffer: collects the views of the arriving frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..rig.frame import Frame, View

__all__ = ["BackBuffer", "OrderError"]


class OrderError(ValueError):
    """A view came out of order; the error names the field, its value and what was expected."""

    def __init__(self, field: str, value: object, expected: str) -> None:
        self.field, self.value, self.expected = field, value, expected
        super().__init__(f"{field}: {value}: expected {expected}")


class BackBuffer:
    """The frames of one source, one after the other. Within a frame, views come in any order, each once.

    A frame may be closed although views are missing; they are late if they come after that.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._frame = -1
        self._views: dict[str, View] = {}
        self._gone_without: tuple[int, frozenset[str]] = -1, frozenset()  # the last frame that was closed

    @property
    def missing(self) -> list[str]:
        """The cameras whose views the frame lacks that is incomplete; none if no frame is."""
        return [name for name in self._names if name not in self._views] if self._views else []

    def is_next(self, frame: int) -> bool:
        """Whether a view is of a later frame than the one that is incomplete."""
        return bool(self._views) and frame > self._frame

    def is_late(self, frame: int, name: str) -> bool:
        """Whether a view is one of those that the last closed frame went without."""
        return frame == self._gone_without[0] and name in self._gone_without[1]

    def close(self, left_out: Callable[[str], View]) -> Frame:
        """The frame that is incomplete, as it is; `left_out` makes the views in place of those that are missing."""
        missing = self.missing
        self._gone_without = self._frame, frozenset(missing)
        self._views |= {name: left_out(name) for name in missing}
        return self._complete()

    def clear(self) -> None:
        """Lets go of the views of a frame that is not complete."""
        self._views = {}

    def add(self, frame: int, view: View) -> Frame | None:
        """Take a view. Returns the frame, its views in the order of the cameras, if it is complete now; else None.

        Raises OrderError for a view of another frame than the one that is incomplete, for a frame whose number does not
        rise, and for a camera that is unknown or has delivered its view.
        """
        missing = [name for name in self._names if name not in self._views]
        if self._views and frame != self._frame:
            raise OrderError("frame", frame, f"{self._frame}, which still lacks {', '.join(missing)}")
        if not self._views and frame <= self._frame:
            raise OrderError("frame", frame, f"more than {self._frame}")
        name = view.camera.name
        if name not in missing:
            raise OrderError("camera", name, f"one of {', '.join(missing)} in frame {frame}")
        self._frame = frame
        self._views[name] = view
        if len(self._views) < len(self._names):
            return None
        return self._complete()

    def _complete(self) -> Frame:
        views, self._views = self._views, {}
        return Frame(self._frame, tuple(views[name] for name in self._names))
