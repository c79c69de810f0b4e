# SPDX-License-Identifier: Apache-2.0
"""Small faults in the C code of src: what measurements/mutations/mutate.py can put into a line, and which of them it chooses.

A fault is a change of one line, or of the lines of one lock. The code is formatted by clang-format, so binary operators
have a space on each side. Comments, strings and preprocessor lines are masked before a pattern is applied.
"""
import collections
import dataclasses
import math
import random
import re
import zlib

SKIPPED_FILES = re.compile(r"_(table|schemas)\.c$")  # rows, no logic
NOT_MUTATED = re.compile(r"\b(assert|static_assert|_Static_assert|log_\w+)\(")

INVERTED = {"<": ">=", ">=": "<", ">": "<=", "<=": ">", "==": "!=", "!=": "=="}
OFF_BY_ONE = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
OPPOSITE = {"+": "-", "-": "+", "*": "/", "/": "*"}
UNITS = {"1000": "1", "1e3": "1.0", "1e-3": "1.0", "1e6": "1e3", "1e-6": "1e-3", "1e9": "1e6", "1e-9": "1e-6",
         "3600": "60", "1024": "1000", "1000000": "1000", "1000000000": "1000000"}

COMPARISON = re.compile(r"(?<= )(<=|>=|==|!=|<|>)(?= )")
BOOLEAN = re.compile(r"(?<= )(&&|\|\|)(?= )")
ARITHMETIC = re.compile(r"(?<=[\w\])] )([-+*/])(?= [\w(*&-])")
COMPOUND = re.compile(r"(?<= )([-+*/])(?== )")
UNIT = re.compile(r"(?<![\w.])(" + "|".join(sorted(map(re.escape, UNITS), key=len, reverse=True)) + r")(?![\w.])")
LITERAL = re.compile(r"(?<![\w.])(\d+\.\d+)(?![\w.])")
CONSTANT = re.compile(r"^(?:static const (?:double|float|int|unsigned|size_t|u?int\d+_t) |enum \{ )(\w+) = "
                      r"([\w.+*/ -]+?)(?: \})?;")
MINUS = re.compile(r"(?:(?<=[=(,*/?:] )|(?<=\()|(?<=return ))-(?=[A-Za-z_(])")
CALL = re.compile(r"^(\w+)\(.*\);$")
FREE = re.compile(r"^(\w*free\w*|mem_free|close|fclose|closedir|unlink|sqlite3_finalize)\(.*\);$")
ASSIGNMENT = re.compile(r"^\*?[A-Za-z_][\w.>\[\]+-]*(?:->[\w.\[\]]+)* (?:[-+*/|&]|<<|>>)?= .*;$")
LOCK = re.compile(r"^(\w*?)(_lock|lock_)(\w*)\((.*)\);$")


@dataclasses.dataclass(frozen=True)
class Mutant:
    """One fault. `edits` are (line number, text before, text after); `mapped` are the lines whose tests execute it."""
    file: str
    operator: str
    edits: tuple
    mapped: tuple
    id: str = ""

    @property
    def line(self):
        return self.edits[0][0]


def mask(text):
    """The text with comments, contents of strings and preprocessor lines replaced by spaces or underscores."""
    out = []
    pattern = re.compile(r"//[^\n]*|/\*.*?\*/|\"(?:\\.|[^\"\\\n])*\"|'(?:\\.|[^'\\\n])*'|^[ \t]*#(?:\\\n|[^\n])*", re.S | re.M)
    end = 0
    for found in pattern.finditer(text):
        out.append(text[end:found.start()])
        word = found.group()
        if word[0] in "\"'":
            out.append(word[0] + "_" * (len(word) - 2) + word[-1])
        else:
            out.append(re.sub(r"[^\n]", " ", word))
        end = found.end()
    out.append(text[end:])
    return "".join(out)


def closing(text, start):
    """The position of the parenthesis that closes the one at start, or -1: it is on another line."""
    depth = 0
    for i in range(start, len(text)):
        depth += (text[i] == "(") - (text[i] == ")")
        if depth == 0:
            return i
    return -1


def statement_start(masked):
    """Where the statement of a line begins: behind its indentation, `if (...)`, `else`, `for (...)` and `while (...)`."""
    at = len(masked) - len(masked.lstrip())
    while True:
        head = re.compile(r"(?:else )?(?:if|for|while) (?=\()|else ").match(masked, at)
        if not head:
            return at
        if masked[head.end() - 5:head.end()] == "else " and masked[head.end()] != "(":
            at = head.end()
            continue
        end = closing(masked, head.end())
        if end < 0 or masked[end + 1:end + 2] != " " or masked[end + 2:end + 3] in ("{", ""):
            return None
        at = end + 2


class File:
    """A file of src, and the faults that can be put into it."""

    def __init__(self, path, text):
        self.path = path
        self.lines = text.split("\n")
        self.masked = mask(text).split("\n")
        self.found = []

    def add(self, operator, number, after, mapped=None):
        before = self.lines[number - 1]
        if after != before:
            self.found.append(Mutant(self.path, operator, ((number, before, after),), mapped or (number,)))

    def begins_statement(self, number):
        """Whether the line is not the continuation of the line before."""
        for i in range(number - 2, -1, -1):
            text = self.masked[i].rstrip()
            if text:
                return text[-1] in ";{}:)" or text.endswith("else")
        return False

    def replace(self, operator, number, found, text):
        """Replaces a match in the masked line. Outside of strings both lines have the same positions."""
        line = self.lines[number - 1]
        self.add(operator, number, line[:found.start()] + text + line[found.end():])

    def expressions(self, number):
        masked = self.masked[number - 1]
        for found in COMPARISON.finditer(masked):
            self.replace("inverted comparison", number, found, INVERTED[found.group()])
            if found.group() in OFF_BY_ONE:
                self.replace("bound off by one", number, found, OFF_BY_ONE[found.group()])
        for found in BOOLEAN.finditer(masked):
            self.replace("boolean operator", number, found, "||" if found.group() == "&&" else "&&")
        for found in ARITHMETIC.finditer(masked):
            self.replace("arithmetic operator", number, found, OPPOSITE[found.group()])
        for found in COMPOUND.finditer(masked):
            self.replace("sign of a term" if found.group() in "+-" else "arithmetic operator", number, found,
                         OPPOSITE[found.group()])
        for found in MINUS.finditer(masked):
            self.replace("sign of a term", number, found, "")
        for found in UNIT.finditer(masked):
            self.replace("wrong unit or constant", number, found, UNITS[found.group()])
        for found in LITERAL.finditer(masked):
            if float(found.group()) != 0:
                self.replace("wrong unit or constant", number, found, f"(2 * {found.group()})")

    def conditions(self, number):
        line, masked = self.lines[number - 1], self.masked[number - 1]
        head = re.match(r"\s*(?:\} )?(?:else )?if \(", masked)
        end = closing(masked, head.end() - 1) if head else -1
        if end < 0:
            return
        self.add("negated condition", number, f"{line[:head.end()]}!({line[head.end():end]}){line[end:]}")
        action = re.match(r" (return|goto)\b[^;]*;$", masked[end + 1:])
        if action and re.search(r"\b(e|error|why)\)", masked):
            self.add("ignored error", number, line[:end + 1] + " (void)0;")

    def statements(self, number):
        line, masked = self.lines[number - 1], self.masked[number - 1]
        start = statement_start(masked)
        if start is None or not self.begins_statement(number):
            return
        statement = masked[start:].rstrip()
        if statement.count("(") != statement.count(")") or statement.count("{") != statement.count("}"):
            return
        if statement == "return false;":
            self.add("ignored error", number, line[:start] + "return true;")
        elif re.match(r"return error_set\(.*\);$", statement):
            self.add("ignored error", number, line[:start + len(statement) - 1] + ", true;")
        elif FREE.match(statement):
            self.add("missing free", number, line[:start] + ";")
        elif LOCK.match(statement):
            self.lock(number, start)
        elif "unlock" in statement.split("(")[0]:
            return  # a lock that stays locked is found by every test that waits for it
        elif CALL.match(statement) or ASSIGNMENT.match(statement):
            self.add("deleted statement", number, line[:start] + ";")

    def lock(self, number, start):
        """Deletes the call that locks, and up to the function's end the calls that unlock the same."""
        name, mark, rest, argument = LOCK.match(self.masked[number - 1][start:].rstrip()).groups()
        unlock = f"{name}{mark.replace('lock', 'unlock')}{rest}({argument});"
        edits = [(number, self.lines[number - 1], self.lines[number - 1][:start] + ";")]
        for at in range(number + 1, len(self.lines) + 1):
            if self.lines[at - 1] == "}":
                break
            if unlock in self.masked[at - 1]:
                line = self.lines[at - 1]
                edits.append((at, line, line.replace(unlock, ";")))
        if len(edits) > 1:
            self.found.append(Mutant(self.path, "lock not taken", tuple(edits), (number,)))

    def constants(self, code_lines):
        for number, masked in enumerate(self.masked, 1):
            found = CONSTANT.match(masked)
            if not found:
                continue
            used = tuple(n for n in code_lines if re.search(rf"\b{found[1]}\b", self.masked[n - 1]))
            if used:
                line = self.lines[number - 1]
                self.add("wrong unit or constant", number,
                         f"{line[:found.start(2)]}2 * ({found[2]}){line[found.end(2):]}", used)

    def mutants(self, code_lines):
        """All faults of the lines that have code."""
        self.constants(code_lines)
        for number in code_lines:
            if number > len(self.lines) or NOT_MUTATED.search(self.masked[number - 1]):
                continue
            self.expressions(number)
            self.conditions(number)
            self.statements(number)
        return self.found


def identified(mutants):
    """The mutants with an id that survives changes of other lines: file, operator, and a sum of the changed text."""
    out, seen = [], collections.Counter()
    for m in mutants:
        text = "\n".join((m.file, m.operator, *(part.strip() for edit in m.edits for part in edit[1:])))
        seen[text] += 1
        number = zlib.crc32(f"{text}\n{seen[text]}".encode())
        stem = m.file.rsplit("/", 1)[-1].removesuffix(".c")
        out.append(dataclasses.replace(m, id=f"{stem}-{m.operator.split()[0]}-{number:08x}"))
    return out


def quotas(sizes, count):
    """Divides count over the folders in proportion to their sizes, at least 1 each (largest remainders)."""
    total = sum(sizes.values())
    exact = {name: max(1.0, count * size / total) for name, size in sizes.items()}
    scale = count / sum(exact.values())
    share = {name: max(1, math.floor(value * scale)) for name, value in exact.items()}
    order = sorted(sizes, key=lambda name: (share[name] - exact[name] * scale, name))
    for i in range(count - sum(share.values())):
        share[order[i % len(order)]] += 1
    return share


def folder_of(path):
    return path.rsplit("/", 1)[0]


class Choice:
    """Draws mutants: the kind of fault and the file that have been drawn least often first, each line once."""

    def __init__(self, mutants, seed):
        self.pools = collections.defaultdict(list)
        order = sorted(mutants, key=lambda m: m.id)
        random.Random(seed).shuffle(order)
        for m in order:
            self.pools[folder_of(m.file)].append(m)
        self.operators, self.files = collections.Counter(), collections.Counter()

    def draw(self, folder=None, file=None):
        """The next mutant, of a folder or a file if one is given; None if none is left."""
        pool = self.pools[folder or folder_of(file)] if folder or file else [m for p in self.pools.values() for m in p]
        chosen = min((m for m in pool if file in (None, m.file)), default=None,
                     key=lambda m: (self.operators[m.operator], self.files[m.file]))
        if chosen:
            self.operators[chosen.operator] += 1
            self.files[chosen.file] += 1
            folder = folder_of(chosen.file)
            self.pools[folder] = [m for m in self.pools[folder] if (m.file, m.line) != (chosen.file, chosen.line)]
        return chosen


def choose(executed, sizes, count, seed, required, each=2, spare=4):
    """(chosen mutants, {id: mutants that replace it if it does not compile}). `required` files get `each` at least."""
    choice = Choice(executed, seed)
    share = quotas(sizes, count)
    chosen = []
    for path in required:
        for m in filter(None, (choice.draw(file=path) for _ in range(each))):
            chosen.append(m)
            share[folder_of(path)] -= 1
    for folder in sorted(share):
        chosen += filter(None, (choice.draw(folder) for _ in range(share[folder])))
    while len(chosen) < count:
        m = choice.draw()
        if not m:
            break
        chosen.append(m)
    operators = choice.operators.copy()
    spares = {}
    for m in chosen:
        place = {"file": m.file} if m.file in required else {"folder": folder_of(m.file)}
        spares[m.id] = list(filter(None, (choice.draw(**place) for _ in range(spare))))
        choice.operators = operators.copy()
    return chosen, spares
