#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs this sampler and its peers on the same surfaces, and writes what each took and how good its packing is.

    measurements/speed/bench.py --built BUILD [--output FOLDER] [--surfaces torus,sphere] [--counts 1e3,1e5]
                                [--tools hexad,teem,vtk] [--runs 5] [--budget SECONDS] [--continue]

One run on one machine. Writes results.json, and from it samplers.csv, comparison.csv, bounds.csv and kernels.csv, to FOLDER
(measurements/speed); prints the bounds that are missed. What is not given is everything; a peer whose package is not installed is left out.
--budget: what all runs of one case may take. A case of which one run is expected to take more, by the count before it, is left out; where
more runs do not fit, fewer than --runs are made. --continue: adds to the rows of the same build on the same machine that are there.
HEXAD_SHARED: directory of the data from outside. HEXAD_GEOGRAM, HEXAD_ACVD: the executables vorpalite and ACVD.
"""
import argparse
import datetime
import hashlib
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

import prepared_inputs
import packing
import samplers
import tables
from prepared_inputs import Absent
from samplers import Failed

HERE = pathlib.Path(__file__).resolve().parent
ALL = (samplers.Hexad(), *samplers.PEERS)
COUNTS = [10 ** 3, 10 ** 4, 10 ** 5, 10 ** 6, 10 ** 7]
# Cases that only claims about this sampler need: counts of surfaces that are not held against others, and threads.
OURS = {"ellipsoid-even": [10 ** 5], "torus-formula": [10 ** 6], "quartic-formula": [10 ** 3]}
THREADS = {("torus", 10 ** 6): [2, 3, 8]}
# Points up to which each run is measured; beyond, the first.
MEASURED = 10 ** 5
# Seconds of a run that do not grow with the count, as far as foretelling goes: modules and volumes are loaded.
START_UP_S = 2.0
# A run longer than foretold is stopped at this many times the budget.
PATIENCE = 1.5


def median_row(runs):
    """Medians of what was measured; of what is no number, the first run's."""
    row = {}
    for name in runs[0]:
        values = [r[name] for r in runs if name in r]
        row[name] = statistics.median(values) if isinstance(values[0], float) else values[0]
    return row


def one_run(sampler, surface, count, seed, limit, options, where):
    places, took = sampler.run(surface, count, seed, limit, options.built, where)
    row = {"got": len(places), **{k: took[k] for k in ("cpu_s", "wall_s", "peak_mb")}}
    if "told" in took:
        busy = min(1.0, took["cpu_s"] / took["wall_s"])
        row.update({"relax_s": float(took["told"]["relax"]), "total_s": float(took["told"]["total"]),
                    "relax_cpu_s": float(took["told"]["relax"] * busy), "outcome": took["outcome"],
                    "isa": took["isa"], "sha256": took["sha256"]})
    if count <= MEASURED or seed == 1:
        row.update(packing.of(surface, places, took.get("requested")))
    return row


def run_case(sampler, surface, count, foretold, options, where):
    """The row of one case; raises Failed where it has none."""
    if foretold > options.budget:
        raise Failed(f"left out: foretold to take {foretold:.0f} s")
    runs, spent = [], 0.0
    while len(runs) < options.runs and (not runs or spent + runs[-1]["wall_s"] <= options.budget):
        runs.append(one_run(sampler, surface, count, 1 + len(runs), PATIENCE * options.budget, options, where))
        spent += runs[-1]["wall_s"]
    times = [r["cpu_s"] for r in runs]
    return {**median_row(runs), "cpu_s_least": min(times), "cpu_s_most": max(times), "runs": len(runs)}


def cases_of(surface_name, options, tools):
    """(sampler, count), a sampler's counts ascending."""
    for count in OURS.get(surface_name, COUNTS):
        if count not in options.counts:
            continue
        for sampler in tools:
            yield sampler, count
            if sampler.name == "hexad":
                for threads in THREADS.get((surface_name, count), []):
                    yield samplers.Hexad(threads), count


def run_surface(surface, options, tools, results, where):
    before, failed = {}, {}
    for sampler, count in cases_of(surface.name, options, tools):
        if not sampler.accepts(surface, count):
            continue
        who = sampler.name, sampler.threads
        # what took long at one count takes at least so much longer at the next
        last_count, last_s = before.get(who, (count, 0.0))
        try:
            if who in failed:
                raise Failed(f"left out, as {failed[who]} points are")
            foretold = max(last_s - START_UP_S, 0) * count / last_count
            row = run_case(sampler, surface, count, foretold, options, where)
            before[who] = count, row["wall_s"]
        except Failed as why:
            row = {"missing": str(why)}
            failed.setdefault(who, count)
        results.add({"tool": sampler.name, "surface": surface.name, "asked": count, "threads": sampler.threads, **row})
        print(tables.console_line(results.rows[-1]), flush=True)


class Results:
    """The rows of one run, kept in a file after each."""

    def __init__(self, options):
        self.path, self.rows, self.surfaces, self.peers = options.output / "results.json", [], {}, {}
        self.run = {"id": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%MZ"),
                    "cpu": cpu_model(), "cores": len(os.sched_getaffinity(0)),
                    "worker": hashlib.sha256((options.built / "hexad-worker").read_bytes()).hexdigest()}
        if options.go_on and self.path.exists():
            told = json.loads(self.path.read_text(encoding="utf-8"))
            if any(told["run"][k] != self.run[k] for k in ("cpu", "cores", "worker")):
                raise SystemExit(f"{self.path} is of another build or machine: it cannot be continued")
            self.run, self.rows, self.surfaces = told["run"], told["rows"], told["surfaces"]
        if "kernels" not in self.run:
            self.run["kernels"] = kernels(options.built)

    def add(self, row):
        same = ("tool", "surface", "asked", "threads")
        self.rows = [r for r in self.rows if any(r[k] != row[k] for k in same)] + [{"run": self.run["id"], **row}]
        ours = {(r["surface"], r["asked"]): r["cpu_s"] for r in self.rows
                if r["tool"] == "hexad" and r["threads"] == 1 and "cpu_s" in r}
        for r in self.rows:
            if "cpu_s" in r and (r["surface"], r["asked"]) in ours:
                r["cpu_to_ours"] = r["cpu_s"] / ours[r["surface"], r["asked"]]
        self.write()

    def write(self):
        text = json.dumps({"run": self.run, "peers": self.peers, "surfaces": self.surfaces,
                           "rows": [{k: rounded(v) for k, v in r.items()} for r in self.rows]}, indent=1)
        self.path.write_text(text + "\n", encoding="utf-8")


def kernels(built):
    """The rows of measurements/speed/kernels (make bench-kernels); none where it was not built."""
    program = built / "measurements/speed/kernels"
    if not program.exists():
        return []
    printed = subprocess.run([program], stdout=subprocess.PIPE, text=True, check=True).stdout
    rows = [line.strip("| \n").split(" | ") for line in printed.splitlines()[2:]]
    names = ("field", "isa", "ns", "list_ns", "neighbours", "operations", "bytes", "floor_ns")
    return [{n: v if n in names[:2] else float(v) for n, v in zip(names, row)} for row in rows]


def rounded(value):
    return float(f"{value:.5g}") if isinstance(value, float) else value


def cpu_model():
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        return next((line.split(":")[1].strip() for line in file if line.startswith("model name")), "unknown")


def is_among(sampler, names):
    return not names or any(sampler.name.startswith(n) for n in names)


def chosen_tools(names, built, results):
    """The samplers that are there; of the others `results` tells why not."""
    found = []
    for sampler in ALL:
        try:
            version = sampler.version(built)
        except Absent as why:
            version = str(why)
        else:
            if is_among(sampler, names):
                found.append(sampler)
        results.peers[sampler.name] = {"title": sampler.title, "package": sampler.package, "version": version}
    return found


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--built", required=True, type=lambda p: pathlib.Path(p).resolve())
    parser.add_argument("--output", default=HERE, type=pathlib.Path)
    words = lambda text: text.split(",")  # noqa: E731
    parser.add_argument("--surfaces", default=list(prepared_inputs.SURFACES), type=words)
    parser.add_argument("--counts", default=COUNTS, type=lambda text: [int(float(n)) for n in words(text)])
    parser.add_argument("--tools", default=[], type=words, help="names or what they begin with")
    parser.add_argument("--runs", default=5, type=int)
    parser.add_argument("--budget", default=300.0, type=float)
    parser.add_argument("--continue", dest="go_on", action="store_true")
    options = parser.parse_args()
    for name in set(options.surfaces) - set(prepared_inputs.SURFACES):
        parser.error(f"there is no surface {name}, only {', '.join(prepared_inputs.SURFACES)}")
    for count in set(options.counts) - set(COUNTS):
        parser.error(f"there is no count {count}, only {', '.join(map(str, COUNTS))}")
    for name in options.tools:
        if not any(is_among(sampler, [name]) for sampler in ALL):
            parser.error(f"there is no tool {name}, only {', '.join(s.name for s in ALL)}")
    shared = os.environ.get("HEXAD_SHARED")
    options.shared = pathlib.Path(shared) if shared else HERE.parents[2] / "shared" / "data"
    return options


def main():
    options = arguments()
    results = Results(options)
    tools = chosen_tools(options.tools, options.built, results)
    print(tables.console_head(), flush=True)
    for name in options.surfaces:
        with tempfile.TemporaryDirectory() as where:
            try:
                surface = prepared_inputs.Input(name, options.shared, pathlib.Path(where))
            except Absent as why:
                results.surfaces[name] = {"missing": str(why)}
                print(f"{name}: {why}", file=sys.stderr)
                continue
            results.surfaces[name] = {"area": surface.area, "graded": surface.graded}
            run_surface(surface, options, tools, results, pathlib.Path(where))
    results.write()
    told = json.loads(results.path.read_text(encoding="utf-8"))
    tables.write(options.output, told)
    print(tables.summary(told))


if __name__ == "__main__":
    main()
