# SPDX-License-Identifier: Apache-2.0
"""When ./bootstrap generates configure anew."""
import os
import shutil
import subprocess

import pytest


@pytest.fixture
def generated(source, tmp_path):
    """A tree whose configure is up to date, and a program in place of autoreconf that says that it ran."""
    tree, programs = tmp_path / "tree", tmp_path / "bin"
    for folder in (tree / "src/io/points", programs):
        folder.mkdir(parents=True)
    shutil.copy(source / "bootstrap", tree / "bootstrap")
    for name, age in (("src/io/points/Makefile.inc", 30), ("Makefile.am", 30), ("configure.ac", 30), ("Makefile.in", 20),
                      ("configure", 10)):
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


@pytest.mark.parametrize("name", ["Makefile.am", "src/io/points/Makefile.inc"])
def test_a_changed_list_of_any_folder_generates_configure_anew(generated, name):
    tree, run = generated
    (tree / name).touch()
    assert run()
