"""Server configuration: arguments, or environment variables FARSIDE_*."""

from __future__ import annotations

from typing import Literal

from farside.engine.live.governor import Governor, make_ladder
from farside.engine.settings import Settings
from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from .protocol import MAX_MESSAGE_BYTES

__all__ = ["ServerSettings"]


class ServerSettings(BaseSettings):
    """Settings of the server and of its engine. Loaded once."""

    model_config = SettingsConfigDict(env_prefix="FARSIDE_", frozen=True)

    host: str = "127.0.0.1"
    port: int = Field(8765, ge=0, le=65535)  # 0: any free one
    token: str = ""  # empty: everyone may connect
    allowed_hosts: str = ""  # names of this server besides its machine's, separated by commas; "*": any
    allowed_origins: str = (
        ""  # of other pages that may connect, like https://example.org, separated by commas; "*": any
    )
    quality: Literal["fast", "balanced", "best", "paper"] = "balanced"
    views: int | None = Field(None, ge=1)  # n_render
    init: int | None = Field(None, ge=1)  # n_init
    update: int | None = Field(None, ge=1)  # n_update
    update_interval: int | None = Field(None, ge=1)
    output_scale: float | None = Field(None, ge=0.05, le=4.0)
    background: bool = True
    viewing_space: tuple[float, float, float, float] | None = None  # x, y, z and radius, metres
    jpeg_quality: int | None = Field(None, ge=1, le=100)
    target_fps: float | None = Field(None, gt=0, le=1000)  # stereo pairs a second; None: no rate is held
    longest_update_s: float = Field(5.0, gt=0)  # updates of the model give way to pictures for this long at most
    render_workers: int = Field(2, ge=1, le=64)
    max_viewers: int = Field(8, ge=1)
    max_message_bytes: int = Field(MAX_MESSAGE_BYTES, ge=1 << 16)
    hello_timeout_s: float = Field(10.0, gt=0)
    shutdown_timeout_s: float = Field(1.5, gt=0)  # after a signal; then the engine is killed
    log_level: Literal["critical", "error", "warning", "info", "debug"] = "warning"

    def engine(self) -> Settings:
        """The engine's settings: the preset of `quality`, changed by the options that were given."""
        return Settings.preset(self.quality, **self._given())

    def governor(self) -> Governor | None:
        """The governor that holds `target_fps` and chooses at most `quality`; None if no rate was given."""
        if self.target_fps is None:
            return None
        return Governor(make_ladder(self.quality, **self._given()), self.target_fps)

    def _given(self) -> dict[str, object]:
        given = {
            "n_render": self.views,
            "n_init": self.init,
            "n_update": self.update,
            "update_interval": self.update_interval,
            "output_scale": self.output_scale,
            "jpeg_quality": self.jpeg_quality,
            "background": self.background,
            "viewing_space": self.viewing_space,
        }
        return {name: value for name, value in given.items() if value is not None}
