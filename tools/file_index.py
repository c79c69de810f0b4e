#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Prints an index of the source files: what the first comment of each says it is.

    tools/file_index.py

A header and its .c file are one row. The text is the first sentence of the first comment of the header (of the .c file if there is
no header), without the name that it starts with.
"""
import argparse
import pathlib
import re
import sys

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
    return "\n".join(lines[1:]) + "\n"


def main():
    argparse.ArgumentParser(description=__doc__.split("\n")[0]).parse_args()
    print(section(pathlib.Path(__file__).resolve().parent.parent), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
