# SPDX-License-Identifier: Apache-2.0
"""When ./bootstrap generates configure anew, and the lists of files that it writes (tools/fragments.sh)."""
import os
import re
import shutil
import subprocess

import pytest


@pytest.fixture
def generated(source, tmp_path):
    """A tree whose lists and configure are up to date, and a program in place of autoreconf that says that it ran."""
    tree, programs = tmp_path / "tree", tmp_path / "bin"
    for folder in (tree / "src/io/points", tree / "measurements/speed", tree / "tests", tree / "tools", programs):
        folder.mkdir(parents=True)
    for name in ("bootstrap", "tools/fragments.sh"):
        shutil.copy(source / name, tree / name)
    for name in ("tests/longest.txt", "src/io/points/ply.c"):
        (tree / name).touch()
    (tree / "src/io/points/Makefile.inc").write_text("libhexad_a_SOURCES += $(src_io_points)\n")
    (tree / "measurements/speed/Makefile.inc").touch()
    subprocess.run([tree / "tools/fragments.sh"], check=True)
    for name, age in (("src/io/points/Makefile.inc", 30), ("measurements/speed/Makefile.inc", 30), ("build-aux/files.mk", 30),
                      ("Makefile.am", 30), ("configure.ac", 30), ("Makefile.in", 20), ("configure", 10)):
        (tree / name).touch()
        set_age(tree / name, age)
    (tree / "configure").chmod(0o755)
    (programs / "autoreconf").write_text("#!/bin/sh\ntouch generated\n")
    (programs / "autoreconf").chmod(0o755)

    def run():
        subprocess.run([tree / "bootstrap", "tree"], check=True, capture_output=True,
                       env={**os.environ, "HEXAD_NO_INSTALL": "1", "PATH": f"{programs}:{os.environ['PATH']}"})
        return (tree / "generated").exists()
    return tree, run


def set_age(path, seconds):
    at = path.stat().st_mtime - seconds
    os.utime(path, (at, at))


def test_an_unchanged_tree_is_not_generated_anew(generated):
    tree, run = generated
    assert not run()


@pytest.mark.parametrize("name", ["Makefile.am", "src/io/points/Makefile.inc", "measurements/speed/Makefile.inc"])
def test_a_changed_list_of_any_folder_generates_configure_anew(generated, name):
    tree, run = generated
    (tree / name).touch()
    assert run()


def test_a_file_that_appears_or_disappears_generates_configure_anew(generated):
    tree, run = generated
    (tree / "src/io/points/npz.c").touch()
    assert run() and "src/io/points/npz.c" in (tree / "build-aux/files.mk").read_text()
    (tree / "generated").unlink()
    (tree / "src/io/points/ply.c").unlink()
    assert run() and "ply.c" not in (tree / "build-aux/files.mk").read_text()


# ---- the lists

@pytest.fixture
def lists(source, tmp_path):
    """Writes files into a tree, and returns its lists: name -> words."""
    def write_and_list(**files):
        for name, text in {"tools/fragments.sh": (source / "tools/fragments.sh").read_text(), "tests/longest.txt": "", **files}.items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(text)
        done = subprocess.run(["sh", tmp_path / "tools/fragments.sh", "--print"], capture_output=True, text=True)
        found = re.findall(r"^(\w+) \+?=(.*)$", done.stdout.replace("\\\n", ""), re.M)
        return {name: words.split() for name, words in found} | {"faults": done.stderr}
    return write_and_list


def test_a_list_has_the_files_of_a_folder_and_of_those_below_it(lists):
    found = lists(**{"src/a/Makefile.inc": "", "src/a/one.c": "", "src/a/one.h": "", "src/a/b/two.cc": "", "src/a/c/Makefile.inc": "",
                     "src/a/c/three.c": "", "src/a/notes.txt": ""})
    assert found["src_a"] == ["src/a/b/two.cc", "src/a/one.c", "src/a/one.h"] and found["src_a_c"] == ["src/a/c/three.c"]


def test_a_list_leaves_out_what_its_makefile_names_but_not_what_is_compiled_twice(lists):
    found = lists(**{"src/a/Makefile.inc": "if PREVIEW\nx_SOURCES += \\\n\t%D%/one.c %D%/two.c\nendif\nhexad_y_so_SOURCES = %D%/three.c\n"
                     "tests_unit_test_z_SOURCES = $(test_z_files) %D%/four.c\n",
                     **{f"src/a/{name}.c": "" for name in ("one", "two", "three", "four")}})
    assert found["src_a"] == ["src/a/four.c", "src/a/three.c"]


def test_a_source_without_a_list_is_a_fault(lists):
    assert "src/a/one.c: there is no Makefile.inc" in lists(**{"src/a/one.c": ""})["faults"]


def test_a_unit_test_is_made_of_the_fixtures_that_it_includes(lists):
    found = lists(**{"tests/unit/test_a.c": '#include "one.h"\n', "tests/unit/one.h": "", "tests/unit/one.c": '#include "two.h"\n',
                     "tests/unit/two.h": "", "tests/unit/test_b.c": "#include <stdio.h>\n"})
    assert sorted(found["tests_unit_test_a_SOURCES"] + found["test_a_files"]) == [
        "$(test_a_files)", "tests/unit/one.c", "tests/unit/one.h", "tests/unit/test_a.c", "tests/unit/two.h"]
    assert found["unit_tests"] == ["tests/unit/test_a", "tests/unit/test_b"] and "tests_unit_test_b_SOURCES" not in found


def test_a_unit_test_is_linked_with_what_it_includes(lists):
    found = lists(**{"src/a/Makefile.inc": "libvolume_a_SOURCES += $(src_a)\n", "src/b/Makefile.inc": "libvolume_a_SOURCES += %D%/x.c\n",
                     "tests/unit/test_a.c": '#include "a/x.h"\n', "tests/unit/test_b.c": '#include "b/x.h"\n',
                     "tests/unit/test_c.c": '#include "service/x.h"\n'})
    assert found["tests_unit_test_a_LDADD"] == ["$(volume_ldadd)"] and "tests_unit_test_b_LDADD" not in found
    assert found["daemon_tests"] == ["tests/unit/test_c"] and "$(SERVICE_LDADD)" in found["tests_unit_test_c_LDADD"]


def test_a_makefile_puts_unit_tests_into_lists_itself(lists):
    found = lists(**{"src/a/Makefile.inc": "measuring_tests += tests/unit/test_a\ntests_unit_test_b_LDADD = x\n",
                     "tests/unit/test_a.c": "", "tests/unit/test_b.c": '#include "service/x.h"\n'})
    assert found["unit_tests"] == [] and "tests_unit_test_b_LDADD" not in found


def test_markers_give_the_tiers_of_a_file(lists):
    test, mark, data = "def test_one():\n    pass\n", "pytest.mark.", "shared" "_data"  # in parts: the lists are made from the text of this file, too
    found = lists(**{
        "tests/longest.txt": "# a comment\nservice/test_long.py\n", "tests/service/test_long.py": test, "tests/service/test_a.py": test,
        "tests/service/test_b.py": f"pytestmark = {mark}extended\n" + test,
        "tests/service/test_c.py": f"@{mark}extended\n{test}\n@{mark}sanitized\n{test}",
        "tests/service/test_d.py": f"@{mark}extended\n@{mark}sanitized\n{test}def test_two({data}):\n    pass\n",
        "tests/service/test_e.py": f"pytestmark = [{mark}extended, {mark}campaign]\n{test}"})
    names = {name: "".join(re.findall(r"test_(\w)", " ".join(found[name])))
             for name in ("longest_tests", "other_tests", "sanitized_tests", "extended_tests", "campaign_tests")}
    assert names == {"longest_tests": "l", "other_tests": "ac", "sanitized_tests": "cd", "extended_tests": "bcd", "campaign_tests": "e"}


def test_a_long_test_that_is_nowhere_is_a_fault(lists):
    assert "tests/service/test_gone.py, which is nowhere" in lists(**{"tests/longest.txt": "service/test_gone.py\n"})["faults"]


def test_copies_and_packages_of_others_are_in_no_list(lists):
    found = lists(**{"page/one.js": "", "page/preact.js": "", "page/node_modules/a/two.js": "", "tests/__pycache__/x.py": "",
                     "doc/guide.md": ""})
    assert found["page_files"] == ["page/one.js"]
    assert found["distributed_files"] == ["doc/guide.md", "tests/longest.txt", "tools/fragments.sh"]
