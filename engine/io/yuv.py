"""Raw planar video files: headerless frames, luma first, as named by FFmpeg's pixel formats."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..rig.frame import Texture

__all__ = ["PIXEL_FORMATS", "TEXTURE_BITS", "PixelFormat", "RawVideo", "from_texture", "to_texture"]

TEXTURE_BITS = 10  # of Texture's codes

PIXEL_FORMATS = r"(?:yuv420p|yuv400p|gray)(?:(?P<bits>9|1[0-6])le)?"
_NAME = re.compile(PIXEL_FORMATS)

Codes = npt.NDArray[np.uint16]
Samples = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, slots=True)
class PixelFormat:
    """A pixel format: 4:2:0 (yuv420p...) or luma alone (yuv400p..., gray...) of 8 to 16 bits."""

    name: str

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise ValueError(
                f"format: {self.name!r}: expected yuv420p, yuv400p or gray, and for more than 8 bits "
                "the number of bits and le, as in yuv420p10le"
            )

    @property
    def bits(self) -> int:
        """Bits per sample."""
        match = _NAME.fullmatch(self.name)
        return int(match["bits"] or 8) if match else 0

    @property
    def has_chroma(self) -> bool:
        """Whether Cb and Cr planes of half the width and height follow the luma plane."""
        return self.name.startswith("yuv420p")

    @property
    def dtype(self) -> np.dtype[np.uint8] | np.dtype[np.uint16]:
        """The type of a stored sample."""
        return np.dtype(np.uint8) if self.bits == 8 else np.dtype("<u2")

    def plane_shapes(self, width: int, height: int) -> list[tuple[int, int]]:
        """(rows, columns) of the planes of a frame, in file order."""
        half = ((height + 1) // 2, (width + 1) // 2)
        return [(height, width), half, half] if self.has_chroma else [(height, width)]

    def frame_samples(self, width: int, height: int) -> int:
        """Samples per frame, all planes together."""
        return sum(rows * columns for rows, columns in self.plane_shapes(width, height))


class RawVideo:
    """A raw planar file. A truncated last frame is not counted.

    Planes are private mappings that live as long as they are used: nothing is copied, and writes do not reach the
    file.
    """

    def __init__(self, path: Path | str, width: int, height: int, pixel_format: PixelFormat | str) -> None:
        self.path = Path(path)
        self.width, self.height = width, height
        self.format = PixelFormat(pixel_format) if isinstance(pixel_format, str) else pixel_format
        samples = self.format.frame_samples(width, height)
        self.frame_bytes = samples * self.format.dtype.itemsize
        self.frame_count, self.extra_bytes = divmod(self.path.stat().st_size, self.frame_bytes)

    def plane(self, frame: int, index: int) -> Samples:
        """Plane 0, 1 or 2 (Y, Cb, Cr) of a frame, [rows, columns]; raises ValueError if the file does not have it."""
        if not 0 <= frame < self.frame_count:
            raise ValueError(
                f"{self.path.name}: frame: {frame!r}: the file holds {self.frame_count} whole frames of "
                f"{self.width}x{self.height} {self.format.name} and {self.extra_bytes} bytes more"
            )
        shapes = self.format.plane_shapes(self.width, self.height)
        if not 0 <= index < len(shapes):
            raise ValueError(f"{self.path.name}: plane: {index!r}: {self.format.name} has {len(shapes)}")
        before = sum(rows * columns for rows, columns in shapes[:index]) * self.format.dtype.itemsize
        offset = frame * self.frame_bytes + before
        return np.asarray(np.memmap(self.path, self.format.dtype, "c", offset, shapes[index]))

    def native(self, frame: int) -> Texture:
        """The frame of a 4:2:0 file in its own codes, not converted to 10 bits; raises ValueError without chroma."""
        return Texture(*(self.plane(frame, i).astype(np.uint16, copy=False) for i in range(3)))

    def codes(self, frame: int) -> Codes:
        """The luma plane as uint16 without conversion: depth codes."""
        return self.plane(frame, 0).astype(np.uint16, copy=False)

    def texture(self, frame: int) -> Texture:
        """The frame converted to 10-bit codes; without chroma planes it is grey."""
        bits = self.format.bits
        planes = [to_texture(self.plane(frame, i), bits) for i in range(3 if self.format.has_chroma else 1)]
        if not self.format.has_chroma:
            shape = ((self.height + 1) // 2, (self.width + 1) // 2)
            planes += [np.full(shape, 1 << (TEXTURE_BITS - 1), np.uint16)] * 2
        return Texture(*planes)


def to_texture(plane: Samples, bits: int) -> Codes:
    """Samples of `bits` bits -> 10-bit codes; the same array where they already are."""
    codes: Codes = plane.astype(np.uint16, copy=False)
    if bits < TEXTURE_BITS:
        return np.left_shift(codes, np.uint16(TEXTURE_BITS - bits))
    return np.right_shift(codes, np.uint16(bits - TEXTURE_BITS)) if bits > TEXTURE_BITS else codes


def from_texture(plane: Codes, bits: int) -> Samples:
    """10-bit codes -> samples of `bits` bits as stored, rounded where bits are lost."""
    if bits >= TEXTURE_BITS:
        return np.left_shift(plane, np.uint16(bits - TEXTURE_BITS))
    half = 1 << (TEXTURE_BITS - bits - 1)
    rounded = np.minimum((plane + np.uint16(half)) // np.uint16(2 * half), np.uint16((1 << bits) - 1))
    narrow: Samples = rounded.astype(np.uint8) if bits == 8 else rounded
    return narrow
