# SPDX-License-Identifier: Apache-2.0
"""What bench.py prints and writes: rows of a table, and what follows from them."""
import prepared_inputs
from claims import CLAIMS

HEAD = """# Performance

`make bench` writes this page, except the part below the comment "{mark}". One run on one machine: {cpu}, {cores} cores, {id}.
Compare ratios rather than seconds: another machine, or other load on this one, changes all seconds alike.

- Each row has one tool and one number of points. Its figures are medians over `runs` runs with the seeds 1, 2, and so on.
- CPU time, wall time and peak memory are those of the whole process. Every tool runs on one thread unless the row has another
  number. `CPU ratio` is the CPU time over that of hexad.
- hexad runs the whole job: it reads a level set from a VDB file, writes `points.ply`, reads it again and verifies it. Teem and
  CGAL's Surface_mesher get a dense volume of exact distances at the same voxels. The other tools get triangles whose corners lie on
  the surface. These inputs are prepared before the run and are not part of its time.
- [packing.py](packing.py) computes the measures from the points alone, with
  [measure.py](measure.py): the Delaunay triangulation restricted to the surface, with the exact surface's
  normals. Lengths are relative to the requested spacing, which is even or 1 / kappa within {ratio}:1. `residual` is the largest
  distance of a point from the surface, in spacings. Above {most:.0e} points, randomly placed windows are measured.
- Poisson-disk samplers draw random points at a minimum distance. They do not compute a packing and are listed for their cost.

"""
KEPT = "<!-- make bench keeps what follows -->"
COLUMNS = (("got", "points", "{:d}"), ("cpu_s", "CPU s", "{:.3g}"), ("wall_s", "wall s", "{:.3g}"),
           ("peak_mb", "peak MB", "{:.0f}"), ("hex_fraction", "hex_fraction", "{:.4f}"),
           ("edge_cv", "edge_cv", "{:.4f}"),
           ("energy_excess", "energy_excess %", "{:.3f}"), ("grading_cv", "grading CV", "{:.4f}"),
           ("residual", "residual", "{:.0e}"), ("runs", "runs", "{:d}"), ("cpu_to_ours", "CPU ratio", "{:.3g}"))


def cells(row):
    factor = {"energy_excess": 100}
    return [form.format(factor.get(name, 1) * row[name]) if name in row else "" for name, _, form in COLUMNS]


def tool_name(row):
    return row["tool"] + (f", {row['threads']} threads" if row["threads"] > 1 else "")


def console_line(row):
    who = f"{row['surface']:<15} {row['asked']:>9} {tool_name(row):<17}"
    if "missing" in row:
        return f"{who} {row['missing']}"
    return who + "".join(f" {text:>{max(len(title), 8)}}" for text, (_, title, _) in zip(cells(row), COLUMNS))


def console_head():
    titles = "".join(f" {title:>{max(len(title), 8)}}" for _, title, _ in COLUMNS)
    return f"{'surface':<15} {'requested':>9} {'tool':<17}{titles}"


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
    return markdown(["requested", "tool", *(title for _, title, _ in COLUMNS)], lines)


def claims_table(rows):
    lines = []
    for text, wanted, judge in CLAIMS:
        answer = judge(rows)
        found, met = answer or ("", None)
        lines.append([text, wanted, found, {True: "met", False: "**missed**", None: "not in this run"}[met]])
    return markdown(["claim", "bound", "measured", ""], lines)


def kernels_section(kernels):
    if not kernels:
        return ""
    head = ["field", "instruction set", "ns per update", "ns per particle listed", "neighbours", "operations", "bytes",
            "lower bound, ns"]
    numbers = ("ns", "list_ns", "neighbours", "operations", "bytes", "floor_ns")
    table = markdown(head, [[k["field"], k["isa"]] + [f"{k[n]:g}" for n in numbers] for k in kernels])
    return ("\n## Kernels\n\nCost of one update of a converged particle, of 100 000, on one thread (`measurements/speed/kernels`). The lower "
            "bound is the time of its\noperations at the rate of multiplications and additions that the same run "
            "measured.\n\n"
            + table)


def whole(told, most):
    """The page of the results `told`; `most`: points up to which all are measured."""
    parts = [HEAD.format(**told["run"], mark=KEPT.strip("<!-> "), ratio=prepared_inputs.RATIO, most=most), "## Tools\n\n", peers_table(told),
             "\n## Claims\n\n", claims_table(told["rows"]), kernels_section(told["run"].get("kernels"))]
    for name, surface in told["surfaces"].items():
        rows = [r for r in told["rows"] if r["surface"] == name]
        if rows:
            parts.append(f"\n## {name}\n\n{prepared_inputs.describe(name)}\n\n{surface_table(rows)}")
        elif "missing" in surface:
            parts.append(f"\n## {name}\n\nLeft out: {surface['missing']}.\n")
    return "".join(parts)


def kept(path):
    """The part of a page that a new run keeps: from the line KEPT on; empty without such a line or page."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    return text[text.index(KEPT + "\n"):] if KEPT + "\n" in text else ""
