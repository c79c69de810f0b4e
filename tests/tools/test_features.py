# SPDX-License-Identifier: Apache-2.0
"""measurements/meshes/features.py: its measures on meshes of known shape, and the worker's resolve on a thin shell with a handle whose
sheets are close."""
import pathlib
import sys

import numpy
import pytest

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2] / "measurements" / folder) for folder in ("common", "meshes")]
import features  # noqa: E402
import meshes  # noqa: E402
import results  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service


def tube(radius, steps=48, outwards=True):
    """A torus of major radius 1."""
    u, v = (g.ravel() for g in numpy.meshgrid(*[2 * numpy.pi * numpy.arange(steps) / steps] * 2, indexing="ij"))
    vertices = numpy.stack([(1 + radius * numpy.cos(v)) * numpy.cos(u), (1 + radius * numpy.cos(v)) * numpy.sin(u),
                            radius * numpy.sin(v)], axis=1)
    index = numpy.arange(steps * steps).reshape(steps, steps)
    a, b = index.ravel(), numpy.roll(index, -1, 0).ravel()
    d, c = numpy.roll(index, -1, 1).ravel(), numpy.roll(index, (-1, -1), (0, 1)).ravel()
    triangles = numpy.concatenate([numpy.stack([a, b, c], 1), numpy.stack([a, c, d], 1)])
    return vertices, triangles if outwards else triangles[:, ::-1]


def shell(outer, inner):
    (v, t), (w, s) = tube(outer), tube(inner, outwards=False)
    return numpy.concatenate([v, w]), numpy.concatenate([t, s + len(v)])


def write(path, vertices, triangles):
    path.write_text("\n".join([f"OFF\n{len(vertices)} {len(triangles)} 0"] + ["%r %r %r" % tuple(v) for v in vertices.tolist()] +
                              ["3 %d %d %d" % tuple(t) for t in triangles]) + "\n")


def test_topology_is_counted():
    _, triangles = shell(0.3, 0.2)
    whole = features.Topology(triangles)
    assert (whole.closed, whole.manifold, whole.parts, whole.genus) == (True, True, 2, 2)
    assert not features.Topology(triangles[1:]).closed
    flipped = numpy.concatenate([triangles[:1, ::-1], triangles[1:]])
    assert not features.Topology(flipped).closed
    pinched = numpy.where(triangles == triangles.max(), 0, triangles)
    joined = features.Topology(pinched)
    assert joined.closed and not joined.manifold


def test_feature_sizes_and_distances(monkeypatch):
    monkeypatch.setattr(features, "PLACES", 20000)
    monkeypatch.setattr(features, "DISTANT_PLACES", 20000)
    thin = meshes.Mesh(*shell(0.3, 0.2))
    point, normal = meshes.places(thin, 4000)
    axis = features.medial_axis(point, normal)
    # the middle of the wall, the circle of radius 1 within the hollow, and the torus' axis
    across = numpy.hypot(axis[:, 0], axis[:, 1])
    off = numpy.hypot(across - 1, axis[:, 2])
    assert len(axis) > 3000 and (numpy.minimum(numpy.minimum(abs(off - 0.25), off), across) < 0.04).mean() > 0.95
    moved = meshes.Mesh(thin.vertices + [0, 0, 0.01], thin.triangles)
    assert 0.1 < features.farthest(thin, moved, 0) < 0.35
    assert features.farthest(thin, moved, 0.1) <= 0.11
    right = numpy.array([[0, 0, 0], [3, 0, 0], [0, 4, 0]])
    assert abs(features.least_angles(right, numpy.array([[0, 1, 2]]))[0] - 36.87) < 0.01


def test_few_places_know_what_their_balls_touch():
    """Two plates: every place of either has its ball between them."""
    x, y = (g.ravel() for g in numpy.meshgrid(numpy.arange(10.0), numpy.arange(12.0)))
    up = numpy.tile([0.0, 0, 1], (len(x), 1))
    point = numpy.concatenate([numpy.stack([x, y, numpy.full(len(x), z)], axis=1) for z in (0.5, -0.5)])
    axis = features.medial_axis(point, numpy.concatenate([up, -up]))
    assert (abs(axis[:, 2]) < 0.01).sum() == len(point)


def test_a_thin_shell_with_a_handle_is_resolved(build, tmp_path, diagnose, monkeypatch):
    monkeypatch.setattr(features, "PLACES", 20000)
    monkeypatch.setattr(features, "DISTANT_PLACES", 60000)
    vertices, triangles = shell(0.4, 0.22)
    path = tmp_path / "shell.off"
    write(path, vertices, triangles)
    found = features.resolve(build / "hexad-worker", path, tmp_path, {"min_spacing": 0.04})
    cells = features.measure(*found)
    diagnose(" | ".join(text for text, _ in cells))
    assert all(good for _, good in cells)
    told = found[1]["grading"]["feature_size"]
    assert abs(told["median"] / 0.09 - 1) < 0.1 and told["below_floor"] == 0
    assert found[1]["reached"]["count"] == found[1]["count"]


def dented(path, count, depth):
    """A torus of which so many vertices are pushed in."""
    radius = 0.3
    vertices, triangles = tube(radius, 60)
    which = numpy.random.default_rng(1).choice(len(vertices), count, replace=False)
    middle = vertices * [1, 1, 0]
    middle /= numpy.linalg.norm(middle, axis=1)[:, None]
    vertices[which] -= depth * (vertices - middle)[which] / radius
    write(path, vertices, triangles)
    return path


def test_dents_as_large_as_the_spacing_are_reached(build, tmp_path, diagnose, monkeypatch):
    """Points lie around some of the dents, and one is held in each of these. A dent that none reaches is .375 away; of twenty seeds the
    farthest place is .31 to .343."""
    monkeypatch.setattr(features, "PLACES", 20000)
    monkeypatch.setattr(features, "DISTANT_PLACES", 60000)
    path = dented(tmp_path / "dented.off", 40, 0.06)
    given, report, result, spacing = features.resolve(build / "hexad-worker", path, tmp_path, {"min_spacing": 0.16})
    cells = features.measure(given, report, result, spacing)
    diagnose(" | ".join(text for text, _ in cells))
    whole = features.Topology(result[1])
    assert report["outcome"] == "converged"
    assert whole.manifold and whole.parts == whole.genus == 1
    assert float(cells[-1][0]) < 0.36


def test_rows_are_written_as_they_are_made(tmp_path, monkeypatch):
    """A run that is interrupted leaves its rows."""
    file = tmp_path / "features.csv"
    file.write_text("mesh\nold\n")
    report = {"timing_s": {"total": 1.0}}
    given = meshes.Mesh(numpy.eye(3), numpy.array([[0, 1, 2]]))

    def resolve(_worker, path, _work):
        if path.name == features.CASES[1]:
            raise KeyboardInterrupt
        return given, report, None, 0.5

    monkeypatch.setattr(features, "resolve", resolve)
    monkeypatch.setattr(features, "measure", lambda *_: tuple((str(k), k != 1) for k in range(8)))
    monkeypatch.setattr(sys, "argv", ["features.py", "--worker", "w", "--output", str(file), "--data", str(tmp_path)])
    with pytest.raises(KeyboardInterrupt):
        features.main()
    (row,) = results.read(file)
    assert list(row) == list(features.HEADER) and row["mesh"] == features.CASES[0]
    assert (row["least_spacing_thousandths"], row["points"], row["outcome"], row["missed"]) == ("500.00", "0", "1", "outcome")
