"""Server configuration. Each field's description says what is expected; errors quote it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import unquote

from farside.engine.io.saved_file import check_settings, read_about
from farside.engine.io.seed_file import check_seed
from farside.engine.live.governor import Governor, make_ladder
from farside.engine.live.saving import ModelFiles
from farside.engine.settings import QUALITIES, Settings
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, PrivateAttr, field_validator

from .certificate import check_certificate
from .origins import canonical, is_name, is_origin
from .protocol import MAX_MESSAGE_BYTES

__all__ = ["ServerSettings", "listed"]

_SAVING_S = 30.0  # for the model to be saved at the end; the second signal ends the server at once
_MOST = 1_000_000  # of counts and seconds: far beyond any use, and still a number that messages and timers can hold


def listed(text: str) -> list[str]:
    """The items of a list that is written with commas."""
    return [item.strip() for item in text.split(",") if item.strip()]


def _checked(is_valid: Any) -> AfterValidator:
    def check(text: str) -> str:
        if not all(map(is_valid, listed(text))):
            raise ValueError
        return text

    return AfterValidator(check)


def _hosts(text: str) -> str:
    if not listed(text):
        raise ValueError
    return text


def _root(path: str) -> str:
    """A path as requests have it: percent-decoded, without a slash at its end."""
    if path and not re.fullmatch(r"/|(/[^/?#\s]+)+/?", path):
        raise ValueError
    return unquote(path).rstrip("/")


def _numbers(given: Any) -> Any:
    """Numbers of a text: apart from each other as in options, or a JSON list."""
    if not isinstance(given, str):
        return given
    return json.loads(given) if given.lstrip().startswith("[") else tuple(re.split(r"[\s,]+", given.strip()))


def _ball(space: tuple[float, float, float, float] | None) -> tuple[float, float, float, float] | None:
    if space is not None and space[3] < 0:
        raise ValueError
    return space


_Ball = Annotated[tuple[float, float, float, float] | None, BeforeValidator(_numbers), AfterValidator(_ball)]


def _count(least: int, description: str, most: int = _MOST) -> Any:
    return Field(ge=least, le=most, description=description)


def _seconds(description: str) -> Any:
    return Field(gt=0, le=_MOST, description=f"seconds, above 0 and at most {_MOST}: {description}")


class ServerSettings(BaseModel):
    """Settings of the server and of its engine. Raises ValidationError for a value out of range."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)
    _names: dict[str, str] = PrivateAttr(default_factory=dict)

    host: Annotated[str, AfterValidator(_hosts), Field(description="addresses of this machine, or names of them")] = (
        "127.0.0.1"  # several: separated by commas
    )
    port: Annotated[int, _count(0, "a number from 0 (any free port) to 65535", 65535)] = 8765
    token: Annotated[str, Field(description="text")] = ""  # empty: everyone may connect
    root_path: Annotated[
        str, AfterValidator(_root), Field(description="a path that starts with one slash, like /farside")
    ] = ""  # under which a proxy shows the service, if it keeps that path in its requests
    allowed_hosts: Annotated[
        str, _checked(is_name), Field(description='names like farside.example, separated by commas, or "*"')
    ] = ""  # names of this server besides its machine's; "*": any
    allowed_origins: Annotated[
        str,
        _checked(is_origin),
        Field(description='origins like https://example.org, without a path, separated by commas, "null" or "*"'),
    ] = ""  # of other pages that may connect; "*": any
    ssl_certfile: Annotated[str, Field(description="a PEM file")] = ""  # a certificate and its chain; empty: no TLS
    ssl_keyfile: Annotated[str, Field(description="a PEM file")] = ""  # empty: the key is in ssl_certfile
    quality: Annotated[
        Literal["fast", "balanced", "best", "paper"], Field(description="fast, balanced, best or paper")
    ] = "balanced"
    views: Annotated[int | None, _count(1, "a number of views, 1 or more")] = None  # n_render
    init: Annotated[int | None, _count(1, "a number of views, 1 or more")] = None  # n_init
    update: Annotated[int | None, _count(1, "a number of views, 1 or more")] = None  # n_update
    update_interval: Annotated[int | None, _count(1, "a number of frames, 1 or more")] = None
    output_scale: Annotated[float | None, Field(ge=0.05, le=4.0, description="a factor from 0.05 to 4")] = None
    background: Annotated[bool, Field(description="true or false")] = True
    draw_moving: Annotated[bool | None, Field(description="true or false")] = None  # views of cameras that move
    viewing_space: Annotated[_Ball, Field(description="x, y, z and a radius of 0 or more, metres")] = None
    light: Annotated[
        float | None, Field(ge=0, allow_inf_nan=False, description="a time constant, 0 or more seconds")
    ] = None  # light_s
    cull_stale: Annotated[bool | None, Field(description="true or false")] = None
    middle_layers: Annotated[int | None, _count(0, "a number of triangles, 0 or more")] = None
    late_rounds: Annotated[int | None, _count(0, "a number of rounds from 0 to 100", 100)] = None
    model: Annotated[str, Field(description="a file in a folder that exists")] = ""  # of the model; empty: none is kept
    save_interval_s: Annotated[float, _seconds("the time between two savings of the model")] = 60.0
    seed_model: Annotated[str, Field(description="a file, a saved model or GLB")] = ""
    jpeg_quality: Annotated[int | None, _count(1, "a number from 1 to 100", 100)] = None
    target_fps: Annotated[
        float | None, Field(gt=0, le=1000, description="stereo pairs a second, above 0 and at most 1000")
    ] = None  # None: no rate is held
    # Updates of the model give way to pictures for this long at most.
    longest_update_s: Annotated[float, _seconds("the longest time that an update gives way to pictures")] = 5.0
    render_workers: Annotated[int, _count(1, "a number of threads from 1 to 64", 64)] = 2
    max_viewers: Annotated[int, _count(1, "a number of viewers, 1 or more")] = 8
    max_message_bytes: Annotated[int, _count(1 << 16, "bytes, 65536 or more", 1 << 40)] = MAX_MESSAGE_BYTES
    max_queries: Annotated[int, _count(1, "a number of rays, points or spheres in a request, 1 or more")] = 1 << 18
    max_query_bytes: Annotated[int, _count(1 << 10, "bytes, 1024 or more", 1 << 30)] = 16 << 20
    hello_timeout_s: Annotated[float, _seconds("the time for a client's hello")] = 10.0
    shutdown_timeout_s: Annotated[float, _seconds("the time after a signal until the engine is killed")] = 1.5
    log_level: Annotated[
        Literal["critical", "error", "warning", "info", "debug"],
        Field(description="critical, error, warning, info or debug"),
    ] = "warning"

    @field_validator("*", mode="before")
    @classmethod
    def _is_text(cls, value: Any) -> Any:
        """Texts that are no Unicode cannot be sent, printed or looked up."""
        if isinstance(value, str):
            value.encode()  # raises a ValueError
        return value

    def name_of(self, field: str) -> str:
        """What the user calls a field: the option or the variable that it comes from; else its own name."""
        return self._names.get(field, field)

    def call(self, names: dict[str, str]) -> None:
        """From now on errors call fields by these names."""
        self._names.update(names)

    def check(self) -> None:
        """Raises ValueError, which names a field, for values that do not go together and for unusable files."""
        self.engine()
        self.governor()
        check_certificate(self.ssl_certfile, self.ssl_keyfile)
        self._check_model()

    def _check_model(self) -> None:
        for field in ("model", "seed_model"):
            if getattr(self, field) and not self.background:
                raise ValueError(f"{field}: {getattr(self, field)!r}: expected none without a background model")
        path, seed = Path(self.model), Path(self.seed_model)
        if self.model and (not path.parent.is_dir() or path.is_dir()):
            raise ValueError(f"model: {self.model!r}: expected a file in a folder that exists")
        if self.seed_model and not seed.is_file():
            raise ValueError(f"seed_model: {self.seed_model!r}: expected a file, a saved model or GLB")
        try:
            if self.model and path.exists():
                check_settings(read_about(path), self.engine())
        except (OSError, ValueError) as error:
            raise ValueError(f"model: {self.model}: {str(error).removeprefix(f'{self.model}: ')}") from error
        try:
            if seed.is_file():
                check_seed(seed)
        except (OSError, ValueError) as error:
            raise ValueError(f"seed_model: {error}") from error

    @property
    def files(self) -> ModelFiles:
        """The files of the model."""
        return ModelFiles(self.model, self.save_interval_s, self.seed_model)

    @property
    def ending_s(self) -> float:
        """Seconds from a signal until the engine is killed: a model takes a while to be saved."""
        return self.shutdown_timeout_s + (_SAVING_S if self.model else 0.0)

    @property
    def secure(self) -> bool:
        """Whether clients connect by TLS."""
        return bool(self.ssl_certfile)

    @property
    def names(self) -> list[str]:
        """Names by which clients may address the server, besides the machine's own."""
        return [*listed(self.host), *listed(self.allowed_hosts)]

    @property
    def origins(self) -> list[str]:
        """Origins of other pages that may connect, as browsers spell them."""
        return [canonical(origin) for origin in listed(self.allowed_origins)]

    def engine(self) -> Settings:
        """The engine's settings: the preset of `quality`, changed by the options that were given."""
        return Settings.preset(self.quality, **self._given())

    def governor(self) -> Governor | None:
        """The governor that holds `target_fps` and chooses at most `quality`; None if no rate was given."""
        if self.target_fps is None:
            return None
        return Governor(make_ladder(self.quality, **self._given()), self.target_fps)

    @property
    def needed(self) -> tuple[str, ...]:
        """Which compiled kernels are needed (`engine.compiling.needed`), those for the first picture first."""
        lower = QUALITIES[: QUALITIES.index(self.quality)] if self.target_fps else ()
        return *self.needed_for_model, *reversed(lower), "effects"

    @property
    def needed_for_model(self) -> tuple[str, ...]:
        """Which of them the background model waits for."""
        seed, beyond = ("seed",) if self.seed_model else (), ("beyond",) if self.engine().beyond else ()
        return "picture", self.quality, *seed, *beyond

    def _given(self) -> dict[str, object]:
        given = {
            "n_render": self.views,
            "n_init": self.init,
            "n_update": self.update,
            "update_interval": self.update_interval,
            "output_scale": self.output_scale,
            "jpeg_quality": self.jpeg_quality,
            "background": self.background,
            "draw_moving": self.draw_moving,
            "viewing_space": self.viewing_space,
            "light_s": self.light,
            "cull_stale": self.cull_stale,
            "middle_layers": self.middle_layers,
            "late_rounds": self.late_rounds,
        }
        return {name: value for name, value in given.items() if value is not None}
