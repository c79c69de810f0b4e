# SPDX-License-Identifier: Apache-2.0
"""The lists of debian/ without a build of packages (make deb, make packagecheck): each file that make install writes is in one
package, and no list names what is nowhere."""
import fnmatch
import os
import pathlib
import re
import subprocess

import pytest


PAGE = "usr/share/hexad/page"  # not built without the modules of npm

LIKE_RULES = ["prefix=/usr", "libdir=/usr/lib", "librarydir=/usr/lib/x86_64-linux-gnu", "sysconfdir=/etc", "datarootdir=/usr/share",
              "systemdsystemunitdir=/lib/systemd/system"]


def words(path):
    """The first words of the lines of a list, as paths in the package."""
    lines = [line.split()[0] for line in path.read_text().splitlines() if line and not line.startswith("#")]
    return [line.removeprefix("debian/tmp/") for line in lines]


def is_named(name, patterns):
    return any(fnmatch.fnmatch(name, p) or name.startswith(p + "/") for p in patterns)


@pytest.fixture(scope="module")
def installed(build, tmp_path_factory):
    where = tmp_path_factory.mktemp("installed")
    environment = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    subprocess.run(["make", "-C", build, "install", f"DESTDIR={where}", *LIKE_RULES], check=True, capture_output=True,
                   env=environment)
    names = [str(path.relative_to(where)) for path in where.rglob("*") if path.is_file()]
    return [name.replace("zsh/site-functions", "zsh/vendor-completions") for name in names]  # as debian/rules moves it


def test_each_installed_file_is_in_one_package(source, build, installed):
    lists = {p.name: words(p) for p in (source / "debian").glob("*hexad*.install") if p.name != "hexad-doc.install"}
    lists["not-installed"] = words(source / "debian/not-installed")
    holders = {name: [where for where, patterns in lists.items() if is_named(name, patterns)] for name in installed}
    assert not {name: where for name, where in holders.items() if len(where) != 1}
    nowhere = {p for patterns in lists.values() for p in patterns if not any(is_named(name, [p]) for name in installed)}
    assert nowhere == (set() if (build / "page").is_dir() else {PAGE}) and len(installed) > 40


PLACE = "usr/share/doc/hexad-doc"
PROGRAMS = (".py", ".c", ".cc", ".h", ".sh", ".inc", "")  # endings of files of measurements that are not in the package; "": also folders


@pytest.fixture(scope="module")
def measured(source, tmp_path_factory):
    """What the recipe of debian/rules takes of measurements: path in the package -> file in the source."""
    pages = tmp_path_factory.mktemp("pages")
    environment = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    subprocess.run(["make", "-C", source, "-f", "debian/rules", "execute_after_dh_install-indep", f"pages={pages}"], check=True,
                   capture_output=True, env=environment)
    names = [str(path.relative_to(pages)) for path in pages.rglob("*") if path.is_file()]
    return {name: source / name for name in names}


def test_the_pages_on_measurements_are_packaged_with_pictures_and_results_and_without_programs(source, measured):
    there = {str(path.relative_to(source)) for path in (source / "measurements").rglob("*")
             if path.is_file() and "__pycache__" not in path.parts}
    assert {name for name in there if pathlib.PurePath(name).suffix not in PROGRAMS} == set(measured)
    assert {pathlib.PurePath(name).suffix for name in measured} >= {".md", ".csv", ".json", ".png"}
    assert {name for name in there if name.endswith("/README.md")} <= set(measured)


@pytest.fixture(scope="module")
def files(source, measured):
    """The files of hexad-doc: path in its directory -> file in the source."""
    found = dict(measured)
    for line in (source / "debian/hexad-doc.install").read_text().splitlines():
        *patterns, target = line.split()
        for pattern in patterns:
            paths = list(source.glob(pattern))
            assert paths, pattern
            for path in paths:
                place = pathlib.PurePath(target).relative_to(PLACE) / path.name
                inside = [path] if path.is_file() else [p for p in path.rglob("*") if p.is_file()]
                found |= {str(place / p.relative_to(path)): p for p in inside}
    return found


def links_of_pages(source, files):
    """(page, what it links to) of all links to files and pictures, without those of pages on measurements to programs and to folders
    of programs."""
    pages = {name: path for name, path in files.items() if name.endswith(".md")}
    assert {"README.md", "doc/operations.md", "measurements/packing/README.md"} <= set(pages)
    links = [(name, os.path.normpath(os.path.join(os.path.dirname(name), link))) for name, path in pages.items()
             for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", path.read_text()) if "://" not in link]
    return [(name, link) for name, link in links
            if not (name.startswith("measurements/") and pathlib.PurePath(link).suffix in PROGRAMS and (source / link).exists())]


def test_links_of_the_packaged_pages_lead_to_files_of_the_package(source, files):
    folders = {str(parent) for name in files for parent in pathlib.PurePath(name).parents}
    assert not [link for link in links_of_pages(source, files) if link[1] not in files and link[1] not in folders]


def test_debhelper_compresses_no_linked_file_and_no_result(source, files, measured):
    """A compressed file has another name than the link."""
    excluded = re.findall(r"-X(\S+)", re.search(r"^\tdh_compress(.*)$", (source / "debian/rules").read_text(), re.M)[1])
    linked = {name for _, name in links_of_pages(source, files) if name in files and files[name].suffix != ".png"} | set(measured)
    assert "etc/hexad.conf" in linked
    for name in linked:
        short = files[name].stat().st_size <= 4096
        assert short or any(part in f"/{PLACE}/{name}" for part in excluded), name
