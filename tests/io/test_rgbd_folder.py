"""Folders of pictures of one hand-held RGB-D camera."""

from __future__ import annotations

import numpy as np
import pytest
from farside.clients.cli import app
from farside.engine.io.recording import open_recording
from farside.engine.io.rgbd_folder import RgbdFolder
from farside.engine.rig.texture import from_rgb
from PIL import Image
from typer.testing import CliRunner

K = np.array([[40.0, 0.0, 23.5], [0.0, 42.0, 15.0], [0.0, 0.0, 1.0]])
WIDTH, HEIGHT = 48, 32


def pose_of(k):
    """World from camera, in OpenCV's axes: it turns about its y axis and moves."""
    c, s = np.cos(0.1 * k), np.sin(0.1 * k)
    pose = np.array([[c, 0, s, 0.2 * k], [0, 1, 0, 0.1 * k], [-s, 0, c, -0.3 * k], [0, 0, 0, 1.0]])
    return np.array([[0, 0, 1, 5.0], [1, 0, 0, -2.0], [0, 1, 0, 3.0], [0, 0, 0, 1.0]]) @ pose


@pytest.fixture
def folder(tmp_path):
    rng = np.random.default_rng(0)
    for name in ("color", "depth", "pose"):
        (tmp_path / name).mkdir()
    np.savetxt(tmp_path / "intrinsics.txt", K)
    for k, stem in enumerate(("00007", "00010", "00008")):
        rgb = rng.integers(0, 256, (HEIGHT, WIDTH, 3)).astype(np.uint8)
        Image.fromarray(rgb).save(tmp_path / "color" / f"{stem}.png")
        depth = rng.integers(300, 9000, (HEIGHT, WIDTH)).astype(np.uint16)
        depth[k, :] = 0
        Image.fromarray(depth).save(tmp_path / "depth" / f"{stem}.png")
        np.savetxt(tmp_path / "pose" / f"{stem}.txt", pose_of(k))
    return tmp_path


def test_pictures_depth_and_poses_are_read_in_the_order_of_their_numbers(folder):
    recording = open_recording(folder)
    assert isinstance(recording, RgbdFolder)
    assert (recording.frame_count, recording.source_names, recording.truth_names) == (3, ("camera",), ())
    frames = list(recording.frames())
    for frame, stem, k in zip(frames, ("00007", "00008", "00010"), (0, 2, 1), strict=True):
        (view,) = frame.views
        rgb, millimetres = (np.asarray(Image.open(folder / part / f"{stem}.png")) for part in ("color", "depth"))
        np.testing.assert_array_equal(view.texture.y, from_rgb(rgb).y)
        depth = view.camera.depth.depth(view.codes)
        np.testing.assert_array_equal(np.isnan(depth), millimetres == 0)
        there = millimetres > 0
        np.testing.assert_allclose(depth[there], millimetres[there] / 1000, rtol=4e-3)
        # A pixel's point: by OpenCV's rules in the file's world, and by Farside's in that of the first camera.
        u, v, z = 31, 4, 2.0
        opencv = pose_of(k) @ [(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z, 1.0]
        in_first = np.linalg.inv(pose_of(0)) @ opencv
        found = view.camera.unproject(np.array([u + 0.5, v + 0.5]), np.array(z))
        np.testing.assert_allclose(found, [in_first[2], -in_first[0], -in_first[1]], atol=1e-9)
    assert recording.poses("camera") == [frame.views[0].camera.pose for frame in frames]
    assert recording.poses("camera")[0].position == (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(recording.texture("camera", 1).y, frames[1].views[0].texture.y)


@pytest.mark.parametrize(
    ("file", "content", "said"),
    [
        ("pose/00008.txt", None, r"pose/00008.txt: .*: expected 4 x 4 numbers"),
        ("pose/00008.txt", "1 0\n0 1\n", r"pose/00008.txt: numbers \(2, 2\): expected 4 x 4"),
        ("pose/00008.txt", "2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n", r"pose/00008.txt: .*expected a rotation"),
        ("intrinsics.txt", "a b c\n", r"intrinsics.txt: .*'a'.*: expected 3 x 3 numbers"),
        ("intrinsics.txt", "nan " * 3 + "\n" + "0 0 1\n" * 2, r"expected 3 x 3 that are finite"),
    ],
)
def test_a_file_that_does_not_fit_is_named(folder, file, content, said):
    path = folder / file
    path.unlink()
    if content is not None:
        path.write_text(content)
    with pytest.raises(ValueError, match=said):
        list(open_recording(folder).frames())


@pytest.mark.parametrize(
    ("file", "content", "reason", "said"),
    [
        ("depth", None, "depth", "expected a PNG picture"),
        ("depth", b"no picture", "depth", "expected a PNG picture"),
        ("color", b"\x89PNG\r\n", "texture", "expected a PNG picture"),
        ("depth", WIDTH + 1, "depth", "00008.png: 49x32 uint16: expected 48x32 I;16"),
        ("pose", b"nan nan nan nan\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "pose", "expected finite numbers"),
        ("pose", b"1 0 0 900\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", "pose", "jumps by"),
    ],
)
def test_a_damaged_picture_or_a_lost_pose_leaves_the_view_out(folder, caplog, file, content, reason, said):
    path = next((folder / file).glob("00008.*"))
    path.unlink()
    if isinstance(content, int):
        Image.fromarray(np.zeros((HEIGHT, content), np.uint16)).save(path)
    elif content is not None:
        path.write_bytes(content)
    frames = list(open_recording(folder).frames())
    assert [frame.there for frame in frames] == [[0], [], [0]]
    fault = frames[1].faults["camera"]
    assert fault.reason == reason
    assert said in fault.detail
    assert len(caplog.messages) == (file == "pose")


def test_the_first_pose_that_there_is_is_that_of_the_world(folder):
    (folder / "pose" / "00007.txt").write_text("inf inf inf inf\n" * 4)
    recording = open_recording(folder)
    assert [frame.there for frame in recording.frames()] == [[], [0], [0]]
    assert recording.poses("camera")[0] == recording.poses("camera")[1]
    assert recording.poses("camera")[1].position == pytest.approx((0.0, 0.0, 0.0))


def test_frames_and_cameras_that_are_not_there(folder):
    recording = open_recording(folder)
    with pytest.raises(ValueError, match="frame: 3: expected 0 to 2"):
        recording.frame(3)
    with pytest.raises(ValueError, match="camera: 'v0': expected camera"):
        recording.camera("v0")
    with pytest.raises(ValueError, match="moving camera: 'v0': expected none"):
        open_recording(folder, {"v0": folder / "x.csv"})


def test_farside_info_lists_what_it_holds(folder):
    done = CliRunner().invoke(app, ["info", str(folder)])
    assert done.exit_code == 0, done.output
    assert "48x32" in done.output
    assert "no problems found" in done.output
    (folder / "depth" / "00008.png").unlink()
    done = CliRunner().invoke(app, ["info", str(folder)])
    assert done.exit_code == 2
    assert "problem frame 1: left out: depth: " in done.output
    assert "00008.png" in " ".join(done.output.split())
