# SPDX-License-Identifier: Apache-2.0
"""tools/commit.sh identifies the sources of a build: a clone, a clone with changes, a tarball, or nothing."""
import os
import shutil
import subprocess

import pytest

NAMES = {"GIT_AUTHOR_NAME": "a", "GIT_AUTHOR_EMAIL": "a@example.invalid", "GIT_COMMITTER_NAME": "a",
         "GIT_COMMITTER_EMAIL": "a@example.invalid", "GIT_CONFIG_GLOBAL": os.devnull}


@pytest.fixture
def tree(source, tmp_path):
    """A folder with the script and a source file."""
    for name in ("tools/commit.sh", "configure.ac", "Makefile.am"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(source / name, tmp_path / name)
    (tmp_path / "src").mkdir()
    (tmp_path / "src/one.c").write_text("int one;\n")
    return tmp_path


def commit_of(tree):
    return subprocess.run([tree / "tools/commit.sh", tree], check=True, capture_output=True, text=True).stdout.strip()


def git(tree, *words):
    return subprocess.run(["git", "-C", tree, *words], check=True, capture_output=True, text=True, env={**os.environ, **NAMES}).stdout.strip()


@pytest.mark.skipif(not shutil.which("git"), reason="git is not installed")
def test_a_clone_has_its_commit_and_a_hash_of_changes(tree):
    git(tree, "init")
    git(tree, "add", ".")
    git(tree, "commit", "-m", "one")
    head = git(tree, "rev-parse", "HEAD")
    assert commit_of(tree) == head
    (tree / "README.md").write_text("no part of a build\n")
    assert commit_of(tree) == head
    (tree / "src/one.c").write_text("int two;\n")
    changed = commit_of(tree)
    assert changed.startswith(f"{head}-") and len(changed) == 81
    (tree / "src/one.c").write_text("int three;\n")
    assert commit_of(tree) not in (head, changed)


def test_a_tarball_has_the_commit_of_its_file_also_within_a_clone(tree):
    inner = tree / "hexad"
    shutil.copytree(tree / "tools", inner / "tools")
    if shutil.which("git"):
        git(tree, "init")
    assert commit_of(inner) == ""
    (inner / "build-aux").mkdir()
    (inner / "build-aux/commit").write_text("0123abcd\n")
    assert commit_of(inner) == "0123abcd"
