#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Gives every file of a collection to the worker, and writes what became of each (measurements/inputs/files.csv).

    measurements/inputs/inputs.py --worker build/hexad-worker --output measurements/inputs/files.csv [--data DIRECTORY] [--only WORD ...]
                    [--summary FILE.csv] [--agreement FILE.csv] [--counts 5000 50000] [--resume] [--seconds N]

DIRECTORY, or HEXAD_SHARED, has the folders meshes, vdb, volumes, exr, cases and malformed. Nothing is known about the files
beforehand: the kind of surface follows from the folder and the name's ending; where the worker's error says that there is
a choice of grids, parts, channels or volumes, each grid and the first of the others are taken; where it says between what values
the volume lies, the middle is the isovalue. An image is made a stack of six copies. Malformed files are given the first count
alone. Points of meshes are measured on their triangles (measurements/common/mesh_measures.py). The summary has the numbers of
results and errors of each folder; the agreement has the differences between the report's measures and those computed here.

With --resume, rows that the output has of the same worker are kept. With --seconds, no file is begun after that time, so that the
results can be made in pieces: the exit status is 3 until they are complete. Ends with 1 when a result is not sound, or an error is
no error of the file's.

Sound is a result without a lost point, with all points on the surface, and whose outcome is true: a converged result of a mesh meets
the bounds of the outcome (doc/report.md) also by the measures that are computed here. `coverage` here is up to 0.12 spacings
too low, never too high.
"""
import argparse
import hashlib
import json
import os
import pathlib
import re
import resource
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import measure  # noqa: E402
import mesh_measures  # noqa: E402
import meshes  # noqa: E402
import results  # noqa: E402

COUNTS, SLICES = (5000, 50000), 6
# Runs what follows as a child of a small process: the kernel hands the peak of a process's memory on to what it starts.
SMALL_PARENT = ("sh", "-c", '"$@"; exit $?', "sh")
# Of the spacing: how far points may be off the surface.
RESIDUAL = 1e-3
PATIENCE_S = 900
# The worker's exit codes: a result, converged or not; and errors that are those of the input.
RESULTS, FAULTS = (0, 10, 11), (2, 3, 4, 5)
# Codes that blame the file; the others are nothing that a file should come to.
OF_FILES = {"input_damaged", "input_unsupported", "input_missing", "no_surface", "grid_missing", "grid_ambiguous",
            "isovalue_required", "limit_memory", "spec_invalid"}
READ_HERE = {".obj", ".off", ".ply", ".stl"}  # by measurements/common/meshes.py
MESHES = {".3mf", ".glb", ".gltf", *READ_HERE}
# Above the values of all volumes: the answer says what they are.
FAR = 1e30
# Files that another one names as its data, and papers that lie beside them.
BESIDE = re.compile(r"(\.(raw|zraw|mtl|md)|SHA256SUMS|/quarter\.\d+)$")
FOLDERS = ("meshes", "vdb", "volumes", "exr", "cases", "malformed")


def kind_of(path, folder):
    group = path.parent.name if folder == "malformed" else folder
    if "exr" in group or path.suffix == ".exr":
        return "exr"
    if path.suffix == ".vdb":
        return "vdb"
    if path.suffix.lower() in MESHES:
        return "mesh"
    return "volume"


class Case:
    """One file, and the members of its surface as far as they are known."""

    def __init__(self, path, kind, work, worker):
        self.path, self.kind, self.work, self.worker = path, kind, work, worker

    def surface(self, chosen):
        if self.kind != "exr":
            return {"path": str(self.path), **chosen}
        for k in range(1, SLICES + 1):
            link = self.work / f"slice.{k}.exr"
            link.unlink(missing_ok=True)
            link.symlink_to(self.path)
        return {"path": str(self.work / "slice.#.exr"), "slices": f"1-{SLICES}", **chosen}

    def run(self, chosen, count, seed=0):
        """(None, report) or (error, None)."""
        spec = {"version": 1, "surface": {self.kind: self.surface(chosen)}, "sampling": {"count": count},
                "solver": {"threads": 1, "seed": seed}, "output": {"preview": False, "ply": {"properties": ["all"]}}, "limits": {"timeout_s": PATIENCE_S}}
        (self.work / "spec.json").write_text(json.dumps(spec))
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run([*SMALL_PARENT, self.worker, "run", self.work / "spec.json", "--output", self.work / "out"],
                              text=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        self.processor_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        if done.returncode in RESULTS:
            return None, json.loads((self.work / "out" / "report.json").read_text())
        if done.returncode not in FAULTS:
            return {"code": "internal", "message": f"exit {done.returncode}: {done.stderr[-200:]}"}, None
        return json.loads(done.stderr.splitlines()[-1]), None

    def measured(self):
        """The measures of the last result on its mesh; None of other files, and of malformed ones, whose mesh is a matter of
        opinion."""
        if self.kind != "mesh" or {"malformed", "cases"} & set(self.path.parts) or self.path.suffix.lower() not in READ_HERE:
            return None
        points = measure.read_ply(self.work / "out" / "points.ply")
        return mesh_measures.measure(meshes.read(self.path), points.position, points.spacing)

    def outcomes(self, count, chosen=None):
        """Runs the file in every way that its errors leave open: (members, error, report) of each."""
        chosen = dict(chosen or {})
        if self.kind in ("volume", "exr"):
            chosen.setdefault("isovalue", FAR)
        error, report = self.run(chosen, count)
        said = error["message"] if error else ""
        grids = re.search(r"set grid to one of (.*)", said)
        equals = re.search(r'choose one by "([^"]*)\[0\]" to "[^"]*\[(\d+)\]"', said)
        channels = re.search(r"has the channels (.*): choose one with exr.channel", said)
        parts = re.search(r'parts of the file have .*? \("([^"]*)".*: choose one with exr.part', said)
        several = re.search(r"has \d+ volumes of .*: choose one with index", said)
        values = re.search(r"isovalue above its lowest value, (\S+), and below its highest, ([^\s;]+)", said)
        if grids and "grid" not in chosen:
            for name in dict.fromkeys(re.findall(r'"([^"]*)"', grids[1])):
                yield from self.outcomes(count, {**chosen, "grid": name})
        elif equals and "[" not in chosen.get("grid", ""):
            yield from self.outcomes(count, {**chosen, "grid": f"{equals[1]}[0]"})
        elif channels and "channel" not in chosen:
            yield from self.outcomes(count, {**chosen, "channel": channels[1].split(", ")[0]})
        elif parts and "part" not in chosen:
            yield from self.outcomes(count, {**chosen, "part": parts[1]})
        elif several and "index" not in chosen:
            yield from self.outcomes(count, {**chosen, "index": 0})
        elif error and error["code"] == "isovalue_required" and "isovalue" not in chosen:
            yield from self.outcomes(count, {**chosen, "isovalue": FAR})
        elif values and chosen.get("isovalue") == FAR and float(values[1]) < float(values[2]):
            middle = (float(values[1]) + float(values[2])) / 2
            yield from self.outcomes(count, {**chosen, "isovalue": max(-FAR / 2, min(middle, FAR / 2))})
        else:
            yield chosen, error, report


def faults(error, report, measured):
    """What is not sound, in words."""
    if error:
        return [] if error["code"] in OF_FILES else ["an error that is not the file's"]
    q, found = report["quality"], []
    if q["lost"]:
        found.append("points are lost")
    if q["max_residual"] > RESIDUAL:
        found.append("points are off the surface")
    if measured and report["outcome"] == "converged":
        found += [f"converged, but fails {name}" for name in measured.failed()]
    return found


def message(case, data, error, report):
    """The reasons and warnings of a result, or the error's message, without the machine's paths."""
    if report:
        return "; ".join([reason["criterion"] for reason in report["outcome_reasons"]] + report["surface"]["warnings"])
    return error["message"].replace(str(case.work) + "/", "").replace(str(data) + "/", "")


# Measures of the report and, of meshes, those that are computed here (columns measured_*).
MEASURES = ("hex_fraction", "edge_cv", "area_cv", "min_spacing_ratio", "close_share", "coverage", "missing_share", "max_residual")
HEADER = ("job", "folder", "file", "surface", "points", "outcome", "code", "unsound", *MEASURES, *(f"measured_{name}" for name in MEASURES),
          "cpu_s", "memory_mib", "message", "worker")


def figure(value):
    return "" if value is None else f"{value:.4g}"


def printable(text):
    """Damaged files have any bytes for names."""
    return "".join(c if c.isprintable() else "?" for c in text)


def files(data, folder):
    return [p for p in sorted((data / folder).rglob("*")) if p.is_file() and not BESIDE.search(str(p))]


def row(case, data, folder, name, chosen, count, error, report, mark):
    """A row of HEADER."""
    measured = case.measured() if report else None
    members = " ".join(f"{k} {v:.6g}" if isinstance(v, float) else f"{k} {v}" for k, v in chosen.items() if v != FAR)
    surface = f"{case.kind} {members}".strip()
    cells = {"job": f"{folder}/{name} {surface.partition(' ')[2]} {count}".replace("  ", " "), "folder": folder, "file": name,
             "surface": surface, "points": str(count), "outcome": report["outcome"].replace("_", " ") if report else "error",
             "code": error["code"] if error else "", "unsound": ", ".join(faults(error, report, measured)),
             "message": message(case, data, error, report), "worker": mark}
    if report:
        cells |= {name: figure(report["quality"][name]) for name in MEASURES}
        cells |= {"cpu_s": f"{case.processor_s:.1f}", "memory_mib": f"{report['peak_memory_bytes'] / 2 ** 20:.0f}"}
    if measured:
        cells |= {f"measured_{name}": figure(getattr(measured, name)) for name in MEASURES}
    return [printable(cells.get(name, "")) for name in HEADER]


def runs(case, counts):
    """(members, count, error, report): of the first count in every way that errors leave open, of the others in the ways that
    gave points."""
    ways = []
    for chosen, error, report in case.outcomes(counts[0]):
        ways += [chosen] if report else []
        yield chosen, counts[0], error, report
    for count in counts[1:]:
        for chosen in ways:
            yield chosen, count, *case.run(chosen, count)


def mark_of(worker):
    """A digest of a worker and of the modules beside it."""
    whole = hashlib.sha256()
    for path in [pathlib.Path(worker), *sorted(pathlib.Path(worker).parent.glob("hexad-*.so"))]:
        whole.update(path.read_bytes())
    return whole.hexdigest()[:16]


def rows_of(output, mark):
    """{(folder, name): rows} of a file; only the rows that the worker of this mark has made."""
    found = {}
    for cells in results.read(output):
        if cells["worker"] == mark:
            found.setdefault((cells["folder"], cells["file"]), []).append([cells[name] for name in HEADER])
    return found


def make_rows(case, data, folder, counts, mark, say):
    rows, name = [], str(case.path.relative_to(data / folder))
    for chosen, count, error, report in runs(case, counts):
        rows.append(row(case, data, folder, name, chosen, count, error, report, mark))
        say(", ".join(rows[-1]))
    return rows


SUMMARY = ("folder", "files", "results", "converged", "unresolved", "not_converged", "unsound", "errors", "input_damaged",
           "input_unsupported", "no_surface", "other_errors", "cpu_s")


def summary(table):
    """Rows of SUMMARY: numbers of files, of results and of errors, for each folder and for all."""
    rows = []
    for folder in (*FOLDERS, "all"):
        cells = [dict(zip(HEADER, row)) for row in table if folder in (row[1], "all")]
        codes = [c["code"] for c in cells if c["outcome"] == "error"]
        outcomes = [c["outcome"] for c in cells if c["outcome"] != "error"]
        named = [codes.count(name) for name in SUMMARY[8:11]]
        rows.append([folder, len({(c["folder"], c["file"]) for c in cells}), len(outcomes),
                     *(outcomes.count(name.replace("_", " ")) for name in SUMMARY[3:6]), sum(c["unsound"] != "" for c in cells),
                     len(codes), *named, len(codes) - sum(named), f"{sum(float(c['cpu_s'] or 0) for c in cells):.0f}"])
    return rows


AGREEMENT = ("measure", "meshes", "difference_median", "difference_largest", "job")


def agreement(table):
    """Rows of AGREEMENT: differences between the report's measures and those computed here, and the job of the largest."""
    rows, jobs = [], [dict(zip(HEADER, row)) for row in table]
    for name in MEASURES:
        differences = sorted((abs(float(job[name]) - float(job[f"measured_{name}"])), job["job"]) for job in jobs
                             if job[name] and job[f"measured_{name}"])
        if differences:
            rows.append([name, len(differences), *(f"{differences[k][0]:.4g}" for k in (len(differences) // 2, -1)), differences[-1][1]])
    return rows


def parser_of(description):
    """What every program that goes through the collection is told."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--worker", required=True)
    parser.add_argument("--output", required=True)
    parser.add_argument("--data", default=os.environ.get("HEXAD_SHARED"))
    parser.add_argument("--only", nargs="*", default=[])
    return parser


def arguments(parser):
    options = parser.parse_args()
    if not options.data or not pathlib.Path(options.data).is_dir():
        parser.error("give --data, or HEXAD_SHARED, the directory of the files")
    return options


def main():
    parser = parser_of(__doc__.splitlines()[0])
    parser.add_argument("--summary")
    parser.add_argument("--agreement")
    parser.add_argument("--counts", nargs="+", type=int, default=COUNTS)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    options = arguments(parser)
    data, worker, output = pathlib.Path(options.data), os.path.abspath(options.worker), pathlib.Path(options.output)
    mark, end = mark_of(worker), time.monotonic() + options.seconds
    rows = rows_of(output, mark) if options.resume else {}
    found = {(folder, printable(str(path.relative_to(data / folder)))): path for folder in FOLDERS for path in files(data, folder)}
    table = [row for place in found for row in rows.get(place, [])]
    for (folder, name), path in found.items():
        wanted = not options.only or any(word in f"{folder}/{name}" for word in options.only)
        if not wanted or (folder, name) in rows:
            continue
        if time.monotonic() > end:
            return 3
        with tempfile.TemporaryDirectory() as where:
            case = Case(path, kind_of(path, folder), pathlib.Path(where), worker)
            counts = options.counts[:1] if folder == "malformed" else options.counts
            rows[folder, name] = make_rows(case, data, folder, counts, mark, lambda text: print(text, file=sys.stderr))
        table = [row for place in found for row in rows.get(place, [])]
        results.write(output, HEADER, table)
    for path, header, rows in ((options.summary, SUMMARY, summary(table)), (options.agreement, AGREEMENT, agreement(table))):
        for cells in (header, *rows):
            print(*cells, sep=", ")
        if path:
            results.write(path, header, rows)
    return 1 if any(row[HEADER.index("unsound")] for row in table) else 0


if __name__ == "__main__":
    sys.exit(main())
