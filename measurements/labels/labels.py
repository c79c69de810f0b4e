#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Samples segmentations of known shapes, and compares points, areas and lines with the exact ones
(shapes.csv, methods.csv, cost.csv and segmentations.csv in measurements/labels).

    measurements/labels/labels.py --worker build/hexad-worker --output FOLDER [--seeds 5] [--counts 10000,100000] [--size 96]
        [--data FOLDER --real 10000 --files tooth.nrrd,frogtissue.mhd]

With --data segmentations.csv has real volumes of this folder. Each figure is the median over the seeds; the shapes are those of
tests/service/label_shapes.py. methods.csv compares other ways to remove the stairs of voxels, computed here, at the first count.
cost.csv compares a ball of two labels with its level set. Shares no code with the sampler.
"""
import argparse
import json
import pathlib
import resource
import subprocess
import sys
import tempfile

import numpy
from scipy import ndimage
from scipy.spatial import cKDTree

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "service"), str(ROOT / "measurements" / "common")]
import results  # noqa: E402
from label_shapes import PLAIN, TURNED, Balls, Sectors, places  # noqa: E402
from readers import read_columns  # noqa: E402
from volumes import read_nrrd, write_nrrd  # noqa: E402

# Width of the filters that are compared, and what is near a line, in voxels.
WIDTH, NEAR = 0.8, 3


def ball(size):
    """The labels, and the distances that the level set of the same ball has."""
    off = numpy.linalg.norm(places(size), axis=-1) - 0.3 * size
    return (off < 0).astype("u1"), off.astype("f4")


def tooth(values):
    """A tooth in air: dentine and enamel, by thresholds. Of each only what is five voxels thick counts, lest the soft edge of enamel is
    a sheet of dentine; the other voxels are of the nearest one that does."""
    parts = numpy.digitize(ndimage.median_filter(values, 3), [600, 980])
    cores = [ndimage.binary_opening(parts == k, iterations=2) for k in range(3)]
    nearest = ndimage.distance_transform_edt(~numpy.any(cores, axis=0), return_distances=False, return_indices=True)
    return numpy.argmax(cores, axis=0)[tuple(nearest)].astype("u1")


def run(worker, folder, surface, count, seed):
    spec = {"version": 1, "surface": surface, "sampling": {"count": count}, "solver": {"seed": seed, "threads": 1},
            "output": {"preview": False, "mesh": True, "ply": {"precision": "double"},
                       **({"label_meshes": True} if "labels" in surface else {})}}
    (folder / "spec.json").write_text(json.dumps(spec))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([worker, "run", folder / "spec.json", "--output", folder / "out", "--input-root", folder],
                          capture_output=True, text=True)
    if done.returncode not in (0, 10, 11):
        raise SystemExit(done.stderr)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    report = json.loads((folder / "out" / "report.json").read_text())
    points = read_columns((folder / "out" / "points.ply").read_bytes())
    points["at"] = numpy.stack([points[a] for a in "xyz"], axis=1)
    return report, points, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def figures(shape, report, points, cpu):
    """Of one run."""
    at, on = points["at"], points["feature"] > 0
    pairs = [tuple(i["labels"]) for i in report["surface"]["labels"]["interfaces"]]
    of = {p: ~on & (points["label_a"] == p[0]) & (points["label_b"] == p[1]) for p in pairs}
    off = numpy.concatenate([shape.off_interface(at[of[p]], p) for p in pairs])
    middle = (abs(at - (shape.size - 1) / 2) < shape.size / 2 - 1).all(axis=1)
    line = shape.off_lines(at[on & middle])
    trees = {p: cKDTree(at[of[p]]) for p in pairs}
    between = min(trees[a].query(trees[b].data)[0].min() for a in pairs for b in pairs if a < b)
    areas = shape.areas() if hasattr(shape, "areas") else {}
    errors = {p: i["area"] / areas[p] - 1 for p, i in zip(pairs, report["surface"]["labels"]["interfaces"]) if p in areas}
    return {"outcome": report["outcome"],
            "largest_area_error": max((abs(e) for p, e in errors.items() if p[0] == 0), default=numpy.nan),
            "other_area_error": max((abs(e) for p, e in errors.items() if p[0] != 0), default=numpy.nan),
            "interfaces_rms_voxels": numpy.sqrt((off ** 2).mean()), "lines_rms_voxels": numpy.sqrt((line ** 2).mean()),
            "lines_largest_voxels": line.max(), "between_interfaces_spacings": between / report["spacing"],
            "coverage_spacings": report["quality"]["coverage"], "hex_fraction": report["quality"]["hex_fraction"],
            "open_edges": report["mesh"]["boundary_edges"] - report["mesh"]["rim_edges"],
            "closed_labels": " of ".join(map(str, closed_labels(report))), "cpu_s": cpu}


def closed_labels(report):
    """How many labels have a mesh that is closed and manifold, and how many one."""
    told = report["mesh"]["labels"]
    return sum(m["open_edges"] == 0 == m["nonmanifold_edges"] for m in told), len(told)


def real(worker, folder, data, count, files):
    """Rows of segmentations whose exact interfaces are unknown."""
    write_nrrd(folder / "tooth.nrrd", tooth(read_nrrd(data / "tooth.nhdr")[0]))
    for name in ("frogtissue.mhd", "frogtissue.zraw"):
        (folder / name).write_bytes((data / name).read_bytes())
    for name in files:
        closed = {"closed": True} if name == "tooth.nrrd" else {}  # the frog's parts end with the data
        report, _, cpu = run(worker, folder, {"labels": {"path": name, **closed}}, count, 0)
        mesh = report["mesh"]
        yield {"file": name, "points": str(count), "labels": len(report["surface"]["labels"]["materials"]),
               "interfaces": len(report["surface"]["labels"]["interfaces"]), "outcome": report["outcome"],
               "coverage_spacings": report["quality"]["coverage"], "hex_fraction": report["quality"]["hex_fraction"] or numpy.nan,
               "thin_share": report["quality"]["thin_count"] / report["count"], "open_edges": mesh["boundary_edges"] - mesh["rim_edges"],
               "closed_labels": " of ".join(map(str, closed_labels(report))),
               "memory_mib": report["peak_memory_bytes"] / 2 ** 20, "cpu_s": cpu}


def text(value):
    return value if isinstance(value, str) else "" if value != value else f"{value:.4g}"


def write(path, rows):
    """Writes dictionaries with the same names, and prints them."""
    results.write(path, list(rows[0]), [[text(value) for value in row.values()] for row in rows])
    print(path.name, *(", ".join(text(value) for value in row.values()) for row in rows), sep="\n")


def median(runs):
    return {n: runs[0][n] if isinstance(runs[0][n], str) else float(numpy.median([r[n] for r in runs])) for n in runs[0]}


# ---- other ways

def crossings(functions, labels):
    """Places between neighbouring voxels of different largest function, where the two are equal, and their labels."""
    largest = functions.argmax(0)
    found = []
    for axis in range(3):
        a, b = (numpy.take(largest, range(k, largest.shape[axis] - 1 + k), axis) for k in (0, 1))
        at = numpy.argwhere(a != b)
        one, two = at.copy(), at.copy()
        two[:, axis] += 1
        p, q = a[tuple(at.T)], b[tuple(at.T)]
        low, high = (functions[(p, *where.T)] - functions[(q, *where.T)] for where in (one, two))
        place = at.astype(float)
        place[:, axis] += low / (low - high)
        found.append((place, labels[numpy.minimum(p, q)], labels[numpy.maximum(p, q)]))
    return [numpy.concatenate(parts) for parts in zip(*found)]


def indicators(volume, labels):
    return numpy.stack([ndimage.gaussian_filter((volume == k).astype(float), WIDTH, mode="nearest") for k in labels])


def distances(volume, labels):
    def inside(mask):
        return ndimage.distance_transform_edt(mask) - 0.5
    return numpy.stack([ndimage.gaussian_filter(numpy.where(volume == k, inside(volume == k), -inside(volume != k)), WIDTH,
                                                mode="nearest") for k in labels])


def compare(way, shape):
    labels = numpy.unique(shape.labels)
    at, a, b = crossings(way(shape.labels, labels), labels)
    middle = (abs(at - (shape.size - 1) / 2) < shape.size / 2 - 2).all(axis=1)
    off, near = numpy.zeros(len(at)), shape.off_lines(at) < NEAR
    for pair in set(zip(a, b)):
        of = (a == pair[0]) & (b == pair[1])
        off[of] = shape.off_interface(at[of], (int(pair[0]), int(pair[1])))
    return [numpy.sqrt((off[middle & part] ** 2).mean()) for part in (~near, near)]


def lost(way):
    """The share of the voxels of a slanted sheet, one voxel thick, whose own function is not the largest."""
    x = places(40)
    sheet = (abs(x @ numpy.array([3, 2, 6]) / 7) < 0.5).astype("u1")
    return (way(sheet, [0, 1]).argmax(0) != 1)[sheet == 1].mean()


def points_near(shape, points):
    on = points["feature"] > 0
    at, off = points["at"][~on], numpy.zeros((~on).sum())
    pairs = numpy.stack([points["label_a"], points["label_b"]], axis=1)[~on].astype(int)
    for pair in set(map(tuple, pairs)):
        of = (pairs == pair).all(axis=1)
        off[of] = shape.off_interface(at[of], pair)
    near = shape.off_lines(at) < NEAR
    return [numpy.sqrt((off[part] ** 2).mean()) for part in (~near, near)]


def shapes(options, folder):
    """Rows of shapes.csv and of methods.csv."""
    rows, other = [], []
    for kind in (Balls, Sectors):
        for name, turn in (("", PLAIN), (" turned", TURNED)):
            shape, title = kind(options.size, turn), {Balls: "three balls", Sectors: "three sectors"}[kind] + name
            write_nrrd(folder / "v.nrrd", shape.labels)
            for count in options.counts:
                runs = []
                for seed in range(options.seeds):
                    report, points, cpu = run(options.worker, folder, {"labels": {"path": "v.nrrd"}}, count, seed)
                    runs.append(figures(shape, report, points, cpu))
                rows.append({"job": f"{title} {count}", "shape": title, "points": str(count), **median(runs)})
                if count == options.counts[0]:
                    ways = {"smoothed indicators": compare(indicators, shape), "smoothed distances": compare(distances, shape),
                            "hexad": points_near(shape, points)}
                    other += [{"row": f"{title} by {way}", "shape": title, "method": way, "off_lines_rms_voxels": far,
                               "near_lines_rms_voxels": near}
                              for way, (far, near) in ways.items()]
    return rows, other


def cost(options, folder):
    """Rows of cost.csv: a ball of two labels, and its level set."""
    labels, off = ball(options.size)
    write_nrrd(folder / "v.nrrd", labels)
    write_nrrd(folder / "w.nrrd", -off)
    for count in options.counts:
        # in turn, so that other load affects both alike
        pair = [[run(options.worker, folder, surface, count, seed) for surface in
                 ({"labels": {"path": "v.nrrd"}}, {"volume": {"path": "w.nrrd", "isovalue": 0}})] for seed in range(options.seeds)]
        times = [float(numpy.median([runs[k][2] for runs in pair])) for k in (0, 1)]
        radius = numpy.linalg.norm(pair[0][0][1]["at"] - (options.size - 1) / 2, axis=1)
        yield {"points": str(count), "labels_cpu_s": times[0], "level_set_cpu_s": times[1], "ratio": times[0] / times[1],
               "radius_error_voxels": radius.mean() - 0.3 * options.size, "radius_rms_voxels": radius.std()}


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    for name, default in (("worker", None), ("output", None), ("data", ""), ("seeds", 5), ("counts", "10000,100000"), ("size", 96),
                          ("real", 10000), ("files", "tooth.nrrd,frogtissue.mhd")):
        parser.add_argument("--" + name, default=default, type=str if default is None else type(default), required=default is None)
    options = parser.parse_args()
    options.counts = [int(count) for count in options.counts.split(",")]
    output = pathlib.Path(options.output)
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        folder = pathlib.Path(place)
        rows, other = shapes(options, folder)
        write(output / "shapes.csv", rows)
        write(output / "methods.csv", other)
        write(output / "cost.csv", list(cost(options, folder)))
        if options.data:
            write(output / "segmentations.csv", list(real(options.worker, folder, pathlib.Path(options.data), options.real,
                                                          options.files.split(","))))
    print(f"voxels lost of a slanted wall of one voxel: indicators {lost(indicators):.0%}, distances {lost(distances):.0%}")


if __name__ == "__main__":
    main()
