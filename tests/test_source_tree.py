# SPDX-License-Identifier: Apache-2.0
"""Rules of the source tree that a program can check: formatting, files that no list has, and names of files that
do not exist.

Each check returns a list of faults. It is run on the source tree, where the list must be empty, and on a small tree
with one fault, where the list must name it. test_layers.py checks which module of src may include which.
"""
import fnmatch
import io
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tokenize

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "tools"))
import file_index  # noqa: E402
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "measurements" / "isolation"))
import isolation_routes  # noqa: E402
from isolation_routes import results  # noqa: E402

CODE = ("src", "tests", "fuzz", "measurements")
CLANG_FORMAT = "clang-format-14"

PAGES = (r"(ARCHITECTURE|README|CONTRIBUTING|NEWS)\.md", r"tests/README\.md", r"(doc|measurements)/.*")  # where pages may be


def files_of(root, folders, endings):
    """Paths, relative to root, of the files that git tracks; in a tree without git, of all files that are not in a build directory."""
    listed = subprocess.run(["git", "-C", root, "ls-files", "--", *folders], capture_output=True, text=True)
    names = [n for n in listed.stdout.splitlines() if (root / n).is_file()]  # not those about to be removed
    if not names:
        for folder in folders:
            for at, below, found in os.walk(root / folder):
                if at != str(root) and "config.status" in found or "node_modules" in at:  # a build directory, or installed packages
                    below.clear()
                else:
                    names += [os.path.relpath(os.path.join(at, name), root) for name in found]
        names += [folder for folder in folders if (root / folder).is_file()]
    return sorted(n for n in names if n.endswith(endings))


def code_of(root, folders=CODE):
    return files_of(root, folders, (".c", ".h", ".cc"))


def pages_of(root):
    return files_of(root, ("doc", "measurements", "tests/README.md", *(p.name for p in root.glob("*.md"))), (".md",))


# ---- the checks

def unformatted(root):
    done = subprocess.run([CLANG_FORMAT, "--dry-run", "-Werror", *code_of(root)], cwd=root, capture_output=True,
                          text=True)
    names = sorted({line.split(":")[0] for line in done.stderr.splitlines() if "[-Wclang-format-violations]" in line})
    return [f"{name} is not formatted: {CLANG_FORMAT} -i {name}" for name in names] or done.stderr.splitlines()


def misplaced_pages(root):
    return [f"{name} is not where pages are: {', '.join(PAGES)}" for name in pages_of(root)
            if not any(re.fullmatch(pattern, name) for pattern in PAGES)]


def fragments(root):
    """The lists of files that ./bootstrap makes, one line each; what tools/fragments.sh reports if it fails."""
    done = subprocess.run(["sh", root / "tools/fragments.sh", "--print"], capture_output=True, text=True)
    return done.stdout.replace("\\\n", " ") + done.stderr


def makefile(root):
    """The text of Makefile.am and of the files that it includes, with whole paths and without comments."""
    parts = [*root.glob("src/**/Makefile.inc"), *root.glob("measurements/*/Makefile.inc")]
    text = (root / "Makefile.am").read_text() + fragments(root) + "".join(
        part.read_text().replace("%D%", str(part.parent.relative_to(root))) for part in parts)
    return re.sub(r"^\s*#.*", "", text, flags=re.M)


TREE = ("clients", "debian", "doc", "etc", "examples", "fuzz", "measurements", "page", "share", "src", "systemd", "tests", "tools")


def left_out(root):
    """Files that are not compiled, or that the tarball would not have: no list names them or a folder above."""
    faults = [line for line in fragments(root).splitlines() if line.startswith("fragments: ")]
    words = set(re.split(r"[\s\\]+", makefile(root).replace("$(srcdir)/", "")))
    # a test of one file is made of the file of its name
    words |= {f"{word}.c" for word in words if word.startswith("tests/unit/")}
    return faults or [f"no list of Makefile.am names {name}" for name in files_of(root, TREE, "")
                      if not words & {name, *map(str, pathlib.PurePath(name).parents)}
                      or name.endswith((".c", ".h", ".cc")) and name not in words]


# Files that repeat the version of configure.ac, the line, and what "~rc" is called there.
VERSIONS = (("CITATION.cff", r"^version: (\S+)", "~rc"), ("clients/python/pyproject.toml", r'^version = "(.*)"', "rc"),
            ("clients/typescript/package.json", r'^  "version": "(.*)"', "-rc."))


def other_versions(root):
    """Files with another version than configure.ac."""
    version = re.search(r"AC_INIT\(\[hexad\], \[(.*?)\]\)", (root / "configure.ac").read_text())[1]
    if not re.fullmatch(r"\d+\.\d+\.\d+(~rc\d+)?", version):
        return [f"configure.ac: {version} is neither N.N.N nor N.N.N~rcN"]
    faults = []
    for name, pattern, candidate in VERSIONS:
        found, expected = re.search(pattern, (root / name).read_text(), re.M)[1], version.replace("~rc", candidate)
        if found != expected:
            faults.append(f"{name} has version {found}, expected {expected} (configure.ac: {version})")
    return faults


def anchors_of(page):
    """The anchors of the headings of a page."""
    headings = re.findall(r"^#+ +(.*?) *$", re.sub(r"^```.*?^```$", "", page.read_text(), flags=re.M | re.S), re.M)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def lost_links(root):
    """Links and pictures of pages that lead to files or headings that are nowhere."""
    faults = []
    for name in files_of(root, (".",), (".md",)):
        text = (root / name).read_text()
        for link in re.findall(r"\]\(([^)\s]+)[^)]*\)|<img [^>]*src=\"([^\"]+)\"", text):
            file, _, anchor = "".join(link).partition("#")
            target = (root / name).parent / file if file else root / name
            if "://" not in file and not (target.exists() and (not anchor or anchor in anchors_of(target))):
                faults.append(f"{name}: the link to {''.join(link)} leads nowhere")
    return faults


SMALL_TREES = ("tests/test_figures.py", "tests/test_layers.py", "tests/test_source_tree.py", "tests/tools/test_bootstrap.py", "tests/tools/test_commit.py")
SCRIPTS = ("bootstrap", "debian/rules", "fuzz/run", "measurements/paper/reproduce", "share/hexad-frame", "tests/boot/bootcheck",
           "tests/packages/containercheck", "tests/packages/packagecheck", "tests/valgrind/run")
BUILT = ("debian/changelog", "debian/hexad-doc/*", "debian/tmp*", "fuzz/found", "fuzz/smoke", "fuzz/specs.found", "measurements/speed/smoke*", "page/preact.js",
         "page/sha256.js", "page/uplot.*", "src/service/api/openapi_*.inc", "src/service/executor/commit.inc", "src/service/*/lib*_a-*", "tests/pycache",
         "tests/valgrind/calls.so", "share/hexad/*", "share/doc/*", "*/node_modules*")  # by make or npm, or installed below /usr/share


def comments_of_c(text):
    return [(text.count("\n", 0, found.start()) + 1, found[0]) for found in re.finditer(r"/\*.*?\*/|//[^\n]*", text, re.S)]


def comments_of_python(text):
    """Comments and texts in three quotes."""
    return [(token.start[0], token.string) for token in tokenize.generate_tokens(io.StringIO(text).readline)
            if token.type == tokenize.COMMENT or token.string.startswith('"' * 3)]


def texts(root):
    """(name, text) of what may name files: pages, Makefiles and scripts, and the comments of code and of tests that make small trees.
    The text keeps its line breaks."""
    for name in files_of(root, (*TREE, *(p.name for p in root.iterdir() if p.is_file())), ""):
        path = pathlib.PurePath(name)
        if path.name in ("Makefile.am", "Makefile.inc"):
            yield name, (root / name).read_text().replace("%D%", str(path.parent))
        elif (path.suffix in (".md", ".py", ".sh") or name in SCRIPTS) and name not in SMALL_TREES:
            yield name, (root / name).read_text()
        elif path.suffix in (".c", ".h", ".cc", ".py"):
            text = (root / name).read_text()
            lines = [""] * (text.count("\n") + 2)
            for line, comment in comments_of_python(text) if path.suffix == ".py" else comments_of_c(text):
                for number, part in enumerate(comment.split("\n"), line - 1):
                    lines[number] += " " + part
            yield name, "\n".join(lines)


def is_placeholder(path):
    """Whether a name has a word in capitals, such as src/FOLDER/NOUN.c, or is the example of CONTRIBUTING.md, test_noun.c."""
    return re.search(r"(?<![a-zA-Z])[A-Z]{3,}(?![a-zA-Z])|\bnoun\b|_noun\b", path)


def lost_paths(root):
    """Paths that begin with a folder of the tree, and modules (`folder/.../noun` in code style), that are nowhere."""
    files = files_of(root, TREE, "")
    known = {*files, *(str(parent) for name in files for parent in pathlib.PurePath(name).parents),
             *(str(pathlib.PurePath(name).with_suffix("")) for name in files)}
    folders = {p.name for p in (root / "src").iterdir() if p.is_dir()}
    whole = re.compile(rf"(?<![\w./$(){{}}~@<>-])(?:\./)?((?:{'|'.join(TREE)})/[\w./*+-]*[\w*/])([{{$%<\[]?)")
    module = re.compile(rf"`((?:{'|'.join(folders)})(?:/[a-z_]+)+)(?:\.(?:[ch]|cc))?`()")
    faults = []
    for name, text in texts(root):
        for found in [*whole.finditer(text), *module.finditer(text)]:
            path = re.sub(r"^fuzz/(fuzz|replay|lines)_", "fuzz/", found[1].rstrip("/."))
            pattern = path + "*" if found[2] else path
            if path.split("/")[0] not in TREE:
                pattern = f"src/{path}"
            if pattern not in known and not is_placeholder(path) and not any(fnmatch.fnmatch(path, p) for p in BUILT) and not (
                    "*" in pattern and fnmatch.filter(known, pattern)):
                faults.append(f"{name}:{text.count(chr(10), 0, found.start()) + 1}: {found[1]} is nowhere")
    return faults


PROSE = ("src", "include", "etc", "page", "share", "systemd", "clients", "debian", "doc", "tools", "fuzz")  # whose texts users read


def lost_pages(root):
    """Pages, and their headings, that any text names and that are nowhere: in strings of programs, help, settings, manual pages,
    units, the web page. A page may be named without its folder, doc."""
    faults = []
    for name in (*files_of(root, PROSE, ""), *(p.name for p in sorted(root.iterdir()) if p.is_file())):
        try:
            text = (root / name).read_text()
        except UnicodeDecodeError:  # a picture
            continue
        for found in re.finditer(r"(?<![\w./{}*$-])((?:doc/)?\w+\.md)\b(?:#([\w-]+))?", text):
            pages = [path for path in (root / found[1], root / "doc" / found[1], (root / name).parent / found[1]) if path.is_file()]
            if not pages or found[2] and found[2] not in anchors_of(pages[0]):
                faults.append(f"{name}:{text.count(chr(10), 0, found.start()) + 1}: the page {found[0]} is nowhere")
    return faults


STANDARD_TARGETS = ("all", "check", "clean", "dist", "distcheck", "distclean", "install", "uninstall")


def lost_targets(root):
    """Targets in `make TARGET`, in code style or in a block of code of a page, that Makefile.am does not have."""
    rules = re.findall(r"^([\w. %/$()-]+):(?!=)", makefile(root), re.M)
    targets = {*STANDARD_TARGETS, *(word for words in rules for word in words.split())}
    faults = []
    for name, text in texts(root):
        styles = r"`make\s+([^`]+)`|^(?: {4}|\$ )?make +([^\n#]+)" if name.endswith(".md") else r"`make\s+([^`]+)`"
        for found in re.finditer(styles, text, re.M):
            words = re.sub(r"(?<= )-[Cj] ?\S+|\w+=(\"[^\"]*\"|'[^']*'|\S*)", "", " " + (found[1] or found[2] or found[0])).split()
            faults += [f"{name}:{text.count(chr(10), 0, found.start()) + 1}: there is no target {word} of make" for word in words
                       if re.fullmatch(r"[a-z][a-z-]*", word) and word not in targets]
    return faults


def undescribed_files(root):
    """Source files whose first comment does not say what they are."""
    return [f"tools/file_index.py: {line} says nothing" for line in file_index.section(root).splitlines() if line.endswith("|  |")]


PRINTERS = ("src/client/", "src/job/inspect/inspection_text.c", "src/job/report/summary.c", "src/service/results/inventory.c")  # print to streams that their callers choose
PLAIN_PRINTERS = ("src/client/list_query.c",)  # writes URLs


def unescaped_prints(root):
    """Calls that print texts, which may come from others, without base/terminal_text."""
    faults = []
    for name in code_of(root, ("src",)):
        streams = r"[^,]+" if name.startswith(PRINTERS) and name not in PLAIN_PRINTERS else r"std(?:out|err)"
        for call in re.finditer(rf"(?<!\w)(?:printf\(|fprintf\(\s*{streams},)(.*?);\n", (root / name).read_text(), re.S):
            if any(re.search(r"%[-+#0-9.*]*s", literal.replace("%%", "")) for literal in re.findall(r'"((?:[^"\\]|\\.)*)"', call[1])):
                line = (root / name).read_text()[:call.start()].count("\n") + 1
                faults.append(f"{name}:{line}: printf with %s: call terminal_text_print")
    return faults


def indexed_lists(root):
    """Loops over lists of JSON by index or by a length that is counted each time: both take quadratic time."""
    faults = []
    for name in code_of(root, ("src",)):
        for number, line in enumerate((root / name).read_text().splitlines(), 1):
            access = re.search(r"json_element\(|cJSON_GetArrayItem\(|\b(?:for|while) \(.*json_size\(", line)
            if access and not (name == "src/base/json/json.c" and "node, (int)index" in line):  # a step of a JSON Pointer
                faults.append(f"{name}:{number}: iterate with json_first and json_next")
    return faults


ROUTES, TIMES = "src/service/api/routes.c", "measurements/isolation/serving_thread.csv"


def untimed_calls(root):
    """Rows of the table of routes that do not say where their handler runs, and rows whose calls in the serving thread are not
    those of the table of times in measurements/isolation/serving_thread.csv."""
    table = root / ROUTES
    if not table.exists():
        return []
    try:
        calls = isolation_routes.serving_calls(table.read_text())
    except ValueError as fault:
        return [str(fault)]
    timed = {(row["row"], row["calls"]) for row in results.read(root / TIMES)}
    return [f"{TIMES} has no times of {name} ({call}): measurements/isolation/isolation.py --serving-thread measures them"
            for name, call in ((name, ", ".join(found) or "-") for name, found in calls.items()) if (name, call) not in timed]


def imported_tests(root):
    """Lines that import a file of tests: what two files share is in a module without tests (tests/README.md)."""
    return [f"{name}:{number}: imports {found[1]}: move what both use into a module without tests"
            for name in files_of(root, (*CODE, "tools"), (".py",)) for number, line in enumerate((root / name).read_text().splitlines(), 1)
            if (found := re.match(r"\s*(?:from|import) (test_\w+)", line))]


def unnamed_tests(root):
    """Tests and fixtures that tests/README.md does not name, and names that are nowhere."""
    named = set(re.findall(r"`(\w+\.(?:py|h))`", (root / "tests/README.md").read_text()))
    there, wanted = ({pathlib.PurePath(name).name for name in files_of(root, folders, (".py", ".h"))}
                     for folders in (("tests",), ("tests/service", "tests/unit")))
    return ([f"tests/README.md does not name {name}" for name in sorted(wanted - named)]
            + [f"tests/README.md names {name}, which is nowhere" for name in sorted(named - there)])


def lost_recipes(root):
    """Files without a folder in the recipes of CONTRIBUTING.md that are nowhere. A name with a word in capitals is a placeholder."""
    recipes = (root / "CONTRIBUTING.md").read_text().partition("\n## Recipes\n")[2]
    files = {pathlib.PurePath(name).name for name in files_of(root, (".",), "")}
    return [f"CONTRIBUTING.md: a recipe names {word}, which is nowhere"
            for words in re.findall(r"`([^`]+)`", recipes) for word in re.split(r"[\s<>]+", words)
            if re.fullmatch(r"[\w-]+\.(?:[ch]|cc|py|md|json|inc|ac|am|conf)", word) and not is_placeholder(word) and word not in files]


def unlicensed(root):
    """Code whose first line, or the second one after #!, is not its licence."""
    faults = []
    for name in files_of(root, (*CODE, "tools", "page", "clients", "share"), (".c", ".h", ".cc", ".py", ".js", ".ts", ".sh")):
        mark = "#" if name.endswith((".py", ".sh")) else "//"
        if not re.match(rf"(#!.*\n)?{mark} SPDX-License-Identifier: Apache-2\.0\n", (root / name).read_text()):
            faults.append(f"{name}: its first line, or the second after #!, is not {mark} SPDX-License-Identifier: Apache-2.0")
    return faults


def unpackaged_paths(root):
    """Folders of /usr/share/hexad that pages or tools name, and that no package has."""
    packaged = set(re.findall(r"(?m)^usr/share/hexad/(\w+)", "".join(p.read_text() for p in root.glob("debian/*.install"))))
    return [f"{name}: no package has /usr/share/hexad/{folder}"
            for name in (*pages_of(root), *files_of(root, ("share", "clients"), (".py", ".js", ".md")))
            for folder in re.findall(r"/usr/share/hexad/(\w+)", (root / name).read_text()) if folder not in packaged]


# Functions of the C library whose last bits depend on the processor, and the folders whose objects may call them.
INEXACT = r"(?:a?(?:sin|cos|tan)h?|atan2|sincos|exp(?:2|10|m1)?|log(?:2|10|1p)?|pow|hypot|cbrt|erfc?|[lt]gamma|[jy][01n])[fl]?"
INEXACT_OBJECTS = {"src/io/vdb": "templates of OpenVDB: rotations, which hexad does not call, and a comparison of scales within a tolerance"}


def inexact_calls(root):
    """Calls in src of functions with other results on other processors."""
    faults = []
    for name in code_of(root, ("src",)):
        text = re.sub(r'/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\\n])*"', lambda found: re.sub(r"[^\n]", " ", found[0]), (root / name).read_text(),
                      flags=re.S)
        faults += [f"{name}:{text.count(chr(10), 0, found.start()) + 1}: {found[1]} depends on the processor: use base/core/elementary"
                   for found in re.finditer(rf"(?<![\w.>])({INEXACT})\s*\(", text)]
    return faults


CHECKS = [unformatted, misplaced_pages, left_out, other_versions, lost_links, lost_paths, lost_pages, lost_targets, undescribed_files,
          unescaped_prints, indexed_lists, untimed_calls, imported_tests, unnamed_tests,
          lost_recipes, unlicensed, unpackaged_paths, inexact_calls]


@pytest.mark.parametrize(
    "check", [pytest.param(c, marks=pytest.mark.extended) if c is unformatted else c for c in CHECKS],
    ids=lambda c: c.__name__)
def test_the_tree(source, check):
    if check is unformatted and not shutil.which(CLANG_FORMAT):
        pytest.skip(f"{CLANG_FORMAT} is not installed")
    found = check(source)
    assert not found, f"{len(found)} faults:\n" + "\n".join(found)


@pytest.mark.parametrize("name", [*PRINTERS, *PLAIN_PRINTERS, ROUTES])
def test_a_file_that_a_check_names_is_in_the_tree(source, name):
    assert (source / name).exists()


def test_objects_call_exact_functions_of_the_c_library(build):
    """Also what the compiler and the templates of other projects call."""
    objects = [path for path in sorted((build / "src").rglob("*.o")) if str(path.parent.relative_to(build)) not in INEXACT_OBJECTS]
    done = subprocess.run(["nm", "-A", "-u", *objects], capture_output=True, text=True)
    assert done.returncode == 0 and len(objects) > 100, done.stderr
    assert not [line for line in done.stdout.splitlines() if re.fullmatch(rf".* U {INEXACT}(?:@.*)?", line)]


@pytest.mark.parametrize("variable", ["AM_CFLAGS", "AM_CXXFLAGS"])
def test_compilers_fuse_no_operations(source, variable):
    assert re.search(rf"(?m)^{variable} = .*-ffp-contract=off\b", (source / "Makefile.am").read_text())


# ---- what each check would catch

@pytest.fixture
def small(source, tmp_path):
    """A tree of a module and its pages, without a fault."""
    for name, text in {
        "src/base/clock.c": "// SPDX-License-Identifier: Apache-2.0\n/* clock: the time. */\nint one(void)\n{\n    return 1;\n}\n",
        "tests/unit/clock.h": "// SPDX-License-Identifier: Apache-2.0\nint one(void);\n",
        "tests/README.md": "| `clock.h` |\n",
        "CONTRIBUTING.md": "`no/such`\n\n## Recipes\n\n`src/FOLDER/NOUN.c`, `base/clock`, `Makefile.am`, `/such`, `make time` and `clock >doc/guide.md`\n",
        "ARCHITECTURE.md": "# The start\nSee [the guide](doc/guide.md) and [above](#the-start) for `base/clock` and `no/such`.\n",
        "doc/guide.md": "[back](../ARCHITECTURE.md)\n",
        "Makefile.am": "include $(srcdir)/build-aux/files.mk\nEXTRA_DIST = $(distributed_files) measurements"
                       " clients/python/pyproject.toml clients/typescript/package.json\ntime: all\n",
        "src/base/Makefile.inc": "a_SOURCES += $(src_base)\n",
        "tests/longest.txt": "",
        "tools/file_index.py": "# SPDX-License-Identifier: Apache-2.0\n",
        "tools/fragments.sh": re.sub(r"(?m)^#(?!!| SPDX).*\n", "", (source / "tools/fragments.sh").read_text()),
        "configure.ac": "AC_INIT([hexad], [1.2.3~rc4])\n",
        "CITATION.cff": "cff-version: 1.2.0\nversion: 1.2.3~rc4\n",
        "clients/python/pyproject.toml": '[project]\nversion = "1.2.3rc4"\n',
        "clients/typescript/package.json": '{\n  "version": "1.2.3-rc.4"\n}\n',
        ".clang-format": (source / ".clang-format").read_text(),
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


FAULTS = [
    (unformatted, "src/base/clock.c", "int one(void) { return 1; }\nint  two;\n", "src/base/clock.c is not formatted"),
    (misplaced_pages, "PLANS.md", "A page outside the folders of pages.\n", "PLANS.md is not where pages are"),
    (left_out, "fuzz/new.c", "int new;\n", "no list of Makefile.am names fuzz/new.c"),
    (left_out, "measurements/time/new.c", "int new;\n", "no list of Makefile.am names measurements/time/new.c"),
    (left_out, "share/new.py", "", "no list of Makefile.am names share/new.py"),
    (left_out, "src/json/json.c", "int new;\n", "fragments: src/json/json.c: there is no Makefile.inc"),
    (other_versions, "CITATION.cff", "cff-version: 1.2.3~rc4\nversion: 1.2.3~rc3\n", "CITATION.cff has version 1.2.3~rc3, expected 1.2.3~rc4"),
    (other_versions, "clients/python/pyproject.toml", 'version = "1.2.3~rc4"\n', "clients/python/pyproject.toml has version 1.2.3~rc4, expected 1.2.3rc4"),
    (other_versions, "clients/typescript/package.json", '  "version": "1.2.3-rc4"\n',
     "clients/typescript/package.json has version 1.2.3-rc4, expected 1.2.3-rc.4"),
    (other_versions, "configure.ac", "AC_INIT([hexad], [1.2.3-rc4])\n", "configure.ac: 1.2.3-rc4 is neither N.N.N nor N.N.N~rcN"),
    (lost_links, "doc/guide.md", "[back](gone.md)\n", "doc/guide.md: the link to gone.md"),
    (lost_links, "doc/guide.md", "[back](../ARCHITECTURE.md#gone)\n", "doc/guide.md: the link to ../ARCHITECTURE.md#gone"),
    (lost_links, "clients/README.md", "a picture:\n![a job](job.png \"a job\")\n", "clients/README.md: the link to job.png"),
    (lost_paths, "doc/guide.md", "`base/gone` returns the time\n", "doc/guide.md:1: base/gone is nowhere"),
    (lost_paths, "doc/guide.md", "`base/core/clock.c` returns the time\n", "doc/guide.md:1: base/core/clock is nowhere"),
    (lost_paths, "doc/guide.md", "as tools/gone.py does,\nand tools/fragments.sh\n", "doc/guide.md:1: tools/gone.py is nowhere"),
    (lost_paths, "doc/guide.md", "see `tools/g*.py`\n", "doc/guide.md:1: tools/g*.py is nowhere"),
    (lost_paths, "src/base/new.c", "int src;\n// as doc/gone.md says\n", "src/base/new.c:2: doc/gone.md is nowhere"),
    (lost_paths, "src/base/Makefile.inc", "x_SOURCES += %D%/gone.c\n", "src/base/Makefile.inc:1: src/base/gone.c is nowhere"),
    (lost_paths, "tools/new.py", 'PAGE = "doc/gone.md"\n', "tools/new.py:1: doc/gone.md is nowhere"),
    (lost_paths, "tests/new.sh", "# as share/gone does\n", "tests/new.sh:1: share/gone is nowhere"),
    (lost_pages, "src/base/new.c", 'int one(void)\n{\n    log_write("see gone.md");\n}\n', "src/base/new.c:3: the page gone.md is nowhere"),
    (lost_pages, "etc/hexad.conf", "# see doc/gone.md\n", "etc/hexad.conf:1: the page doc/gone.md is nowhere"),
    (lost_pages, "doc/man/hexad.8", "the page gone.md\n", "doc/man/hexad.8:1: the page gone.md is nowhere"),
    (lost_pages, "include/hexad.h", "/* doc/guide.md#gone */\n", "include/hexad.h:1: the page doc/guide.md#gone is nowhere"),
    (lost_targets, "doc/guide.md", "`make -C build time\ngone A=1`\n", "doc/guide.md:1: there is no target gone of make"),
    (lost_targets, "doc/guide.md", "```sh\nmake -j2 gone  # a word\n```\n", "doc/guide.md:2: there is no target gone of make"),
    (lost_targets, "src/base/new.c", "/* new: time.\n   `make gone` writes it. */\n", "src/base/new.c:2: there is no target gone of make"),
    (lost_targets, "tools/new.py", '"""New: `make gone` runs it."""\n', "tools/new.py:1: there is no target gone of make"),
    (undescribed_files, "src/base/new.h", "#pragma once\n", "tools/file_index.py: | `new.h` |  | says nothing"),
    (untimed_calls, ROUTES, '{.method = "GET", .name = "getTime"},\n', "routes.c: the row"),
    (untimed_calls, ROUTES, '{.method = "GET", .runs_in = ROUTE_POOL, .name = "getTime"},\n', f"{TIMES} has no times of getTime (-)"),
    (unescaped_prints, "src/json/json.c", 'void f(void)\n{\n    fprintf(stderr, "a %d\\n", 1);\n    printf("a "\n           "%-3s", x);\n}\n',
     "src/json/json.c:4: printf with %s"),
    (unescaped_prints, "src/client/wait.c", 'void f(FILE *out)\n{\n    fprintf(out, "%s", x);\n}\n', "src/client/wait.c:3: printf with %s"),
    (indexed_lists, "src/base/clock.c", "/* clock: the time. */\nint one(json_at a)\n{\n    for (size_t i = 0; i < json_size(a); i++)\n"
     "        use(a, i);\n}\n", "src/base/clock.c:4: iterate with"),
    (indexed_lists, "src/base/clock.c", "/* clock: the time. */\nconst json *one(const json_at *a)\n{\n    return json_element(a, 1);\n}\n",
     "src/base/clock.c:4: iterate with"),
    (imported_tests, "tests/service/test_new.py", "import pytest\n\nfrom test_rest import exchange\n",
     "tests/service/test_new.py:3: imports test_rest"),
    (imported_tests, "measurements/new.py", "def run():\n    import test_rest\n", "measurements/new.py:2: imports test_rest"),
    (unlicensed, "src/base/new.h", "/* new: a new file. */\n", "src/base/new.h: its first line"),
    (unlicensed, "tools/new.py", "#!/usr/bin/env python3\n\"\"\"New.\"\"\"\n# SPDX-License-Identifier: Apache-2.0\n", "tools/new.py: its first line"),
    (unnamed_tests, "tests/service/test_new.py", "", "tests/README.md does not name test_new.py"),
    (unnamed_tests, "tests/README.md", "`clock.h` and `gone.py`\n", "tests/README.md names gone.py"),
    (unpackaged_paths, "share/new.py", "# PYTHONPATH=/usr/share/hexad/python\n", "share/new.py: no package has /usr/share/hexad/python"),
    (inexact_calls, "src/base/new.c", "/* new: sin(x). */\ndouble cube(double x)\n{\n    return x > 0 ? pow(x, 3) : floor(x);\n}\n",
     "src/base/new.c:4: pow depends on the processor"),
    (inexact_calls, "src/base/new.cc", "// SPDX-License-Identifier: Apache-2.0\nfloat f(float x)\n{\n    return std::expf(x);\n}\n",
     "src/base/new.cc:4: expf depends on the processor"),
    (lost_recipes, "CONTRIBUTING.md", "\n## Recipes\n\n`gone.h`\n", "CONTRIBUTING.md: a recipe names gone.h"),
]


@pytest.mark.parametrize("check, name, text, told",
                         [pytest.param(*f, marks=pytest.mark.extended) if f[0] is unformatted else f for f in FAULTS],
                         ids=[f[3].replace("/", " ") for f in FAULTS])
def test_a_fault_is_found(small, check, name, text, told):
    if check is unformatted and not shutil.which(CLANG_FORMAT):
        pytest.skip(f"{CLANG_FORMAT} is not installed")
    assert not check(small)
    (small / name).parent.mkdir(exist_ok=True, parents=True)
    (small / name).write_text(text)
    found = check(small)
    assert len(found) == 1 and found[0].startswith(told), found


# ---- which test is in which tier

TIERS = {  # the lists of tools/fragments.sh that have the files of each tier
    "basic": ("longest_tests", "other_tests"),
    "sanitized": ("sanitized_tests",),
    "extended": ("extended_tests", "campaign_tests"),
}


def listed_tests(root, variables):
    return {word for words in re.findall(rf"^(?:{'|'.join(variables)}) =(.*)$", fragments(root), re.M) for word in words.split()}


@pytest.fixture(scope="module")
def files_by_tier(source):
    found = {tier: set() for tier in TIERS}
    places = ["tests/service", "tests/tools", "tests/crash", *sorted(str(p.relative_to(source)) for p in source.glob("tests/test_*.py"))]
    for place in places:  # one at a time: there are equal names in two folders
        done = subprocess.run([sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--collect-only", "-q", "--tiers", place],
                              cwd=source, capture_output=True, text=True,
                              env={k: v for k, v in os.environ.items() if k not in ("HEXAD_TIER", "HEXAD_TAP_FD")})
        assert done.returncode == 0, done.stdout
        for line in done.stdout.splitlines():
            if line.startswith("tiers of "):
                name, *tiers = line.split()[2:]
                for tier in tiers:
                    found[tier].add(name)
    return found


@pytest.mark.extended
@pytest.mark.parametrize("tier", TIERS)
def test_lists_have_the_files_with_tests_of_a_tier(source, files_by_tier, tier):
    assert listed_tests(source, TIERS[tier]) == files_by_tier[tier]
