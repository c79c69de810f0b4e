#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs one job with several numbers of threads and instruction sets, and writes the digest of its points and its measures.

    measurements/outputs/same_bytes.py --worker build/hexad-worker --output measurements/outputs/same_bytes.csv [--count 1000000]

The job samples a torus by its formula. An instruction set that the machine lacks is left out. Ends with 1 if a row differs from the first one.
"""
import argparse
import hashlib
import json
import os
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import results  # noqa: E402

SETTINGS = [(1, "auto"), (2, "auto"), (3, "auto"), (8, "auto"), (1, "portable"), (2, "avx2")]
REFUSED = 2


def run(worker, count, threads, isa):
    """The instruction set that was used, the digests of the points and of the measures, and hex_fraction; None if refused."""
    spec = {"version": 1, "surface": {"analytic": {"shape": "torus", "major_radius": 1, "minor_radius": 0.4}}, "sampling": {"count": count},
            "solver": {"isa": isa}, "output": {"preview": False, "ply": {"properties": ["all"]}}}
    with tempfile.TemporaryDirectory() as where:
        done = subprocess.run([worker, "run", "-", "--output", where, "--threads", str(threads)], input=json.dumps(spec), text=True,
                              capture_output=True)
        if done.returncode == REFUSED:
            return None
        if done.returncode not in (0, 10, 11):
            raise SystemExit(done.stderr)
        report = json.loads((pathlib.Path(where) / "report.json").read_text())
        quality = json.dumps(report["quality"], sort_keys=True).encode()
        return (report["diagnostics"]["isa"], hashlib.sha256((pathlib.Path(where) / "points.ply").read_bytes()).hexdigest()[:16],
                hashlib.sha256(quality).hexdigest()[:16], report["quality"]["hex_fraction"])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True, type=os.path.abspath)
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--count", type=int, default=1000000)
    options = parser.parse_args()
    rows = []
    for threads, isa in SETTINGS:
        found = run(options.worker, options.count, threads, isa)
        if not found:
            continue
        rows.append([f"threads {threads}, {found[0]}", options.count, *found[1:]])
        print(*rows[-1], flush=True)
    results.write(options.output, ["row", "points", "points_digest", "measures_digest", "hex_fraction"], rows)
    return 0 if all(row[1:] == rows[0][1:] for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
