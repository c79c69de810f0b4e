# SPDX-License-Identifier: Apache-2.0
"""What the samplers are given: one surface each, as a level set, as a dense volume and as triangles, and what is
known of it beside: its area, its normals and the spacing that is asked for."""
import pathlib
import sys

import numpy
from scipy import ndimage

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))

import levelsets  # noqa: E402
import measure  # noqa: E402
import meshes  # noqa: E402
import surfaces  # noqa: E402

AT_ORIGIN = {"center": [0.0, 0.0, 0.0]}
# Of a graded surface: the largest spacing to the smallest, as the job spec's curvature {ratio, exponent 1}.
RATIO = 10
# name: shape and its half extents, or mesh; voxels along the longest side; whether graded. `ours`: only for a claim
# about this sampler, which no other is held against.
TORUS = {"shape": {"shape": "torus", "major_radius": 1.0, "minor_radius": 0.4}}
ELLIPSOID = {"shape": {"shape": "ellipsoid", "radii": [1.0, 0.6, 0.325]}, "half": [1.0, 0.6, 0.325], "voxels": 128}
SURFACES = {
    "sphere": {"shape": {"shape": "sphere", "radius": 1.0}, "half": [1.0, 1.0, 1.0], "voxels": 128},
    "torus": {**TORUS, "half": [1.4, 1.4, 0.4], "voxels": 128},
    "rounded-box": {"shape": {"shape": "box", "half_size": [1.0, 0.75, 0.5], "rounding": 0.25},
                    "half": [1.0, 0.75, 0.5], "voxels": 128},
    "bunny-128": {"mesh": "meshes/bunny_pmp.off", "voxels": 128},
    "bunny-256": {"mesh": "meshes/bunny_pmp.off", "voxels": 256},
    "ellipsoid": {**ELLIPSOID, "graded": True},
    "ellipsoid-even": {**ELLIPSOID, "ours": True},
    "torus-formula": {**TORUS, "ours": True},
    "quartic-formula": {"shape": {"shape": "quartic", "r": 0.13}, "ours": True},
}


class Absent(Exception):
    """What is needed is not there; the text says what."""


class Input:
    """One surface. `prefix` + .vdb (a narrow level set), .nhdr and .raw (floats, x fastest, distances everywhere),
    .ply (triangles), and where graded .spacing (a volume like .raw: spacings relative to each other)."""

    def __init__(self, name, shared, where):
        self.name, self.prefix = name, where / name
        self.case = SURFACES[name]
        self.graded = self.case.get("graded", False)
        self._scale = 1.0
        if "mesh" in self.case:
            self._from_mesh(shared)
        else:
            self._from_formula()
        self.area = self.truth.area

    def path(self, suffix):
        return pathlib.Path(f"{self.prefix}.{suffix}")

    def _from_formula(self):
        shape = {**self.case["shape"], **AT_ORIGIN}
        self.truth = surfaces.surface_of({"analytic": shape})
        if "voxels" not in self.case:
            self.spec = {"analytic": shape}
            return
        half = numpy.array(self.case["half"])
        voxel = float(2 * half.max() / self.case["voxels"])
        reach = numpy.ceil(half / voxel).astype(int) + levelsets.BAND + 1
        axes = [numpy.arange(-k, k + 1) * voxel for k in reach]
        distance = self._over(axes, self.truth.value)
        levelsets.write_array(distance, -reach, voxel, self.path("vdb"))
        self._write_volumes(distance, -reach * voxel, voxel)
        if self.graded:
            self._write_spacing(axes)

    def _from_mesh(self, shared):
        mesh = shared / self.case["mesh"] if shared else None
        if not (mesh and mesh.exists()):
            raise Absent(f"there is no {self.case['mesh']} (HEXAD_SHARED)")
        levelsets.write_mesh(mesh, self.case["voxels"], self.path("vdb"))
        self.truth = surfaces.Volume(self.path("vdb"))
        voxel, clipped = float(self.truth.voxel[0]), self.truth.samples
        far = numpy.abs(clipped) > (levelsets.BAND - 1) * voxel
        beyond = numpy.where(clipped > 0, 1, -1) * voxel * (
            ndimage.distance_transform_edt(far).astype(numpy.float32) + levelsets.BAND - 1)
        distance = numpy.where(far, beyond, clipped)
        self._write_volumes(distance, self.truth.origin + self.truth.low * voxel, voxel)

    @staticmethod
    def _over(axes, function):
        """A function of places over a grid, slice by slice."""
        flat = numpy.stack(numpy.meshgrid(*axes[1:], indexing="ij"), axis=-1).reshape(-1, 2)
        values = [function(numpy.column_stack([numpy.full(len(flat), x), flat])) for x in axes[0]]
        return numpy.array(values).reshape([len(a) for a in axes])

    def _write_volumes(self, distance, origin, voxel):
        import pyopenvdb
        self.spec = {"vdb": {"path": str(self.path("vdb"))}}
        distance.astype("<f4").ravel(order="F").tofile(self.path("raw"))
        steps = " ".join(f"({','.join(repr(voxel * float(k == a)) for k in range(3))})" for a in range(3))
        self.path("nhdr").write_text(
            "NRRD0004\ntype: float\ndimension: 3\nspace dimension: 3\n"
            f"sizes: {' '.join(map(str, distance.shape))}\nspace directions: {steps}\n"
            f"space origin: ({','.join(repr(float(v)) for v in origin)})\nendian: little\nencoding: raw\n"
            f"data file: {self.path('raw').name}\n", encoding="ascii")
        places, quads = pyopenvdb.read(str(self.path("vdb")), "surface").convertToQuads()
        for _ in range(2):  # Newton's steps: a peer is not to be blamed for the triangles that it was given
            slope = self.truth.gradient(places)
            places = places - (self.truth.value(places) / (slope ** 2).sum(axis=1))[:, None] * slope
        self.triangles = meshes.Mesh(places, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))
        middle = self.triangles.vertices[self.triangles.triangles].mean(axis=1)
        outwards = (self.triangles.normals * self.truth.normal(middle)).sum() > 0
        write_ply(self.path("ply"), self.triangles.vertices, self.triangles.triangles[:, ::1 if outwards else -1])

    def _write_spacing(self, axes):
        self._finest = 1 / numpy.hypot(*self.truth.curvatures(self.triangles.vertices)).max()
        self._over(axes, self._relative).astype("<f4").ravel(order="F").tofile(self.path("spacing"))
        middle = self.triangles.vertices[self.triangles.triangles].mean(axis=1)
        self._scale = float(numpy.sqrt((self.triangles.areas / self._relative(middle) ** 2).sum() * 2 / numpy.sqrt(3)))

    def _relative(self, x):
        kappa = numpy.hypot(*self.truth.curvatures(self.truth.foot(x)))
        return numpy.clip(1 / kappa, self._finest, RATIO * self._finest)

    def scale(self, count):
        """What the relative spacings are multiplied by so that their ideal cells sum to `count`; where even, the
        spacing itself."""
        return self._scale / numpy.sqrt(count) if self.graded else measure.ideal_spacing(self.area, count)

    def requested(self, x, count):
        """The spacing that is asked for at places on the surface."""
        relative = self._relative(x) if self.graded else numpy.ones(len(x))
        return self.scale(count) * relative

    def sampling(self, count):
        """As the job spec has it."""
        return {"count": count, **({"curvature": {"ratio": RATIO, "exponent": 1}} if self.graded else {})}


def write_ply(path, vertices, triangles):
    record = numpy.zeros(len(triangles), [("count", "u1"), ("corner", "<i4", 3)])
    record["count"], record["corner"] = 3, triangles
    with open(path, "wb") as file:
        file.write(f"ply\nformat binary_little_endian 1.0\nelement vertex {len(vertices)}\n"
                   "property double x\nproperty double y\nproperty double z\n"
                   f"element face {len(triangles)}\nproperty list uchar int vertex_indices\nend_header\n".encode())
        vertices.astype("<f8").tofile(file)
        record.tofile(file)
