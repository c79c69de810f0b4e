# SPDX-License-Identifier: Apache-2.0
"""measurements/inputs/inputs.py on a collection of a few files: one that is good and one that is not, of each kind."""
import pathlib
import subprocess
import sys

import numpy
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests" / "service"), str(ROOT / "measurements" / "common")]
import results  # noqa: E402
from volumes import Part, write_exr, write_nrrd  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service

TETRAHEDRON = "OFF\n4 4 0\n1 1 1\n-1 -1 1\n-1 1 -1\n1 -1 -1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


def ball(size):
    index = numpy.stack(numpy.meshgrid(*[numpy.arange(n) for n in size], indexing="ij"), -1)
    return (10 - numpy.linalg.norm(index - (numpy.array(size) - 1) / 2, axis=-1)).astype("f4")


@pytest.fixture
def collection(tmp_path, build):
    data = tmp_path / "data"
    for folder in ("meshes", "vdb", "volumes", "exr", "malformed"):
        (data / folder).mkdir(parents=True)
        (data / folder / "README.md").write_text("not a file of the collection\n")
    (data / "meshes" / "good.off").write_text(TETRAHEDRON)
    write_nrrd(data / "volumes" / "good.nrrd", ball((30, 30, 30)))
    (data / "volumes" / "other.vti").write_text("<VTKFile>\n")
    write_exr(data / "exr" / "good.exr", Part({"A": numpy.zeros((30, 30), "f4"), "Y": ball((30, 30))}),)
    write_exr(data / "exr" / "parts.exr", Part({"Y": ball((30, 30))}, name="l"), Part({"Y": ball((30, 30))}, name="r"))
    (data / "malformed" / "cut|off.exr").write_bytes((data / "exr" / "good.exr").read_bytes()[:500])
    (data / "malformed" / "no.vdb").write_bytes(b"nothing")
    subprocess.run([build / "hexad-worker", "make-example", data / "vdb" / "good.vdb"], check=True)
    return data


def test_every_file_has_its_row(collection, source, build, tmp_path):
    done = subprocess.run([sys.executable, "-B", source / "measurements/inputs/inputs.py", "--worker", build / "hexad-worker",
                           "--data", collection, "--output", tmp_path / "files.csv", "--summary", tmp_path / "folders.csv",
                           "--agreement", tmp_path / "agreement.csv", "--counts", "500", "1000"], capture_output=True, text=True)
    text = (tmp_path / "files.csv").read_text()
    assert done.returncode == 0, text
    assert str(tmp_path) not in text
    rows = {}
    for row in results.read(tmp_path / "files.csv"):
        rows.setdefault(row["file"], []).append(row)
    assert len({row["job"] for found in rows.values() for row in found}) == sum(map(len, rows.values()))  # the first column names the row
    assert set(rows) == {"good.off", "good.vdb", "good.nrrd", "other.vti", "good.exr", "parts.exr", "cut|off.exr", "no.vdb"}
    for name in ("good.off", "good.vdb", "good.nrrd", "parts.exr"):
        assert [(row["points"], row["outcome"] != "error") for row in rows[name]] == [("500", True), ("1000", True)], rows[name]
    assert 0.4 < float(rows["good.off"][0]["measured_coverage"]) < 1 and rows["good.off"][0]["measured_missing_share"] == "0"
    (row,) = rows["good.exr"]  # its first channel is 0 everywhere
    assert "channel A" in row["surface"] and row["code"] == "no_surface" and row["message"]
    assert "part l" in rows["parts.exr"][0]["surface"] and "isovalue" in rows["good.nrrd"][0]["surface"]
    assert [rows[name][0]["code"] for name in ("other.vti", "cut|off.exr", "no.vdb")] == ["input_unsupported", "input_damaged", "input_damaged"]
    folders = {row["folder"]: row for row in results.read(tmp_path / "folders.csv")}
    assert [folders["all"][name] for name in ("files", "results", "errors", "unsound")] == ["8", "8", "4", "0"]
    assert [folders["malformed"][name] for name in ("files", "results", "input_damaged")] == ["2", "0", "2"]
    measures = {row["measure"]: row for row in results.read(tmp_path / "agreement.csv")}
    assert measures["coverage"]["meshes"] == "2" and float(measures["coverage"]["difference_largest"]) < 0.2


def test_results_are_made_in_pieces(collection, source, build, tmp_path):
    """Rows of the same worker stay, rows of another are made again; a piece without time ends with 3."""
    def make(*options):
        done = subprocess.run([sys.executable, "-B", source / "measurements/inputs/inputs.py", "--worker", worker, "--data", collection,
                               "--output", file, "--counts", "500", "--only", "malformed", "--resume", *options],
                              capture_output=True, text=True)
        return done.returncode, done.stderr.count(", error, ")
    worker, file = tmp_path / "worker", tmp_path / "files.csv"
    worker.write_text(f'#!/bin/sh\nexec "{build}/hexad-worker" "$@"\n')
    worker.chmod(0o755)
    assert make("--seconds", "0") == (3, 0) and not file.exists()
    assert make() == (0, 2)
    whole = file.read_text()
    assert make() == (0, 0) and file.read_text() == whole
    file.write_text(whole.replace("no.vdb,vdb,", "no.vdb,kept,"))
    assert make("--only", "no.vdb") == (0, 0) and "no.vdb,kept," in file.read_text()
    worker.write_text(worker.read_text() + "# another\n")
    assert make() == (0, 2) and "no.vdb,vdb," in file.read_text()


def test_summaries_agree_with_the_results(source, monkeypatch):
    """Those of the repository."""
    for folder in ("common", "inputs"):
        monkeypatch.syspath_prepend(str(source / "measurements" / folder))
    import inputs
    folder = source / "measurements/inputs"
    rows = [list(row.values()) for row in results.read(folder / "files.csv")]
    assert len({row[0] for row in rows}) == len(rows) > 300 and all(len(row) == len(inputs.HEADER) for row in rows)
    for file, found in (("folders.csv", inputs.summary(rows)), ("agreement.csv", inputs.agreement(rows))):
        assert [list(row.values()) for row in results.read(folder / file)] == [list(map(str, row)) for row in found]


CORNER = 1.0 * numpy.array([[1, 1, 1], [-1, -1, 1], [-1, 1, -1], [1, -1, -1]])
FACE = numpy.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


@pytest.fixture
def tools(source, monkeypatch):
    for folder in ("common", "inputs"):
        monkeypatch.syspath_prepend(str(source / "measurements" / folder))
    import mesh_measures
    import meshes
    return meshes, mesh_measures


def test_missing_area_is_found(tools):
    """Points on one face of a tetrahedron leave out the three others; a shell within another does not count."""
    meshes, mesh_measures = tools
    mesh = meshes.Mesh(numpy.concatenate([CORNER, 0.2 * CORNER]), numpy.concatenate([FACE, FACE + 4]))
    outer = meshes.places(meshes.Mesh(CORNER, FACE), 6000)[0]
    spacing = 0.2
    whole = mesh_measures.measure(mesh, outer, numpy.full(len(outer), spacing))
    assert whole.coverage < 1.2 and whole.missing_share == 0 and whole.max_residual < 1e-6
    some = outer[(outer @ [1, 1, -1]) > 1 - 1e-9]
    part = mesh_measures.measure(mesh, some, numpy.full(len(some), spacing))
    # the three other faces, but for strips beside the face with points whose width is 0.24 over the sine of the angle between faces
    strips = 3 * 8 ** 0.5 * 0.24 / (8 / 9) ** 0.5 / (16 * 0.75 ** 0.5)
    assert part.coverage > 10 and abs(part.missing_share - 0.75 + strips) < 0.02
    assert {"coverage", "missing_share"} <= set(part.failed())


def test_ten_points_of_a_tetrahedron_have_the_ideal_degree(tools):
    meshes, mesh_measures = tools
    points = numpy.concatenate([CORNER, [(CORNER[i] + CORNER[j]) / 2 for i in range(4) for j in range(i)]])
    found = mesh_measures.measure(meshes.Mesh(CORNER, FACE), points, numpy.full(10, 2 ** 0.5))
    assert found.hex_fraction == 1 and found.edge_cv < 1e-9 and abs(found.min_spacing_ratio - 1) < 1e-9
    assert numpy.allclose(found.ideal_degree, [3] * 4 + [6] * 6) and found.failed() == []


def lattice(rows, columns):
    i, j = numpy.meshgrid(numpy.arange(columns), numpy.arange(rows))
    return numpy.stack([i + 0.5 * (j % 2), j * 0.75 ** 0.5, 0.0 * i], axis=-1).reshape(-1, 3)


def box(low, high):
    corner = numpy.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * (numpy.array(high) - low) + low
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corner, numpy.array([(a, b, c) for q in quads for a, b, c in ((q[0], q[1], q[2]), (q[0], q[2], q[3]))])


def test_points_on_borders_have_cells(tools):
    """A lattice on an open rectangle: only the sides without points of their own have others than the ideal degree."""
    meshes, mesh_measures = tools
    points = lattice(30, 30)
    across, up = points[:, :2].max(axis=0)
    sheet = meshes.Mesh([[0, 0, 0], [across, 0, 0], [across, up, 0], [0, up, 0]], [[0, 1, 2], [0, 2, 3]])
    found = mesh_measures.measure(sheet, points, numpy.ones(len(points)))
    inner = ((points[:, :2] > 0.6) & (points[:, :2] < [across - 0.6, up - 0.6])).all(axis=1)
    assert (found.degree[inner] == 6).all() and 0.9 < found.hex_fraction < 1
    below = (points[:, 1] == 0) & (points[:, 0] > 0) & (points[:, 0] < across - 0.6)
    assert (found.ideal_degree[below] == 4).all() and (found.degree[below] == 4).all()
    assert found.edge_cv < 1e-9 and found.unmeasured_share == 0 and 0.5 < found.coverage < 0.6 and found.failed() == []


@pytest.mark.parametrize("points, criterion", [("both walls", None), ("one wall", "missing_share"), ("double row", "close_share")])
def test_walls_of_a_thin_plate(tools, points, criterion):
    """Opposite walls do not count as near each other; a wall without points and points of one wall twice are found."""
    meshes, mesh_measures = tools
    flat = lattice(20, 20)
    across, up = flat[:, :2].max(axis=0)
    above = flat + [0, 0, 0.3]
    place = {"both walls": [flat, above], "one wall": [flat], "double row": [flat, above, flat[40:60] + [0.1, 0.05, 0]]}[points]
    place = numpy.concatenate(place)
    found = mesh_measures.measure(meshes.Mesh(*box([0, 0, 0], [across, up, 0.3])), place, numpy.ones(len(place)))
    if criterion:
        assert criterion in found.failed()
    else:
        assert "missing_share" not in found.failed() and found.missing_share == 0


def test_a_part_without_points_is_found(tools):
    meshes, mesh_measures = tools
    mesh = meshes.Mesh(numpy.concatenate([CORNER, CORNER + [9, 0, 0]]), numpy.concatenate([FACE, FACE + 4]))
    place = meshes.places(meshes.Mesh(CORNER, FACE), 800)[0]
    found = mesh_measures.measure(mesh, place, numpy.full(len(place), 0.3))
    assert found.parts_without_points == 1 and abs(found.empty_area_share - 0.5) < 1e-9
    assert "parts_without_points" in found.failed()


def test_triangles_behind_many_others_are_not_missed(source):
    """Points on a large triangle, and many small ones beside them whose places are all nearer than its own."""
    sys.path[:0] = [str(source / "measurements" / folder) for folder in ("common", "inputs")]
    import meshes
    random = numpy.random.default_rng(1)
    large = numpy.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    on = numpy.array([[.3, .4, 0], [.25, .5, 0]])
    small = numpy.repeat(on, 40, axis=0)[:, None] + [0, 0, .001] + random.normal(size=(80, 3, 3)) * .0002
    mesh = meshes.Mesh(numpy.concatenate([large, small.reshape(-1, 3)]), numpy.arange(243).reshape(-1, 3))
    meshes.CANDIDATES, before = 4, meshes.CANDIDATES
    try:
        assert mesh.nearest(on)[0].max() > 2e-4 and mesh.farthest(on, numpy.ones(2)) < 1e-9
    finally:
        meshes.CANDIDATES = before


def test_concave_polygons_of_an_obj_keep_their_area(tools, tmp_path):
    comb = [(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)]
    (tmp_path / "comb.obj").write_text("".join(f"v {x} {y} 7\n" for x, y in comb) +
                                       f"f {' '.join(str(k + 1) for k in range(len(comb)))} # a face\n")
    mesh = tools[0].read(tmp_path / "comb.obj")
    assert len(mesh.triangles) == len(comb) - 2 and abs(mesh.area - 8) < 1e-12


def test_a_crash_of_the_worker_is_not_sound(collection, source, tmp_path):
    worker = tmp_path / "worker"
    worker.write_text("#!/bin/sh\nkill -SEGV $$\n")
    worker.chmod(0o755)
    done = subprocess.run([sys.executable, "-B", source / "measurements/inputs/inputs.py", "--worker", worker, "--data", collection,
                           "--only", "good.off", "--output", tmp_path / "files.csv"], capture_output=True, text=True)
    (row,) = results.read(tmp_path / "files.csv")
    assert done.returncode == 1 and row["unsound"] == "an error that is not the file's"
