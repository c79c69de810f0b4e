#!/usr/bin/env python3
"""Gives every file of a collection to the worker, and writes what became of each as a table (doc/measured/inputs.md).

    tools/inputs.py --worker build/hexad-worker --output doc/measured/inputs.md [--data DIRECTORY] [--only WORD ...]

DIRECTORY, or HEXAD_SHARED, has the folders meshes, vdb, volumes, exr and malformed. Nothing is known about the files
beforehand: the kind of surface follows from the folder and the name's ending; where the worker's error says that there is
a choice of grids, parts or channels, each grid and the first part and channel are taken; where it says between what values
the volume lies, the middle is the isovalue. An image is made a stack of six copies. Ends with 1 when a file's result is not
sound, or its error is no error of the file's.
"""
import argparse
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile

COUNT, SLICES = 500, 6
# Of the spacing: how far points may be off the surface.
RESIDUAL = 1e-3
PATIENCE_S = 300
# The worker's exit codes: a result, converged or not; and errors that are those of the input.
RESULTS, FAULTS = (0, 10, 11), (2, 3, 4, 5)
# Codes that blame the file; the others are nothing that a file should come to.
OF_FILES = {"input_damaged", "input_unsupported", "input_missing", "no_surface", "grid_missing", "grid_ambiguous",
            "isovalue_required", "limit_memory", "spec_invalid"}
MESHES = {".obj", ".off", ".ply", ".stl"}
# Above the values of all volumes: the answer says what they are.
FAR = 1e30
# Files that another one names as its data, and papers that lie beside them.
BESIDE = re.compile(r"(\.(raw|zraw|mtl|md)|SHA256SUMS|/quarter\.\d+)$")
FOLDERS = ("meshes", "vdb", "volumes", "exr", "malformed")


def kind_of(path, folder):
    group = path.parent.name if folder == "malformed" else folder
    if "exr" in group or path.suffix == ".exr":
        return "exr"
    if path.suffix == ".vdb":
        return "vdb"
    if path.suffix.lower() in MESHES:
        return "mesh"
    return "volume"


class Case:
    """One file, and the members of its surface as far as they are known."""

    def __init__(self, path, kind, work, worker):
        self.path, self.kind, self.work, self.worker = path, kind, work, worker

    def surface(self, chosen):
        if self.kind != "exr":
            return {"path": str(self.path), **chosen}
        for k in range(1, SLICES + 1):
            link = self.work / f"slice.{k}.exr"
            link.unlink(missing_ok=True)
            link.symlink_to(self.path)
        return {"path": str(self.work / "slice.#.exr"), "slices": f"1-{SLICES}", **chosen}

    def run(self, chosen):
        """(None, report) or (error, None)."""
        spec = {"version": 1, "surface": {self.kind: self.surface(chosen)}, "sampling": {"count": COUNT},
                "solver": {"threads": 1}, "output": {"preview": False}}
        if self.kind == "mesh":
            spec["surface"]["mesh"]["resolution"] = 96
        (self.work / "spec.json").write_text(json.dumps(spec))
        done = subprocess.run([self.worker, "run", self.work / "spec.json", "--output", self.work / "out"], text=True,
                              capture_output=True, timeout=PATIENCE_S)
        if done.returncode in RESULTS:
            return None, json.loads((self.work / "out" / "report.json").read_text())
        if done.returncode not in FAULTS:
            return {"code": "internal", "message": f"exit {done.returncode}: {done.stderr[-200:]}"}, None
        return json.loads(done.stderr.splitlines()[-1]), None

    def outcomes(self, chosen=None):
        """Runs the file in every way that its errors leave open: (members, error, report) of each."""
        chosen = dict(chosen or {})
        if self.kind in ("volume", "exr"):
            chosen.setdefault("isovalue", FAR)
        error, report = self.run(chosen)
        said = error["message"] if error else ""
        grids = re.search(r"name one of (.*) as grid", said)
        equals = re.search(r'write "([^"]*)\[0\]" to "[^"]*\[(\d+)\]"', said)
        channels = re.search(r"has the channels (.*): give exr.channel", said)
        parts = re.search(r'parts of the file have .*?: "([^"]*)".*: give exr.part', said)
        values = re.search(r"values range from (\S+) to ([^\s;]+)", said)
        if grids and "grid" not in chosen:
            for name in dict.fromkeys(re.findall(r'"([^"]*)"', grids[1])):
                yield from self.outcomes({**chosen, "grid": name})
        elif equals and "[" not in chosen.get("grid", ""):
            yield from self.outcomes({**chosen, "grid": f"{equals[1]}[0]"})
        elif channels and "channel" not in chosen:
            yield from self.outcomes({**chosen, "channel": channels[1].split(", ")[0]})
        elif parts and "part" not in chosen:
            yield from self.outcomes({**chosen, "part": parts[1]})
        elif error and error["code"] == "isovalue_required" and "isovalue" not in chosen:
            yield from self.outcomes({**chosen, "isovalue": FAR})
        elif values and chosen.get("isovalue") == FAR and float(values[1]) < float(values[2]):
            middle = (float(values[1]) + float(values[2])) / 2
            yield from self.outcomes({**chosen, "isovalue": max(-FAR / 2, min(middle, FAR / 2))})
        else:
            yield chosen, error, report


def sound(error, report):
    if error:
        return error["code"] in OF_FILES
    return report["quality"]["lost"] == 0 and report["quality"]["max_residual"] <= RESIDUAL


def told(case, data, error, report):
    """The result in words without the machine's paths."""
    if report:
        q, hexagons = report["quality"], report["quality"]["hex_fraction"]
        words = [f"{report['count']} points", report["outcome"].replace("_", " "),
                 f"hex {hexagons:.2f}" if hexagons is not None else "hex -", f"residual {q['max_residual']:.0e} h"]
        return ", ".join(words + report["surface"]["warnings"])
    text = error["message"].replace(str(case.work) + "/", "").replace(str(data) + "/", "")
    return f"`{error['code']}`: {text}"


def cell(text):
    """As one cell of a table: damaged files have any bytes for names."""
    clean = "".join(c if c.isprintable() else "?" for c in text)
    return clean.replace("|", "\\|").replace("<", "&lt;")


def files(data, folder):
    return [p for p in sorted((data / folder).rglob("*")) if p.is_file() and not BESIDE.search(str(p))]


def page(data, worker, only, say):
    lines, counts, bad = [], {"points": 0, "errors": 0}, 0
    with tempfile.TemporaryDirectory() as where:
        for folder in FOLDERS:
            lines += ["", f"## {folder}", "", "| file | surface | what becomes of it |", "|---|---|---|"]
            for path in files(data, folder):
                name = str(path.relative_to(data / folder))
                if only and not any(word in f"{folder}/{name}" for word in only):
                    continue
                case = Case(path, kind_of(path, folder), pathlib.Path(where), worker)
                for chosen, error, report in case.outcomes():
                    counts["errors" if error else "points"] += 1
                    good = sound(error, report)
                    bad += not good
                    members = " ".join(f"{k} {v:.6g}" if isinstance(v, float) else f'{k} "{v}"'
                                       for k, v in chosen.items() if v != FAR)
                    mark = "" if good else "**not sound** "
                    row = [name, f"{case.kind} {members}".strip(), mark + told(case, data, error, report)]
                    lines.append("| " + " | ".join(cell(text) for text in row) + " |")
                    say(" | ".join(row)[:160])
    return lines, counts, bad


def arguments(description):
    """What every program that goes through the collection is told."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--worker", required=True)
    parser.add_argument("--output", required=True)
    parser.add_argument("--data", default=os.environ.get("HEXAD_SHARED"))
    parser.add_argument("--only", nargs="*", default=[])
    options = parser.parse_args()
    if not options.data or not pathlib.Path(options.data).is_dir():
        parser.error("give --data, or HEXAD_SHARED, the directory of the files")
    return options


def main():
    options = arguments(__doc__.splitlines()[0])
    lines, counts, bad = page(pathlib.Path(options.data), os.path.abspath(options.worker), options.only,
                              lambda text: print(text, file=sys.stderr))
    head = ["# Every file of the collection", "",
            "Made by `make inputs`: what the worker makes of each file (`tools/inputs.py` says how a surface is chosen). "
            f"{counts['points']} results, {counts['errors']} errors, {bad} of them not sound."]
    pathlib.Path(options.output).write_text("\n".join(head + lines) + "\n")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
