#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints how many lines of each folder of src were executed, from the counts that a build with --coverage leaves.

    tools/coverage.py BUILD [--files FOLDER]

BUILD is a build directory; `make coverage` makes one. With --files each file of that folder has a line.
A file that several programs contain is counted once: a line is executed if one of them executed it.
"""
import argparse
import collections
import json
import os
import pathlib
import subprocess
import sys


def executed(build, source):
    """For each file of src, its lines and how often each was executed."""
    lines = collections.defaultdict(lambda: collections.defaultdict(int))
    notes = sorted(str(p.resolve()) for p in build.rglob("*.gcno"))
    for start in range(0, len(notes), 50):
        done = subprocess.run(["gcov", "--json-format", "--stdout", *notes[start:start + 50]], cwd=build,
                              capture_output=True, text=True, check=True)
        for document in map(json.loads, done.stdout.splitlines()):
            for file in document["files"]:
                path = pathlib.Path(os.path.normpath(build / document["current_working_directory"] / file["file"]))
                if not path.is_relative_to(source / "src"):
                    continue
                counts = lines[path.relative_to(source)]
                for line in file["lines"]:
                    counts[line["line_number"]] += line["count"]
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--files", metavar="FOLDER")
    options = parser.parse_args()
    source = pathlib.Path(__file__).resolve().parent.parent
    totals = collections.defaultdict(lambda: [0, 0])
    for path, counts in executed(options.build.resolve(), source).items():
        folder = str(path.parent)
        if options.files not in (None, folder, folder.removeprefix("src/")):
            continue
        for name in {str(path) if options.files else folder, "all"}:
            totals[name][0] += sum(count > 0 for count in counts.values())
            totals[name][1] += len(counts)
    if not totals:
        sys.exit(f"{options.build} has no counts: make coverage builds with --coverage and runs the tests")
    for name, (run, all_lines) in sorted(totals.items(), key=lambda item: (item[0] == "all", item[0])):
        print(f"{name:32} {run:6} of {all_lines:6} lines  {100 * run / max(all_lines, 1):5.1f} %")


if __name__ == "__main__":
    main()
