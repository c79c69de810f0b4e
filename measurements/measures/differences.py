#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Summarises how far the measures of reports differ from those of other programs: brute_measures.csv and meshes.csv.

    measurements/measures/differences.py [--output measurements/measures/differences.csv]

A row for each measure of each set of jobs: the median and the largest difference, the job with the largest one, and how many jobs differ by more
than the bound of brute_measures.py.
"""
import argparse
import pathlib
import statistics
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "common"))
import brute_measures  # noqa: E402
import results  # noqa: E402

HEADER = ["row", "jobs", "bound", "jobs_beyond_bound", "difference_median", "difference_largest", "job_of_largest"]


def jobs():
    """(name of a set, its rows)."""
    meshes = results.read(HERE / "meshes.csv")
    yield "formulas, volumes and segmentations", results.read(HERE / "brute_measures.csv")
    for name, chosen in (("meshes, 10 points", lambda n: n == 10), ("meshes, 200 to 10 000 points", lambda n: 200 <= n <= 10000),
                         ("meshes, 50 000 points", lambda n: n == 50000)):
        yield name, [row for row in meshes if chosen(int(row["points"]))]


def summary(name, measure, rows):
    def bound_of(row):
        few = measure == "hex_fraction" and int(row["points"]) < brute_measures.FEW
        return brute_measures.ALLOWED_OF_FEW if few else brute_measures.ALLOWED[measure]
    apart = [abs(float(row[f"{measure}_report"]) - float(row[f"{measure}_program"])) for row in rows]
    largest = max(range(len(rows)), key=apart.__getitem__)
    beyond = sum(a > bound_of(row) + 1e-9 for a, row in zip(apart, rows))
    return [f"{measure}: {name}", len(rows), max(map(bound_of, rows)), beyond, f"{statistics.median(apart):.2g}", f"{apart[largest]:.2g}",
            next(iter(rows[largest].values())) if apart[largest] else None]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=pathlib.Path, default=HERE / "differences.csv")
    options = parser.parse_args()
    found = [summary(name, measure, rows) for name, rows in jobs() for measure in brute_measures.ALLOWED if f"{measure}_report" in rows[0]]
    results.write(options.output, HEADER, found)
    for row in found:
        print(", ".join(f"{key} {value}" for key, value in zip(HEADER, row) if value is not None))


if __name__ == "__main__":
    main()
