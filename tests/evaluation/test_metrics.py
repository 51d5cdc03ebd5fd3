"""Quality metrics: the reference tool's figures, and a slow plain twin of IV-PSNR."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from farside.clients.compare import command, compare
from farside.engine.evaluation.metrics import iv_psnr, psnr, ssim, ws_psnr
from farside.engine.evaluation.structural_similarity import structural_similarity
from farside.engine.io.yuv import RawVideo
from farside.engine.rig.frame import Texture
from support.shared import SHARED, needs_shared

SIZES = {"persp": (256, 192), "erp": (384, 192)}


def video(name: str) -> RawVideo:
    width, height = SIZES[name.split("_")[0]]
    return RawVideo(
        SHARED / "metrics" / f"{name}_{width}x{height}_yuv420p10le.yuv", width, height, "yuv420p10le"
    )


def random_texture(h: int, w: int, seed: int, bits: int = 10) -> Texture:
    rng = np.random.default_rng(seed)
    shapes = ((h, w), ((h + 1) // 2, (w + 1) // 2), ((h + 1) // 2, (w + 1) // 2))
    return Texture(*(rng.integers(0, 1 << bits, shape).astype(np.uint16) for shape in shapes))


def plain_iv_psnr(ref: Texture, test: Texture, bits: int) -> float:
    """The published definition, one pixel after the other."""
    h, w = ref.y.shape

    def at(texture: Texture, y: int, x: int) -> list[int]:
        return [int(texture.y[y, x]), int(texture.cb[y // 2, x // 2]), int(texture.cr[y // 2, x // 2])]

    def one_way(a: Texture, b: Texture) -> float:
        peak = 2**bits - 1
        limit = round(0.01 * peak)
        pixels = [(y, x) for y in range(h) for x in range(w)]
        means = [sum(at(b, *p)[c] - at(a, *p)[c] for p in pixels) / len(pixels) for c in range(3)]
        shift = [max(-limit, min(limit, int(math.copysign(int(abs(m) + 0.5), m)))) for m in means]
        totals = [0, 0, 0]
        for y, x in pixels:
            mine = [value + s for value, s in zip(at(a, y, x), shift, strict=True)]
            errors = [
                [(m - o) ** 2 for m, o in zip(mine, at(b, v, u), strict=True)]
                for v in range(max(0, y - 2), min(h, y + 3))
                for u in range(max(0, x - 2), min(w, x + 3))
            ]
            best = min(errors, key=lambda e: 4 * e[0] + e[1] + e[2])
            totals = [t + e for t, e in zip(totals, best, strict=True)]
        y_, cb, cr = (10 * math.log10(h * w * peak**2 / max(1, t)) for t in totals)
        return (4 * y_ + cb + cr) / 6

    return min(one_way(ref, test), one_way(test, ref))


def plain_ssim(a: np.ndarray, b: np.ndarray, peak: int) -> float:
    """The published definition (Wang et al. 2004), one window after the other."""
    offsets = np.arange(-5, 6)
    weights = np.exp(-(offsets[:, None] ** 2 + offsets**2) / (2 * 1.5**2))
    weights /= weights.sum()
    values = []
    for y in range(a.shape[0] - 10):
        for x in range(a.shape[1] - 10):
            p, q = (plane[y : y + 11, x : x + 11].astype(float) for plane in (a, b))
            mean_p, mean_q = (weights * p).sum(), (weights * q).sum()
            p, q = p - mean_p, q - mean_q
            c1, c2 = (0.01 * peak) ** 2, (0.03 * peak) ** 2
            luminance = (2 * mean_p * mean_q + c1) / (mean_p**2 + mean_q**2 + c1)
            spread = (weights * p * p).sum() + (weights * q * q).sum()
            values.append(luminance * (2 * (weights * p * q).sum() + c2) / (spread + c2))
    return float(np.mean(values))


@pytest.mark.parametrize(("h", "w", "bits"), [(11, 11, 10), (14, 19, 10), (23, 12, 8)])
def test_ssim_agrees_with_its_definition(h: int, w: int, bits: int) -> None:
    ref = random_texture(h, w, 1, bits)
    mixed = ((3 * ref.y.astype(int) + random_texture(h, w, 2, bits).y) // 4).astype(np.uint16)
    for luma in (mixed, random_texture(h, w, 3, bits).y, np.full_like(ref.y, 7)):
        test = Texture(luma, ref.cb, ref.cr)
        assert ssim(ref, test, bits=bits) == pytest.approx(plain_ssim(ref.y, luma, 2**bits - 1), abs=1e-9)
    assert ssim(ref, ref, bits=bits) == pytest.approx(1.0, abs=1e-12)
    with pytest.raises(ValueError, match=r"picture: \(20, 10\): expected at least 11"):
        ssim(random_texture(10, 20, 0), random_texture(10, 20, 0))


def test_compare_has_ssim_where_the_window_fits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = [random_texture(12, 16, seed) for seed in range(2)]
    a, b = write_video(tmp_path / "a.yuv", frames[:1]), write_video(tmp_path / "b.yuv", frames[1:])
    command(a, b, "16x12", json_file=tmp_path / "out.json")
    figures = json.loads((tmp_path / "out.json").read_text())["mean"]
    assert figures["ssim_gaussian"] == pytest.approx(ssim(*frames))
    assert f"{figures['ssim']:.4f}" in capsys.readouterr().out
    assert "ms_ssim" not in figures  # smaller than any scale


def plain_windows(a: np.ndarray, b: np.ndarray, peak: int, *, luminance: bool = True) -> np.ndarray:
    """SSIM of all windows of 8 x 8 pixels, four apart, one after the other; [rows, columns]."""
    c1, c2 = (0.01 * peak) ** 2, (0.03 * peak) ** 2
    rows = []
    for y in range(0, a.shape[0] - 7, 4):
        rows.append([])
        for x in range(0, a.shape[1] - 7, 4):
            p, q = (plane[y : y + 8, x : x + 8].astype(float) for plane in (a, b))
            value = (2 * np.mean((p - p.mean()) * (q - q.mean())) + c2) / (p.var() + q.var() + c2)
            if luminance:
                value *= (2 * p.mean() * q.mean() + c1) / (p.mean() ** 2 + q.mean() ** 2 + c1)
            rows[-1].append(value)
    return np.array(rows)


def plain_matches(moved: Texture, other: Texture, peak: int) -> Texture:
    """Each pixel of `moved` replaced by its best match in `other`, chroma at luma resolution."""
    h, w = moved.y.shape
    chroma = [[c.repeat(2, 0).repeat(2, 1)[:h, :w] for c in (t.cb, t.cr)] for t in (moved, other)]
    a, b = ([p.astype(int) for p in (t.y, *more)] for t, more in zip((moved, other), chroma, strict=True))
    limit = round(0.01 * peak)
    means = [float(q.mean() - p.mean()) for p, q in zip(a, b, strict=True)]
    shift = [max(-limit, min(limit, int(math.copysign(int(abs(m) + 0.5), m)))) for m in means]
    out = np.empty((3, h, w), np.uint16)
    for y in range(h):
        for x in range(w):
            near = [(v, u) for v in range(max(0, y - 2), min(h, y + 3)) for u in range(max(0, x - 2), min(w, x + 3))]
            errors = [
                sum(k * (a[c][y, x] + shift[c] - b[c][p]) ** 2 for c, k in enumerate((4, 1, 1))) for p in near
            ]
            best = near[errors.index(min(errors))]
            out[:, y, x] = [min(max(b[c][best] - shift[c], 0), peak) for c in range(3)]
    return Texture(out[0], out[1][::2, ::2], out[2][::2, ::2])


@pytest.mark.parametrize(("h", "w", "bits"), [(8, 8, 10), (13, 22, 10), (36, 64, 8)])
def test_block_ssims_agree_with_their_definition(h: int, w: int, bits: int) -> None:
    """Chroma that is flat is left out of what is matched, so that the plain twin may halve it again."""
    peak = 2**bits - 1
    ref = random_texture(h, w, 1, bits)
    test = Texture(((3 * ref.y.astype(int) + random_texture(h, w, 2, bits).y) // 4).astype(np.uint16), ref.cb, ref.cr)
    flat = Texture(*(np.full_like(p, 100) for p in (ref.y, ref.cb, ref.cr)))
    ref, test = (Texture(t.y, flat.cb, flat.cr) for t in (ref, test))
    got = structural_similarity(ref, test, bits=bits)
    assert got.ssim == pytest.approx((plain_windows(ref.y, test.y, peak).mean(), 1.0, 1.0), abs=1e-9)
    moved = [(test, plain_matches(test, ref, peak)), (ref, plain_matches(ref, test, peak))]
    ways = [(4 * plain_windows(a.y, b.y, peak).mean() + 2) / 6 for a, b in moved]
    assert got.iv_ssim == pytest.approx(min(ways), abs=1e-9)
    rows = [plain_windows(a.y, b.y, peak).mean(axis=1) for a, b in moved]
    weights = np.cos(((np.arange(h) + 0.5) / h - 0.5) * math.radians(90.0))[4 : h - 3 : 4]
    ways = [(4 * np.average(row, weights=weights) + 2) / 6 for row in rows]
    assert structural_similarity(ref, test, (180.0, 90.0), bits=bits).iv_ssim == pytest.approx(min(ways), abs=1e-9)
    same = structural_similarity(ref, ref, bits=bits)
    assert same.figures() == pytest.approx(dict.fromkeys(same.figures(), 1.0))
    if h < 32:
        assert got.ms_ssim is got.iv_ms_ssim is None
        return
    # One scale of 36 x 64 pixels: the limit is 32 a side.
    assert got.ms_ssim == pytest.approx(got.ssim)
    assert got.iv_ms_ssim == pytest.approx(got.iv_ssim)


def test_two_scales_take_structure_from_the_finer_and_all_from_the_coarser() -> None:
    ref, other = random_texture(64, 70, 1), random_texture(64, 70, 2)
    test = Texture(((3 * ref.y.astype(int) + other.y) // 4).astype(np.uint16), ref.cb, ref.cr)
    halves = [
        ((p[::2, ::2].astype(int) + p[1::2, ::2] + p[::2, 1::2] + p[1::2, 1::2] + 2) // 4) for p in (ref.y, test.y)
    ]
    fine = plain_windows(ref.y, test.y, 1023, luminance=False).mean()
    coarse = plain_windows(*halves, 1023).mean()
    got = structural_similarity(ref, test).ms_ssim
    assert got is not None
    assert got[0] == pytest.approx(fine**0.1356 * coarse**0.8644, abs=1e-9)
    inverse = Texture((1023 - ref.y).astype(np.uint16), ref.cb, ref.cr)
    negative = structural_similarity(ref, inverse)
    assert negative.ssim[0] < 0
    assert negative.ms_ssim is not None
    assert negative.ms_ssim[0] == 0.0


def test_ssims_refuse_what_does_not_fit() -> None:
    with pytest.raises(ValueError, match=r"picture: \(20, 7\): expected at least 8"):
        structural_similarity(random_texture(7, 20, 0), random_texture(7, 20, 0))
    with pytest.raises(ValueError, match="expected the reference's size"):
        structural_similarity(random_texture(16, 20, 0), random_texture(16, 22, 0))


@needs_shared
@pytest.mark.parametrize(
    ("ref", "test", "erp", "expected"),
    [
        (
            "persp_ref", "persp_shift", None,
            (0.89630162, 0.99995898, 1.0, 0.93086091, 0.95725587, 0.99998103, 1.0, 0.97150075, 0.98559111, 0.99516767),
        ),
        (
            "persp_ref", "persp_hole", None,
            (0.95060987, 1.0, 1.0, 0.96707325, 0.90078963, 1.0, 1.0, 0.93385975, 0.96597171, 0.94072677),
        ),
        (
            "erp_ref", "erp_polar", "360,180",
            (0.95174685, 1.0, 1.0, 0.96783123, 0.99002301, 1.0, 1.0, 0.99334868, 0.99411465, 0.99688689),
        ),
    ],
)  # fmt: skip
def test_ssims_are_those_of_the_present_tool(
    ref: str, test: str, erp: str | None, expected: tuple[float, ...], tmp_path: Path
) -> None:
    a, b = video(ref), video(test)
    command(a.path, b.path, f"{a.width}x{a.height}", erp=erp, json_file=tmp_path / "out.json")
    mean = json.loads((tmp_path / "out.json").read_text())["mean"]
    names = [f"{kind}{plane}" for kind in ("ssim", "ms_ssim") for plane in ("_y", "_cb", "_cr", "")]
    assert [mean[name] for name in (*names, "iv_ssim", "iv_ms_ssim")] == pytest.approx(expected, abs=1e-6)


@needs_shared
@pytest.mark.parametrize(
    ("ref", "test", "planes", "iv"),
    [
        ("persp_ref", "persp_shift", (30.495346, 46.218113, 107.112925), 39.808631),
        ("persp_ref", "persp_hole", (24.398799, 107.112925, 107.112925), 31.871115),
    ],
)
def test_perspective_figures(ref: str, test: str, planes: tuple[float, ...], iv: float) -> None:
    pictures = video(ref).texture(0), video(test).texture(0)
    assert psnr(*pictures) == pytest.approx(planes, abs=1e-5)
    assert iv_psnr(*pictures) == pytest.approx(iv, abs=1e-5)


@needs_shared
def test_equirectangular_figures() -> None:
    pictures = video("erp_ref").texture(0), video("erp_polar").texture(0)
    identical = 108.873837
    assert psnr(*pictures) == pytest.approx((40.157266, identical, identical), abs=1e-5)
    assert ws_psnr(*pictures, (360, 180)) == pytest.approx((43.150886, identical, identical), abs=1e-5)
    assert iv_psnr(*pictures, (360, 180)) == pytest.approx(56.748831, abs=1e-5)


@pytest.mark.parametrize(("h", "w", "bits"), [(8, 10, 10), (7, 5, 10), (6, 6, 8), (1, 3, 16), (9, 4, 16)])
def test_iv_psnr_agrees_with_its_definition(h: int, w: int, bits: int) -> None:
    ref, test = random_texture(h, w, 1, bits), random_texture(h, w, 2, bits)
    assert iv_psnr(ref, test, bits=bits) == pytest.approx(plain_iv_psnr(ref, test, bits), abs=1e-9)
    brighter = Texture(np.minimum(ref.y + 9, (1 << bits) - 1).astype(np.uint16), ref.cb, ref.cr)
    assert iv_psnr(ref, brighter, bits=bits) == pytest.approx(plain_iv_psnr(ref, brighter, bits), abs=1e-9)


def test_identical_pictures_have_a_finite_figure() -> None:
    texture = random_texture(6, 8, 3)
    expected = 10 * math.log10(48 * 1023**2)
    assert psnr(texture, texture) == pytest.approx((expected,) * 3)
    assert iv_psnr(texture, texture) == pytest.approx(expected)
    assert ws_psnr(texture, texture, (180, 90)) == pytest.approx((expected,) * 3)


def test_global_colour_difference_is_forgiven_up_to_one_percent() -> None:
    texture = random_texture(6, 8, 3)
    base = Texture(texture.y // 2 + 100, texture.cb, texture.cr)
    near, far = (Texture(base.y + step, base.cb, base.cr) for step in (10, 30))
    assert iv_psnr(base, near) == iv_psnr(base, base)
    assert iv_psnr(base, far) < iv_psnr(base, base) - 10


def test_polar_errors_weigh_less() -> None:
    ref = random_texture(32, 8, 1)
    tops = []
    for row in (0, 16):
        y = ref.y.copy()
        y[row] ^= 64
        tops.append(ws_psnr(ref, Texture(y, ref.cb, ref.cr), (360, 180))[0])
    expected = math.cos(0.5 / 32 * math.pi) / math.cos((0.5 - 0.5 / 32) * math.pi)
    assert tops[0] - tops[1] == pytest.approx(10 * math.log10(expected))


def test_sizes_must_agree() -> None:
    for metric in (psnr, iv_psnr):
        with pytest.raises(ValueError, match=r"test picture: \(8, 6\): expected .* \(4, 6\)"):
            metric(random_texture(6, 4, 0), random_texture(6, 8, 0))
    with pytest.raises(ValueError, match=r"erp: \(0, 180\)"):
        ws_psnr(random_texture(6, 4, 0), random_texture(6, 4, 0), (0, 180))


def write_video(path: Path, textures: list[Texture], dtype: str = "<u2") -> Path:
    with path.open("wb") as file:
        for texture in textures:
            for plane in (texture.y, texture.cb, texture.cr):
                file.write(plane.astype(dtype).tobytes())
    return path


@pytest.mark.parametrize(("pixel_format", "bits"), [("yuv420p", 8), ("yuv420p10le", 10), ("yuv420p16le", 16)])
def test_compare_formats(
    tmp_path: Path, pixel_format: str, bits: int, capsys: pytest.CaptureFixture[str]
) -> None:
    frames = [random_texture(6, 8, seed, bits) for seed in range(4)]
    dtype = "u1" if bits == 8 else "<u2"
    a = write_video(tmp_path / "a.yuv", frames[:2], dtype)
    b = write_video(tmp_path / "b.yuv", frames[2:], dtype)
    command(a, b, "8x6", pixel_format, "90,60", tmp_path / "out.json")
    report = json.loads((tmp_path / "out.json").read_text())
    assert [frame["frame"] for frame in report["frames"]] == [0, 1]
    expected = [iv_psnr(frames[i], frames[i + 2], (90, 60), bits=bits) for i in (0, 1)]
    assert [frame["iv_psnr"] for frame in report["frames"]] == pytest.approx(expected)
    assert report["mean"]["iv_psnr"] == pytest.approx(sum(expected) / 2)
    assert report["mean"]["psnr_cr"] == pytest.approx(
        sum(psnr(frames[i], frames[i + 2], bits=bits)[2] for i in (0, 1)) / 2
    )
    assert {"ws_psnr_y", "ws_psnr_cb", "ws_psnr_cr"} < set(report["mean"])
    assert f"{report['mean']['iv_psnr']:.4f}" in capsys.readouterr().out


def test_compare_refuses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames = [random_texture(6, 8, seed) for seed in range(2)]
    a, b = write_video(tmp_path / "a.yuv", frames), write_video(tmp_path / "b.yuv", frames[:1])
    with pytest.raises(ValueError, match=r"frames: a.yuv has 2, b.yuv has 1"):
        command(a, b, "8x6", json_file=tmp_path / "out.json")
    assert len(json.loads((tmp_path / "out.json").read_text())["frames"]) == 1
    assert "mean" in capsys.readouterr().out
    with pytest.raises(ValueError, match=r"a.yuv: 288 bytes: expected a multiple of 180"):
        command(a, b, "10x6")
    with pytest.raises(ValueError, match="--size: '8': expected"):
        command(a, b, "8")
    with pytest.raises(ValueError, match="--erp: '360': expected"):
        command(a, b, "8x6", erp="360")
    with pytest.raises(ValueError, match="format: 'gray10le': expected 4:2:0"):
        compare(RawVideo(a, 8, 6, "gray10le"), RawVideo(b, 8, 6, "gray10le"))
    with pytest.raises(OSError, match="nowhere"):
        command(tmp_path / "nowhere.yuv", b, "8x6")
