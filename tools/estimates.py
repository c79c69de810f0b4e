#!/usr/bin/env python3
"""Holds the memory that the worker says a job would take against what the job takes (doc/measured/estimates.md).

    tools/estimates.py --worker build/hexad-worker --output doc/measured/estimates.md [--data DIRECTORY] [--only WORD ...]
                       [--counts 1000 30000]

DIRECTORY, or HEXAD_SHARED, has the folders meshes, vdb and volumes. Both runs are of the same spec, each a process of its own.
Ends with 1 when an estimate is below the job's peak by more than a tenth, or above it by more than a half.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

# Of all surfaces, and of one of each kind besides.
COUNTS, LARGE = (1000, 30000), 1000000
OF_LARGE = {"torus", "vdb/ls_sphere_half.vdb", "meshes/spot.obj"}
LEAST, MOST = 0.9, 1.5
# The worker's exit codes of results.
RESULTS = (0, 10, 11)
TORUS = {"shape": "torus", "center": [0, 0, 0], "axis": [0, 0, 1], "major_radius": 1, "minor_radius": 0.3}


def surfaces(data):
    """Names and members of surfaces: of each way into the sampler a small and a large one."""
    def of(kind, path, **more):
        return path, {kind: {"path": str(data / path), **more}}
    return dict([("torus", {"analytic": TORUS}),
                 of("vdb", "vdb/ls_sphere_half.vdb"), of("vdb", "vdb/ls_cube_half.vdb"),
                 of("vdb", "vdb/vpt_dragon_fog.vdb", isovalue=0.5),
                 of("vdb", "vdb/wdas_cloud_sixteenth.vdb", isovalue=0.1),
                 of("mesh", "meshes/spot.obj"), of("mesh", "meshes/cup.obj"), of("mesh", "meshes/dragon_100k.obj"),
                 of("mesh", "meshes/fandisk.off"), of("mesh", "meshes/plane_holes.obj"),
                 of("volume", "volumes/HeadMRVolume.mhd", isovalue=30), of("volume", "volumes/tooth.nhdr", isovalue=900)])


def call(worker, command, spec, where):
    """What the worker's command left in a file of JSON, or None and the last line of what it said."""
    (where / "spec.json").write_text(json.dumps(spec))
    done = subprocess.run([worker, command, where / "spec.json", "--output", where / command], text=True,
                          capture_output=True)
    if done.returncode not in RESULTS:
        return None, done.stderr.splitlines()[-1]
    return json.loads((where / command / {"run": "report.json", "estimate": "estimate.json"}[command]).read_text()), None


def row(worker, name, surface, count, where):
    """(cells of the table, whether the estimate is near)."""
    spec = {"version": 1, "surface": surface, "sampling": {"count": count}, "output": {"preview": False}}
    told, failed = call(worker, "estimate", spec, where)
    found, failed = call(worker, "run", spec, where) if told else (None, failed)
    if failed:
        return [name, f"{count}", "", "", failed], False
    ratio = told["memory_bytes"] / found["peak_memory_bytes"]
    return [name, f"{count}", f"{told['memory_bytes'] / 2 ** 20:.0f}", f"{found['peak_memory_bytes'] / 2 ** 20:.0f}",
            f"{ratio:.2f}"], LEAST <= ratio <= MOST


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worker", required=True)
    parser.add_argument("--data", type=pathlib.Path, default=os.environ.get("HEXAD_SHARED"))
    parser.add_argument("--only", nargs="*", default=[""])
    parser.add_argument("--counts", nargs="*", type=int, default=COUNTS)
    parser.add_argument("--output", type=pathlib.Path, required=True)
    words = parser.parse_args()
    if not words.data:
        parser.error("give --data or set HEXAD_SHARED")
    lines, sound = [], True
    for name, surface in surfaces(pathlib.Path(words.data)).items():
        if not any(word in name for word in words.only):
            continue
        for count in (*words.counts, *([LARGE] if name in OF_LARGE else [])):
            with tempfile.TemporaryDirectory() as where:
                cells, near = row(words.worker, name, surface, count, pathlib.Path(where))
            sound = sound and near
            lines.append("| " + " | ".join(cells) + " |")
            print(lines[-1], flush=True)
    words.output.write_text("# What estimates say of memory, and what jobs take\n\n"
                            "Made by `tools/estimates.py`. Memory in MiB, of the worker and of its reader.\n\n"
                            "| surface | points | estimate | peak | ratio |\n|---|---|---|---|---|\n" + "\n".join(lines) + "\n")
    return 0 if sound else 1


if __name__ == "__main__":
    sys.exit(main())
