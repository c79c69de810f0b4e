#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the same specs with all instructions of the processor and without FMA and AVX2, and compares the bytes of all outputs.

    measurements/outputs/processors.py --worker build/hexad-worker [--output FILE.csv] [--data DIRECTORY] [--only WORD ...] [--resume]

DIRECTORY, or HEXAD_SHARED, has the folders meshes, vdb, volumes, exr and cases. The specs are those of tools/same_points.py and, for each
other file, the first one that `inspect` suggests, with 2 000 points. Each job writes every output. Compared are all files but the
report, of the report the outcome, the surface, the measures and the warnings, and the error of a job without points. With --resume, rows that the
output has are kept. Ends with 1 if a row differs, and with 2 if the processor has no FMA, so that a difference could not show.
"""
import argparse
import hashlib
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve()
for folder in ("measurements/common", "measurements/inputs", "tools"):
    sys.path.insert(0, str(HERE.parents[2] / folder))
import inspections  # noqa: E402
import results  # noqa: E402
import same_points  # noqa: E402

HEADER = ("spec", "outcome", "files", "different")
COUNT, PATIENCE_S = 2000, 900
OUTPUTS = {name: True for name in ("points_npz", "points_glb", "points_usda", "points_vdb", "points_vtp", "mesh", "mesh_usda", "orient",
                                   "convergence")}
# The C library then uses the versions of its functions for processors without these instructions.
WITHOUT_FMA = {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2"}
LIBRARY = "import hashlib, math; print(hashlib.sha256(repr([f(0.01 * k) for f in (math.sin, math.cos, math.exp) for k in range(10000)]).encode()).hexdigest())"


def library_differs():
    """Whether functions of the C library give other numbers without FMA here."""
    return len({subprocess.run([sys.executable, "-c", LIBRARY], env={**os.environ, **more}, capture_output=True, check=True).stdout
                for more in ({}, WITHOUT_FMA)}) > 1


def suggested(worker, data):
    """Name and spec of the first suggestion for each file."""
    for path in inspections.files_of(data, []):
        if "malformed" in path.parts:
            continue
        found, _ = inspections.inspect(worker, path)
        specs = [s["spec"] for s in found["suggestions"] if "spec" in s] if found else []
        if specs:
            yield str(path.relative_to(data)), {**specs[0], "sampling": {"count": COUNT}}


def run(worker, spec, out, portable):
    """Outcome or error, and the digests of the files and of parts of the report."""
    shutil.rmtree(out, ignore_errors=True)
    solver = {**spec["solver"], "isa": "portable"} if portable else spec["solver"]
    done = subprocess.run([worker, "run", "-", "--output", out], input=json.dumps({**spec, "solver": solver}), capture_output=True, text=True,
                          env={**os.environ, **(WITHOUT_FMA if portable else {})}, timeout=PATIENCE_S)
    if done.returncode not in (0, 10, 11):
        error = json.loads(done.stderr.splitlines()[-1])
        return error["code"], {"error": error["message"]}
    report = json.loads((out / "report.json").read_text())
    parts = {path.name: path.read_bytes() for path in out.iterdir() if path.is_file() and path.name not in ("report.json", "summary.json")}
    parts |= {name: json.dumps(report.get(name), sort_keys=True).encode() for name in ("surface", "quality", "warnings")}
    return report["outcome"], {name: hashlib.sha256(data).hexdigest() for name, data in parts.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True, type=os.path.abspath)
    parser.add_argument("--output", type=pathlib.Path)
    parser.add_argument("--data", type=pathlib.Path, default=os.environ.get("HEXAD_SHARED"))
    parser.add_argument("--only", nargs="*", default=[], help="specs whose names have these words")
    parser.add_argument("--resume", action="store_true")
    options = parser.parse_args()
    if not options.data:
        parser.error("give --data or set HEXAD_SHARED")
    if not library_differs():
        print("the C library gives the same numbers without FMA here: use a processor with FMA")
        return 2
    rows = [list(row.values()) for row in results.read(options.output)] if options.resume and options.output else []
    known = {row[0] for row in rows}
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        for generator in (same_points.jobs(options.data, work), suggested(options.worker, options.data)):
            for name, spec in generator:
                if name in known or not all(word in name for word in options.only):
                    continue
                spec = {"version": 1, **spec, "solver": {"seed": 1, "threads": 1, **spec.get("solver", {})},
                        "output": {**OUTPUTS, **spec.get("output", {}), "label_meshes": "labels" in spec["surface"]}}
                (outcome, first), (other, second) = (run(options.worker, spec, work / "out", portable) for portable in (False, True))
                unlike = [part for part in sorted(first.keys() | second.keys()) if first.get(part) != second.get(part)]
                rows.append([name, outcome if outcome == other else f"{outcome}, {other}", len(first), " ".join(unlike)])
                print(*rows[-1], sep=" | ", flush=True)
                if options.output:
                    results.write(options.output, HEADER, rows)
    return results.end(options.output, HEADER, rows, sum(bool(row[3]) for row in rows))


if __name__ == "__main__":
    sys.exit(main())
