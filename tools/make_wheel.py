#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes a wheel for pip: the package hexad with libhexad, hexad-worker and the libraries that a minimal Debian lacks.

    make_wheel.py BUILD MODULE...

`make wheel` calls it. BUILD/wheel/lib has the library and the worker, linked to be beside what they need; BUILD has the modules of
the worker. The wheel is put into BUILD/wheel. It needs setuptools and wheel, strip, ldd, dpkg and a C compiler.
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import sysconfig

import setuptools
from wheel.bdist_wheel import bdist_wheel

SOURCE = pathlib.Path(__file__).resolve().parents[1]
# Present in each Debian: the C library, the libraries of the compiler, and zlib, which dpkg needs.
PRESENT = re.compile(r"(ld-linux.*|linux-vdso|lib(c|m|dl|rt|pthread|gcc_s|stdc\+\+|z))\.so\.\d+")
# libtiff needs libjbig, whose licence is the GPL, for pictures of fax machines. These functions report an error in its place.
NO_JBIG = """
#define FAILS(name) long name(void); long name(void) { return 0x70; }
FAILS(jbg_dec_init) FAILS(jbg_dec_in) FAILS(jbg_dec_getimage) FAILS(jbg_dec_getsize) FAILS(jbg_dec_free)
FAILS(jbg_enc_init) FAILS(jbg_enc_out) FAILS(jbg_enc_free) FAILS(jbg_newlen)
const char *jbg_strerror(int code);
const char *jbg_strerror(int code) { return code ? "JBIG is not supported" : ""; }
"""


class PlatformWheel(bdist_wheel):
    """A wheel for any Python 3 of this platform."""

    def finalize_options(self):
        super().finalize_options()
        self.root_is_pure = False

    def get_tag(self):
        return "py3", "none", sysconfig.get_platform().replace("-", "_")


class Package(setuptools.Distribution):
    def has_ext_modules(self):
        return True


def output_of(*words):
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout


def needed_by(paths):
    """Libraries that the files are linked with, directly or not: name -> path."""
    found = {}
    for path in paths:
        for name, place in re.findall(r"^\s+(\S+) => (\S+)", output_of("ldd", path), re.M):
            if place == "not":
                sys.exit(f"wheel: {path}: {name} is not found")
            if not PRESENT.fullmatch(name):
                found[name] = pathlib.Path(place)
    return found


def package_of(library):
    """The package of Debian that has a library."""
    real = library.resolve()
    for path in (str(real), str(real).removeprefix("/usr")):
        found = subprocess.run(["dpkg-query", "-S", path], capture_output=True, text=True)
        if found.returncode == 0:
            return found.stdout.split(":")[0]
    sys.exit(f"wheel: {library} is of no package, so that its licence is unknown")


def copy_libraries(libraries, lib):
    for name, path in libraries.items():
        if name == "libjbig.so.0":
            subprocess.run(["cc", "-shared", "-fPIC", f"-Wl,-soname,{name}", "-x", "c", "-", "-o", lib / name], input=NO_JBIG, text=True,
                           check=True)
        else:
            shutil.copyfile(path, lib / name)


def copy_licences(libraries, stage):
    """LICENSE.PACKAGE of each package, and the texts that those only name."""
    common = set()
    for name, path in libraries.items():
        if name == "libjbig.so.0":
            continue
        package = package_of(path)
        text = pathlib.Path(f"/usr/share/doc/{package}/copyright").read_text()
        (stage / f"LICENSE.{package}").write_text(text)
        common.update(re.findall(r"/usr/share/common-licenses/([\w.-]*\w)", text))
    for name in common:
        shutil.copyfile(f"/usr/share/common-licenses/{name}", stage / f"LICENSE.{name}")


def make_stage(build, modules):
    """A copy of the Python package, with the files of the build."""
    stage = build / "wheel/stage"
    shutil.rmtree(stage, ignore_errors=True)
    shutil.copytree(SOURCE / "clients/python", stage, ignore=shutil.ignore_patterns("__pycache__", "generate.py"))
    shutil.copyfile(SOURCE / "LICENSE", stage / "LICENSE")
    lib = stage / "hexad/lib"
    lib.mkdir()
    own = [build / "wheel/lib/libhexad.so.1", build / "wheel/lib/hexad-worker", *(build / module for module in modules)]
    for path in own:
        shutil.copy(path, lib)
    libraries = needed_by(own)
    copy_libraries(libraries, lib)
    copy_licences(libraries, stage)
    subprocess.run(["strip", "--strip-unneeded", *lib.iterdir()], check=True)
    return stage


def main():
    build = pathlib.Path(sys.argv[1]).resolve()
    stage = make_stage(build, sys.argv[2:])
    for old in (build / "wheel").glob("*.whl"):
        old.unlink()
    os.chdir(stage)
    setuptools.setup(distclass=Package, cmdclass={"bdist_wheel": PlatformWheel},
                     script_args=["--quiet", "bdist_wheel", "--dist-dir", str(build / "wheel")])
    shutil.rmtree(stage)
    made, = (build / "wheel").glob("*.whl")
    print(f"{made}: {made.stat().st_size / 1e6:.0f} MB")


main()
