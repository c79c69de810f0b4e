# SPDX-License-Identifier: Apache-2.0
"""The bounds on the sampler's speed and quality. Each judge takes the rows of a run and returns the measured number and whether it meets the
bound, or None where the run lacks a row that it needs. Bounds are on quality, memory and ratios of times. Seconds have none: a judge of
seconds returns None in place of the verdict."""


def row_of(rows, surface, asked, tool="hexad", threads=1):
    """The row of one case, or None where it has no figures."""
    wanted = {"surface": surface, "asked": asked, "tool": tool, "threads": threads}
    return next((r for r in rows if "cpu_s" in r and all(r[k] == v for k, v in wanted.items())), None)


def fastest_over_hexad(*tools, limit):
    """A judge of the CPU time of the fastest of the tools on the torus at 100 000 points, over hexad's: more than the limit."""
    def judge(rows):
        hexad = row_of(rows, "torus", 10 ** 5)
        peers = [r for r in (row_of(rows, "torus", 10 ** 5, tool) for tool in tools) if r]
        if not hexad or not peers:
            return None
        value = min(r["cpu_s"] for r in peers) / hexad["cpu_s"]
        return value, value > limit
    return judge


def at_most(surface, asked, figure, limit, over=None, least=False):
    """A judge of one figure, or of its ratio to another of the same row."""
    def judge(rows):
        row = row_of(rows, surface, asked)
        if not row or figure not in row:
            return None
        value = row[figure] / (row[over] if over else 1)
        return value, value >= limit if least else value <= limit
    return judge


def seconds(surface, asked, figure):
    """The CPU seconds of a row, without a verdict."""
    def judge(rows):
        row = row_of(rows, surface, asked)
        return (row[figure], None) if row and figure in row else None
    return judge


def ratio(figure, limit, above, below, least=False):
    """A judge of one row's figure by another's; rows as (surface, asked, threads)."""
    def judge(rows):
        first, second = (row_of(rows, s, n, threads=t) for s, n, t in (above, below))
        if not first or not second:
            return None
        value = first[figure] / second[figure]
        return value, value >= limit if least else value <= limit
    return judge


def same_bytes(rows):
    found = [row_of(rows, "torus", 10 ** 6, threads=t) for t in (1, 2, 3, 8)]
    if not all(found):
        return None
    kinds = len({r["sha256"] for r in found})
    return kinds, kinds == 1


MILLION, TEN = ("torus", 10 ** 6, 1), ("torus", 10 ** 7, 1)
TWO, EVEN, GRADED = ("torus", 10 ** 6, 2), ("ellipsoid-even", 10 ** 5, 1), ("ellipsoid", 10 ** 5, 1)
QUARTIC, TORUS = ("quartic-formula", 10 ** 3), ("torus", 10 ** 5)
# name of the row, bound, judge; no bound: seconds
CLAIMS = (
    ("torus 100000: CPU of the faster of Teem and VTK smoothing over hexad's", "> 60",
     fastest_over_hexad("teem", "vtk-smoothing", limit=60)),
    ("torus 100000: CPU of the faster CGAL mesher over hexad's", "> 1",
     fastest_over_hexad("cgal-remesh", "cgal-surface", limit=1)),
    ("torus 100000: hex_fraction", ">= 0.98", at_most(*TORUS, "hex_fraction", 0.98, least=True)),
    ("torus 100000: edge_cv", "<= 0.05", at_most(*TORUS, "edge_cv", 0.05)),
    ("torus 100000: energy_excess", "<= 0.004", at_most(*TORUS, "energy_excess", 0.004)),
    ("torus 1000000: CPU s of the relaxation", "", seconds("torus", 10 ** 6, "relax_cpu_s")),
    ("torus by its formula 1000000: CPU s of the relaxation", "", seconds("torus-formula", 10 ** 6, "relax_cpu_s")),
    ("torus 1000000: hex_fraction", ">= 0.99", at_most("torus", 10 ** 6, "hex_fraction", 0.99, least=True)),
    ("torus 1000000: CPU of the whole job over its relaxation", "<= 3", at_most("torus", 10 ** 6, "cpu_s", 3, over="relax_cpu_s")),
    ("torus 1000000: peak MB", "<= 400", at_most("torus", 10 ** 6, "peak_mb", 400)),
    ("torus 10000000: hex_fraction", ">= 0.99", at_most("torus", 10 ** 7, "hex_fraction", 0.99, least=True)),
    ("torus 10000000: CPU over that of 1000000", "<= 11.5", ratio("cpu_s", 11.5, TEN, MILLION)),
    ("torus 10000000: peak memory over that of 1000000", "<= 11.5", ratio("peak_mb", 11.5, TEN, MILLION)),
    ("torus 1000000: wall time of the relaxation on one thread over two", ">= 1.7",
     ratio("relax_s", 1.7, MILLION, TWO, least=True)),
    ("torus 1000000: wall time of the whole job on one thread over two", ">= 1.6", ratio("wall_s", 1.6, MILLION, TWO, least=True)),
    ("torus 1000000: different points.ply with 1 2 3 and 8 threads", "1", same_bytes),
    ("ellipsoid 100000: CPU of spacing graded 10:1 over that of even spacing", "<= 1.5", ratio("cpu_s", 1.5, GRADED, EVEN)),
    ("ellipsoid 100000: CV of achieved over requested spacing", "<= 0.015", at_most("ellipsoid", 10 ** 5, "told_cv", 0.015)),
    ("quartic 1000: CPU s of the relaxation", "", seconds(*QUARTIC, "relax_cpu_s")),
    ("quartic 1000: CPU s of the whole process", "", seconds(*QUARTIC, "cpu_s")),
    ("quartic 1000: hex_fraction", ">= 0.93", at_most(*QUARTIC, "hex_fraction", 0.93, least=True)),
)
