#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs dense volumes with walls thinner than a voxel, and thicker ones (measurements/measures/README.md).

    measurements/measures/thin_volumes.py --worker build/hexad-worker [--output measurements/measures/thin_volumes.csv]

Values are distances. A thin body has to be `unresolved` with lost_walls; a thick one, above 0.9 voxels, must not.
"""
import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1] / "common"),
                str(pathlib.Path(__file__).resolve().parents[2] / "tests" / "service")]
import results  # noqa: E402
from volumes import write_nrrd  # noqa: E402

SIZE, END = 128, 1.25
VOXEL = 2 * END / (SIZE - 1)


def ball(x, y, z, radius=1.0):
    return np.sqrt(x * x + y * y + z * z) - radius


def ring(x, y, z, radius=0.3):
    return np.hypot(np.hypot(x, y) - 0.8, z) - radius


def cuboid(*half):
    def value(x, y, z):
        q = [abs(x) - half[0], abs(y) - half[1], abs(z) - half[2]]
        outside = np.sqrt(sum(np.maximum(t, 0) ** 2 for t in q))
        return outside + np.minimum(np.maximum(np.maximum(q[0], q[1]), q[2]), 0)
    return value


def turned(of, a=0.5, b=0.3):
    def value(x, y, z):
        x, y = np.cos(a) * x - np.sin(a) * y, np.sin(a) * x + np.cos(a) * y
        y, z = np.cos(b) * y - np.sin(b) * z, np.sin(b) * y + np.cos(b) * z
        return of(x, y, z)
    return value


def shell(of, voxels):
    return lambda x, y, z: abs(of(x, y, z)) - voxels * VOXEL / 2


def without(of, slit):
    return lambda x, y, z: np.maximum(of(x, y, z), -slit(x, y, z))


def both(one, other):
    return lambda x, y, z: np.minimum(one(x, y, z), other(x, y, z))


def plate(voxels):
    return cuboid(0.9, 0.8, voxels * VOXEL / 2)


def wave(x, y, z):
    return z - 0.3 * np.sin(4 * x)


def limited(of):
    return lambda x, y, z: np.maximum(of(x, y, z), cuboid(0.9, 0.9, 0.9)(x, y, z))


def beside(x, y, z):
    return ball(x, y, z - 0.9, 0.2)


BODIES = {
    "thin": {"shell of 0.2": shell(ball, 0.2), "shell of 0.4": shell(ball, 0.4), "shell of 0.6": shell(ball, 0.6), "ring of 0.3": shell(ring, 0.3),
             "ring of 0.5": shell(ring, 0.5), "turned plate of 0.3": turned(plate(0.3)), "turned plate of 0.5": turned(plate(0.5)),
             "plate of 0.5 between samples, and a ball": both(plate(0.5), beside), "slit of 0.5 in a box": without(cuboid(1, 0.9, 0.5), turned(plate(0.5))),
             "wave of 0.4": limited(shell(wave, 0.4))},
    "thick": {"shell of 0.95": shell(ball, 0.95), "shell of 1.2": shell(ball, 1.2), "shell of 3": shell(ball, 3), "ring of 1.3": shell(ring, 1.3),
              "turned plate of 0.95": turned(plate(0.95)), "turned plate of 1.5": turned(plate(1.5)), "plate of 3": plate(3), "ball": ball,
              "turned box": turned(cuboid(0.8, 0.6, 0.4)), "slit of 2 in a box": without(cuboid(1, 0.9, 0.5), turned(plate(2)))},
}


def run(worker, of):
    axis = np.linspace(-END, END, SIZE)
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        write_nrrd(folder / "v.nrrd", -of(*np.meshgrid(axis, axis, axis, indexing="ij")).astype("f4"))
        spec = {"version": 1, "surface": {"volume": {"path": str(folder / "v.nrrd"), "isovalue": 0}}, "sampling": {"count": 1000},
                "output": {"preview": False}}
        done = subprocess.run([worker, "run", "-", "--output", folder / "out"], input=json.dumps(spec), text=True, capture_output=True)
        if done.returncode not in (0, 10, 11):
            raise SystemExit(done.stderr)
        return json.loads((folder / "out" / "report.json").read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worker", required=True)
    parser.add_argument("--output", type=pathlib.Path)
    options = parser.parse_args()
    rows, wrong = [], 0
    for kind, bodies in BODIES.items():
        for name, of in bodies.items():
            report = run(options.worker, of)
            lost = [r["value"] for r in report["outcome_reasons"] if r["criterion"] == "lost_walls"]
            note = [w.split(" %")[0] for w in report["surface"]["warnings"] if "thinner than two voxels" in w]
            wrong += bool(lost) != (kind == "thin")
            rows.append([name, kind, report["outcome"], f"{lost[0]:.3f}" if lost else "", note[0] if note else ""])
            print(*rows[-1], flush=True)
    if options.output:
        results.write(options.output, ["row", "kind", "outcome", "lost_walls", "thin_percent"], rows)
    print(f"{len(rows)} bodies, {wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
