"""Which module of src may include which: the tables of ARCHITECTURE.md, compared with all include lines.

A module is a row of the table of modules: a folder of src, with the folders below it. It may include what its row names and what
those rows name in turn. Each check returns a list of faults. It is run on the source tree, where the list must be empty, and on a
small tree with one fault, where the list must name it.
"""
import pathlib
import re

import pytest

MODULES = "| module | holds | may use |"
SUFFIXES = (".c", ".h", ".cc")


def table(root, header):
    """The rows below a header of a table of ARCHITECTURE.md: lists of cells."""
    lines = (root / "ARCHITECTURE.md").read_text().splitlines()
    rows = []
    for line in lines[lines.index(header) + 2:]:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def names_of(cell):
    return [name.strip() for name in cell.split(",") if name.strip()]


def uses_of(root):
    """What each module's row names; "all": every module."""
    rows = {row[0]: names_of(row[2]) for row in table(root, MODULES)}
    return {name: [m for m in rows if m != name] if uses == ["all"] else uses for name, uses in rows.items()}


def reached(start, uses):
    """What is used by `start`, directly or through others."""
    found, left = set(), [start]
    while left:
        for name in uses.get(left.pop(), ()):
            if name not in found:
                found.add(name)
                left.append(name)
    return found


def files_of(root):
    """Paths below src of the code."""
    return sorted(p.relative_to(root / "src").as_posix() for p in (root / "src").rglob("*") if p.suffix in SUFFIXES)


def module_of(path, uses):
    """The longest name of a module above a file; None: there is none."""
    return next((str(p) for p in pathlib.PurePosixPath(path).parents if str(p) in uses), None)


def includes_of(root, path):
    """(line number, path below src) of each include with a folder in its name."""
    for number, line in enumerate((root / "src" / path).read_text().splitlines(), 1):
        found = re.match(r'#\s*include "(\w[\w./-]*/[\w.-]+)"', line)
        if found:
            yield number, found[1]


# ---- the checks

def modules_without_a_row(root):
    uses = uses_of(root)
    return [f"src/{folder} is in no row of ARCHITECTURE.md" for folder in sorted(
        {str(pathlib.PurePosixPath(path).parent) for path in files_of(root) if not module_of(path, uses)})]


def rows_without_a_folder(root):
    return [f"ARCHITECTURE.md: there is no src/{name}" for name in uses_of(root) if not (root / "src" / name).is_dir()]


def circles_of_rows(root):
    uses = {name: row for name, row in uses_of(root).items() if name != "programs"}
    return [f"ARCHITECTURE.md: {name} may use itself through others" for name in uses if name in reached(name, uses)]


def forbidden_includes(root):
    uses, faults = uses_of(root), []
    allowed = {name: reached(name, uses) | {name} for name in uses}
    for path in files_of(root):
        here = module_of(path, uses)
        for number, other in includes_of(root, path):
            there = module_of(other, uses)
            if here and there not in allowed[here]:
                faults.append(f"src/{path}:{number}: {here} may not use {there or other}")
    return faults


CHECKS = [modules_without_a_row, rows_without_a_folder, circles_of_rows, forbidden_includes]


@pytest.mark.parametrize("check", CHECKS, ids=lambda c: c.__name__)
def test_the_tree(source, check):
    found = check(source)
    assert not found, f"{len(found)} faults:\n" + "\n".join(found)


# ---- what each check would catch

@pytest.fixture
def small(tmp_path):
    """A tree of four modules in two layers, without a fault."""
    for name, text in {
        "ARCHITECTURE.md": f"{MODULES}\n|---|---|---|\n| base/core | memory | |\n| base/json | values | base/core |\n"
                           "| io | files | base/json |\n| programs | mains | all |\n\n",
        "src/base/core/memory.h": "int size;\n",
        "src/base/json/json.c": '#include "base/core/memory.h"\n',
        "src/io/points/ply.c": '#include "base/core/memory.h"\n#include "config.h"\n',
        "src/programs/main.c": '#include "io/points/ply.h"\n',
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


FAULTS = [
    (modules_without_a_row, "src/more/deep/new.c", "int new;\n", "src/more/deep is in no row of ARCHITECTURE.md"),
    (rows_without_a_folder, "ARCHITECTURE.md", f"{MODULES}\n|---|---|---|\n| gone | nothing | |\n", "ARCHITECTURE.md: there is no src/gone"),
    (circles_of_rows, "ARCHITECTURE.md", f"{MODULES}\n|---|---|---|\n| base/core | memory | io |\n| io | files | base/core |\n",
     "ARCHITECTURE.md: base/core may use itself through others"),
    (forbidden_includes, "src/base/core/memory.c", '#include "base/json/json.h"\n', "src/base/core/memory.c:1: base/core may not use base/json"),
    (forbidden_includes, "src/io/points/deep/npz.c", 'int a;\n# include "programs/main.h"\n',
     "src/io/points/deep/npz.c:2: io may not use programs"),
    (forbidden_includes, "src/io/new.c", '#include "gone/new.h"\n', "src/io/new.c:1: io may not use gone/new.h"),
]


@pytest.mark.parametrize("check, name, text, expected", FAULTS, ids=[f[3].replace("/", " ") for f in FAULTS])
def test_a_fault_is_found(small, check, name, text, expected):
    assert not check(small)
    (small / name).parent.mkdir(exist_ok=True, parents=True)
    (small / name).write_text(text)
    assert expected in check(small)
