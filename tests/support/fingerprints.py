"""Hashes of the command line's output: they show whether two versions of Farside make the same pictures, bit for bit.

    python tests/support/fingerprints.py .venv/bin/farside [OTHER/bin/farside] [--folder DIR]

Each program renders virtual cameras and stereo pairs along a head's path, and exports the background model, for two
twins and, if the shared sequences exist, Atrium and Table, with each quality. Of the model (PLY) all but the header
counts: geometry, and colours of vertices. With two programs the table shows where they differ, and the exit status is 1
if they do anywhere. Only names of the fixed command line are used, so that versions with different inner structure can
be compared. The twins are made once, by the first program.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

SHARED = Path(os.environ.get("FARSIDE_SHARED", Path(__file__).resolve().parents[3] / "shared"))
TWINS = ("museum", "painter")
SCALE, FRAMES = 0.25, 12
QUALITIES = ("fast", "balanced", "best")


def run(farside: Path, *arguments: object) -> None:
    """Run a command of the program; raises CalledProcessError if it fails."""
    subprocess.run([farside, *map(str, arguments)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def sequences(farside: Path, folder: Path) -> Iterator[Path]:
    """Folders of the sequences; missing twins are made."""
    for name in ("Atrium", "Table"):
        if (SHARED / "sequences" / name).is_dir():
            yield SHARED / "sequences" / name
    for name in TWINS:
        twin = folder / "twins" / name
        if not twin.is_dir():
            run(farside, "synth", name, twin, "--scale", SCALE, "--frames", FRAMES)
        yield twin


def virtual_cameras(sequence: Path) -> list[str]:
    """Names of a sequence's cameras that are not sources: t0, t1 and so on."""
    description = json.loads(next(sequence.glob("*.json")).read_text())
    return [camera["Name"] for camera in description["cameras"] if camera["Name"].startswith("t")]


def write_trace(path: Path) -> None:
    """Write the trace of a head that moves sideways and up, and turns, in twelve steps."""
    rows = [f"{0.01 * k},{0.02 * k},{0.005 * k},{3.0 * k},{-k},{0.5 * k}" for k in range(FRAMES)]
    path.write_text("\n".join(["X,Y,Z,Yaw,Pitch,Roll", *rows]) + "\n")


def fingerprints(farside: Path, sequence: Path, folder: Path) -> dict[str, str]:
    """SHA-256 of each file that the program `farside` writes for a sequence, by quality and file name."""
    write_trace(folder / "head.csv")
    found = {}
    for quality in QUALITIES:
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            out = Path(scratch)
            cameras = [word for name in virtual_cameras(sequence) for word in ("--camera", name)]
            run(farside, "render", sequence, "--out", out / "cameras", *cameras, "--quality", quality)
            stereo = ("--pose-trace", folder / "head.csv", "--stereo", "--size", "320x361", "--fov", 95)
            run(farside, "render", sequence, "--out", out / "stereo", *stereo, "--quality", quality)
            run(farside, "export", sequence, out / "model.ply", "--quality", quality)
            for path in sorted(path for path in out.rglob("*") if path.is_file()):
                name = f"{sequence.name} {quality} {path.relative_to(out)}"
                data = path.read_bytes()
                if path.suffix == ".ply":
                    data = data.partition(b"end_header\n")[2]
                found[name] = hashlib.sha256(data).hexdigest()
    return found


def main() -> int:
    """Print the table; returns 1 if two programs differ."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("farside", type=Path, nargs="+", help="one or two programs")
    parser.add_argument("--folder", type=Path, help="where the twins are kept; default: made anew")
    options = parser.parse_args()
    programs = [program.absolute() for program in options.farside]
    differs = False
    with tempfile.TemporaryDirectory() as scratch:
        folder = options.folder or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for sequence in sequences(programs[0], folder):
            results = [fingerprints(program, sequence, folder) for program in programs]
            for name, digest in results[0].items():
                same = all(result.get(name) == digest for result in results)
                differs |= not same
                print(f"{digest[:16]}  {name}{'' if same else '   DIFFERS'}", flush=True)
            differs |= any(result.keys() != results[0].keys() for result in results)
    return int(differs)


if __name__ == "__main__":
    raise SystemExit(main())
