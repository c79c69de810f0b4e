#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Seeds of the fuzz target for specs: every two members of /surface in one spec, drawn from the worker's schema.

    fuzz/pairs.py WORKER DIRECTORY

Members of /surface exclude each other, so that each of these specs is refused; while it is read both are in memory. Each
pair is written several times: as the surface, as a part of a union, and as the inside of a region."""
import argparse
import itertools
import json
import pathlib
import random
import subprocess

import specs

DRAWS = 3  # of each pair: members that a schema does not require are drawn at random
STACK = {"path": "slices.####.exr", "slices": "1-65536"}  # the largest spec in memory


def surface(draw, kinds):
    """One surface with all of these members."""
    made = draw.surface_of(kinds, 0)
    for kind in {"exr", "labels"} & made.keys():
        made[kind].update(STACK)
    return made


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worker", type=pathlib.Path)
    parser.add_argument("directory", type=pathlib.Path)
    parser.add_argument("--seed", type=int, default=1)
    o = parser.parse_args()
    schema = json.loads(subprocess.run([o.worker, "schema"], check=True, capture_output=True, text=True).stdout)
    kinds = schema["properties"]["surface"]["properties"]
    draw = specs.Draw(schema, dict.fromkeys(kinds, ["a.vdb"]), random.Random(o.seed))
    o.directory.mkdir(parents=True, exist_ok=True)
    ball = {"analytic": {"shape": "sphere", "radius": 0.4}}
    for pair in itertools.combinations(kinds, 2):
        for k in range(DRAWS):
            both = surface(draw, pair)
            spec = {"version": 1, "surface": both, "sampling": {"count": 100}}
            if k == 1:
                spec["surface"] = {"union": [ball, both]}
            elif k == 2:
                spec.update(surface=ball, region={"inside": both})
            (o.directory / f"{'-'.join(pair)}.{k}.json").write_text(json.dumps(spec))


if __name__ == "__main__":
    main()
