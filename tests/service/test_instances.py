# SPDX-License-Identifier: Apache-2.0
"""output.orient and output.usd.instancer, read by a parser of USD's text that is none of hexad's, and by NumPy."""
import json
import math
import re

import numpy
import pytest

from readers import EVERY, read_columns, read_mesh
from scenes import read_glb, stack
from service import sphere
from volumes import write_nrrd

TOKEN = re.compile(r"""\s+|(?P<asset>@@@.*?@@@|@[^@\n]*@)|(?P<path><[^>]*>)|"""
                   r"""(?P<text>"[^"\n]*")|"""
                   r"""(?P<number>[-+]?(?:\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+|inf|nan)(?!\w))|"""
                   r"""(?P<name>[A-Za-z_][\w:.]*(?:\[\])?)|(?P<mark>[(){}\[\]=,:])""")


class Usda:
    """Prims by path: type, metadata, attributes {name: (type, value)}, relations; by the grammar of USD's text."""

    def __init__(self, text):
        assert text.startswith("#usda 1.0\n")
        body = text.partition("\n")[2]
        self.tokens, at = [], 0
        while at < len(body):
            found = TOKEN.match(body, at)
            assert found, body[at:at + 40]
            at = found.end()
            if found.lastgroup:
                self.tokens.append((found.lastgroup, found[0]))
        self.at, self.prims = 0, {}
        self.stage = self.metadata() if self.peek() == "(" else {}
        while self.at < len(self.tokens):
            self.prim("")

    def peek(self, ahead=0):
        return self.tokens[self.at + ahead][1]

    def take(self, expected=None):
        kind, text = self.tokens[self.at]
        assert expected in (None, text), (text, expected, self.at)
        self.at += 1
        return kind, text

    def value(self):
        kind, text = self.take()
        if text in "([":
            items = []
            while self.peek() not in ")]":
                items.append(self.value())
                if self.peek() == ",":
                    self.take()
            self.take(")" if text == "(" else "]")
            return items
        if text == "{":
            samples = {}
            while self.peek() != "}":
                time = float(self.take()[1])
                self.take(":")
                samples[time] = self.value()
                if self.peek() == ",":
                    self.take()
            self.take("}")
            return samples
        assert kind in ("number", "text", "asset", "path"), text
        return float(text) if kind == "number" else text

    def metadata(self):
        """Of a stage, a prim or an attribute: in brackets; only names and plain values."""
        found = {}
        self.take("(")
        while self.peek() != ")":
            words = [self.take()[1]]
            while self.peek() != "=":
                words.append(self.take()[1])
            self.take("=")
            found[" ".join(words)] = self.value()
        self.take(")")
        return found

    def prim(self, parent):
        self.take("def")
        kind = self.take()[1] if self.tokens[self.at][0] == "name" else None
        path = f"{parent}/" + self.take()[1].strip('"')
        entry = self.prims[path] = {"type": kind, "attributes": {}, "relations": {}, "of": {}}
        entry["metadata"] = self.metadata() if self.peek() == "(" else {}
        self.take("{")
        while self.peek() != "}":
            if self.peek() == "def":
                self.prim(path)
                continue
            words = [self.take()[1]]
            while self.peek() not in ("=", "(") and self.tokens[self.at][0] == "name" and len(words) < 3:
                words.append(self.take()[1])
            if words[0] == "uniform":
                words.pop(0)
            kind, name = words
            if self.peek() == "(":
                entry["of"][name] = self.metadata()
            if self.peek() != "=":
                entry["attributes"][name] = (kind, None)
                continue
            self.take("=")
            value = self.value()
            if self.peek() == "(":
                entry["of"][name] = self.metadata()
            (entry["relations"] if kind == "rel" else entry["attributes"])[name.removesuffix(".timeSamples")] = \
                value if kind == "rel" else (kind, value)
        self.take("}")


def turned(quaternions, x):
    """A vector turned by unit quaternions x y z w."""
    v, w = quaternions[:, :3], quaternions[:, 3:]
    t = 2 * numpy.cross(v, x)
    return x + w * t + numpy.cross(v, t)


@pytest.fixture
def run(worker, tmp_path):
    """Runs a job that must succeed; its directory and the columns of points.ply."""
    def call(spec, where="out", *words):
        done = worker(spec, *words, output=where)
        assert done.returncode in (0, 10, 11), done.stderr
        return tmp_path / where, read_columns((tmp_path / where / "points.ply").read_bytes())
    return call


def job(count=200, **output):
    return sphere(count, output={"preview": False, "ply": {"precision": "double", **EVERY}, **output})


def orient_of(columns):
    return stack(columns, "orient_x", "orient_y", "orient_z", "orient_w")


@pytest.fixture
def fields(tmp_path):
    """Attributes of a sphere: an angle, and a vector."""
    n = 12
    rng = numpy.random.default_rng(5)
    matrix = numpy.diag([0.3, 0.3, 0.3, 1.0])
    matrix[:3, 3] = -1.6
    write_nrrd(tmp_path / "angle.nrrd", (4 * rng.random((n, n, n))).astype("f4"), matrix)
    return [{"from": str(tmp_path / "angle.nrrd"), "as": "angle"},
            {"from": "geometry", "name": "direction1", "as": "along"}]


@pytest.mark.sanitized
def test_every_format_has_the_quaternions(run):
    where, columns = run(job(orient=True, points_npz=True, points_glb=True, points_usda=True, points_vdb=True,
                             mesh=True, mesh_usda=True))
    orient, normal = orient_of(columns), stack(columns, "nx", "ny", "nz")
    assert numpy.abs((orient ** 2).sum(1) - 1).max() < 1e-14 and (orient[:, 3] >= 0).all()
    assert numpy.abs(turned(orient, numpy.array([0, 0, 1.0])) - normal).max() < 1e-14
    assert (orient[:, 2] == 0).all()  # the shortest way
    with numpy.load(where / "points.npz") as arrays:
        assert arrays["orient"].shape == (200, 4) and (arrays["orient"] == orient).all()
    of_gltf, _ = read_glb((where / "points.glb").read_bytes())
    assert (of_gltf["_ORIENT"] == orient.astype("f4")).all()
    for name, path in (("points.usda", "/points"), ("mesh.usda", "/mesh")):
        kind, value = Usda((where / name).read_text()).prims[path]["attributes"]["primvars:orient"]
        assert kind == "quatf[]" and (numpy.array(value, "f4") == orient[:, [3, 0, 1, 2]].astype("f4")).all()  # w first
    data = (where / "points.vdb").read_bytes()
    assert b"orient" in data and b"quats" in data  # the worker has compared the values that the library reads
    names, vertices, _ = read_mesh((where / "mesh.ply").read_bytes())
    at = names.index("orient_x")
    assert (vertices[:, at:at + 4] == orient).all()
    plain = job(points_npz=True)
    where, columns = run(plain, "plain")
    assert "orient_x" not in columns
    with numpy.load(where / "points.npz") as arrays:
        assert "orient" not in arrays


def test_a_twist_comes_from_a_seed_or_an_attribute(run, fields):
    z, x = numpy.array([0, 0, 1.0]), numpy.array([1.0, 0, 0])
    _, plain = run(job(orient=True), "plain")
    normal, untwisted = stack(plain, "nx", "ny", "nz"), orient_of(plain)

    def angles(orient):
        ahead, axis = turned(orient, x), turned(untwisted, x)
        return numpy.arctan2((ahead * numpy.cross(normal, axis)).sum(1), (ahead * axis).sum(1)) % (2 * math.pi)

    found = {}
    for seed in (1, 2, 1):
        _, columns = run(job(orient={"seed": seed}), f"seed{seed}")
        assert numpy.abs(turned(orient_of(columns), z) - normal).max() < 1e-14
        assert (found.setdefault(seed, orient_of(columns)) == orient_of(columns)).all()
        even, _ = numpy.histogram(angles(orient_of(columns)), 4, (0, 2 * math.pi))
        assert even.min() > 25
    assert (found[1] != found[2]).any()
    for twist in ("angle", "along"):
        spec = job(orient={"twist": twist})
        spec["attributes"] = fields
        _, columns = run(spec, twist)
        assert numpy.abs(turned(orient_of(columns), z) - normal).max() < 1e-14
        if twist == "angle":
            off = angles(orient_of(columns)) - columns["angle"] % (2 * math.pi)
            assert numpy.abs((off + math.pi) % (2 * math.pi) - math.pi).max() < 1e-6
        else:
            along = stack(columns, "along_x", "along_y", "along_z")
            assert numpy.abs(turned(orient_of(columns), x) - along).max() < 1e-6


def test_up_replaces_the_normal(run, fields):
    """At every point, also for a direction along -z, with all twists; the normals stay."""
    z, x = numpy.array([0, 0, 1.0]), numpy.array([1.0, 0, 0])
    _, plain = run(job(), "plain")
    for number, (up, twist) in enumerate([([0, 1, 0], {}), ([0, 0, -2], {}), ([3, -4, 12], {"seed": 1}), ([0, 2, 0], {"twist": "along"})]):
        axis = numpy.array(up) / numpy.linalg.norm(up)
        spec = job(orient={"up": up, **twist}, points_usda=True, usd={"instancer": {"prototype": "tree.usda"}})
        spec["attributes"] = fields
        where, columns = run(spec, f"up{number}")
        orient = orient_of(columns)
        assert numpy.abs(turned(orient, z) - axis).max() < 1e-14
        assert (stack(columns, "nx", "ny", "nz") == stack(plain, "nx", "ny", "nz")).all()
        assert (len(numpy.unique(orient, axis=0)) == 1) == (not twist)
        prim = Usda((where / "points.usda").read_text()).prims["/points"]
        assert (numpy.array(prim["attributes"]["orientationsf"][1], "f4") == orient[:, [3, 0, 1, 2]].astype("f4")).all()
        if "twist" in twist:
            along = stack(columns, "along_x", "along_y", "along_z") * [1, 0, 1]  # the part across `up`
            length = numpy.linalg.norm(along, axis=1)
            assert numpy.abs(turned(orient, x) * length[:, None] - along)[length > 0.01].max() < 1e-5


@pytest.mark.sanitized
def test_points_of_usd_are_instances(run):
    """Far from the origin, with the order of all outputs."""
    spec = job(points_usda=True, order="progressive", orient={"seed": 3},
               usd={"instancer": {"prototype": "./assets/rock@2.usda", "size": 0.5}})
    spec["surface"]["analytic"]["center"] = [1e6, -2e6, 3]
    spec["attributes"] = [{"from": "geometry", "name": "direction1", "as": "along"}]
    where, columns = run(spec)
    text = (where / "points.usda").read_text()
    usda = Usda(text)
    prim = usda.prims["/points"]
    assert usda.stage["defaultPrim"] == '"points"' and prim["type"] == "PointInstancer"
    assert list(usda.prims) == ["/points", "/points/prototypes", "/points/prototypes/prototype"]
    assert usda.prims["/points/prototypes/prototype"]["metadata"] == {
        "prepend references": "@@@./assets/rock@2.usda@@@"}
    assert prim["relations"] == {"prototypes": "</points/prototypes/prototype>"}
    kinds = {name: kind for name, (kind, _) in prim["attributes"].items()}
    values = {name: numpy.array(value) for name, (kind, value) in prim["attributes"].items()
              if kind.endswith("[]") and kind != "token[]"}
    expected = {"positions": "point3f[]", "orientations": "quath[]", "orientationsf": "quatf[]", "scales": "float3[]",
                "protoIndices": "int[]", "ids": "int64[]", "xformOp:translate": "double3",
                "primvars:normal": "normal3f[]", "primvars:radius": "float[]", "primvars:along": "float3[]"}
    assert {name: kinds[name] for name in expected} == expected
    assert not {"points", "normals", "widths", "extent", "primvars:orient"} & set(kinds)
    assert prim["of"]["primvars:radius"] == {"interpolation": '"vertex"'}
    at, h = stack(columns, *"xyz"), columns["spacing"][0]
    origin = numpy.array(prim["attributes"]["xformOp:translate"][1])
    assert prim["attributes"]["xformOpOrder"][1] == ['"xformOp:translate"']
    assert numpy.abs(values["positions"].astype("f4").astype(float) + origin - at).max() < 1e-6 * h
    assert numpy.abs(values["positions"]).max() < 4 and (values["ids"] == numpy.arange(200)).all()
    assert values["protoIndices"].tolist() == [0] * 200
    orient = orient_of(columns)
    assert (values["orientationsf"].astype("f4") == orient[:, [3, 0, 1, 2]].astype("f4")).all()  # w first
    half = values["orientations"]
    assert numpy.abs(half - half.astype("f2")).max() < 1e-9  # 9 digits
    assert (half.astype("f2") == orient[:, [3, 0, 1, 2]].astype("f4").astype("f2")).all()
    assert numpy.abs((half ** 2).sum(1) - 1).max() < 2e-3
    normal = stack(columns, "nx", "ny", "nz")
    assert numpy.abs(turned(half[:, [1, 2, 3, 0]], numpy.array([0, 0, 1.0])) - normal).max() < 3e-3
    assert numpy.allclose(values["scales"], 0.5 * columns["spacing_local"][:, None].repeat(3, 1), rtol=1e-6)


def test_scales_come_from_an_attribute(run, fields):
    """A number for all axes, a vector for each. Without output.orient the shortest turns are in points.usda alone."""
    for scale, names in (("angle", ["angle"] * 3), ("along", ["along_x", "along_y", "along_z"])):
        spec = job(points_usda=True, usd={"instancer": {"prototype": "a.usd", "scale": scale, "size": 2}})
        spec["attributes"] = fields
        where, columns = run(spec, scale)
        prim = Usda((where / "points.usda").read_text()).prims["/points"]
        assert numpy.allclose(prim["attributes"]["scales"][1], 2 * stack(columns, *names), rtol=1e-6)
        assert "orient_x" not in columns
        orient = numpy.array(prim["attributes"]["orientationsf"][1])[:, [1, 2, 3, 0]]
        assert numpy.abs(turned(orient, numpy.array([0, 0, 1.0])) - stack(columns, "nx", "ny", "nz")).max() < 1e-6
        assert b"@a.usd@" in (where / "points.usda").read_bytes()


def test_a_sequence_of_instances_is_one_stage(run):
    """Frames have samples of all that changes; twists of a seed stay with the ids."""
    spec = job(points_usda=True, orient={"seed": 4}, usd={"instancer": {"prototype": "rock.usda"}})
    spec["queue"] = {"frames": "3-4", "by_frame": {"/surface/analytic/radius": [1.0, 1.2]}, "coherent": True}
    first, columns = run(spec, "3", "--frame", 3)
    second, later = run(spec, "4", "--frame", 4, "--previous", "3")
    text = (first / "points_sequence.usda").read_text()
    assert 'def PointInstancer "points"' in text and "rel prototypes = </points/prototypes/prototype>" in text
    assert "prepend references = @rock.usda@" in text
    declared = set(re.findall(r"^    (\w+\[\] [\w:]+)(?: \(|$)", text, re.M))
    for where, frame, table in ((first, 3, columns), (second, 4, later)):
        prim = Usda((where / "points.usda").read_text()).prims["/points"]
        samples = {f"{kind} {name}": value for name, (kind, value) in prim["attributes"].items()
                   if isinstance(value, dict)}
        assert declared == {name for name in samples if "[]" in name}
        assert {tuple(v) for v in samples.values()} == {(float(frame),)}
        orient = numpy.array(samples["quatf[] orientationsf"][frame])[:, [1, 2, 3, 0]]
        assert (orient.astype("f4") == orient_of(table).astype("f4")).all()
        assert (numpy.array(samples["int64[] ids"][frame]) == table["id"]).all()
    kept, before, after = numpy.intersect1d(columns["id"], later["id"], return_indices=True)
    alike = numpy.abs((orient_of(columns)[before] * orient_of(later)[after]).sum(1))
    assert len(kept) > 150 and numpy.median(alike) > 0.99


USD = {"points_usda": True}


def instancer(**members):
    return {"usd": {"instancer": members}}


@pytest.mark.parametrize("output,words", [
    ({"orient": {"twist": "heat"}}, '/output/orient/twist: the points have no attribute "heat": choose one of none, '
                                    'and add it to /attributes'),
    ({"orient": {"twist": "a", "seed": 1}}, "/output/orient: may have at most one of twist, seed (given both): "),
    ({"orient": {"seed": -1}}, "/output/orient/seed: must be an integer from 0"),
    ({"orient": {"up": [0, 0, 0]}}, "/output/orient/up: is zero: give a direction"),
    ({"orient": {"up": "y"}}, "/output/orient/up: "),
    ({"orient": 3}, "/output/orient: "),
    (instancer(prototype="a.usd"), "/output/usd/instancer: requires points_usda: true"),
    (instancer() | USD, "/output/usd/instancer/prototype: is required"),
    (instancer(prototype="a\nb") | USD, "/output/usd/instancer/prototype: must not contain control characters"),
    (instancer(prototype="a@@@b") | USD, "/output/usd/instancer/prototype: must not contain"),
    (instancer(prototype="a", size=0) | USD, "/output/usd/instancer/size: must be a number above 0"),
    (instancer(prototype="a", scale="heat") | USD, '/output/usd/instancer/scale: the points have no attribute "heat"'),
])
def test_what_cannot_be_is_refused(worker, output, words):
    done = worker(job(100, **output))
    message = json.loads(done.stderr.splitlines()[-1])["message"]
    assert done.returncode in (2, 3) and message.startswith(words), done.stderr
