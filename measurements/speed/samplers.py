# SPDX-License-Identifier: Apache-2.0
"""The samplers that are held against each other: how each is found, started and read."""
import hashlib
import importlib.util
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import numpy

from prepared_inputs import Absent

HERE = pathlib.Path(__file__).resolve().parent
DRIVERS = HERE / "peers"
# One core each: processor time is what is compared.
ONE_THREAD = {"OMP_NUM_THREADS": "1", "VTK_SMP_MAX_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",
              "PYTHONDONTWRITEBYTECODE": "1"}
MOST_OF_PEERS = 10 ** 6
# What a job may have: more than any machine's, since what it takes is to be seen and not to be bounded.
MEMORY_MB = 65536


class Failed(Exception):
    """A run that gave no points; the text says why."""


def timed(command, limit):
    """What `command` took: cpu_s, wall_s, peak_mb, code; of all its processes that it waited for."""
    done = subprocess.run([sys.executable, "-BS", HERE / "timed.py", str(limit), *map(str, command)],
                          env={**os.environ, **ONE_THREAD}, capture_output=True, text=True, check=True)
    took = json.loads(done.stdout)
    if took["stopped"]:
        raise Failed(f"stopped after {limit:.0f} s")
    took["said"] = (done.stderr.strip().splitlines() or [""])[-1]
    return took


# ---- points from files

def read_doubles(path):
    return numpy.fromfile(path, "<f8").reshape(-1, 3)


def read_nrrd(path):
    """Teem's: four doubles a point, the last of them a scale that is not used."""
    head, _, body = path.read_bytes().partition(b"\n\n")
    assert b"type: double" in head and b"encoding: raw" in head
    return numpy.frombuffer(body, "<f8").reshape(-1, 4)[:, :3]


def read_ply(path):
    """Positions, from little-endian vertices that begin with x y z."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    count = int(re.search(rb"element vertex (\d+)", head).group(1))
    vertex = head.partition(b"element vertex")[2].partition(b"element")[0]
    kinds = {b"float": "<f4", b"double": "<f8", b"uchar": "u1", b"int": "<i4", b"uint": "<u4"}
    fields = [(name.decode(), kinds[kind]) for kind, name in re.findall(rb"property (\w+) (\w+)", vertex)]
    table = numpy.frombuffer(body, fields, count)
    columns = {name: table[name].astype(float) for name, _ in fields if name in ("x", "y", "z", "spacing")}
    return numpy.column_stack([columns[a] for a in "xyz"]), columns.get("spacing")


def read_ply_positions(path):
    return read_ply(path)[0]


# ---- peers

class Peer:
    """A sampler from a Debian package. `needs`: programs, or modules of Python, or a driver that was compiled."""
    threads = 1

    def __init__(self, name, title, package, driver, read=read_doubles, programs=(), modules=(), graded=False):
        self.name, self.title, self.package, self.driver, self.read = name, title, package, driver, read
        self.programs, self.modules, self.graded = programs, modules, graded

    def command(self, built):
        path = DRIVERS / self.driver
        if path.suffix == ".py":
            return [sys.executable, path]
        if path.suffix == ".sh":
            return ["sh", path]
        return [built / "measurements/speed/peers" / path.stem]

    def version(self, built):
        """Of the package; raises Absent when it cannot be run here."""
        missing = [p for p in self.programs if not shutil.which(p)]
        missing += [m for m in self.modules if not importlib.util.find_spec(m)]
        if missing or not shutil.which(str(self.command(built)[0])):
            raise Absent(f"absent: {self.package} is not installed, or the driver not built")
        done = subprocess.run(["dpkg-query", "-W", "-f", "${Version}", self.package.split()[0]], capture_output=True,
                              text=True)
        return done.stdout or "unknown"

    def accepts(self, surface, count):
        return not surface.case.get("ours") and count <= MOST_OF_PEERS and (self.graded or not surface.graded)

    def run(self, surface, count, seed, limit, built, where):
        """Positions and what they took."""
        output = where / "points"
        output.unlink(missing_ok=True)
        took = timed([*self.command(built), surface.prefix, count, repr(surface.scale(count)), seed, output], limit)
        if took["code"] != 0 or not output.exists():
            raise Failed(f"failed with {took['code']}: {took['said']}")
        return self.read(output), took


class BuiltPeer(Peer):
    """A sampler that Debian does not package. The environment names its executable; without that it is left out."""

    def __init__(self, name, title, package, driver, read, variable):
        super().__init__(name, title, package, driver, read)
        self.variable = variable

    def version(self, built):
        program = os.environ.get(self.variable)
        if not (program and shutil.which(program)):
            raise Absent(f"absent: {self.variable} does not name its executable")
        return "built from source"


class Hexad:
    """This sampler: the whole job, from the file to a points.ply that was re-read and verified."""
    name, title, package = "hexad", "hexad", ""

    def __init__(self, threads=1):
        self.threads = threads

    def version(self, built):
        del built
        return "this build"

    def accepts(self, surface, count):
        del surface, count
        return True

    def run(self, surface, count, seed, limit, built, where):
        spec = {"version": 1, "surface": surface.spec, "sampling": surface.sampling(count),
                "solver": {"seed": seed, "threads": self.threads}, "output": {"preview": False},
                "limits": {"memory_mb": MEMORY_MB}}
        (where / "spec.json").write_text(json.dumps(spec), encoding="utf-8")
        job = where / "job"
        shutil.rmtree(job, ignore_errors=True)
        took = timed([built / "hexad-worker", "run", where / "spec.json", "--output", job], limit)
        if took["code"] not in (0, 10, 11):
            raise Failed(f"failed with {took['code']}: {took['said']}")
        report = json.loads((job / "report.json").read_text(encoding="utf-8"))
        took["told"] = report["timing_s"]
        took["isa"], took["outcome"] = report["diagnostics"]["isa"], report["outcome"]
        took["sha256"] = hashlib.sha256((job / "points.ply").read_bytes()).hexdigest()
        places, took["requested"] = read_ply(job / "points.ply")
        return places, took


PEERS = (
    Peer("teem", "Teem pull", "teem-apps", "teem_puller.sh", read_nrrd, programs=["teem-puller"]),
    Peer("vtk-smoothing", "VTK point smoothing", "python3-vtk9", "vtk_smoothing.py", modules=["vtk"]),
    Peer("cgal-remesh", "CGAL isotropic remeshing", "libcgal-dev", "cgal_remesh.cc"),
    Peer("cgal-surface", "CGAL Surface_mesher", "libcgal-dev", "cgal_surface.cc", graded=True),
    Peer("vtk-poisson", "VTK Poisson disk", "python3-vtk9", "vtk_poisson.py", modules=["vtk"]),
    Peer("open3d", "Open3D Poisson disk", "python3-open3d", "open3d_poisson.py", modules=["open3d"]),
    Peer("meshlab", "MeshLab Poisson disk", "meshlab (with xvfb, xauth)", "meshlab_poisson.sh", read_ply_positions,
         programs=["meshlabserver", "xvfb-run", "xauth"]),
    BuiltPeer("geogram", "Geogram CVT", "github BrunoLevy/geogram", "geogram_cvt.sh", read_ply_positions, "HEXAD_GEOGRAM"),
    BuiltPeer("acvd", "ACVD", "github valette/ACVD", "acvd.sh", read_ply_positions, "HEXAD_ACVD"),
    BuiltPeer("fine-acvd", "ACVD fine", "github valette/ACVD", "acvd_fine.sh", read_ply_positions, "HEXAD_ACVD"),
)
