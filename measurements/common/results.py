# SPDX-License-Identifier: Apache-2.0
"""Results of measuring programs as CSV: a line of names, then one line for each row. The first column names the row."""
import csv
import pathlib


def write(path, header, rows):
    """Writes the rows, each a list of as many cells as the header has; None is an empty cell."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def read(path):
    """The rows of a file as dictionaries from the names of the header to texts; none if there is no file."""
    if not pathlib.Path(path).exists():
        return []
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def end(path, header, rows, missed):
    """Writes the rows unless path is None, and prints how many miss a bound. Returns the exit status."""
    if path:
        write(path, header, rows)
    print(f"{missed} of {len(rows)} rows miss a bound")
    return 1 if missed else 0
