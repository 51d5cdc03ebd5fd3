"""The core of the live engine: a protocol, and a core in this process (`core_process` has one in its own process)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from ..rig.camera import Camera
from ..rig.effects import Effect
from ..rig.frame import Fault, Frame
from ..rig.questions import Hits, NoModelError, Touched
from ..rig.viewer import EncodedPair, StereoView
from ..settings import Settings
from ..support.stages import Stages, timed
from .saving import ModelFiles, Saver

if TYPE_CHECKING:
    from ..pipeline.engine import Engine

__all__ = ["QUESTIONS", "Core", "CoreLostError", "LocalCore", "Look", "Source", "Updated", "make_local_core"]

# Questions about the model, and the methods of `background.queries.ModelQueries` that answer them.
QUESTIONS = {"rays": "cast_rays", "free": "are_free", "closest": "closest_points", "overlaps": "overlaps"}
Look = Callable[[], Mapping[str, StereoView]]  # returns the present views of all viewers; called in any thread


@dataclass(frozen=True, slots=True)
class Source:
    """The source that is playing: its name, nominal frame rate (1/s) and cameras."""

    name: str
    fps: float
    cameras: tuple[Camera, ...]


@dataclass(frozen=True, slots=True)
class Updated:
    """A core's report on an update: milliseconds per stage (and `total`), and the core's status after it.

    left_out: why views were left out of the frame, by camera. shown: whether the frame is what pictures show now; not
    if all of its views were left out.
    """

    stages: Mapping[str, float]
    status: Mapping[str, Any]
    left_out: Mapping[str, Fault] = field(default_factory=dict)
    shown: bool = True


class CoreLostError(RuntimeError):
    """The core's process has ended; requests that were under way are not done."""


class Core(Protocol):
    """Takes frames and returns encoded pairs; methods are called in worker threads, several at the same time.

    Each method may raise CoreLostError; once one has, all do.
    """

    def give_way(self, niceness: int) -> None:
        """Do the work of the calling thread at a lower priority from now on (`support.runtime.give_way`)."""

    def update(self, frame: Frame, look: Look, speeds: Mapping[str, float], f_vin: float) -> Updated:
        """Take a frame and make it the one that is rendered; called by one thread at a time.

        look: called each time that the viewers' poses are needed. speeds: of the viewers' heads, m/s. f_vin: frames per
        second; the frame is shown for 1 / f_vin. Raises ValueError for a frame that does not fit the rig.
        """

    def picture(self, view: StereoView, viewer: str, encoding: str) -> EncodedPair:
        """Both eyes' pictures of the newest frame for a viewer, as bytes (encoding: `io.images.encode_picture`)."""

    def retune(self, settings: Settings) -> None:
        """Use other settings from the next picture on; returns at once."""

    def continues(self, cameras: Sequence[Camera]) -> bool:
        """Whether a source with these cameras goes on with the model of this core: where the model is kept in a file,
        cameras that have moved may come back anywhere.

        False if nobody keeps the model: other poses begin another one. Raises ValueError, which names the camera and
        the field, if it is kept, and the cameras are others, or one that has never moved is elsewhere.
        """

    def begin_model(self) -> None:
        """Build the background model from the next frame on, if that has not begun."""

    def put_effect(self, name: str, effect: Effect, content: Any = None) -> None:
        """Add or change a 3D effect (`Engine.put_effect`), which the next picture shows. Raises ValueError, and changes
        nothing, for one that the engine does not take."""

    def remove_effect(self, name: str) -> None:
        """Remove a 3D effect, if it is there."""

    def mesh(self, file_format: str, colours: str | None = None) -> bytes:
        """The background model as a file: glb or ply, colours in a texture or at the vertices (`io.mesh_files`).

        Raises ValueError for other formats or colours, and if there is no model yet.
        """

    def query(self, question: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """The answer, arrays and numbers by name, to one of QUESTIONS about the background model, with the arguments
        and results of the method of `background.queries.ModelQueries` that it stands for.

        Raises NoModelError if there is no model yet, and ValueError for arguments that the method refuses.
        """

    def close(self) -> None:
        """End the core, and save its model if it is to be saved; no method is called after this."""


class LocalCore:
    """A core in this process, around the synchronous engine. saver: saves its model; None: nobody does."""

    def __init__(self, engine: Engine, saver: Saver | None = None) -> None:
        self._engine, self._saver = engine, saver

    def give_way(self, niceness: int) -> None:
        """Run the calling thread's kernels on one core fewer, and at a lower priority."""
        from ..support.runtime import give_way  # late, as it loads the compiler

        give_way(niceness)

    def update(self, frame: Frame, look: Look, speeds: Mapping[str, float], f_vin: float) -> Updated:
        """Take a frame; the report has the engine's stages and `Engine.status`, and `Saver.status` as `saved`."""
        self._engine.f_vin = f_vin
        with self._saver.updating if self._saver is not None else nullcontext():
            with timed(whole := Stages(), "total"):
                report = self._engine.update(frame, look, speeds)
            shown, status = len(report.left_out) < len(frame.views), self._engine.status()
            if self._saver is not None:
                if shown:
                    self._saver.offer()
                status["saved"] = self._saver.status()
        return Updated({**report.stages, **whole}, status, report.left_out, shown)

    def picture(self, view: StereoView, viewer: str, encoding: str) -> EncodedPair:
        """Both eyes, each encoded in the thread that rendered it."""
        return self._engine.render_encoded(view, viewer, encoding)

    def retune(self, settings: Settings) -> None:
        """Set the settings of the next picture."""
        self._engine.retune(settings)

    def continues(self, cameras: Sequence[Camera]) -> bool:
        """Whether a source with these cameras goes on with the model that is kept."""
        if self._saver is None:
            return False
        try:
            self._engine.check_rig(cameras)
        except ValueError as error:
            raise ValueError(f"model {self._saver.path.name}: {error}") from error
        return True

    def begin_model(self) -> None:
        """Build the background model from the next frame on."""
        self._engine.begin_model()

    def put_effect(self, name: str, effect: Effect, content: Any = None) -> None:
        """Add or change a 3D effect."""
        self._engine.put_effect(name, effect, content)

    def remove_effect(self, name: str) -> None:
        """Remove a 3D effect."""
        self._engine.remove_effect(name)

    def mesh(self, file_format: str, colours: str | None = None) -> bytes:
        """The background model as a file (`Engine.export`)."""
        return self._engine.export(file_format, colours)

    def query(self, question: str, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """The answer to a question about the background model."""
        model = self._engine.model
        if model is None:
            raise NoModelError("model: there is none before the first frame: expected a source to be playing")
        answer = getattr(model.queries, QUESTIONS[question])(**arguments)
        if isinstance(answer, Hits | Touched):
            return {item.name: getattr(answer, item.name) for item in fields(answer)}
        return {"free": answer}

    def close(self) -> None:
        """Save the model, and end the engine's threads."""
        if self._saver is not None:
            self._saver.finish()
        self._engine.close()


def make_local_core(
    cameras: Sequence[Camera], settings: Settings, modelling: bool = True, files: ModelFiles | None = None
) -> LocalCore:
    """A core with an engine for a rig; `modelling` False: without a model until `begin_model`. files: of the model.

    Loads the engine and its compiler, so only processes that render call this. Raises OSError and ValueError for files
    that cannot be read, and for a saved model of another rig or with other settings.
    """
    from ..background.saved_model import SavedModel
    from ..background.seed_files import read_seed
    from ..pipeline.engine import Engine

    files = files or ModelFiles()
    path, saved, seed = Path(files.model), None, None
    if files.model and path.exists():
        saved = SavedModel.read(path)
    elif files.seed:
        seed = read_seed(Path(files.seed))
    try:
        engine = Engine(cameras, settings, modelling=modelling, saved=saved, seed=seed)
    except ValueError as error:
        raise ValueError(f"model {path.name}: {error}" if saved is not None else str(error)) from error
    return LocalCore(engine, Saver(path, files.interval_s, engine.state) if files.model else None)
