#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Random specs, run by the worker (measurements/reliability/README.md).

Specs are drawn from the worker's own schema (`hexad-worker schema`), so that new parameters are tried as soon as there are
any, and lose the members for which they are refused. Files are a few that are written here and, where HEXAD_SHARED names
it, the shared data. What is held of each:

- the worker ends by itself, with an exit code that has a meaning, and an error has a stable code that is not `internal`;
- it keeps to its memory; what takes longer than --cpu-seconds, as what asks for millions of points may, is ended, and
  its spec is left as slow.*;
- a result is whole: its report has no number that is not finite, and as many points as points.ply; what has failed leaves no
  report;
- the same spec gives the same bytes with another number of threads.

A spec that breaks one is left in DIRECTORY with what the worker said, and runs again by `hexad-worker run`. How many ended in
which way is printed at last; the exit status is 1 where anything broke.

--wrong gives --runs specs whose members have wrong values, alone and in pairs (wrong_values.py), to one of:

- `lines`: the fuzz target for specs, all in one process (--program fuzz/lines_spec), which a sanitized build checks best;
- `worker`: `hexad-worker run`, each in a process of its own; what was accepted runs for a second at most;
- `service`: POST /v1/jobs:validate of the service beside the worker, by one client whose token has the scope read. No answer
  may have a status 5xx or take more than 50 CPU ms of the service.
"""
import argparse
import collections
import itertools
import json
import math
import os
import pathlib
import random
import resource
import shutil
import signal
import struct
import subprocess
import sys
import time

import wrong_values

ENDS = {0: "converged", 10: "not_converged", 11: "unresolved"}
ERRORS = {2, 3, 4, 5, 7}
# beyond limits.memory_mb: the program itself, and what its readers and the sanitizers take
MEMORY_MORE = 1.15
FILE_MOST = 40e6
# members that a worker on its own does not read, or that name places
LEFT_OUT = {"queue", "name", "directory", "limits", "timeout_s"}
# how often a member is there that need not be
OFTEN = {"sampling": 1, "solver": 0.8, "output": 0.6, "preview": 0.3, "mesh": 0.3, "region": 0.12, "attributes": 0.05,
         "isovalue": 0.6, "threads": 0}
TARGETS = {"count": 14, "spacing": 3, "density": 1, "control": 2, "resolve": 3}
SURFACES = {"analytic": 6, "mesh": 6, "vdb": 5, "volume": 2, "labels": 2, "bspline": 1, "union": 1, "intersection": 1,
            "difference": 1, "offset": 1, "transform": 1}
# how often a surface has a second member, which is refused: both are read before
TWO = 0.05
NAMES = ["density", "surface", "ls_sphere", "distance"]
NESTED = {"union", "intersection", "difference", "offset", "transform"}


def write_files(folder, worker):
    """A few small files, so that nothing else is needed."""
    folder.mkdir(parents=True, exist_ok=True)
    subprocess.run([worker, "make-example", folder / "example.vdb"], check=True, stdout=subprocess.DEVNULL)
    corners = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    for name, scale, left_out in (("cube", (1, 1, 1), 0), ("sheet", (1, 1, 0.01), 0), ("open", (1, 0.7, 0.3), 2)):
        lines = ["v %g %g %g" % tuple(c * s for c, s in zip(corner, scale)) for corner in corners]
        lines += ["f " + " ".join(str(i + 1) for i in face) for face in faces[left_out:]]
        (folder / f"{name}.obj").write_text("\n".join(lines) + "\n")
    n = 24
    values = bytearray()
    for z in range(n):
        for y in range(n):
            for x in range(n):
                values.append((math.dist((x, y, z), (9, 9, 11)) < 7) + 2 * (math.dist((x, y, z), (16, 13, 12)) < 5))
    header = f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: {n} {n} {n}\nencoding: raw\n\n"
    (folder / "labels.nrrd").write_bytes(header.encode() + values)


def files_of(folders):
    """By what reads them."""
    kinds = {"vdb": (".vdb",), "mesh": (".obj", ".ply", ".stl", ".off"), "volume": (".nrrd", ".nhdr", ".nii", ".mhd"),
             "labels": (".nrrd", ".nhdr", ".mhd"), "bspline": (".json", ".nrrd")}
    every = sorted(path for folder in folders for path in folder.rglob("*")
                   if path.is_file() and path.stat().st_size < FILE_MOST)
    return {kind: [str(path) for path in every if path.suffix in ends] for kind, ends in kinds.items()}


class Draw:
    """A value that a schema allows."""

    def __init__(self, schema, files, rng, often=OFTEN, left_out=LEFT_OUT, texts=None):
        self.schema, self.files, self.rng = schema, files, rng
        self.often, self.left_out, self.texts = often, left_out, texts or {}

    def chosen(self, weights):
        names = list(weights)
        return self.rng.choices(names, [weights[name] for name in names])[0]

    def number(self, of):
        low, high = of.get("minimum", of.get("exclusiveMinimum", -1e3)), of.get("maximum", 1e3)
        pick = self.rng.random()
        if pick < 0.03:
            return low if "minimum" in of else high
        if pick < 0.06:
            return high
        default = of.get("default")
        if pick < 0.4 and isinstance(default, (int, float)) and default:
            value = default * 2 ** self.rng.uniform(-3, 3)
        elif low < 0 and self.rng.random() < 0.5:
            value = self.rng.uniform(-1, 1)
        else:
            value = 10 ** self.rng.uniform(-3, 1)
        return min(max(float(f"{value:.3g}"), low), high) or low + 1e-3

    def integer(self, of):
        low, high = of.get("minimum", -100), of.get("maximum", 1000)
        if self.rng.random() < 0.03:
            return low
        return min(max(low, round(10 ** self.rng.uniform(0, 3.3))), high)

    def members(self, of, kind, depth):
        all_of, required = of["properties"], of.get("required", [])
        out = {}
        for name, member in all_of.items():
            if name in self.left_out or (name not in required and self.rng.random() >= self.often.get(name, 0.12)):
                continue
            out[name] = self.value(member, name if kind is None else kind, name, depth)
        for rule in of.get("allOf", []):
            both = rule.get("not", {}).get("required", [])
            if both and all(name in out for name in both):
                del out[self.rng.choice(both)]
        return out

    def surface(self, depth):
        weights = {name: weight for name, weight in SURFACES.items() if depth < 2 or name not in NESTED}
        kinds = [self.chosen(weights) for _ in range(1 + (self.rng.random() < TWO))]
        return self.surface_of(kinds, depth)

    def surface_of(self, kinds, depth):
        of = self.schema["properties"]["surface"]["properties"]
        return {kind: self.value(of[kind], kind, kind, depth + 1) for kind in kinds}

    def sampling(self, of, depth):
        wanted = self.chosen(TARGETS)
        rest = dict(of, properties={k: v for k, v in of["properties"].items() if k not in TARGETS})
        value = True if wanted == "resolve" else self.value(of["properties"][wanted], "sampling", wanted, depth)
        return {wanted: value, **self.members(rest, "sampling", depth)}

    def matrix(self):
        angle, size = self.rng.uniform(0, 3), self.rng.choice([1, 1, 0.1, 20])
        c, s = size * math.cos(angle), size * math.sin(angle)
        return [c, -s, 0, self.rng.uniform(-1, 1), s, c, 0, 0, 0, 0, size, 0, 0, 0, 0, 1]

    def value(self, of, kind, name, depth=0):
        if of.get("$ref") == "#/properties/surface" or of is self.schema["properties"]["surface"]:
            return self.surface(depth)
        if name == "sampling":
            return self.sampling(of, depth)
        if name == "matrix":
            return self.matrix()
        if name == "path":
            return self.rng.choice(self.files.get(kind, self.files["vdb"]))
        if name in self.texts and of.get("type") == "string":
            return self.rng.choice(self.texts[name])
        if "oneOf" in of:
            return self.value(self.rng.choice(of["oneOf"]), kind, name, depth)
        if "const" in of:
            return of["const"]
        if "enum" in of:
            return self.rng.choice(of["enum"])
        kinds = {"object": lambda: self.members(of, kind, depth) if "properties" in of else {},
                 "array": lambda: [self.value(of["items"], kind, name, depth)
                                   for _ in range(of.get("minItems", self.rng.randint(1, 3)))],
                 "number": lambda: self.number(of), "integer": lambda: self.integer(of),
                 "boolean": lambda: self.rng.random() < 0.5, "string": lambda: self.rng.choice(NAMES)}
        return kinds[of["type"]]()

    def spec(self):
        return self.members(self.schema, None, 0)


def run(worker, spec, output, limits, threads):
    """What became of it: exit code, standard error, MB."""
    shutil.rmtree(output, ignore_errors=True)

    def bound():
        resource.setrlimit(resource.RLIMIT_CPU, (limits.cpu_seconds, limits.cpu_seconds + 5))

    log = output.with_suffix(".log")
    with open(log, "w") as said:
        process = subprocess.Popen([worker, "run", "-", "--output", output, "--memory-mb", str(limits.memory_mb),
                                    "--threads", str(threads)], stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=said,
                                   preexec_fn=bound, text=True)
        process.stdin.write(json.dumps(spec))
        process.stdin.close()
        _, status, used = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, log.read_text(errors="replace"), used.ru_maxrss / 1024


def code_of(said):
    for line in reversed(said.splitlines()):
        if line.startswith("{"):
            return json.loads(line).get("code")
    return None


def without_refused(spec, said):
    """The spec without the members that a refusal names, or None where one of them has to be there."""
    last = json.loads(said.strip().splitlines()[-1])
    dropped = False
    for refused in last.get("errors", []):
        *way, name = refused["pointer"].split("/")[1:] or [""]
        at = spec
        for step in way:
            at = at[int(step)] if isinstance(at, list) else at.get(step) if isinstance(at, dict) else None
        if isinstance(at, dict) and name in at and name not in ("surface", "sampling", *SURFACES):
            del at[name]
            dropped = True
    return spec if dropped else None


def numbers_of(value):
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list):
        for one in value:
            yield from numbers_of(one)
    elif isinstance(value, float):
        yield value


def points_of(path):
    """Their number and places, of a PLY file of either format."""
    with open(path, "rb") as f:
        head = b""
        while not head.endswith(b"end_header\n"):
            line = f.readline()
            if not line:
                return 0, []
            head += line
        lines = head.decode().splitlines()
        count = next(int(l.split()[2]) for l in lines if l.startswith("element vertex"))
        kinds = []
        for line in lines[lines.index(f"element vertex {count}") + 1:]:
            if not line.startswith("property"):
                break
            kinds.append(line.split()[1])
        if "ascii" in lines[1]:
            return count, [tuple(map(float, f.readline().split()[:3])) for _ in range(count)]
        form = "<" + "".join({"float": "f", "double": "d", "uchar": "B", "uint": "I", "int": "i", "ushort": "H", "short": "h",
                              "char": "b"}[kind] for kind in kinds)
        data = f.read(count * struct.calcsize(form))
        return count, [row[:3] for row in struct.iter_unpack(form, data)]


def fault_of(output, code, said):
    """What is wrong with a run's end, or None."""
    if "Sanitizer" in said or "runtime error" in said:
        return "a sanitizer's word"
    if code in ENDS:
        report = json.loads((output / "report.json").read_text())
        if not all(math.isfinite(value) for value in numbers_of(report)):
            return "a number of the report is not finite"
        count, places = points_of(output / "points.ply")
        if count != report["count"] or len(places) != count:
            return f"{report['count']} points of the report are {len(places)} in points.ply"
        if not all(math.isfinite(x) for place in places for x in place):
            return "a place is not finite"
        return None
    if code not in ERRORS:
        return f"exit status {code}"
    if code_of(said) in (None, "internal"):
        return f"error code {code_of(said)}"
    if (output / "report.json").exists():
        return "a report of a run that failed"
    return None


def judge(worker, spec, folder, limits):
    """How it ended, and what broke, or None. `spec` loses what is refused, as long as that helps."""
    first = folder / "first"
    code, said, memory = run(worker, spec, first, limits, 1)
    while code == 2 and code_of(said) == "spec_invalid" and without_refused(spec, said):
        code, said, memory = run(worker, spec, first, limits, 1)
    if code == -signal.SIGXCPU:
        return "slow", None, said
    end = ENDS.get(code) or code_of(said)
    fault = fault_of(first, code, said)
    if not fault and memory > limits.memory_mb * MEMORY_MORE + 64:
        fault = f"{memory:.0f} MB of {limits.memory_mb}"
    if not fault and code in ENDS:
        again, said_again, _ = run(worker, spec, folder / "second", limits, 3)
        if again == -signal.SIGXCPU:
            return "slow", None, said_again
        if again != code:
            fault = f"with 3 threads exit status {again}: {said_again[-300:]}"
        elif (first / "points.ply").read_bytes() != (folder / "second" / "points.ply").read_bytes():
            fault = "other bytes with 3 threads"
    return end, fault, said


def wrong_places(schema):
    """The JSON Pointers of all members that get wrong values."""
    places = wrong_values.Specs(Draw(schema, {}, random.Random(0)), TARGETS).places
    return {"".join(f"/{step}" for step in place) for place in places}


def wrong_specs(schema, seed):
    """The same sequence for the same seed."""
    files = dict.fromkeys([*schema["properties"]["surface"]["properties"], "grid", "points"], wrong_values.FILES)
    draw = Draw(schema, files, random.Random(seed), wrong_values.OFTEN, set(), wrong_values.TEXTS)
    return iter(wrong_values.Specs(draw, TARGETS))


def wrong_through_worker(worker, specs, runs, folder, limits):
    """How many broke something."""
    broken, ends = 0, collections.Counter()
    for number, spec in enumerate(itertools.islice(specs, runs), 1):
        code, said, _ = run(worker, spec, folder / "first", limits, 1)
        slow = code == -signal.SIGXCPU
        fault = None if slow else fault_of(folder / "first", code, said)
        ends["slow" if slow else ENDS.get(code) or code_of(said)] += 1
        if fault:
            broken += 1
            (folder / f"broken.{number}.json").write_text(json.dumps(spec))
            (folder / f"broken.{number}.txt").write_text(f"{fault}\n{said}")
            print(f"{number}: {fault}", flush=True)
    print(", ".join(f"{count} {end}" for end, count in ends.most_common()))
    return broken


def wrong_through_lines(program, schema, o, folder):
    code, told, number = wrong_values.through_lines(program, wrong_specs(schema, o.seed), o.runs, folder / "lines.log")
    if code == 0:
        print(told)
        return 0
    print(f"exit status {code} at spec {number}: see lines.log")
    if number:
        spec = next(itertools.islice(wrong_specs(schema, o.seed), number - 1, None))
        (folder / f"broken.{number}.json").write_text(json.dumps(spec))
    return 1


def give_wrong(o, folder, worker, schema):
    """The exit status of --wrong."""
    specs = wrong_specs(schema, o.seed)
    if o.wrong == "lines":
        broken = wrong_through_lines(o.program.resolve(), schema, o, folder)
    elif o.wrong == "worker":
        o.cpu_seconds = 1
        broken = wrong_through_worker(worker, specs, o.runs, folder, o)
    else:
        with wrong_values.Service(worker.parent, folder) as service:
            broken = wrong_values.through_service(service, specs, o.runs,
                                                  lambda name, spec: (folder / f"{name}.json").write_text(json.dumps(spec)))
    print(f"{broken} of {o.runs} specs with wrong values broke something")
    return broken > 0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("worker", type=pathlib.Path)
    parser.add_argument("directory", type=pathlib.Path)
    parser.add_argument("--seconds", type=float, default=3600)
    parser.add_argument("--runs", type=int, default=sys.maxsize, help="end after so many specs that were not refused")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(10**6))
    parser.add_argument("--memory-mb", type=int, default=1500)
    parser.add_argument("--cpu-seconds", type=int, default=60, help="what a run may take")
    parser.add_argument("--wrong", choices=["lines", "worker", "service"], help="specs with wrong values; requires --runs")
    parser.add_argument("--program", type=pathlib.Path, help="of --wrong lines: fuzz/lines_spec of a build")
    o = parser.parse_args()
    folder, worker = o.directory.resolve(), o.worker.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    schema = json.loads(subprocess.run([worker, "schema"], check=True, capture_output=True, text=True).stdout)
    print(f"seed {o.seed}", flush=True)
    if o.wrong:
        return give_wrong(o, folder, worker, schema)
    write_files(folder / "files", worker)
    shared = os.environ.get("HEXAD_SHARED")
    folders = [folder / "files"] + [pathlib.Path(shared) / name for name in ("meshes", "vdb", "volumes") if shared]
    draw = Draw(schema, files_of(folders), random.Random(o.seed))
    ends, broken, ran, until = collections.Counter(), 0, 0, time.monotonic() + o.seconds
    while ran < o.runs and time.monotonic() < until:
        spec = draw.spec()
        end, fault, said = judge(worker, spec, folder, o)
        ends[end] += 1
        ran += end != "spec_invalid"
        broken += fault is not None
        if fault or end == "slow":
            name = f"{'broken' if fault else 'slow'}.{o.seed}.{sum(ends.values())}"
            (folder / f"{name}.json").write_text(json.dumps(spec))
            (folder / f"{name}.txt").write_text(f"{fault}\n{said}")
            print(f"{name}: {fault or 'more than %d s' % o.cpu_seconds}", flush=True)
    print(", ".join(f"{count} {end}" for end, count in ends.most_common()))
    print(f"{broken} of {sum(ends.values())} broke something")
    return broken > 0


if __name__ == "__main__":
    sys.exit(main())
