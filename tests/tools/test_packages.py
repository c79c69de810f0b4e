"""The lists of debian/ without a build of packages (make deb, make packagecheck): each file that make install writes is in one
package, and no list names what is nowhere."""
import fnmatch
import os
import subprocess

import pytest


PAGE = "usr/share/hexad/page"  # not built without the modules of npm

LIKE_RULES = ["prefix=/usr", "libdir=/usr/lib", "sysconfdir=/etc", "datarootdir=/usr/share",
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
    lists = {p.name: words(p) for p in (source / "debian").glob("hexad*.install") if p.name != "hexad-doc.install"}
    lists["not-installed"] = words(source / "debian/not-installed")
    holders = {name: [where for where, patterns in lists.items() if is_named(name, patterns)] for name in installed}
    assert not {name: where for name, where in holders.items() if len(where) != 1}
    nowhere = {p for patterns in lists.values() for p in patterns if not any(is_named(name, [p]) for name in installed)}
    assert nowhere == (set() if (build / "page").is_dir() else {PAGE}) and len(installed) > 40


def test_the_pages_are_there(source):
    for pattern in words(source / "debian/hexad-doc.install"):
        assert list(source.glob(pattern)), pattern
