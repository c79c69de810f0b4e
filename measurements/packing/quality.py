#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Runs the cases of quality.json and measures their points (measurements/packing/README.md).

    measurements/packing/quality.py --worker build/hexad-worker --output measurements/packing/quality.csv [--case NAME ...] [--long] [--seeds N]

Every figure is computed from points.ply, the spec and an area that is a closed form or an integral of the program
(measure.py, surfaces.py, meshes.py); report.json is only compared with them. The CSV has the median over the seeds, half of
their range, and the faults of each case. The fault of a case whose feature is not built, or whose data are missing, is the
reason. Ends with 1 when a measure differs from the report by more than its tolerance, or misses its bound; the file is
written in both cases. HEXAD_SHARED: directory of the data from outside.
"""
import argparse
import collections
import json
import os
import pathlib
import subprocess
import sys
import tempfile

import numpy
from scipy.sparse import coo_matrix, csgraph
from scipy.spatial import cKDTree

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))
import levelsets  # noqa: E402
import measure  # noqa: E402
import meshes  # noqa: E402
import results  # noqa: E402
import surfaces  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent
# The measures that the report must confirm, and by how much they may differ from its value, relative to it. For area_cv the difference counts
# as it is: cells here are flat, those of the report lie on the surface and grow with its curvature.
CONFIRMED = {"edge_cv": 0.02, "area_cv": 0.01, "energy_excess": 0.02}
# A particle farther from the surface than this, in spacings, is lost; from a mesh, whose level set is smoother
# than itself, a voxel is granted.
LOST = 0.01
LOST_VOXELS = 1.5  # off a mesh: its level set rounds a knife's edge by up to a voxel
CREASE_COSINE = 0.7
# Share of close points, as counted here, from which on the outcome must be `unresolved`; else it must be `converged`.
CLOSE = 0.01


class Unavailable(Exception):
    """The case cannot be run here; the text says why."""


# ---- running

def resolve(surface, shared, scratch):
    """The surface as the worker is told it: paths below the shared data made whole, level sets written."""
    (kind, members), = surface.items()
    if kind == "analytic":
        return surface
    needed = members.get("path") or members.get("mesh")
    if needed and not (shared and (shared / needed).exists()):
        raise Unavailable(f"skipped: there is no {needed} (HEXAD_SHARED)")
    if kind != "level_set":
        return {kind: {**members, "path": str(shared / needed)}}
    name = "-".join(str(v) for v in members.values()).replace("/", "-").replace(" ", "")
    path = scratch / f"{name}.vdb"
    if not path.exists():
        levelsets.write(members, shared, path)
    return {"vdb": {"path": str(path)}}


def run_worker(worker, spec, where):
    """points and report; raises Unavailable for what the worker does not know yet."""
    done = subprocess.run([worker, "run", "-", "--output", where], input=json.dumps(spec), text=True,
                          capture_output=True)
    if done.returncode not in (0, 10, 11):
        last = (done.stderr.strip().splitlines() or ["{}"])[-1]
        try:
            told = json.loads(last)
        except ValueError:
            told = {"code": f"exit {done.returncode}", "message": last}
        if told.get("code") == "not_supported":
            raise Unavailable(f"not supported yet: {told.get('message')}")
        raise RuntimeError(f"the worker failed: {told.get('code')}: {told.get('message')}")
    with open(where / "report.json", encoding="utf-8") as file:
        return measure.read_ply(where / "points.ply"), json.load(file)


def spec_of(case, surface, seed):
    return {"version": 1, "surface": surface, "sampling": case["sampling"],
            "solver": {"threads": 0, **case.get("solver", {}), "seed": seed},
            "output": {"preview": False, "ply": {"precision": "double", "properties": ["all"]}}}


# ---- what is known of the surface beside its points

class FormulaTruth:
    """A surface that can be evaluated: formulas and volumes."""
    exact = True

    def __init__(self, surface, case):
        self.surface, self.case = surface, case
        self.area, self.domain = surface.area, surface.domain

    def questions(self, points, found):
        x, h = points.position, found["h"]
        off = numpy.concatenate([self.surface.distance(part) for part in numpy.array_split(x, 1 + len(x) // 100000)])
        answers = {"max_residual": float(off.max() / h), "lost": int((off > LOST * h).sum())}
        if self.surface.euler is not None:
            answers["euler_true"] = self.surface.euler
        if self.domain is not None:
            answers["outside"] = int(((x < self.domain[0]) | (x > self.domain[1])).any(axis=1).sum())
            answers["rim_gap"] = rim_gap(self.surface, x, h)
        if "curvature" in self.case["sampling"]:
            answers["spacing_error"] = spacing_error(self.case, self.surface, points, found)
        if "box" in self.case:
            answers["crease_gap"] = gap_to_edges(cube_edges(self.case["box"], 0.25 * h), points, found)
            answers["other_side"] = int(((points.normal * self.surface.normal(x)).sum(axis=1) < 0).sum())
        return answers


class MeshTruth:
    """A triangle mesh: what the level set made of it is near to."""
    exact, domain = False, None

    def __init__(self, members):
        self.mesh = meshes.read(members["path"])
        self.seen, self.component = self.mesh.seen()
        self.area = float(self.seen.sum())
        self.voxel = float(numpy.ptp(self.mesh.vertices, axis=0).max() / members["resolution"])

    def questions(self, points, found):
        far, which = self.mesh.nearest(points.position)
        facing = (points.normal * self.mesh.normals[which]).sum(axis=1)
        share = numpy.bincount(self.component, self.seen) / self.area * points.count
        count = numpy.bincount(self.component[which], minlength=len(share))
        sized = share > 1  # larger than one ideal cell
        error = numpy.abs(count - share)[sized] / numpy.maximum(0.05 * share[sized], 1)
        crease = self.mesh.creases(CREASE_COSINE, 0.25 * found["h"])
        return {"max_residual": float("nan"), "lost": int((far > LOST_VOXELS * self.voxel).sum()),
                "other_side": int((facing < 0).sum()), "parts": len(share),
                "empty_parts": int((count[sized] == 0).sum()), "share_error": float(error.max()),
                "crease_gap": gap_to_edges(crease, points, found)}


def truth_of(surface, case):
    if "mesh" in surface:
        return MeshTruth(surface["mesh"])
    return FormulaTruth(surfaces.surface_of(surface), case)


def cube_edges(half, step):
    along = numpy.arange(-half, half + step, step)
    ends = [(a, b) for a in (-half, half) for b in (-half, half)]
    return numpy.concatenate([numpy.insert(numpy.tile(e, (len(along), 1)), axis, along, axis=1)
                              for axis in range(3) for e in ends])


def gap_to_edges(edges, points, found):
    """The farthest that a place on a crease is from its nearest particle, in that particle's local spacings."""
    if not len(edges):
        return 0.0
    far, which = cKDTree(points.position).query(edges)
    local = numpy.where(found["local"] > 0, found["local"], points.spacing)
    return float((far / local[which]).max())


def rim_gap(surface, position, h):
    """The longest way along a rim from particle to particle, in h: twice the farthest of the rim's places from
    a particle."""
    low, high = (numpy.asarray(corner, float) for corner in surface.domain)
    tree, worst = cKDTree(position), 0.0
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        lines = numpy.arange(low[b], high[b], 0.25 * h)
        steps = numpy.linspace(low[c], high[c], 1 + int(4 * (high[c] - low[c]) / h))
        for face in (low[axis], high[axis]):
            x = numpy.empty((len(lines), len(steps), 3))
            x[:, :, axis], x[:, :, b], x[:, :, c] = face, lines[:, None], steps
            side = surface.value(x.reshape(-1, 3)).reshape(x.shape[:2])
            for first, second in ((side[:, :-1], side[:, 1:]), (side[:-1], side[1:])):
                hit = (first < 0) != (second < 0)
                t = (first / (first - second))[hit][:, None]
                a, z = (x[:, :-1][hit], x[:, 1:][hit]) if first.shape[1] < x.shape[1] else (x[:-1][hit], x[1:][hit])
                if len(t):
                    worst = max(worst, tree.query(a + t * (z - a))[0].max())
    return float(2 * worst / h)


# ---- grading: the requested spacing, by the spec's words

def spacing_error(case, surface, points, found):
    """How far the column `spacing` is from the spec's formula, as a factor less 1, at the worst of 99 %."""
    sampling, x = case["sampling"], points.position
    first, second = surface.curvatures(x)
    rule = sampling["curvature"]
    if "chord_error" in rule:
        wanted = numpy.sqrt(8 * rule["chord_error"] / numpy.maximum(numpy.abs(first), numpy.abs(second)))
    else:
        wanted = numpy.hypot(first, second) ** -rule.get("exponent", 1)
    scale = numpy.median(points.spacing / wanted)
    wanted = wanted * scale
    if "ratio" in rule:
        wanted = numpy.clip(wanted, points.spacing.min(), rule["ratio"] * points.spacing.min())
    if found["gradation"]:
        wanted = graded_field(wanted, found["gradation"], found["edges"], found["edge_length"])
    wanted *= numpy.median(points.spacing / wanted)
    return float(numpy.quantile(numpy.abs(numpy.log(points.spacing / wanted)), 0.99))


def graded_field(wanted, gradation, edges, length):
    """The largest field below `wanted` that grows by at most `gradation` per distance along the edges: the
    shortest ways from a source that every point hangs on by its own wanted spacing."""
    n = len(wanted)
    i, j = edges.T
    row = numpy.concatenate([i, j, numpy.full(n, n)])
    column = numpy.concatenate([j, i, numpy.arange(n)])
    weight = numpy.concatenate([gradation * length] * 2 + [wanted])
    graph = coo_matrix((weight, (row, column)), (n + 1, n + 1)).tocsr()
    return csgraph.dijkstra(graph, indices=n)[:n]


# ---- one case

def one_run(case, spec, truth, worker, where):
    """The measures of one job, and how they part from the report's."""
    points, report = run_worker(worker, spec, where)
    found = measure.measure(points, truth.area, truth.domain)
    sampling = report["spec"]["sampling"]
    found["gradation"] = sampling.get("gradation") or 0
    row = {k: v for k, v in found.items() if numpy.isscalar(v)}
    row.update(truth.questions(points, found))
    row["missing"] = abs(points.count - case["sampling"].get("count", points.count))
    row["spacing_ratio"] = float(points.spacing.max() / points.spacing.min())
    row["area_error"] = report["surface"]["area"] / truth.area - 1
    told = report["quality"]
    row["difference"] = {k: (row[k] - told[k]) / (1 if k == "area_cv" else told[k]) for k in CONFIRMED if told.get(k)}
    if not truth.exact:  # the level set's own area is not known
        row["difference"].pop("energy_excess", None)
    row["told_count"] = report["count"]
    row["verdict"] = (report["outcome"], tuple(reason["criterion"] for reason in report["outcome_reasons"]))
    return row


def run_case(case, options, scratch, truths):
    surface = resolve(case["surface"], options.shared, scratch)
    rows = []
    for seed in case.get("seeds", range(1, options.seeds + 1)):
        spec = spec_of(case, surface, seed)
        if options.threads is not None:
            spec["solver"]["threads"] = options.threads
        key = json.dumps(surface)
        if key not in truths:
            truths[key] = truth_of(surface, case)
        truths[key].case = case
        rows.append(one_run(case, spec, truths[key], options.worker, scratch / "job"))
    return rows


def medians(rows):
    """Median and half the range of every number."""
    return {k: (float(numpy.median([r[k] for r in rows])), float(numpy.ptp([r[k] for r in rows]) / 2))
            for k, v in rows[0].items() if numpy.isscalar(v)}


def judge(case, rows, bounds):
    """What is wrong, as words; the worst of the seeds for what must never happen, else their medians."""
    wrong = []
    middle = medians(rows)
    for name, (kind, *limit) in bounds[case["bounds"]].items():
        if name in case.get("free", ()):
            continue
        values = [r.get(name, float("nan")) for r in rows]
        value = max(values) if limit == [0] else middle.get(name, (float("nan"),))[0]
        fine = {">=": lambda: value >= limit[0], "<=": lambda: value <= limit[0],
                "within": lambda: limit[0] <= value <= limit[-1]}[kind]()
        if not fine:
            wrong.append(f"{name} {value:.4g}, bound {kind} {' '.join(map(str, limit))}")
    for row in rows:
        if row["told_count"] != row["count"]:
            wrong.append(f"the report tells {row['told_count']} points, the file has {row['count']}")
    return wrong + verdict_faults(rows)


def verdict_faults(rows):
    """Outcomes that the measures do not confirm."""
    expected = ["unresolved" if row["close_share"] > CLOSE or row["coincident"] else "converged" for row in rows]
    return [f"{row['verdict'][0]} ({', '.join(row['verdict'][1])}), expected {wanted}"
            for row, wanted in zip(rows, expected) if row["verdict"][0] != wanted]


def outcomes(rows):
    """How many of the seeds ended how, the most frequent first."""
    ends = collections.Counter(row["verdict"][0] for row in rows).most_common()
    return ", ".join(name if count == len(rows) else f"{count} {name}" for name, count in ends)


def differences(rows):
    """The largest difference from the report by measure, and those that are too large."""
    largest = {k: max((abs(r["difference"][k]) for r in rows if k in r["difference"]), default=float("nan"))
               for k in CONFIRMED}
    return largest, [f"{k} differs from the report by {100 * v:.2f} %" for k, v in largest.items() if v > CONFIRMED[k]]


def compare(case, middle, others):
    """Whether the medians of two starts differ by less than the spread over the seeds."""
    if case.get("like") not in others:
        return []
    wrong = []
    for name in ("hex_fraction", "edge_cv", "energy_excess"):
        (here, half), (there, half_there) = middle[name], others[case["like"]][name]
        if abs(here - there) >= 2 * max(half, half_there):
            wrong.append(f"{name} {here:.5f} against {there:.5f} of {case['like']}: more than the spread "
                         f"{2 * max(half, half_there):.5f}")
    return wrong


# ---- the results

SPREAD = (("hex_fraction", "{:.4f}"), ("edge_cv", "{:.4f}"), ("area_cv", "{:.4f}"), ("energy_excess_percent", "{:.3f}"),
          ("min_spacing_ratio", "{:.3f}"), ("euler", "{:.4g}"))  # with half of the range
SINGLE = (("max_residual", "{:.0e}"), ("lost", "{:.0f}"), ("area_error", "{:.0e}"), ("close_share", "{:.4f}"), ("grading_cv", "{:.4f}"),
          ("grading_exponent", "{:.4f}"), ("spacing_ratio", "{:.1f}"), ("spacing_error", "{:.2g}"), ("outside", "{:.0f}"), ("rim_gap", "{:.2f}"),
          ("other_side", "{:.0f}"), ("crease_gap", "{:.2f}"), ("parts", "{:.0f}"), ("empty_parts", "{:.0f}"), ("share_error", "{:.2f}"))
GRADED = ("grading_cv", "grading_exponent", "spacing_ratio", "spacing_error")
HEADER = ["case", "points", "outcome", *(name + end for name, _ in SPREAD for end in ("", "_half_range")), *(name for name, _ in SINGLE),
          *(f"{name}_difference_percent" for name in CONFIRMED), "faults"]


def result(case, rows, wrong):
    """A row of the CSV."""
    middle = medians(rows)
    middle["energy_excess_percent"] = [100 * v for v in middle["energy_excess"]]
    largest, _ = differences(rows)

    def text(name, form, which=0):
        known = name in middle and middle[name][0] == middle[name][0] and (name not in GRADED or "curvature" in case["sampling"])
        return form.format(middle[name][which]) if known else None
    return [case["name"], rows[0]["count"], outcomes(rows), *(text(name, form, which) for name, form in SPREAD for which in (0, 1)),
            *(text(name, form) for name, form in SINGLE), *(f"{100 * v:.2f}" if v == v else None for v in largest.values()), "; ".join(wrong)]


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worker", required=True, type=lambda p: str(pathlib.Path(p).resolve()))
    parser.add_argument("--output", required=True, type=pathlib.Path)
    parser.add_argument("--cases", default=HERE / "quality.json", type=pathlib.Path)
    parser.add_argument("--case", action="append", help="only this one; may be given several times")
    parser.add_argument("--seeds", default=5, type=int)
    parser.add_argument("--threads", type=int, help="of each job; default: the worker's choice")
    parser.add_argument("--long", action="store_true", help="the cases that take minutes, too")
    options = parser.parse_args()
    shared = os.environ.get("HEXAD_SHARED")
    options.shared = pathlib.Path(shared) if shared else HERE.parents[2] / "shared" / "data"
    return options


def main():
    options = arguments()
    with open(options.cases, encoding="utf-8") as file:
        table = json.load(file)
    lines = []
    faults, others, truths = [], {}, {}
    with tempfile.TemporaryDirectory() as scratch:
        for case in table["cases"]:
            if options.case and case["name"] not in options.case:
                continue
            try:
                if case.get("long") and not options.long:
                    raise Unavailable("left out: takes minutes (--long)")
                rows = run_case(case, options, pathlib.Path(scratch), truths)
                others[case["name"]] = medians(rows)
                wrong = (judge(case, rows, table["bounds"]) + differences(rows)[1] +
                         compare(case, others[case["name"]], others))
                lines.append(result(case, rows, wrong))
                faults += [f"{case['name']}: {w}" for w in wrong]
            except Unavailable as why:
                lines.append([case["name"], case["sampling"].get("count"), *[None] * (len(HEADER) - 3), str(why)])
            print(*(f"{name} {value}," for name, value in zip(HEADER, lines[-1]) if value not in (None, "")), flush=True)
    results.write(options.output, HEADER, lines)
    print(f"{len(lines)} cases, {len(faults)} faults")
    for fault in faults:
        print(f"quality: {fault}", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
