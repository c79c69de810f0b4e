"""What bench.py prints and writes: rows of a table, and what follows from them."""
import inputs
from claims import CLAIMS

HEAD = """# Performance, measured

Written by `make bench`; do not edit. One run on one machine: {cpu}, {cores} cores, {id}. Ratios are what counts:
another machine has other seconds, and one that is busy with something else stretches all of them.

- A row is one tool at one count, median over `runs` (seeds 1, 2, ...). CPU and wall seconds and the peak of memory are
  those of the whole process, from its start to its end, as the kernel tells them. Every tool has one thread where
  nothing else is said. `to ours` is its CPU by ours.
- `hexad` is the whole job, from a level set in a VDB file to a `points.ply` that was read again and verified. Teem and
  CGAL's Surface_mesher are given a dense volume of true distances of the same voxels, the others triangles of it
  whose corners lie on the surface, which are made for them beforehand and cost them nothing.
- The measures come from the points alone, by [bench/packing.py](../../bench/packing.py) on
  [tools/measure.py](../../tools/measure.py): the Delaunay triangulation restricted to the surface, with the exact
  surface's normals. Lengths are relative to the spacing that was asked for: even, or 1 / kappa within {ratio}:1.
  `residual` is the largest distance from the surface, in spacings. Beyond {most:.0e} points windows are measured.
- Poisson-disk samplers throw darts: they are no packings, and are here for their cost.

"""
COLUMNS = (("got", "got", "{:d}"), ("cpu_s", "CPU s", "{:.3g}"), ("wall_s", "wall s", "{:.3g}"),
           ("peak_mb", "peak MB", "{:.0f}"), ("hex_fraction", "hex_fraction", "{:.4f}"),
           ("edge_cv", "edge_cv", "{:.4f}"),
           ("energy_excess", "energy_excess %", "{:.3f}"), ("grading_cv", "grading CV", "{:.4f}"),
           ("residual", "residual", "{:.0e}"), ("runs", "runs", "{:d}"), ("cpu_to_ours", "to ours", "{:.3g}"))


def cells(row):
    factor = {"energy_excess": 100}
    return [form.format(factor.get(name, 1) * row[name]) if name in row else "" for name, _, form in COLUMNS]


def tool_name(row):
    return row["tool"] + (f", {row['threads']} threads" if row["threads"] > 1 else "")


def console_line(row):
    who = f"{row['surface']:<15} {row['asked']:>8} {tool_name(row):<17}"
    if "missing" in row:
        return f"{who} {row['missing']}"
    return who + "".join(f" {text:>{max(len(title), 8)}}" for text, (_, title, _) in zip(cells(row), COLUMNS))


def console_head():
    titles = "".join(f" {title:>{max(len(title), 8)}}" for _, title, _ in COLUMNS)
    return f"{'surface':<15} {'asked':>8} {'tool':<17}{titles}"


def markdown(names, lines):
    return "\n".join("| " + " | ".join(line) + " |" for line in (names, ["---"] * len(names), *lines)) + "\n"


def peers_table(told):
    lines = [[f"`{name}`", p["title"], p["package"], p["version"]] for name, p in told["peers"].items()]
    return markdown(["tool", "what it is", "Debian package", "version"], lines)


def surface_table(rows):
    lines = []
    for row in sorted(rows, key=lambda r: r["asked"]):
        figures = [*[""] * (len(COLUMNS) - 1), row["missing"]] if "missing" in row else cells(row)
        lines.append([str(row["asked"]), tool_name(row), *figures])
    return markdown(["asked", "tool", *(title for _, title, _ in COLUMNS)], lines)


def claims_table(rows):
    lines = []
    for text, wanted, judge in CLAIMS:
        answer = judge(rows)
        found, met = answer or ("", None)
        lines.append([text, wanted, found, {True: "met", False: "**missed**", None: "not in this run"}[met]])
    return markdown(["claim", "wanted", "found", ""], lines)


def kernels_section(kernels):
    if not kernels:
        return ""
    head = ["field", "instruction set", "ns per update", "ns per particle listed", "neighbours", "operations", "bytes",
            "floor, ns"]
    numbers = ("ns", "list_ns", "neighbours", "operations", "bytes", "floor_ns")
    table = markdown(head, [[k["field"], k["isa"]] + [f"{k[n]:g}" for n in numbers] for k in kernels])
    return ("\n## Kernels\n\nOne update of one of 100 000 particles at rest by one thread, from `bench/kernels`; the "
            "floor is its operations\nat the rate of multiplications and additions that the same run measured.\n\n"
            + table)


def whole(told, most):
    """The page of the results `told`; `most`: points up to which all are measured."""
    parts = [HEAD.format(**told["run"], ratio=inputs.RATIO, most=most), "## Tools\n\n", peers_table(told),
             "\n## Claims\n\n", claims_table(told["rows"]), kernels_section(told["run"].get("kernels"))]
    for name, surface in told["surfaces"].items():
        rows = [r for r in told["rows"] if r["surface"] == name]
        if rows:
            parts.append(f"\n## {name}\n\n{inputs.describe(name)}\n\n{surface_table(rows)}")
        elif "missing" in surface:
            parts.append(f"\n## {name}\n\nLeft out: {surface['missing']}.\n")
    return "".join(parts)
