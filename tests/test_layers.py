# SPDX-License-Identifier: Apache-2.0
"""Which layer and which module of src may include which: the tables of ARCHITECTURE.md, compared with all include lines.

A layer is a folder of src. A module is a row of the table of modules: a folder with the folders below it. Layers and modules may
include what their rows name and what those rows name in turn. The daemon shares with the worker only what SHARED names. No files
call each other in a circle. Each check returns a list of faults. It is run on the source tree, where the list must be empty, and on
a small tree with one fault, where the list must name it.
"""
import pathlib
import re
import sys

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "tools"))

import complexity  # noqa: E402

LAYERS = "| layer | holds | may use |"
MODULES = "| module | holds | may use |"
DAEMON = ("service/", "programs/hexad.c")  # the code that only daemon and client contain
SHARED = ("base/", "geometry/", "files/", "spec/", "io/pictures/")
DRAWN = "io/points/"  # shared as well, as far as pictures include it
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


def uses_of(root, header=MODULES):
    """What each row names; "all": every row."""
    rows = {row[0]: names_of(row[2]) for row in table(root, header)}
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


def layers_out_of_order(root):
    """Rows of layers that name a row below them: data pass the layers in the order of the table."""
    rows = [(row[0], names_of(row[2])) for row in table(root, LAYERS)]
    above = [{name for name, _ in rows[:k]} for k in range(len(rows))]
    return [f"ARCHITECTURE.md: the layer {name} may use {other}, which is not above it"
            for (name, uses), known in zip(rows, above) for other in uses if other not in known | {"all"}]


def folders_without_a_layer(root):
    layers = uses_of(root, LAYERS)
    return [f"src/{name} is no layer of ARCHITECTURE.md" for name in sorted({path.split("/")[0] for path in files_of(root)})
            if name not in layers]


def includes_against_layers(root):
    layers, faults = uses_of(root, LAYERS), []
    allowed = {name: reached(name, layers) | {name} for name in layers}
    for path in files_of(root):
        here = path.split("/")[0]
        faults += [f"src/{path}:{number}: the layer {here} may not use {other.split('/')[0]}" for number, other in includes_of(root, path)
                   if here in allowed and other.split("/")[0] not in allowed[here]]
    return faults


def is_shared(path, includer):
    return path.startswith(SHARED) or path.startswith(DRAWN) and includer.startswith(("io/pictures/", DRAWN))


def code_that_the_daemon_shares(root):
    """What the daemon's code includes, with the .c files of these headers, that is neither its own nor shared."""
    files, faults = set(files_of(root)), []
    left = [path for path in sorted(files) if path.startswith(DAEMON)]
    seen = set(left)
    while left:
        path = left.pop()
        for number, other in includes_of(root, path):
            if not other.startswith(("service/", "client/", "programs/")) and not is_shared(other, path):
                faults.append(f"src/{path}:{number}: the daemon may not contain {other}")
                continue
            beside = [name for name in (other, *(other.removesuffix(".h") + end for end in (".c", ".cc"))) if name in files - seen]
            seen.update(beside)
            left += beside
    return faults


def circles_of_calls(root):
    """Files that reach each other by calls. Functions belong where no circle remains: a file of its own, or the file that is called."""
    return [" ".join(path.relative_to(root).as_posix() for path in group) + ": these files call each other"
            for group in complexity.circles(complexity.sources(root / "src", ".c"))]


def repeated_base_names(root):
    """Names of files without suffix that are there twice: a name says the subject, and its folder is no part of it."""
    folders = {}
    for path in map(pathlib.PurePosixPath, files_of(root)):
        folders.setdefault(path.stem, set()).add(f"src/{path.parent}")
    return [f"{name}: {' '.join(sorted(where))} have files of this name" for name, where in sorted(folders.items()) if len(where) > 1]


CHECKS = [layers_out_of_order, folders_without_a_layer, includes_against_layers, code_that_the_daemon_shares, modules_without_a_row,
          rows_without_a_folder, circles_of_rows, forbidden_includes, circles_of_calls, repeated_base_names]


@pytest.mark.parametrize("check", CHECKS, ids=lambda c: c.__name__)
def test_the_tree(source, check):
    found = check(source)
    assert not found, f"{len(found)} faults:\n" + "\n".join(found)


# ---- what each check would catch

MODULES_TABLE = (f"{MODULES}\n|---|---|---|\n| base/core | memory | |\n| base/json | values | base/core |\n| io/points | files | base/json |\n"
                 "| io/pictures | pictures | io/points |\n| service/api | routes | io/pictures |\n| programs | mains | all |\n\n")


@pytest.fixture
def small(tmp_path):
    """A tree of six modules in four layers, without a fault."""
    for name, text in {
        "ARCHITECTURE.md": f"{LAYERS}\n|---|---|---|\n| base | memory | |\n| io | files | base |\n| service | jobs | io |\n"
                           f"| programs | mains | all |\n\n{MODULES_TABLE}",
        "src/base/core/memory.h": "int size;\n",
        "src/base/json/json.c": '#include "base/core/memory.h"\n\nvoid json(void)\n{\n    memory();\n}\n',
        "src/io/points/ply.c": '#include "base/core/memory.h"\n#include "config.h"\n',
        "src/io/points/scene.h": "int scene;\n",
        "src/io/pictures/preview.h": '#include "io/points/scene.h"\n',
        "src/service/api/routes.c": '#include "io/pictures/preview.h"\n',
        "src/programs/main.c": '#include "io/points/ply.h"\n',
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


FAULTS = [
    (layers_out_of_order, "ARCHITECTURE.md", f"{LAYERS}\n|---|---|---|\n| base | memory | io |\n| io | files | |\n\n{MODULES_TABLE}",
     "ARCHITECTURE.md: the layer base may use io, which is not above it"),
    (folders_without_a_layer, "src/more/new.c", "int new;\n", "src/more is no layer of ARCHITECTURE.md"),
    (includes_against_layers, "src/base/core/new.c", '#include "io/points/scene.h"\n', "src/base/core/new.c:1: the layer base may not use io"),
    (code_that_the_daemon_shares, "src/service/api/new.c", '#include "io/points/ply.h"\n',
     "src/service/api/new.c:1: the daemon may not contain io/points/ply.h"),
    (code_that_the_daemon_shares, "src/io/pictures/preview.c", '#include "surface/new.h"\n',
     "src/io/pictures/preview.c:1: the daemon may not contain surface/new.h"),
    (repeated_base_names, "src/io/points/memory.c", "int new;\n", "memory: src/base/core src/io/points have files of this name"),
    (modules_without_a_row, "src/more/deep/new.c", "int new;\n", "src/more/deep is in no row of ARCHITECTURE.md"),
    (rows_without_a_folder, "ARCHITECTURE.md", f"{MODULES}\n|---|---|---|\n| gone | nothing | |\n", "ARCHITECTURE.md: there is no src/gone"),
    (circles_of_rows, "ARCHITECTURE.md", f"{MODULES}\n|---|---|---|\n| base/core | memory | io |\n| io | files | base/core |\n",
     "ARCHITECTURE.md: base/core may use itself through others"),
    (forbidden_includes, "src/base/core/memory.c", '#include "base/json/json.h"\n', "src/base/core/memory.c:1: base/core may not use base/json"),
    (forbidden_includes, "src/io/points/deep/npz.c", 'int a;\n# include "programs/main.h"\n',
     "src/io/points/deep/npz.c:2: io/points may not use programs"),
    (forbidden_includes, "src/io/points/new.c", '#include "gone/new.h"\n', "src/io/points/new.c:1: io/points may not use gone/new.h"),
]


@pytest.mark.parametrize("check, name, text, expected", FAULTS, ids=[f[3].replace("/", " ") for f in FAULTS])
def test_a_fault_is_found(small, check, name, text, expected):
    assert not check(small)
    (small / name).parent.mkdir(exist_ok=True, parents=True)
    (small / name).write_text(text)
    assert expected in check(small)
