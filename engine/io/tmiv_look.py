"""A look at the first frame of a sequence: samples that contradict its description.

Such a sequence can be read, but what is rendered from it looks wrong. All of these are guesses from what samples mostly
look like, so they are warnings, not problems.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from ..rig.camera import Camera
from ..rig.depth import DepthCoding
from .depth_meaning import StillView, doubt_coding
from .tmiv_json import Description
from .video_files import Kind, find_video
from .yuv import RawVideo

__all__ = ["look_at_first_frame"]

_ROWS = 512  # rows of a picture that are looked at, at most
_BLACK, _WHITE, _BEYOND = 64, 940, 16  # limited range in 10-bit codes; codes that filters and noise lead beyond it
_DARK_SHARE, _BRIGHT_SHARE = 0.005, 0.05  # of luma beyond black and white; cameras do record brighter than white
_HOLES_SHARE = 0.002  # of a code that stands out from its neighbours
_HOLE_PX = 16  # mean width of holes that sensors leave: the sky is wider

Plane = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
Bools = npt.NDArray[np.bool_]


def look_at_first_frame(folder: Path, description: Description) -> list[str]:
    """What the description's lengths and the samples of its source views make doubtful, one line each.

    `folder`: that of the video files. Files that are missing or hold no whole frame are passed over
    (`tmiv_check.check_sequence` reports them).
    """
    warnings = []
    if not description.lengths_in_metres:
        warnings.append("lengthsInMeters: false: expected true: positions and depths are read as metres")
    seen: dict[bytes, str] = {}
    still = []
    for name in description.source_names:
        if camera := description.cameras.get(name):
            texture, depth = (_video(folder, camera, kind, description) for kind in ("texture", "depth"))
            if texture:
                warnings += _look_at_samples(texture) or _look_at_luma(texture)
            if depth:
                warnings += _look_at_samples(depth) or _look_at_codes(depth, camera.depth)
            if texture and depth:
                warnings += _look_at_both(texture, depth)
                still += [StillView(camera, texture, depth)] * (name not in description.pose_files)
            warnings += _look_for_copies([video for video in (texture, depth) if video], seen)
    return warnings or doubt_coding(still)


def _video(folder: Path, camera: Camera, kind: Kind, description: Description) -> RawVideo | None:
    try:
        video = find_video(folder, camera, kind, description.cameras)
    except ValueError:
        return None  # several files could be meant: check_sequence names them
    return video if video and video.frame_count else None


def _plane(video: RawVideo, index: int = 0) -> Plane:
    plane = video.plane(0, index)
    return plane[:: -(-len(plane) // _ROWS)]


def _look_at_samples(video: RawVideo) -> list[str]:
    """Samples that have more bits than the format says, fewer by far, or one value only."""
    samples, bits = _plane(video), video.format.bits
    least, most, limit = int(samples.min()), int(samples.max()), (1 << bits) - 1
    where = f"{video.path.name}: "
    if least == most:
        return [f"{where}every sample of the first picture is {most}"]
    if most > limit:
        said = f"{where}samples up to {most}: expected at most {limit}, as {video.format.name} has {bits} bits"
        if not (samples & ((1 << (16 - bits)) - 1)).any():
            return [f"{said}; they seem to be in the upper bits (all are multiples of {1 << (16 - bits)})"]
        return [f"{said}; their bytes seem to be swapped"] if samples.byteswap().max() <= limit else [said]
    fewer = next((fewer for fewer in (8, 10, 12) if most < 1 << fewer), bits)
    if fewer <= bits - 2:
        return [f"{where}no sample above {most}: expected more of {video.format.name}; they seem to have {fewer} bits"]
    return []


def _look_at_luma(video: RawVideo) -> list[str]:
    """Luma beyond the limited range, as which textures are read."""
    luma, scale = _plane(video), 2.0 ** (video.format.bits - 10)
    dark, bright = np.mean(luma < scale * (_BLACK - _BEYOND)), np.mean(luma > scale * (_WHITE + _BEYOND))
    if dark <= _DARK_SHARE and bright <= _BRIGHT_SHARE:
        return []
    limits = f"{scale * _BLACK:g} to {scale * _WHITE:g}"
    said = f"{video.path.name}: {dark + bright:.1%} of luma is far beyond {limits}"
    return [f"{said}: expected the limited range; it seems to be the full one"]


def _look_at_codes(video: RawVideo, coding: DepthCoding) -> list[str]:
    """Codes that seem to mean "no depth", but say something else."""
    codes, most = _plane(video), (1 << video.format.bits) - 1
    near, far = codes == most, codes == 0
    warnings = []
    if _stands_out(near, (codes >= most - most // 16) & ~near):
        warnings.append(
            f"{video.path.name}: {near.mean():.1%} of codes are {most}, the nearest depth, and few are close to it: "
            'expected 0, with HasInvalidDepth true, if they mean "no depth"'
        )
    # Far surfaces crowd in small codes: these are linear in disparity.
    stands_out = _stands_out(far, (codes <= max(2, most // 256)) & ~far)
    if not coding.has_invalid and stands_out and (np.isfinite(coding.far) or _mean_width(far) < _HOLE_PX):
        warnings.append(
            f"{video.path.name}: {far.mean():.1%} of codes are 0, the farthest depth, and few are close to it: "
            'expected HasInvalidDepth true if they mean "no depth"'
        )
    return warnings


def _stands_out(mask: Bools, around: Bools) -> bool:
    return bool(mask.mean() > max(_HOLES_SHARE, 10 * around.mean()))


def _mean_width(mask: Bools) -> float:
    """The mean number of marked pixels that lie side by side in a row."""
    starts = mask[:, 0].sum() + (mask[:, 1:] & ~mask[:, :-1]).sum()
    return float(mask.sum() / max(1, starts))


def _look_at_both(texture: RawVideo, depth: RawVideo) -> list[str]:
    """Textures and depths that seem to be in each other's file, or that are the same."""
    both = f"{texture.path.name}, {depth.path.name}: "
    if texture.format.has_chroma and depth.format.has_chroma:
        coloured = [any(np.ptp(_plane(video, index)) for index in (1, 2)) for video in (texture, depth)]
        if coloured == [False, True]:
            return [f"{both}only the depth has colours: they seem to be swapped"]
    luma, codes = _plane(texture), _plane(depth)
    if np.ptp(luma) and np.array_equal(luma, codes):
        return [f"{both}the same samples: expected a texture and its depth"]
    return []


def _look_for_copies(videos: Iterable[RawVideo], seen: dict[bytes, str]) -> list[str]:
    """Files with the same first picture as an earlier one of the same kind."""
    copies = []
    for video in videos:
        samples = _plane(video)
        if np.ptp(samples):
            first = seen.setdefault(hashlib.blake2b(samples.tobytes()).digest(), video.path.name)
            if first != video.path.name:
                copies.append(f"{first}, {video.path.name}: the same first picture: expected one of each camera")
    return copies
