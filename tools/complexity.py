#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Counts what makes C code hard to change: lines, constants, statements, and circles of calls between files.

    tools/complexity.py constants FOLDER ...    named constants, and numeric literals elsewhere, of each folder
    tools/complexity.py statements FOLDER ...   statements of each folder
    tools/complexity.py lines FOLDER ...        lines of each folder without comments and blank lines
    tools/complexity.py circles FOLDER ...      groups of .c files each of which reaches every other by calls; ends with 1 if there are any

A named constant is a `static const` number or array of numbers, a member of an enumeration with a value, or a macro that is a number; one of
several values counts once for each. Literals that are 0, 1, 2 or 0.5 do not count, with either sign, nor do those in array
subscripts, in case labels and in shifts. A statement is a semicolon outside of the head of a `for`, comments and strings; the code is
formatted as clang-format leaves it, so that no two programs count differently.
"""
import argparse
import collections
import pathlib
import re
import sys

COMMENT = re.compile(r'/\*.*?\*/|//[^\n]*', re.S)
STRING = re.compile(r'"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'')
NUMBER = re.compile(r'(?<![\w.])(?:0[xX][0-9a-fA-F]+|(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)[fFuUlL]*(?![\w.])')
# `static const double A = 1, B[2] = {3, 4};`, an enumeration with values, `#define A 3`
CONSTANTS = re.compile(r'^[ \t]*static const (?:unsigned |signed )?\w+ [^;()]*?=[^;]*;|\benum\b[^{};]*\{[^}]*\}|^#define \w+ .*?(?<!\\)$', re.M | re.S)
USUAL = {0.0, 1.0, 2.0, 0.5}
DEFINITION = re.compile(r'^(?!static\b|typedef\b|#|struct \w+ \{|enum\b)\w[\w \*]*?\b(\w+)\([^;{}]*\)\s*\{', re.M)
CALL = re.compile(r'\b(\w+)\(')


def code_of(path):
    """The text without comments, and with empty strings."""
    return STRING.sub('""', COMMENT.sub(' ', path.read_text()))


def value(literal):
    digits = literal.rstrip('uUlL')
    return float(int(digits, 16)) if digits[:2] in ('0x', '0X') else float(digits.rstrip('fF'))


def counted(text):
    text = re.sub(r'\[[^\]\[]*\]|\bcase\b[^:]*:|(<<|>>)=? *\d+|#include[^\n]*', ' ', text)
    return sum(value(m.group()) not in USUAL for m in NUMBER.finditer(text))


def constants_of(path):
    """Named constants, and literals elsewhere."""
    code = code_of(path)
    named = sum(counted(m.group()) for m in CONSTANTS.finditer(code))
    return named, counted(CONSTANTS.sub(' ', code))


def statements_of(path):
    return re.sub(r'\bfor \([^{}]*?;[^{}]*?;', 'for (', code_of(path)).count(';')


def lines_of(path):
    """Lines that are not blank once comments are removed."""
    code = re.sub(rf"{STRING.pattern}|({COMMENT.pattern})", lambda m: "" if m[1] else m[0], path.read_text(), flags=re.S)
    return sum(1 for line in code.split("\n") if line.strip())


def sources(folder, *suffixes):
    return sorted(p for p in pathlib.Path(folder).rglob('*') if p.suffix in suffixes)


def circles(files):
    """Groups of files that reach each other by calls of functions with external linkage."""
    home, calls = {}, {}
    code = {path: code_of(path) for path in files}
    for path in files:
        for m in DEFINITION.finditer(code[path]):
            home[m.group(1)] = path
    for path in files:
        calls[path] = {home[name] for name in CALL.findall(code[path]) if name in home} - {path}
    reached = {path: reach(path, calls) for path in files}
    groups, seen = [], set()
    for path in files:
        group = sorted(p for p in reached[path] if path in reached[p])
        if path not in seen and len(group) > 1:
            groups.append(group)
        seen.update(group)
    return groups


def reach(path, calls):
    found, front = set(), [path]
    while front:
        for called in calls[front.pop()]:
            if called not in found:
                found.add(called)
                front.append(called)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("constants", "statements", "lines", "circles"))
    parser.add_argument("folder", nargs="+")
    args = parser.parse_args()
    if args.what == "circles":
        groups = circles([path for folder in args.folder for path in sources(folder, ".c")])
        for group in groups:
            print(" ".join(map(str, group)))
        return 1 if groups else 0
    total = collections.Counter()
    for folder in args.folder:
        of = collections.Counter()
        for path in sources(folder, ".c", ".h", ".cc"):
            if args.what in ("statements", "lines"):
                of[args.what] += {"statements": statements_of, "lines": lines_of}[args.what](path)
            else:
                of["named"], of["elsewhere"] = (a + b for a, b in zip((of["named"], of["elsewhere"]), constants_of(path)))
        total += of
        print(folder, " ".join(f"{name} {count}" for name, count in of.items()))
    print("all", " ".join(f"{name} {count}" for name, count in total.items()), "sum", total.total())
    return 0


if __name__ == "__main__":
    sys.exit(main())
