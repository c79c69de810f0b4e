# SPDX-License-Identifier: Apache-2.0
"""The benchmark: its measures, its judgements, and a short run of it."""
import json
import math
import pathlib
import subprocess
import sys
import types

import numpy
import pytest

BENCH = pathlib.Path(__file__).resolve().parents[2] / "measurements" / "speed"
sys.path[:0] = [str(BENCH), str(BENCH.parent / "common")]

import bench  # noqa: E402
import claims  # noqa: E402
import measure_costs  # noqa: E402
import packing  # noqa: E402
import prepared_inputs  # noqa: E402
import samplers  # noqa: E402
import results  # noqa: E402
import surfaces  # noqa: E402
import tables  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service


@pytest.fixture(scope="module")
def smoke(source, build, tmp_path_factory):
    where = tmp_path_factory.mktemp("bench")
    subprocess.run([sys.executable, source / "measurements/speed/bench.py", "--built", build, "--output", where, "--tools", "hexad", "--surfaces", "torus,quartic-formula",
                    "--counts", "1e3", "--runs", "1"], check=True)
    return where


def test_rows_of_a_short_run(smoke):
    told = json.loads((smoke / "results.json").read_text())
    assert [(r["tool"], r["surface"], r["got"]) for r in told["rows"]] == [
        ("hexad", "torus", 1000), ("hexad", "quartic-formula", 1000)]
    for row in told["rows"]:
        assert row["run"] == told["run"]["id"]
        assert row["hex_fraction"] > 0.85 and row["edge_cv"] < 0.08 and row["residual"] < 1e-3
        assert row["cpu_s"] > 0 and row["wall_s"] >= row["total_s"] > 0 and row["peak_mb"] > 1


def test_tables_of_a_short_run(smoke):
    rows = {r["row"]: r for r in results.read(smoke / "samplers.csv")}
    assert list(rows) == ["quartic-formula 1000 hexad", "torus 1000 hexad"]
    assert rows["torus 1000 hexad"]["points"] == "1000" and float(rows["torus 1000 hexad"]["hex_fraction"]) > 0.85
    bounds = {r["row"]: r["verdict"] for r in results.read(smoke / "bounds.csv")}
    assert bounds["quartic 1000: CPU s of the whole process"] == "none"
    assert bounds["torus 100000: hex_fraction"] == "not in this run" and not (smoke / "comparison.csv").exists()


def test_continued_run_keeps_its_rows(smoke, source, build, tmp_path):
    kept = tmp_path / "results.json"
    kept.write_text((smoke / "results.json").read_text())
    command = [sys.executable, source / "measurements/speed/bench.py", "--built", build, "--output", tmp_path,
               "--surfaces", "quartic-formula", "--counts", "1e4", "--continue"]
    subprocess.run(command, check=True)
    assert len(json.loads(kept.read_text())["rows"]) == 2
    told = json.loads(kept.read_text())
    told["run"]["worker"] = "of another build"
    kept.write_text(json.dumps(told))
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode != 0 and "another build" in done.stderr


def test_limits_of_a_short_run(source, build, tmp_path):
    output = tmp_path / "limits.csv"
    subprocess.run([sys.executable, source / "measurements/speed/limits.py", "--worker", build / "hexad-worker", "--output", output,
                    "--count", "500", "--only", "sphere", "torus"], check=True)
    rows = results.read(output)
    assert [r["row"] for r in rows] == ["sphere 500", "torus 500"]
    for r in rows:
        assert float(r["hex_fraction"]) > 0.8 and float(r["cpu_us_per_point"]) == pytest.approx(float(r["cpu_s"]) / 500e-6, rel=0.05)


def test_shares_of_measuring():
    header, rows = measure_costs.table([("torus", 10, 2.0, 1.0, "converged"), ("cup", 10, 4.0, 1.0, "not_converged")])
    assert [dict(zip(header, r))["share"] for r in rows] == [0.5, 0.25, 0.375, 0.5]
    assert [r[0] for r in rows] == ["torus 10", "cup 10", "median of 10", "largest of 10"] and rows[1][3] == "not converged"


# ---- what is measured

def test_distance_from_an_ellipsoid():
    """Along the normals of known places, inside and outside, within the least radius of curvature."""
    shape = surfaces.Ellipsoid([1.0, 0.6, 0.325], (0.1, 0.2, 0.3))
    u = numpy.random.default_rng(1).standard_normal((500, 3))
    u /= numpy.linalg.norm(u, axis=1)[:, None]
    place = shape.center + u * shape.radii
    normal = u / shape.radii
    normal /= numpy.linalg.norm(normal, axis=1)[:, None]
    for distance in (-0.09, -0.01, 0.0, 0.2, 3.0):
        away = place + distance * normal
        assert numpy.abs(shape.value(away) - distance).max() < 1e-8
        assert numpy.abs(shape.foot(away) - place).max() < 1e-6
        assert numpy.abs(shape.normal(away) - normal).max() < 1e-6
    # between two feet, at (x r0^2 / (r0^2 - r2^2), 0, +-z)
    foot = 0.5 / (1 - 0.325 ** 2)
    far = math.hypot(foot - 0.5, 0.325 * math.sqrt(1 - foot ** 2))
    assert shape.value(shape.center + [[0.5, 0.0, 0.0]])[0] == pytest.approx(-far, rel=1e-6)


def test_area_of_an_ellipsoid():
    """Of a prolate one: 2 pi a^2 (1 + c / (a e) asin e)."""
    a, c = 0.5, 1.2
    e = math.sqrt(1 - (a / c) ** 2)
    area = 2 * math.pi * a * a * (1 + c / (a * e) * math.asin(e))
    assert surfaces.Ellipsoid([a, a, c]).area == pytest.approx(area, rel=1e-9)


def test_files_of_an_input(tmp_path, monkeypatch):
    """Triangles and spacings: closed, on the surface, and as many ideal cells as were asked for."""
    monkeypatch.setitem(prepared_inputs.SURFACES["ellipsoid"], "voxels", 48)
    given = prepared_inputs.Input("ellipsoid", None, tmp_path)
    vertices = given.triangles.vertices
    assert numpy.abs(given.truth.value(vertices)).max() < 1e-9
    assert given.triangles.area == pytest.approx(given.area, rel=1e-2)
    middle = vertices[given.triangles.triangles].mean(axis=1)
    asked = given.requested(middle, 10000)
    assert (given.triangles.areas / asked ** 2).sum() * 2 / math.sqrt(3) == pytest.approx(10000, rel=1e-6)
    assert asked.max() / asked.min() == pytest.approx(prepared_inputs.RATIO, rel=0.05)
    size = [int(n) for n in given.path("nhdr").read_text().split("sizes: ")[1].splitlines()[0].split()]
    assert given.path("raw").stat().st_size == given.path("spacing").stat().st_size == 4 * math.prod(size)


def test_windows_tell_what_the_whole_tells(build, tmp_path, monkeypatch):
    given = prepared_inputs.Input("torus-formula", None, tmp_path)
    places, _ = samplers.Hexad().run(given, 5000, 1, 600, build, tmp_path)
    whole = packing.of(given, places)
    monkeypatch.setattr(packing, "MOST", 4000)
    monkeypatch.setattr(packing, "IN_WINDOW", 1500)
    windows = packing.of(given, places)
    assert windows["windows"] and not whole["windows"]
    assert windows["hex_fraction"] == pytest.approx(whole["hex_fraction"], abs=0.02)
    assert windows["edge_cv"] == pytest.approx(whole["edge_cv"], rel=0.1)
    assert windows["energy_excess"] == pytest.approx(whole["energy_excess"], abs=0.003)


# ---- how it is told

def test_timed_tells_memory_and_code():
    took = samplers.timed([sys.executable, "-c", "x = bytearray(2 ** 26); raise SystemExit(3)"], 60)
    assert took["code"] == 3 and 64 < took["peak_mb"] < 164


def test_timed_stops_what_takes_too_long():
    with pytest.raises(samplers.Failed, match="stopped after"):
        samplers.timed(["sh", "-c", "sleep 600; true"], 0.1)


@pytest.mark.parametrize("kind,code", [("float", "<f4"), ("double", "<f8")])
def test_positions_of_a_ply(tmp_path, kind, code):
    path = tmp_path / "points"
    names = ("x", "y", "z", "spacing")
    table = numpy.arange(8, dtype=code).reshape(2, 4)
    head = "".join(f"property {kind} {n}\n" for n in names)
    path.write_bytes(f"ply\nformat binary_little_endian 1.0\nelement vertex 2\n{head}element face 0\n"
                     "property list uchar int vertex_indices\nend_header\n".encode() + table.tobytes())
    places, spacing = samplers.read_ply(path)
    assert places.tolist() == [[0, 1, 2], [4, 5, 6]] and spacing.tolist() == [3, 7]


def row(tool, cpu_s, surface="torus", asked=10 ** 5, threads=1, **more):
    return {"run": "r", "tool": tool, "surface": surface, "asked": asked, "threads": threads, "cpu_s": cpu_s, **more}


def judged(rows):
    return {name: judge(rows) for name, _, judge in claims.CLAIMS}


def test_ratio_is_to_the_faster_peer():
    relaxations, meshers = (name for name, *_ in claims.CLAIMS[:2])
    rows = [row("hexad", 1.0), row("teem", 100.0), row("vtk-smoothing", 59.0)]
    assert judged(rows)[relaxations] == (59.0, False)
    assert judged(rows[:2])[relaxations] == (100.0, True)
    assert judged(rows[:1])[relaxations] is None
    assert judged([*rows, row("cgal-remesh", 1.1), row("cgal-surface", 0.9)])[meshers] == (0.9, False)


@pytest.mark.parametrize("seconds", [0.001, 1000.0])
def test_seconds_have_no_verdict(seconds):
    told = {"rows": [row("hexad", seconds, surface="quartic-formula", asked=1000, relax_cpu_s=seconds)]}
    verdicts = {name: (measured, verdict) for name, _, measured, verdict in tables.bounds(told)[1]}
    assert verdicts["quartic 1000: CPU s of the whole process"] == (seconds, "none")
    assert verdicts["quartic 1000: CPU s of the relaxation"] == (seconds, "none")
    assert "missed" not in tables.summary(told)


def test_bytes_are_the_same_only_if_all_are():
    rows = [row("hexad", 1.0, asked=10 ** 6, threads=t, sha256="a") for t in (1, 2, 3)]
    assert claims.same_bytes(rows) is None
    assert claims.same_bytes([*rows, row("hexad", 1.0, asked=10 ** 6, threads=8, sha256="a")])[1] is True
    assert claims.same_bytes([*rows, row("hexad", 1.0, asked=10 ** 6, threads=8, sha256="b")])[1] is False


def told_of(rows):
    return {"run": {"id": "r"}, "surfaces": {"bunny-128": {"missing": "there is no bunny"}}, "rows": rows,
            "peers": {p.name: {"title": p.title, "package": p.package, "version": "1"} for p in bench.ALL}}


def test_row_without_figures_has_its_reason():
    teem = {"run": "r", "tool": "teem", "surface": "torus", "asked": 10 ** 5, "threads": 1}
    rows = [row("hexad", 2.0, got=10 ** 5), {**teem, "missing": "left out: foretold to take 400 s"}]
    head, lines = tables.samplers(told_of(rows))
    assert [line[-2] for line in lines] == [None, "left out: foretold to take 400 s", "there is no bunny"]
    assert all(len(line) == len(head) for line in lines)
    assert judged(rows)[claims.CLAIMS[0][0]] is None


def test_comparison_has_the_tools_by_time():
    rows = [row("teem", 9.0, cpu_s_least=8.0, cpu_s_most=9.5), row("hexad", 1.0), row("hexad", 0.5, threads=2), row("acvd", 3.0),
            row("hexad", 0.1, asked=1000)]
    head, lines = tables.comparison(told_of(rows))
    assert [line[0] for line in lines] == ["hexad", "ACVD", "Teem pull"]
    assert [line[head.index("cpu_s_least")] for line in lines] == [None, None, 8.0]


def test_missed_bounds_are_in_the_summary():
    rows = [row("hexad", 1.0, hex_fraction=0.9)]
    assert "missed: torus 100000: hex_fraction: 0.9, bound >= 0.98" in tables.summary(told_of(rows))


DRIVEN = """#!/bin/sh
# writes its arguments and a point to the PLY that it is given
for word; do case $word in *points.ply) file=$word; esac; done
[ "$file" = points.ply ] && file=$9/points.ply
echo "$@" >>"$ARGUMENTS"
printf 'ply\nformat binary_little_endian 1.0\nelement vertex 0\nproperty float x\nproperty float y\nproperty float z\nend_header\n' >"$file"
"""


@pytest.mark.parametrize("name,words", [("geogram", ["remesh:nb_pts=1000", "algo:random_seed=7", "sys:multithread=false"]),
                                        ("acvd", [" 1000 0 ", "-s 10 "]), ("fine-acvd", [" 1000 0 ", "-s 100 "])])
def test_driver_of_a_built_peer(tmp_path, monkeypatch, name, words):
    """A program in place of the peer gets the count and the seed; without the variable the peer is left out."""
    peer = next(p for p in samplers.PEERS if p.name == name)
    monkeypatch.delenv(peer.variable, raising=False)
    with pytest.raises(prepared_inputs.Absent, match=peer.variable):
        peer.version(None)
    program = tmp_path / "program"
    program.write_text(DRIVEN)
    program.chmod(0o755)
    monkeypatch.setenv(peer.variable, str(program))
    monkeypatch.setenv("ARGUMENTS", str(tmp_path / "arguments"))
    assert peer.version(None) == "built from source"
    surface = types.SimpleNamespace(prefix=tmp_path / "torus", scale=lambda count: 0.1)
    places, took = peer.run(surface, 1000, 7, 60, None, tmp_path)
    assert places.shape == (0, 3) and took["code"] == 0
    said = (tmp_path / "arguments").read_text()
    assert str(tmp_path / "torus.ply") in said and all(word in said for word in words)


class Slow:
    """A sampler that says how long it takes, and cannot do a thousand."""
    name, threads = "slow", 1

    def accepts(self, surface, count):
        return True

    def run(self, surface, count, seed, *_):
        if count == 1000:
            raise samplers.Failed("failed with 1: no")
        return [None] * count, {"cpu_s": float(seed), "wall_s": 10.0, "peak_mb": 1.0}


@pytest.mark.parametrize("budget,runs", [(25.0, 2), (1000.0, 5)])
def test_as_many_runs_as_the_budget_allows(monkeypatch, budget, runs):
    monkeypatch.setattr(packing, "of", lambda *_: {})
    options = types.SimpleNamespace(runs=5, budget=budget, built=None)
    row = bench.run_case(Slow(), None, 10, 0.0, options, None)
    assert row["runs"] == runs and row["cpu_s"] == (1 + runs) / 2
    assert (row["cpu_s_least"], row["cpu_s_most"]) == (1.0, float(runs))


def test_what_takes_too_long_or_fails_is_left_out_and_said():
    options = types.SimpleNamespace(runs=1, budget=50.0, built=None, counts=[1000, 10000])
    with pytest.raises(samplers.Failed, match="to take 100 s"):
        bench.run_case(Slow(), None, 10, 100.0, options, None)
    told = types.SimpleNamespace(rows=[])
    told.add = told.rows.append
    bench.run_surface(types.SimpleNamespace(name="sphere"), options, [Slow()], told, None)
    assert [r["missing"] for r in told.rows] == [
        "failed with 1: no", "left out, as 1000 points are"]
