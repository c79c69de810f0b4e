#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Growth of the instructions that parsing and checking a spec take with the length of its lists.

    tools/list_growth.py BUILD [--only MEMBER] [--elements N] [--jobs N]

Each list of the worker's schema is given 10 000 and 20 000 elements, or half of its limit and its limit if that is lower:
once with different elements that are right, and once with elements that are all wrong. fuzz/replay_spec of BUILD parses the
document, checks the spec and prints it, under callgrind. The instructions of a spec with two elements are subtracted. The
exit status is 1 if a list with twice the elements takes more than 2.5 times the instructions.
"""
import argparse
import concurrent.futures
import copy
import json
import math
import pathlib
import re
import subprocess
import sys
import tempfile

MOST = 2.5
BALL = {"analytic": {"shape": "sphere", "radius": 0.4}}
# the group of each list, where the least spec does not have it
GROUPS = {"/surface/labels": {"path": "a.nrrd"}, "/surface/transform": {"surface": BALL},
          "/output/preview": {}, "/queue": {"frames": "1-2"}}


def lists_of(of, pointer=""):
    """JSON Pointer and schema of each list whose length may vary, and of objects with members of any name."""
    for one in [of, *of.get("oneOf", [])]:
        if one.get("type") == "array" and one.get("minItems", 0) < one.get("maxItems", math.inf):
            yield pointer, one
        if isinstance(one.get("additionalProperties"), dict):
            yield pointer, one
        for name, member in one.get("properties", {}).items():
            yield from lists_of(member, f"{pointer}/{name}")


def right(pointer, of, k):
    """An element that differs from the others."""
    if "$ref" in of:
        return BALL
    if of.get("type") == "array":
        return [2 * k, 2 * k + 1]
    if "enum" in of:
        return of["enum"][k % len(of["enum"])]
    if of.get("type") == "object":
        return {"from": "surface", "name": f"n{k}"}
    return k if of.get("type") in ("integer", "number") else f"{k:026}"


def wrong(pointer, of, k):
    return [k, k] if of.get("type") == "array" else None


def spec_with(pointer, value):
    """The least spec with this list."""
    spec = {"version": 1, "surface": copy.deepcopy(BALL), "sampling": {"count": 10}}
    at, way = spec, ""
    *groups, last = pointer.split("/")[1:]
    if groups and groups[0] == "surface" or not groups and last == "surface":
        spec["surface"] = {}
    for name in groups:
        way += "/" + name
        at = at.setdefault(name, copy.deepcopy(GROUPS.get(way, {})))
    at[last] = value
    return spec


def rows(schema, long):
    """A name, and the value for a number of elements, with the two numbers: `long` for a list without a lower limit."""
    for pointer, of in lists_of(schema):
        most = min(long, of.get("maxItems", of.get("maxProperties", long)))
        sizes = (most // 2, most)
        if "items" not in of:
            yield f"{pointer} (members)", pointer, sizes, lambda n: {f"/sampling/m{k}": {"from": 1, "to": 2} for k in range(n)}
            continue
        for kind in (right, wrong):
            yield (f"{pointer} ({kind.__name__})", pointer, sizes,
                   lambda n, kind=kind, pointer=pointer, of=of: [kind(pointer, of["items"], k) for k in range(n)])
        if of["items"].get("type") == "array":
            yield f"{pointer} (one list)", pointer, (long // 2, long), lambda n: [list(range(n))]
            yield f"{pointer} (one list, all equal)", pointer, (long // 2, long), lambda n: [[7] * n]
    frames = ",".join(str(2 * k) for k in range(long))[:100000].rpartition(",")[0].split(",")
    yield "/queue/frames (text)", "/queue/frames", (len(frames) // 2, len(frames)), lambda n: ",".join(frames[:n])
    yield ("/queue/by_frame (values)", "/queue/by_frame", (min(5000, long // 2), min(10000, long)),
           lambda n: {"/solver/seed": list(range(n)), "/sampling/count": list(range(10, n + 10))})
    yield "/surface/exr/slices", "/surface/exr", (min(32768, 2 * long), min(65536, 4 * long)), lambda n: {"path": "a.####.exr", "slices": f"1-{n}", "isovalue": 1}
    for group in ("/unknown", "/sampling/unknown", "/solver"):
        yield f"{group} (unknown members)", group, (long // 2, long), lambda n: {f"/no/m{k}": 1 for k in range(n)}
    yield "/name (text)", "/name", (10 * long, 20 * long), lambda n: "x" * n
    yield "/queue/by_frame (too many members)", "/queue/by_frame", (long // 2, long), lambda n: {f"/sampling/m{k}": [1] for k in range(n)}
    yield "/region/inside/union (too many)", "/region/inside", (long // 2, long), lambda n: {"union": [BALL] * n}


def spec_of(pointer, value, n):
    """With n elements, and what depends on their number."""
    spec = spec_with(pointer, value(n))
    if pointer == "/surface/bspline/coefficients":
        spec["surface"]["bspline"]["dims"] = [max(4, n // 16), 4, 4]
    if pointer == "/queue/by_frame":
        spec["queue"]["frames"] = f"1-{n}"
    return spec


def instructions(build, spec, folder):
    path = pathlib.Path(tempfile.mkstemp(dir=folder, suffix=".json")[1])
    path.write_text(json.dumps(spec))
    done = subprocess.run(["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", build / "fuzz" / "replay_spec", path],
                          capture_output=True, text=True)
    found = re.search(r"Collected : (\d+)", done.stderr)
    if done.returncode or not found:
        sys.exit(f"replay_spec failed: {done.stderr[-2000:]}")
    return int(found[1])


def measure(build, row, folder):
    name, pointer, sizes, value = row
    least = instructions(build, spec_of(pointer, value, 2), folder)
    counts = [instructions(build, spec_of(pointer, value, n), folder) - least for n in sizes]
    return name, sizes, counts, counts[1] / counts[0]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--only", default="", help="lists whose JSON Pointer has this text")
    parser.add_argument("--elements", type=int, default=20000, help="of the longer list")
    parser.add_argument("--jobs", type=int, default=2)
    o = parser.parse_args()
    build = o.build.resolve()
    schema = json.loads(subprocess.run([build / "hexad-worker", "schema"], check=True, capture_output=True, text=True).stdout)
    print("| list | elements | million instructions | growth |\n|---|---|---|---|")
    worst = 0
    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor(o.jobs) as pool:
        for name, sizes, counts, growth in pool.map(lambda row: measure(build, row, folder),
                                                    [row for row in rows(schema, o.elements) if o.only in row[0]]):
            worst = max(worst, growth)
            print(f"| {name} | {sizes[0]}, {sizes[1]} | {counts[0] / 1e6:.2f}, {counts[1] / 1e6:.2f} | {growth:.2f} |", flush=True)
    print(f"\nThe largest growth is {worst:.2f}; at most {MOST} is allowed.")
    return worst > MOST


if __name__ == "__main__":
    sys.exit(main())
