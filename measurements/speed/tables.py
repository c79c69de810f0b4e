# SPDX-License-Identifier: Apache-2.0
"""What bench.py prints, and the tables that it writes: samplers.csv, comparison.csv, bounds.csv and kernels.csv."""
import pathlib
import sys

from claims import CLAIMS

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))

import results  # noqa: E402

# name in the row, name in the tables, digits on the console
COLUMNS = (("got", "points", "{:d}"), ("cpu_s", "cpu_s", "{:.3g}"), ("wall_s", "wall_s", "{:.3g}"),
           ("peak_mb", "peak_mb", "{:.0f}"), ("hex_fraction", "hex_fraction", "{:.4f}"), ("edge_cv", "edge_cv", "{:.4f}"),
           ("energy_excess", "energy_excess", "{:.5f}"), ("grading_cv", "grading_cv", "{:.4f}"),
           ("told_cv", "requested_cv", "{:.4f}"), ("residual", "residual_spacings", "{:.0e}"), ("runs", "runs", "{:d}"),
           ("cpu_to_ours", "cpu_ratio", "{:.3g}"))
COMPARED = ("torus", 10 ** 5)
SPREAD = ("cpu_s_least", "cpu_s_most")
KERNELS = ("ns", "list_ns", "neighbours", "operations", "bytes", "floor_ns")
KERNEL_COLUMNS = ("update_ns", "listed_particle_ns", "neighbours", "operations", "bytes", "lower_bound_ns")


def cells(row):
    return [form.format(row[name]) if name in row else "" for name, _, form in COLUMNS]


def tool_name(row):
    return row["tool"] + (f" {row['threads']} threads" if row["threads"] > 1 else "")


def console_line(row):
    label = f"{row['surface']:<15} {row['asked']:>9} {tool_name(row):<17}"
    if "missing" in row:
        return f"{label} {row['missing']}"
    return label + "".join(f" {text:>{max(len(title), 8)}}" for text, (_, title, _) in zip(cells(row), COLUMNS))


def console_head():
    titles = "".join(f" {title:>{max(len(title), 8)}}" for _, title, _ in COLUMNS)
    return f"{'surface':<15} {'requested':>9} {'tool':<17}{titles}"


def figures(row):
    return [row.get(name) for name, _, _ in COLUMNS]


def samplers(told):
    """All rows. Surfaces that were left out have a row of their own, with the reason."""
    rows = [[f"{r['surface']} {r['asked']} {tool_name(r)}", r["surface"], r["asked"], r["tool"], r["threads"], *figures(r),
             r.get("outcome"), r.get("missing"), r["run"][:10]] for r in sorted(told["rows"], key=lambda r: (r["surface"], r["asked"]))]
    left_out = [[name, name, *[None] * (4 + len(COLUMNS)), surface["missing"], told["run"]["id"][:10]]
                for name, surface in told["surfaces"].items() if "missing" in surface]
    head = ["row", "surface", "points_requested", "tool", "threads", *(title for _, title, _ in COLUMNS), "outcome", "reason_left_out", "date"]
    return head, rows + left_out


def comparison(told):
    """One row for each tool that has figures of the compared case, by CPU time."""
    rows = [r for r in told["rows"] if (r["surface"], r["asked"]) == COMPARED and r["threads"] == 1 and "cpu_s" in r]
    head = ["tool", *(title for _, title, _ in COLUMNS), *SPREAD, "package", "version", "date"]
    return head, [[told["peers"][r["tool"]]["title"], *figures(r), *(r.get(name) for name in SPREAD), told["peers"][r["tool"]]["package"],
                   told["peers"][r["tool"]]["version"], r["run"][:10]] for r in sorted(rows, key=lambda r: r["cpu_s"])]


def bounds(told):
    """Each bound with what was measured."""
    rows = []
    for name, bound, judge in CLAIMS:
        value, met = judge(told["rows"]) or (None, None)
        verdict = "not in this run" if value is None else {True: "met", False: "missed", None: "none"}[met]
        rows.append([name, bound, None if value is None else float(f"{value:.4g}"), verdict])
    return ["row", "bound", "measured", "verdict"], rows


def kernels(told):
    return (["row", *KERNEL_COLUMNS],
            [[f"{k['field'].split()[0]} {k['isa']}", *(k[name] for name in KERNELS)] for k in told["run"].get("kernels") or []])


TABLES = {"samplers.csv": samplers, "comparison.csv": comparison, "bounds.csv": bounds, "kernels.csv": kernels}


def write(folder, told):
    """Writes each table that has rows."""
    for name, table in TABLES.items():
        head, rows = table(told)
        if rows:
            results.write(folder / name, head, rows)


def summary(told):
    """The bounds that are missed, and how many of them are met."""
    verdicts = bounds(told)[1]
    lines = [f"missed: {name}: {measured:g}, bound {bound}" for name, bound, measured, verdict in verdicts if verdict == "missed"]
    return "\n".join([f"{sum(v[3] == 'met' for v in verdicts)} bounds are met", *lines])
