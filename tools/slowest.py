#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints which tests took longest in the last test run of a build directory.

    tools/slowest.py BUILD [--count N]

The first table has one row for each test program or test file: wall time, and CPU time of it and all its descendants
(tests/contain prints both). The second table has the wall time of single pytest tests, set-up and clean-up included.
Tests run side by side, so that wall times depend on what else ran.
"""
import argparse
import pathlib
import re

PROGRAM = re.compile(r"^# time: (\d+\.\d+) s wall, (\d+\.\d+) s CPU$", re.M)
TEST = re.compile(r"^# (\d+\.\d+) s in (.*)$", re.M)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--count", type=int, default=20, help="rows of each table [%(default)s]")
    options = parser.parse_args()
    programs, tests = [], []
    for log in sorted((options.build / "tests").rglob("*.log")):
        text = log.read_text(errors="replace")
        times = PROGRAM.findall(text)
        if times:
            wall, cpu = map(float, times[-1])
            programs.append((wall, cpu, str(log.relative_to(options.build).with_suffix(""))))
        tests += [(float(seconds), name) for seconds, name in TEST.findall(text)]
    print(f"{len(programs)} programs and files: {sum(row[1] for row in programs):.0f} s CPU")
    print(f"{'wall (s)':>9} {'CPU (s)':>9}  program or file")
    for wall, cpu, name in sorted(programs, key=lambda row: -row[1])[:options.count]:
        print(f"{wall:9.2f} {cpu:9.2f}  {name}")
    print(f"{'wall (s)':>9}  test")
    for seconds, name in sorted(tests, reverse=True)[:options.count]:
        print(f"{seconds:9.2f}  {name}")


if __name__ == "__main__":
    main()
