# SPDX-License-Identifier: Apache-2.0
"""What is claimed of the sampler's speed, as functions of the rows: each gives what was found, in words, and whether
that is enough, or None when rows that it needs are not there."""


def row_of(rows, surface, asked, tool="hexad", threads=1):
    """The row of one case, or None where it has no figures."""
    wanted = {"surface": surface, "asked": asked, "tool": tool, "threads": threads}
    return next((r for r in rows if "cpu_s" in r and all(r[k] == v for k, v in wanted.items())), None)


def against_relaxations(rows):
    ours = row_of(rows, "torus", 10 ** 5)
    peers = [r for r in (row_of(rows, "torus", 10 ** 5, t) for t in ("teem", "vtk-smoothing")) if r]
    if not ours or not peers:
        return None
    best = min(peers, key=lambda r: r["cpu_s"])
    times = best["cpu_s"] / ours["cpu_s"]
    only = "" if len(peers) == 2 else "; no figures of the second tool"
    return f"{times:.1f} ({best['tool']} {best['cpu_s']:.3g} s over {ours['cpu_s']:.3g} s{only})", times >= 60


def against_meshers(rows):
    ours = row_of(rows, "torus", 10 ** 5)
    peers = [r for r in (row_of(rows, "torus", 10 ** 5, t) for t in ("cgal-remesh", "cgal-surface")) if r]
    if not ours or not peers:
        return None
    return (", ".join(f"{r['cpu_s'] / ours['cpu_s']:.2f} ({r['tool']})" for r in peers),
            all(r["cpu_s"] > ours["cpu_s"] for r in peers))


def at_most(surface, asked, figure, limit, form="{:.3g}", over=None, least=False):
    """A judge of one figure, or of its ratio to another of the same row."""
    def judge(rows):
        row = row_of(rows, surface, asked)
        if not row or figure not in row:
            return None
        value = row[figure] / (row[over] if over else 1)
        return form.format(value), value >= limit if least else value <= limit
    return judge


def relaxation(surface, limit, update_ns):
    """A judge of the relaxation's CPU time; the limit is that of a machine whose updates take update_ns, and longer
    where the kernel benchmark of the same run has longer ones."""
    def judge(rows):
        row = row_of(rows, surface, 10 ** 6)
        if not row or not row.get("kernel_ns"):
            return None
        scaled = limit * max(row["kernel_ns"] / update_ns, 1)
        return (f"{row['relax_cpu_s']:.3g} at {row['kernel_ns']:.0f} ns per update; bound {scaled:.3g}",
                row["relax_cpu_s"] <= scaled)
    return judge


def kernel(surface, limit):
    """A judge of the kernel benchmark, by any row that has its figure."""
    def judge(rows):
        found = [r["kernel_ns"] for r in rows if r.get("kernel_ns") and r["surface"].endswith("-formula") == surface]
        return (f"{found[0]:.1f}", found[0] <= limit) if found else None
    return judge


def ratio(figure, limit, above, below, least=False, form="{:.3g}"):
    """A judge of one row's figure by another's; rows as (surface, asked, threads)."""
    def judge(rows):
        first, second = (row_of(rows, s, n, threads=t) for s, n, t in (above, below))
        if not first or not second:
            return None
        value = first[figure] / second[figure]
        return form.format(value), value >= limit if least else value <= limit
    return judge


def same_bytes(rows):
    found = [row_of(rows, "torus", 10 ** 6, threads=t) for t in (1, 2, 3, 8)]
    if not all(found):
        return None
    kinds = len({r["sha256"] for r in found})
    return ("one sha256" if kinds == 1 else f"{kinds} different"), kinds == 1


MILLION, TEN = ("torus", 10 ** 6, 1), ("torus", 10 ** 7, 1)
TWO, EVEN, GRADED = ("torus", 10 ** 6, 2), ("ellipsoid-even", 10 ** 5, 1), ("ellipsoid", 10 ** 5, 1)
QUARTIC, TORUS = ("quartic-formula", 10 ** 3), ("torus", 10 ** 5)
# text, what is wanted, judge
CLAIMS = (
    ("100 000 on the torus: CPU time of the faster of Teem and VTK smoothing, over hexad's", ">= 60", against_relaxations),
    ("- CPU time of each CGAL mesher, over hexad's", "> 1", against_meshers),
    ("- hex_fraction", ">= 0.98", at_most(*TORUS, "hex_fraction", 0.98, "{:.4f}", least=True)),
    ("- edge_cv", "<= 0.05", at_most(*TORUS, "edge_cv", 0.05, "{:.4f}")),
    ("- energy_excess", "<= 0.004", at_most(*TORUS, "energy_excess", 0.004, "{:.5f}")),
    ("1 000 000 on the torus: CPU s of the relaxation, level set", "<= 2.0 at 80 ns per update",
     relaxation("torus", 2.0, 80)),
    ("- formula", "<= 1.5 at 50 ns per update", relaxation("torus-formula", 1.5, 50)),
    ("- hex_fraction", ">= 0.99", at_most("torus", 10 ** 6, "hex_fraction", 0.99, "{:.4f}", least=True)),
    ("- whole job over its relaxation", "<= 3", at_most("torus", 10 ** 6, "cpu_s", 3, over="relax_cpu_s")),
    ("- peak MB", "<= 400", at_most("torus", 10 ** 6, "peak_mb", 400, "{:.0f}")),
    ("10 000 000: hex_fraction", ">= 0.99", at_most("torus", 10 ** 7, "hex_fraction", 0.99, "{:.4f}", least=True)),
    ("- CPU time over that of 1 000 000", "<= 11.5", ratio("cpu_s", 11.5, TEN, MILLION)),
    ("- peak memory over that of 1 000 000", "<= 11.5", ratio("peak_mb", 11.5, TEN, MILLION)),
    ("Two threads at 1 000 000: wall time of the relaxation on one thread over that on two", ">= 1.7",
     ratio("relax_s", 1.7, MILLION, TWO, least=True)),
    ("- whole job", ">= 1.6", ratio("wall_s", 1.6, MILLION, TWO, least=True)),
    ("- points.ply with 1, 2, 3 and 8 threads", "the same bytes", same_bytes),
    ("Graded 10:1 at 100 000: CPU time over that of even sampling", "<= 1.5", ratio("cpu_s", 1.5, GRADED, EVEN)),
    ("- CV of achieved over requested spacing", "<= 0.015", at_most("ellipsoid", 10 ** 5, "told_cv", 0.015, "{:.4f}")),
    ("1 000 on the quartic: CPU s of the relaxation", "<= 0.030", at_most(*QUARTIC, "relax_cpu_s", 0.030)),
    ("- hex_fraction, median over the seeds", ">= 0.93",
     at_most(*QUARTIC, "hex_fraction", 0.93, "{:.4f}", least=True)),
    ("- CPU s of the whole process", "<= 0.100", at_most(*QUARTIC, "cpu_s", 0.100)),
    ("One update on a tricubic field, ns on one core", "<= 80", kernel(False, 80)),
    ("- on a formula", "<= 50", kernel(True, 50)),
)
