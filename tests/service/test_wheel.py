# SPDX-License-Identifier: Apache-2.0
"""The wheel (make wheel): what it holds, and the function of it in a minimal Debian, without a network."""
import os
import re
import shutil
import subprocess
import zipfile

import numpy
import pytest

from library_meshes import Part as MeshPart, collada_text
from service import PATIENCE_S
from solids import ball
from volumes import write_nifti, write_nrrd, write_tiff
from zarr_files import multiscales, write_array_2, write_group_2

pytestmark = pytest.mark.extended

PRESENT = {"libc.so.6", "libm.so.6", "libgcc_s.so.1", "libstdc++.so.6", "libz.so.1", "ld-linux-x86-64.so.2", "libpthread.so.0"}
PACKAGES = "python3,python3-venv,python3-numpy"


def run(*words, **how):
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("MAKE", "MFLAGS", "PIP_", "HEXAD_", "PYTHON"))}
    done = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=5 * PATIENCE_S, **how)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(build):
    for module in ("setuptools", "wheel"):
        pytest.importorskip(module, reason=f"python3-{module} is missing")
    for name in ("readelf", "ldd", "strip", "dpkg-query", "cc"):
        if not shutil.which(name):
            pytest.skip(f"{name} is missing")
    run("make", "-C", build, "wheel")
    made, = (build / "wheel").glob("*.whl")
    return made


@pytest.fixture(scope="module")
def content(wheel, tmp_path_factory):
    where = tmp_path_factory.mktemp("wheel")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(where)
    return where


def test_the_name_and_the_tag_are_of_any_python_3(wheel, content):
    assert re.fullmatch(r"hexad-[\w.]+-py3-none-linux_x86_64\.whl", wheel.name)
    assert "Tag: py3-none-linux_x86_64" in next(content.glob("*.dist-info/WHEEL")).read_text()


def test_each_library_that_is_needed_is_in_the_wheel_or_in_each_debian(content):
    lib = content / "hexad/lib"
    there = {path.name for path in lib.iterdir()}
    assert {"libhexad.so.1", "hexad-worker", "hexad-vdb.so"} <= there
    for name in there:
        needed = re.findall(r"\(NEEDED\).*\[(.*)\]", run("readelf", "-d", lib / name))
        assert set(needed) <= there | PRESENT, name


def test_each_library_has_a_licence_and_none_requires_the_gpl(content):
    names = {path.name for path in content.glob("*.dist-info/LICENSE*")}
    assert "LICENSE" in names
    for stem in ("libassimp", "libcjson", "libnettle", "libopenvdb", "libseccomp", "libtiff", "libstdc", "libjbig"):
        assert any(name.startswith(f"LICENSE.{stem}") for name in names) == (stem not in ("libstdc", "libjbig")), stem
    for path in content.glob("*.dist-info/LICENSE.*"):  # what they refer to is there
        for name in re.findall(r"/usr/share/common-licenses/([\w.-]*\w)", path.read_text()):
            assert f"LICENSE.{name}" in names, path.name


@pytest.fixture(scope="module")
def debian(build, source):
    """A minimal Debian with Python, which is kept in the build."""
    if os.getuid():
        pytest.skip("needs root, to make a minimal Debian")
    for name in ("debootstrap", "unshare", "chroot"):
        if not shutil.which(name):
            pytest.skip(f"{name} is missing")
    base = build / "wheel/base"
    made = subprocess.run(["sh", "-euc", f'. "$0"; make_base "$1" {PACKAGES}', source / "tests/boot/container.sh", base], text=True,
                          capture_output=True)
    if made.returncode == 77:
        pytest.skip(made.stdout.strip().splitlines()[-1].partition("SKIP ")[2])
    assert made.returncode == 0, made.stderr
    return base


def write_inputs(where, worker):
    """A ball in a file for each module of the worker, and one that needs none: name -> members of its surface."""
    i = numpy.indices((20, 20, 20)) - 9.5
    values = (8 - numpy.sqrt((i ** 2).sum(0))).astype("f4")
    solid = ball(1, 2)
    solid.write(where / "ball.obj")
    (where / "ball.dae").write_text(collada_text([MeshPart(solid.vertices, solid.triangles)]))
    write_nrrd(where / "ball.nrrd", values)
    write_nifti(where / "ball.nii", values)
    write_tiff(where / "ball.tif", list(values.transpose(2, 0, 1)), packed=True)
    write_group_2(where / "ball.zarr", multiscales([[1, 1, 1]]))
    write_array_2(where / "ball.zarr/0", values, (10, 20, 20), "blosc")
    run(worker, "make-example", where / "trefoil.vdb")
    volumes = {name: {"isovalue": 0} for name in ("ball.nrrd", "ball.nii", "ball.tif", "ball.zarr")}
    return {"ball.obj": {}, "ball.dae": {}, "trefoil.vdb": {}, **volumes}


def lines_of_the_readme(source):
    lines, = re.findall(r"^```python\n(.*?)^```$", (source / "README.md").read_text(), re.M | re.S)
    return lines


def test_it_runs_in_a_minimal_debian(wheel, debian, build, source):
    home = debian / "root/home"
    shutil.rmtree(home, ignore_errors=True)
    home.mkdir()
    shutil.copy(wheel, home)
    files = write_inputs(home, build / "hexad-worker")
    (home / "try.py").write_text(lines_of_the_readme(source) + f"""
print(points.positions.shape, points.outcome)
for name, members in {files!r}.items():
    print(name, hexad.sample(name, count=300, **members).count)
with hexad.Local() as local:
    print(local.submit({{"surface": {{"analytic": {{"shape": "sphere", "radius": 1}}}}, "sampling": {{"count": 300}}}}, wait=True).outcome)
""")
    inside = "cd /root/home; python3 -m venv --system-site-packages v; v/bin/pip install --no-index hexad-*.whl; v/bin/python try.py"
    told = run("unshare", "--mount", "--net", "sh", "-euc", 'mount -t proc proc "$0/proc"; exec chroot "$0" sh -euc "$1"', debian, inside)
    assert told.splitlines()[-len(files) - 2:] == ["(2000, 3) converged", *(f"{name} 300" for name in files), "converged"]
