"""The core as the live engine uses it: a protocol, and the core in this process (`core_process` has the one apart)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from ..rig.camera import Camera
from ..rig.frame import Frame
from ..rig.viewer import EncodedPair, StereoView
from ..settings import Settings
from ..support.stages import Stages, timed

if TYPE_CHECKING:
    from ..pipeline.engine import Engine

__all__ = ["Core", "CoreLostError", "LocalCore", "Look", "Source", "Updated", "make_local_core"]

Look = Callable[[], Mapping[str, StereoView]]  # where the viewers look at the moment of the call; in any thread


@dataclass(frozen=True, slots=True)
class Source:
    """What is on: a source's name, nominal frame rate (1/s) and cameras."""

    name: str
    fps: float
    cameras: tuple[Camera, ...]


@dataclass(frozen=True, slots=True)
class Updated:
    """What a core says of an update: milliseconds by stage (and `total`), and its own figures after it."""

    stages: Mapping[str, float]
    status: Mapping[str, Any]


class CoreLostError(RuntimeError):
    """The core is gone, with its process; whatever was asked of it is not done."""


class Core(Protocol):
    """Takes frames and gives encoded pairs; every method is called in worker threads, several at the same time.

    Each may raise CoreLostError; after that all do.
    """

    def give_way(self, niceness: int) -> None:
        """What the calling thread asks for from now on is worked at behind everything else (`support.runtime`)."""

    def update(self, frame: Frame, look: Look, speeds: Mapping[str, float], f_vin: float) -> Updated:
        """Take a frame and make it the one that is rendered; by one thread at a time.

        look: asked each time that the viewers' poses are wanted. speeds: of the viewers' heads, m/s. f_vin: frames a
        second, how long this one has to last. Raises ValueError for a frame that does not fit.
        """

    def picture(self, view: StereoView, viewer: str, encoding: str) -> EncodedPair:
        """Both eyes' pictures of the newest frame for a viewer, as bytes (`io.images.encode_picture`)."""

    def retune(self, settings: Settings) -> None:
        """Render from the next picture on as these settings say; waits for nothing."""

    def mesh(self, file_format: str) -> bytes:
        """The background model as a file: glb or ply (`io.mesh_files`). Raises ValueError where there is none."""

    def close(self) -> None:
        """Nobody asks for anything any more."""


class LocalCore:
    """A core in this process, around the synchronous engine."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def give_way(self, niceness: int) -> None:
        """The kernels that the calling thread starts leave a core to others, and it runs behind them."""
        from ..support.runtime import give_way  # late, as all that loads the compiler

        give_way(niceness)

    def update(self, frame: Frame, look: Look, speeds: Mapping[str, float], f_vin: float) -> Updated:
        """Take a frame; stages are the engine's, status is `Engine.status`."""
        self._engine.f_vin = f_vin
        with timed(whole := Stages(), "total"):
            report = self._engine.update(frame, look, speeds)
        return Updated({**report.stages, **whole}, self._engine.status())

    def picture(self, view: StereoView, viewer: str, encoding: str) -> EncodedPair:
        """Both eyes, each encoded in the thread that rendered it."""
        return self._engine.render_encoded(view, viewer, encoding)

    def retune(self, settings: Settings) -> None:
        """Settings of the next picture."""
        self._engine.retune(settings)

    def mesh(self, file_format: str) -> bytes:
        """The background model as a file."""
        from ..io.mesh_files import to_file

        return to_file(self._engine.mesh(), file_format)

    def close(self) -> None:
        """End the engine's threads."""
        self._engine.close()


def make_local_core(cameras: Sequence[Camera], settings: Settings) -> LocalCore:
    """A core with an engine for a rig; only a process that renders loads the engine and its compiler."""
    from ..pipeline.engine import Engine

    return LocalCore(Engine(cameras, settings))
