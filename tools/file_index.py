#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the tables of doc/files.md: for each source file, what its first comment says it is.

    tools/file_index.py [--check]

A header and its .c file are one row. The text is the first sentence of the first comment of the header (of the .c file if there is
no header), without the name that it starts with. --check: changes nothing; prints the rows that differ, and ends with 1 if any do.
"""
import argparse
import difflib
import pathlib
import re
import sys

PAGE = "doc/files.md"
BEGIN, END = "<!-- files: written by tools/file_index.py -->", "<!-- end of files -->"
FOLDERS = ("src", "page", "clients/python/hexad", "clients/typescript")
SUFFIXES = (".h", ".c", ".cc", ".js", ".py")


def first_comment(text):
    """The text of the first comment or docstring, without its markers; empty if the file does not start with one. The licence is skipped."""
    text = re.sub(r"\A(#!.*\n|(//|#) SPDX-.*\n|\s+|#include .*\n)+", "", text)
    for pattern in (r'\A"""(.*?)"""', r"\A/\*+(.*?)\*/", r"\A((?://[^\n]*\n)+)"):
        found = re.match(pattern, text, re.S)
        if found:
            return re.sub(r"(?m)^\s*(\*|//)? ?", "", found[1]).strip()
    return ""


def first_sentence(comment, name):
    """The first sentence, without `name: ` at its start."""
    paragraph = re.sub(r"\s+", " ", comment.split("\n\n")[0])
    return re.sub(r"\.( .*|$)", "", re.sub(rf"^{re.escape(name)}(\.\w+)?: ", "", paragraph)).rstrip(" :")


def rows(folder):
    """(names, text) of each module of a folder, sorted."""
    modules = {}
    for path in sorted(folder.iterdir()):
        if path.suffix in SUFFIXES and path.name != "__init__.py":
            modules.setdefault(path.stem, []).append(path)
    for stem, paths in sorted(modules.items()):
        paths.sort(key=lambda path: SUFFIXES.index(path.suffix))
        texts = [first_sentence(first_comment(path.read_text()), stem) for path in paths]
        names = "`" + stem + ("`" if len(paths) > 1 and paths[0].suffix == ".h" else paths[0].suffix + "`")
        yield names, next((text for text in texts if text), "").replace("|", "\\|").replace("<", "&lt;")


def section(root):
    lines = []
    folders = [folder for top in FOLDERS for folder in [root / top, *sorted((root / top).rglob("*"))] if folder.is_dir()]
    for folder in folders:
        table = list(rows(folder)) if not {"__pycache__", "node_modules"} & set(folder.parts) else []
        if table:
            lines += ["", f"## {folder.relative_to(root)}", "", "| file | what it is |", "|---|---|"]
            lines += [f"| {names} | {text} |" for names, text in table]
    return "\n".join(lines) + "\n\n"


def parts(root):
    """The page before, in and after the tables, and the tables as they must be."""
    before, _, rest = (root / PAGE).read_text().partition(BEGIN)
    present, _, after = rest.partition(END)
    return before, present, after, "\n" + section(root)


def differences(root):
    """Rows that are missing (+) and rows that are wrong (-)."""
    _, present, _, wanted = parts(root)
    return [line for line in difflib.unified_diff(present.splitlines(), wanted.splitlines(), lineterm="", n=0)
            if re.match(r"[+-]\|", line)]


def main():
    arguments = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    arguments.add_argument("--check", action="store_true")
    root = pathlib.Path(__file__).resolve().parent.parent
    if arguments.parse_args().check:
        found = differences(root)
        print("".join(line + "\n" for line in found), end="")
        return 1 if found else 0
    before, _, after, wanted = parts(root)
    (root / PAGE).write_text(before + BEGIN + wanted + END + after)
    return 0


if __name__ == "__main__":
    sys.exit(main())
