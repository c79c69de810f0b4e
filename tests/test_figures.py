# SPDX-License-Identifier: Apache-2.0
"""The measured figures of pages, compared with the results that they name (measurements/README.md).

A link names a figure in its title: `[0.91](measurements/speed/README.md "comparison.csv: hexad torus, cpu_s")`. The file lies beside
the linked page, or is the linked file; the first column names the row. A table is named in the line before it:
`<!-- figures: PATH.csv; label = csv_name; ... -->`, with a path relative to the page. The first cell of a row of the table is the
first column of the file. The labels of the columns are names of the file, unless the comment translates them. Empty cells are not
compared. Figures are compared at the digits that are shown.
"""
import csv
import os
import re
import subprocess

import pytest

LINK = re.compile(r'\[([^\]\[]*)\]\(([^)\s"]+)\s+"([^"]*)"\)(\s?%?)')
TITLE = re.compile(r"(\S+\.csv): (.+), ([^,]+)")
TABLE = re.compile(r"^<!-- figures: ([^>]*?) -->\n((?:\|.*\n)*)", re.M)
NUMBER = re.compile(r"[-−+]?(?:\d{1,3}(?:[ \u00a0]\d{3})+|\d+)?(\.\d+)?(?:e([-+]?\d+))?")


def pages_of(root):
    listed = subprocess.run(["git", "-C", root, "ls-files", "--", "*.md"], capture_output=True, text=True).stdout.splitlines()
    walked = [os.path.relpath(path, root) for path in root.rglob("*.md") if "node_modules" not in path.parts]
    return [name for name in sorted(listed or walked) if (root / name).is_file()]


def number_of(text):
    """(value, half of the last digit) of a figure, or None."""
    found = NUMBER.fullmatch(text)
    if not found or not re.search(r"\d", text):
        return None
    digits = -len(found[1]) + 1 if found[1] else 0
    return float(re.sub(r"[ \u00a0]", "", text).replace("−", "-")), 0.5 * 10.0 ** (digits + int(found[2] or 0))


def agrees(shown, value, is_percent=False):
    """Whether a figure of a page is a value of a file: the same text, or the value rounded to the digits that are shown. A figure
    in percent may be a fraction in the file."""
    plain = re.sub(r"[*`]", "", shown).replace("\\|", "|").strip()
    if " ".join(plain.split()) == " ".join(value.split()):
        return True
    if plain.endswith("%"):
        plain, is_percent = plain[:-1].rstrip(), True
    figure, exact = number_of(plain), number_of(value.strip())
    if not figure or not exact:
        return False
    return any(abs(figure[0] - exact[0] * scale) <= figure[1] * (1 + 1e-9) for scale in ((1, 100) if is_percent else (1,)))


class Results:
    """Rows of CSV files by the name of the file, read once."""

    def __init__(self, root):
        self.root, self.read = root, {}

    def rows(self, name):
        """The lines of a file as lists, the first one with the names of the columns; none if it is nowhere."""
        if name not in self.read:
            path = self.root / name
            self.read[name] = []
            if path.is_file():
                with open(path, newline="", encoding="utf-8") as file:
                    self.read[name] = list(csv.reader(file))
        return self.read[name]

    def compare(self, name, row, column, shown, is_percent=False):
        """The fault of a figure, or None."""
        lines = self.rows(name)
        if not lines:
            return f"there is no {name}"
        if column not in lines[0]:
            return f"{name} has no column {column}"
        found = [line for line in lines[1:] if " ".join(line[0].split()) == row or (
            number_of(row) and number_of(line[0]) and number_of(row)[0] == number_of(line[0])[0])]
        if len(found) != 1:
            return f"{name} has {len(found) or 'no'} {'rows' if found else 'row'} {row}"
        value = found[0][lines[0].index(column)]
        return None if agrees(shown, value, is_percent) else f"{shown} is {value or 'empty'} in {name}: {row}, {column}"


def compared(root):
    """(place, fault or None) of each figure that names its result."""
    results = Results(root)
    for page in pages_of(root):
        # examples of the convention are no figures
        text = re.sub(r"^```.*?^```$", lambda block: "\n" * block[0].count("\n"), (root / page).read_text(), flags=re.M | re.S)
        here = os.path.dirname(page)

        def at(found, more=0):
            return f"{page}:{found.string.count(chr(10), 0, found.start()) + 1 + more}"

        plain = re.sub(r"`[^`]*`", lambda code: "\n" * code[0].count("\n") if "](" in code[0] else code[0], text)
        for found in LINK.finditer(plain):
            shown, link, title, after = found.groups()
            title = " ".join(title.split())
            name = TITLE.fullmatch(title)
            if not name:
                if ".csv" in title:
                    yield at(found), f'the title "{title}" is not "FILE.csv: ROW, COLUMN"'
                continue
            target = os.path.normpath(os.path.join(here, link.partition("#")[0]))
            beside = os.path.normpath(os.path.join(os.path.dirname(target), name[1]))
            if target.endswith(".csv") and target != beside:
                yield at(found), f"the link leads to {link}, and its title names {name[1]}"
            else:
                yield at(found), results.compare(beside, name[2], name[3], " ".join(shown.split()), after.strip() == "%")
        for found in TABLE.finditer(text):
            file, *pairs = [part.strip() for part in re.split(r";\s", found[1] + "; ") if part.strip()]
            file = os.path.normpath(os.path.join(here, file))
            names = dict(pair.rsplit(" = ", 1) for pair in pairs if " = " in pair)
            lines = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in found[2].splitlines()]
            if len(lines) < 3:
                yield at(found), "no table follows the comment"
                continue
            header = [names.pop(re.sub(r"[*`]", "", label), re.sub(r"[*`]", "", label)) for label in lines[0]]
            for label in names:
                yield at(found), f"the table has no column {label}"
            first = (results.rows(file) or [[""]])[0][0]
            if header[0] != first:
                yield at(found), f"the first column is {header[0]}, in {file} it is {first}" if first else f"there is no {file}"
                continue
            for number, cells in enumerate(lines[2:], 3):
                for column, shown in zip(header[1:], cells[1:]):
                    if shown:
                        row = re.sub(r"[*`]", "", cells[0]).replace("\\|", "|")
                        yield at(found, number), results.compare(file, row, column, shown)


def test_figures_of_pages_are_those_of_the_results(source, diagnose):
    figures = list(compared(source))
    faults = [f"{place}: {fault}" for place, fault in figures if fault]
    diagnose(f"{len(figures)} figures are compared")
    assert not faults, f"{len(faults)} of {len(figures)} figures:\n" + "\n".join(faults)
    assert len(figures) > 1000


# ---- what the comparison finds

CSV = "job,share,time_s,count,note\na 1,0.9142,0.4251,12345,converged\n\"b, c\",0.5,4.23e-05,9300000,\n10000,0.07,-8.492,1,2 of 3\n"


@pytest.fixture
def small(tmp_path):
    """Returns the places and faults of a page in a small tree, by default beside its results in the folder m."""
    def faults(text, name="m/README.md"):
        for path, content in (("m/results.csv", CSV), ("m/other.csv", "x,y\n1,2\n1,3\n"), (name, text)):
            (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / path).write_text(content)
        return [(place, fault) for place, fault in compared(tmp_path)]
    return faults


@pytest.mark.parametrize("text", [
    '[0.91](results.csv "results.csv: a 1, share")', '[.914](results.csv "results.csv: a 1, share")',
    '[91](results.csv "results.csv: a 1, share") %', '[91 %](results.csv "results.csv: a 1, share")',
    '[0.43](results.csv "results.csv: a 1,\ntime_s")', '[12 345](results.csv "results.csv: a 1, count")',
    '[4.2e-05](results.csv "results.csv: b, c, time_s")', '[-8.5](README.md#part "results.csv: 10000, time_s")',
    '[**converged**](results.csv "results.csv: a 1, note")', '[9300000](results.csv "results.csv: b, c, count")'])
def test_a_link_agrees(small, text):
    assert [fault for _, fault in small(f"It is\n{text}.\n")] == [None]


def test_a_link_of_another_folder_agrees(small):
    assert [fault for _, fault in small('[0.50](../m/README.md "results.csv: b, c, share")\n', "doc/page.md")] == [None]


@pytest.mark.parametrize("text, fault", [
    ('[0.92](results.csv "results.csv: a 1, share")', "0.92 is 0.9142 in m/results.csv: a 1, share"),
    ('[.9](results.csv "results.csv: b, c, share")', ".9 is 0.5"),
    ('[92](results.csv "results.csv: a 1, share") %', "92 is 0.9142"),
    ('[91](results.csv "results.csv: a 1, share")', "91 is 0.9142"),
    ('[4.3e-05](results.csv "results.csv: b, c, time_s")', "4.3e-05 is 4.23e-05"),
    ('[0.1](results.csv "results.csv: b, c, note")', "0.1 is empty"),
    ('[0.1](results.csv "results.csv: b, share")', "m/results.csv has no row b"),
    ('[0.1](results.csv "results.csv: a 1, shares")', "m/results.csv has no column shares"),
    ('[0.1](README.md "gone.csv: a 1, share")', "there is no m/gone.csv"),
    ('[0.1](other.csv "results.csv: a 1, share")', "the link leads to other.csv"),
    ('[2](other.csv "other.csv: 1, y")', "m/other.csv has 2 rows 1"),
    ('[0.1](results.csv "results.csv a 1")', "the title")])
def test_a_wrong_link_is_found(small, text, fault):
    (place, found), = small(f"It is\n{text}.\n")
    assert place == "m/README.md:2" and found.startswith(fault)


def table(comment, *rows):
    return f"Text\n\n<!-- figures: {comment} -->\n" + "".join(f"| {row} |\n" for row in rows) + "\n"


def test_a_table_agrees(small):
    found = small(table("results.csv; job, share = job; time, % of 1 = time_s", "job, share | share | time, % of 1", "---|---:|---:",
                        "`a 1` | **.91** | 43 %", "b, c | | 4.2e-05", "10 000 | 7 % | -8.49"))
    assert [fault for _, fault in found] == [None] * 5


def test_an_example_in_code_is_no_figure(small):
    assert small('`[0.1](results.csv "results.csv: a 1, share")`\n\n```\n' + table("gone.csv", "job | x", "---|---", "a 1 | 2") + "```\n") == []


@pytest.mark.parametrize("rows, fault", [
    (("results.csv", "job | share", "---|---", "b, c | 0.5", "a 1 | 0.95"), ("m/README.md:7", "0.95 is 0.9142 in m/results.csv: a 1, share")),
    (("results.csv", "job | share", "---|---", "a 2 | 0.95"), ("m/README.md:6", "m/results.csv has no row a 2")),
    (("results.csv", "job | part", "---|---", "a 1 | 0.95"), ("m/README.md:6", "m/results.csv has no column part")),
    (("results.csv; part = share", "job | share", "---|---", "a 1 | 0.91"), ("m/README.md:3", "the table has no column part")),
    (("results.csv", "share | job", "---|---", "0.5 | a 1"), ("m/README.md:3", "the first column is share, in m/results.csv it is job")),
    (("gone.csv", "job | share", "---|---", "a 1 | 0.91"), ("m/README.md:3", "there is no m/gone.csv")),
    (("results.csv",), ("m/README.md:3", "no table follows the comment"))])
def test_a_wrong_table_is_found(small, rows, fault):
    assert [found for found in small(table(*rows)) if found[1]] == [fault]
