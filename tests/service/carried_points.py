# SPDX-License-Identifier: Apache-2.0
"""A sphere whose points carry a number, a colour and a vector, in the formats of points; fixtures `carried`, `finished`."""
import json

import numpy
import pytest

from readers import read_columns
from service import sphere
from volumes import write_nrrd

FORMATS = {"points_npz": True, "points_glb": True, "points_usda": True}


@pytest.fixture
def finished(worker, tmp_path):
    """Runs a job that must succeed; its directory, its columns and report."""
    def call(spec, where="out"):
        done = worker(spec, output=where)
        assert done.returncode in (0, 10, 11), done.stderr
        return (tmp_path / where, read_columns((tmp_path / where / "points.ply").read_bytes()),
                json.loads((tmp_path / where / "report.json").read_text()))
    return call


@pytest.fixture
def carried(tmp_path):
    """A sphere whose points carry a number, a colour and a vector."""
    n = 16
    rng = numpy.random.default_rng(31)
    matrix = numpy.diag([0.2, 0.2, 0.2, 1.0])
    matrix[:3, 3] = -1.5
    write_nrrd(tmp_path / "heat.nrrd", rng.random((n, n, n)).astype("f4"), matrix)
    values = rng.random((3, n, n, n)).astype("<f4")
    vectors = " ".join("(" + ",".join(repr(float(v)) for v in matrix[:3, k]) + ")" for k in range(3))
    head = ["NRRD0005", "type: float", "dimension: 4", f"sizes: 3 {n} {n} {n}", "encoding: raw", "endian: little",
            "space: left-posterior-superior", f"space directions: none {vectors}", "space origin: (-1.5,-1.5,-1.5)",
            "kinds: vector domain domain domain"]
    (tmp_path / "wind.nrrd").write_bytes(("\n".join(head) + "\n\n").encode() + values.tobytes(order="F"))
    spec = sphere(500, output={"preview": False, "ply": {"precision": "double"}, **FORMATS})
    spec["attributes"] = [{"from": str(tmp_path / "heat.nrrd"), "as": "heat"},
                          {"from": str(tmp_path / "wind.nrrd"), "as": "wind"},
                          {"from": str(tmp_path / "wind.nrrd"), "as": "Cd", "type": "color"},
                          {"from": str(tmp_path / "heat.nrrd"), "as": "label", "type": "int"}]
    return spec


def linear_light(srgb):
    return numpy.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
