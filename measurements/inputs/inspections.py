#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Inspects every file of a collection, runs one of the suggested specs unchanged, and writes what came of each.

    measurements/inputs/inspections.py --worker build/hexad-worker [--output FILE.csv] [--data DIRECTORY] [--only WORD ...]

Ends with 1 when a file is neither described nor its damage named, or when a suggested spec gives no points.
"""
import argparse
import json
import os
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import results  # noqa: E402

PATIENCE_S = 600
HEADER = ("file", "content", "suggested_spec", "good")
# What an inspection may end with: codes of errors that name what is wrong with a file (src/base/core/error.c).
OF_FILES = {"input_damaged", "input_unsupported", "input_missing", "no_surface", "limit_memory"}
FOLDERS = ("meshes", "vdb", "volumes", "exr", "malformed")
# Beside data files: their pages, and files that another one names.
OTHERS = {".md", ".raw", ".zraw", ".mtl", ".png", ".jpg"}


def files_of(data, words):
    for folder in FOLDERS:
        for path in sorted((data / folder).rglob("*")):
            slices = path.suffix[1:].isdigit()  # of a volume whose header names them
            if path.is_file() and path.suffix not in OTHERS and path.name != "SHA256SUMS" and not slices and \
                    all(word in str(path) for word in words):
                yield path


def last_words(done):
    try:
        return json.loads(done.stderr.splitlines()[-1])
    except (IndexError, ValueError):
        return {"code": "none", "message": f"exit status {done.returncode}"}


def inspect(worker, path):
    """The inspection, or the error."""
    done = subprocess.run([worker, "inspect", path, "--json"], capture_output=True, text=True, errors="replace",
                          timeout=PATIENCE_S)
    return (json.loads(done.stdout), None) if done.returncode == 0 else (None, last_words(done))


def run(worker, spec):
    """The report of a job, or the error."""
    with tempfile.TemporaryDirectory() as where:
        done = subprocess.run([worker, "run", "-", "--output", where], input=json.dumps(spec), capture_output=True,
                              text=True, errors="replace", timeout=PATIENCE_S)
        if done.returncode in (0, 10, 11):
            return json.loads((pathlib.Path(where) / "report.json").read_text()), None
        return None, last_words(done)


def describe(found):
    if "mesh" in found:
        m = found["mesh"]
        return f"{m['triangles']} triangles, {m['components']} parts, " + ("closed" if m["closed"] else "open")
    if "grids" in found:
        return ", ".join(f"{g['name'] or '(unnamed)'} {g['type']} {g['class']}" for g in found["grids"]) or "no grid"
    if "volume" in found:
        return f"{found['volume']['type']} {found['volume']['size']} {found['volume']['range']}"
    return f"{len(found['channels'])} channels, {found['images']} images"


def row(worker, path):
    """What the file has, what came of the suggested spec, and whether both are as they should be."""
    found, fault = inspect(worker, path)
    if fault:
        return f"`{fault['code']}`: {fault['message']}", "", fault["code"] in OF_FILES
    with_spec = [s for s in found["suggestions"] if "spec" in s]
    if not with_spec:
        why = "; ".join(s["error"]["message"] for s in found["suggestions"]) or "no surface"
        return describe(found), why, True
    best = next((s for s in with_spec if s["measured"]), with_spec[0])
    report, fault = run(worker, best["spec"])
    if fault:
        return describe(found), f"`{fault['code']}`: {fault['message']}", False
    told = f"{100 * report['quality']['thin_count'] / report['count']:.0f} % on thin walls"
    return describe(found), f"{report['count']} points, {report['outcome']}, {told}", report["count"] > 0


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True)
    parser.add_argument("--data", type=pathlib.Path, default=os.environ.get("HEXAD_SHARED"))
    parser.add_argument("--output")
    parser.add_argument("--only", nargs="*", default=[], help="files whose paths have these words")
    options = parser.parse_args()
    if not options.data:
        parser.error("--data or HEXAD_SHARED names the collection")
    rows = []
    for path in files_of(pathlib.Path(options.data), options.only):
        content, came, good = row(options.worker, path)
        cells = [str(path.relative_to(options.data)), content, came, "yes" if good else "no"]
        rows.append(["".join(c if c.isprintable() else "?" for c in cell) for cell in cells])
        print(*rows[-1], sep=" | ", flush=True)
        if options.output:
            results.write(options.output, HEADER, rows)
    wrong = sum(good == "no" for *_, good in rows)
    print(f"{len(rows)} files, {wrong} of them wrong")
    return wrong > 0


if __name__ == "__main__":
    sys.exit(main())
