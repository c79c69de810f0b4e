#!/usr/bin/python3
# SPDX-License-Identifier: Apache-2.0
"""Mutation test: puts small faults into the C code of src, one at a time, and runs the tests that execute the line.

    measurements/mutations/mutate.py map --build DIR --output map.json
    measurements/mutations/mutate.py --build DIR --map map.json --count 150 --seed 1 --jobs 2 --output mutants.json [--results FOLDER]
    measurements/mutations/mutate.py --build DIR --map map.json --survivors mutants.json --output sanitized.json

`map` makes a traced build in DIR and records the lines of src that each unit test and each pytest test executes. The
campaign makes one copy of the source and one build for each job in DIR. It writes the output after each mutant;
--resume goes on with it, and --only repeats single mutants. With --survivors, the mutants that a campaign has not found are
tried in a build with sanitizers, by the tests of that tier. `make mutation` runs all three.
"""
import argparse
import collections
import concurrent.futures
import difflib
import hashlib
import json
import os
import pathlib
import queue
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import zlib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))

import executed_lines  # noqa: E402
import mutants as faults  # noqa: E402
import results  # noqa: E402
from mutate_plugin import TIME_OVER  # noqa: E402

SOURCE = pathlib.Path(__file__).resolve().parents[2]
PYTEST = [sys.executable, "-B", "-m", "pytest", "-p", "no:cacheprovider", "-q", "--tb=short"]
REQUIRED = ["src/sampling/solver/passes/pin.c", "src/sampling/solver/passes/fill_gaps.c", "src/sampling/solver/description.c", "src/sampling/solver/level.c",
            "src/job/source/mesh_projection.c"]
SKIP = ("test_web_page test_slurm test_farm test_soak test_fuzz test_generated_clients test_bench test_serving "
        "test_source_tree test_reproduce test_packages tests/tools/test_sharing").split()
BATCH_SECONDS = [5, 20, 60, 180]  # tests of one pytest process, by their measured time; the last one repeats
NEW_TEST_LIMIT = 3600             # seconds of a test whose time has not been measured
TIERS = ("basic", "extended")
SANITIZERS = ["--enable-sanitizers", "CFLAGS=-O1 -g1", "CXXFLAGS=-O1 -g1"]


# ---- builds

def default_compiler(name):
    return f"ccache {name}" if shutil.which("ccache") else name


def run_quietly(command, log, **more):
    """Whether a command of the build succeeds; its output goes to the log."""
    with open(log, "ab") as out:
        return subprocess.run(command, stdin=subprocess.DEVNULL, stdout=out, stderr=out, check=False, **more).returncode == 0


def require(done, what, log):
    if not done:
        sys.exit(f"{what} failed: see {log}")


def build_environment(base):
    """For ccache, paths below `base` are relative; flags of an outer make are left out."""
    kept = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    return {**kept, "CCACHE_BASEDIR": str(base)}


def test_environment(source, build, temporary):
    shared = os.environ.get("HEXAD_SHARED", str(SOURCE.parent / "shared" / "data"))
    more = {"HEXAD_BUILD": build, "HEXAD_SOURCE": source, "HEXAD_SHARED": shared, "PYTHONDONTWRITEBYTECODE": "1",
            "CMOCKA_MESSAGE_OUTPUT": "TAP", "PYTHON": sys.executable, "TMPDIR": temporary,
            "HYPOTHESIS_STORAGE_DIRECTORY": temporary, "PYTHONPATH": str(SOURCE / "tools")}
    kept = {k: v for k, v in os.environ.items() if k not in ("HEXAD_TIER", "MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
    return {**kept, **{k: str(v) for k, v in more.items()}}


def limit_memory():
    """Of each process of a test: a mutant may ask for more and more. AddressSanitizer reserves more than any limit."""
    most = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGESIZE") // 3
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def ending(status):
    return "timeout" if status == TIME_OVER else f"status {status}"


class Tests:
    """Runs tests of one build."""

    def __init__(self, source, build, sanitized=False):
        self.source, self.build, self.sanitized = pathlib.Path(source), pathlib.Path(build), sanitized
        # short, for the paths of sockets; one name for each build, so that the next run removes what a killed one left
        self.temporary = pathlib.Path(tempfile.gettempdir(), f"mut.{zlib.crc32(bytes(self.build)):08x}")
        self.close()
        self.temporary.mkdir()
        self.log = self.build / "mutate-test.log"

    def close(self):
        self.unmount()
        shutil.rmtree(self.temporary, ignore_errors=True)

    def unmount(self):
        """The small disks of tests that were ended: without this, their mount points cannot be removed."""
        for line in pathlib.Path("/proc/mounts").read_text().splitlines():
            place = pathlib.Path(line.split()[1])
            if self.temporary in place.parents:
                subprocess.run(["umount", "-l", place], check=False)

    def clear(self):
        self.unmount()
        for entry in self.temporary.iterdir():
            shutil.rmtree(entry, ignore_errors=True)
            entry.unlink(missing_ok=True) if not entry.is_dir() else None

    def words(self):
        return self.log.read_bytes()[-1500:].decode(errors="replace")

    def run(self, command, seconds, **more):
        """Runs a command through tests/contain, its output in the log: (exit status, seconds)."""
        start = time.monotonic()
        with open(self.log, "wb") as out, subprocess.Popen(
                [self.build / "tests/contain", *command], stdin=subprocess.DEVNULL, stdout=out, stderr=out,
                preexec_fn=None if self.sanitized else limit_memory, **more) as process:
            try:
                status = process.wait(seconds)
            except subprocess.TimeoutExpired:
                status = TIME_OVER
            finally:
                process.terminate()
        return status, time.monotonic() - start

    def unit(self, name, seconds):
        """(exit status, seconds)"""
        done = self.run([self.build / name], seconds, cwd=self.build,
                        env=test_environment(self.source, self.build, self.temporary))
        self.clear()
        return done

    def pytest(self, ids, limits, *options, blocks=None, files=False, tier=""):
        """Runs tests of one folder. Returns their records in the order in which they ended; a test that ended its
        process has the outcome `failed`."""
        work, results = self.temporary / "work.json", self.temporary / "results.jsonl"
        results.unlink(missing_ok=True)
        work.write_text(json.dumps({"results": str(results), "limits": limits, "limit": NEW_TEST_LIMIT,
                                    "blocks": blocks and str(blocks)}))
        environment = test_environment(self.source, self.build, self.temporary)
        environment.update(HEXAD_MUTATE=str(work), HEXAD_TIER=tier)
        total = None if files else sum(limits.get(i, NEW_TEST_LIMIT) for i in ids) + 60
        status, _ = self.run([*PYTEST, "-p", "mutate_plugin", f"--rootdir={self.source}",
                              f"--basetemp={self.temporary / 'p'}", *options, *ids], total, cwd=self.source, env=environment)
        records, begun = [], None
        for line in results.read_text().splitlines() if results.exists() else []:
            record = json.loads(line)
            begun = record.get("begin")
            if "end" in record:
                records.append({"id": record.pop("end"), **record})
        if begun or (status not in (0, 1, 5) and not records):
            records.append({"id": begun or ids[0], "outcome": "failed", "seconds": limits.get(begun, 0),
                            "words": ending(status), "hits": None})
        self.clear()
        return records


def collect(source, build, folders, tier=None):
    """The ids of the tests below the folders; with a tier, the marked or the unmarked ones."""
    environment = {**test_environment(source, build, "/tmp"), **({"HEXAD_TIER": tier} if tier else {})}
    found = []
    for folder in folders:
        done = subprocess.run([*PYTEST, "--collect-only", f"--rootdir={source}", folder], cwd=source, env=environment,
                              capture_output=True, text=True, check=False)
        found += [line for line in done.stdout.splitlines() if "::" in line and not line.startswith("ERROR")]
    return found


def measuring_tests():
    """Unit tests that a build with sanitizers leaves out."""
    text = "".join(path.read_text() for path in sorted(SOURCE.glob("src/**/Makefile.inc"))).replace("\\\n", " ")
    return [word for words in re.findall(r"^measuring_tests \+= (.*)$", text, re.M) for word in words.split()]


def is_skipped(path, skip):
    return any(word in path for word in skip)


# ---- the map

def checked_sums(path):
    return [zlib.crc32(line) for line in path.read_bytes().split(b"\n")]


class Map:
    """Makes the map: which test executes which lines."""

    def __init__(self, options):
        self.options = options
        self.build = options.build.resolve()
        self.blocks = self.build / "blocks"
        self.blocks.mkdir(parents=True, exist_ok=True)
        self.records = self.build / "records.jsonl"
        self.programs = {}
        self.service_version = None
        self.tests = None

    def make(self):
        log, traced = self.build / "mutate-build.log", self.build / "trace_blocks.o"
        log.write_text("")
        if not traced.exists():
            require(run_quietly(["gcc", "-O2", "-fPIC", "-D_GNU_SOURCE", f'-DTRACE_DIRECTORY="{self.blocks}"', "-c",
                                 SOURCE / "measurements/mutations/trace_blocks.c", "-o", traced], log), "the tracing function", log)
        environment = build_environment(SOURCE)
        if not (self.build / "Makefile").exists():
            require(run_quietly([SOURCE / "configure", "-q", f"CC={self.options.cc}", f"CXX={self.options.cxx}",
                                 "CFLAGS=-Og -g -fsanitize-coverage=trace-pc", "CXXFLAGS=-O1", f"LDFLAGS={traced}"], log,
                                cwd=self.build, env=environment), "configure", log)
        for words in (["all"], ["check", "TESTS="]):
            require(run_quietly(["make", "-s", f"-j{self.options.jobs}", "WARN_CFLAGS=-w", *words], log, cwd=self.build,
                                env=environment), "the traced build", log)

    def program(self, name):
        if name not in self.programs:
            path = self.build / name
            if not path.exists():
                path = self.build / "tests/unit" / name
            self.programs[name] = executed_lines.Program(path)
        return self.programs[name]

    def version(self, name):
        """A sum of the programs that a test runs: records of other versions are not used."""
        if name.startswith("tests/unit/"):
            return hashlib.sha1((self.build / name).read_bytes()).hexdigest()[:12]
        if not self.service_version:
            sums = [hashlib.sha1((self.build / service).read_bytes()).digest() for service in self.services()]
            self.service_version = hashlib.sha1(b"".join(sums)).hexdigest()[:12]
        return self.service_version

    def services(self):
        return sorted(p.name for p in self.build.iterdir()
                      if p.name in ("hexad", "hexadctl", "hexad-worker", "hexad-node") or p.suffix == ".so")

    def write(self, **record):
        record["version"] = self.version(record["id"])
        with open(self.records, "a", encoding="utf-8") as out:
            out.write(json.dumps(record) + "\n")

    def known(self):
        if not self.records.exists():
            return {}
        records = map(json.loads, self.records.read_text().splitlines())
        return {r["id"]: r for r in records if r["id"].startswith("tests/") and self.is_current(r)}

    def is_current(self, record):
        name = record["id"]
        return ("::" in name or (self.build / name).exists()) and record["version"] == self.version(name)

    def only(self, names):
        """Leaves the files of the programs that the next tests record in."""
        for path in self.blocks.iterdir():
            path.unlink()
        for name in names:
            path = self.build / name if (self.build / name).exists() else self.build / "tests/unit" / name
            executed_lines.prepare(path, self.program(name), self.blocks)

    def is_chosen(self, path):
        return not self.options.tests or any(word in path for word in self.options.tests)

    def run_unit(self, known):
        for path in sorted((self.build / "tests/unit").glob("test_*")):
            name = f"tests/unit/{path.name}"
            if path.suffix or name in known or not self.is_chosen(name):
                continue
            self.only([path.name])
            status, seconds = self.tests.unit(name, NEW_TEST_LIMIT)
            hits = executed_lines.take(self.blocks)
            self.write(id=name, kind="unit", outcome="passed" if status == 0 else "failed", seconds=round(seconds, 3), hits=hits)
            print(f"{name}: {'passed' if status == 0 else 'failed'}, {seconds:.1f} s", flush=True)

    def run_pytest(self, known, files, tier):
        self.only(self.services())
        for file in files:
            if f"{file}::@{tier}" in known:
                continue
            start = time.monotonic()
            executed_lines.take(self.blocks)
            records = self.tests.pytest([file], {}, blocks=self.blocks, files=True, tier=tier)
            while records and records[-1]["outcome"] == "failed" and records[-1]["hits"] is None:
                stopped = records[-1]["id"]  # its process ended: go on behind it
                records[-1]["hits"] = executed_lines.take(self.blocks)
                rest = [i for i in collect(SOURCE, self.build, [file], tier) if i not in {r["id"] for r in records}]
                if "::" not in stopped or not rest:
                    break
                records += self.tests.pytest(rest, {}, blocks=self.blocks, files=True, tier=tier)
            for record in records:
                words = record.pop("words", None)
                if record["outcome"] == "failed":
                    print(f"{record['id']} fails in the traced build: {words}")
                self.write(kind="pytest", **record)
            self.write(id=f"{file}::@{tier}", kind="file")
            outcomes = collections.Counter(r["outcome"] for r in records)
            print(f"{file}, {tier}: {dict(outcomes)}, {time.monotonic() - start:.0f} s", flush=True)

    def compose(self):
        known = [r for r in self.known().values() if r["kind"] != "file"]
        executed = collections.defaultdict(lambda: collections.defaultdict(int))  # file -> line -> bits of tests
        code = collections.defaultdict(set)
        for name in [*self.services(), *(p.name for p in (self.build / "tests/unit").glob("test_*") if not p.suffix)]:
            self.program(name)
        for program in self.programs.values():
            for places in program.lines.values():
                for file, line in places:
                    code[file].add(line)
        for number, record in enumerate(known):
            for name, packed in (record["hits"] or {}).items():
                lines = set()
                for block in executed_lines.unpack(packed):
                    lines |= self.program(name).lines.get(block, set())
                for file, line in lines:
                    executed[file][line] |= 1 << number
        tests = [{k: r[k] for k in ("id", "kind", "outcome", "seconds")} for r in known]
        if self.options.base:
            self.add_base(tests, executed)
        sets, files = {}, {}
        for file in sorted(code):
            if (SOURCE / file).exists() and file.endswith(".c"):
                files[file] = {"sums": checked_sums(SOURCE / file), "code": sorted(code[file]), "executed": {
                    line: sets.setdefault(bits, len(sets)) for line, bits in sorted(executed[file].items())}}
        document = {"tests": tests, "sets": [f"{bits:x}" for bits in sets], "files": files}
        write_json(self.options.output, document)
        lines = sum(len(f["code"]) for f in files.values())
        hit = sum(len(f["executed"]) for f in files.values())
        print(f"{self.options.output}: {len(tests)} tests execute {hit} of {lines} lines of {len(files)} files")

    def add_base(self, tests, executed):
        """Adds the tests of an older map that have no record of this build."""
        base = Executed(self.options.base)
        number = {t["id"]: i for i, t in enumerate(tests)}
        new = {name: test for name, test in base.tests.items() if name not in number}
        number.update({name: len(tests) + i for i, name in enumerate(new)})
        tests += new.values()
        bits = [sum(1 << number[name] for name in names if name in new) for names in base.sets]
        for file, lines in base.lines.items():
            for line, at in lines.items():
                if bits[at]:
                    executed[file][line] |= bits[at]

    def run(self):
        if not self.options.compose:
            self.make()
            self.tests = Tests(SOURCE, self.build)
            known = self.known()
            self.run_unit(known)
            self.compose()
            files = sorted((str(p.relative_to(SOURCE)) for p in SOURCE.glob("tests/*/test_*.py")),
                           key=lambda f: (f.startswith("tests/crash"), f))  # kills and losses take longest
            for tier in TIERS:
                self.run_pytest(known, [f for f in files if self.is_chosen(f) and not is_skipped(f, self.options.skip)], tier)
                self.compose()
            self.tests.close()
        else:
            self.compose()


def write_json(path, document):
    path = pathlib.Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(path.name + ".new")
    new.write_text(json.dumps(document, indent=None if "sets" in document else 1) + "\n")
    new.replace(path)


class Executed:
    """A map as it is read: the tests of each line of the source as it is now."""

    def __init__(self, path, left_out=()):
        document = json.loads(pathlib.Path(path).read_text())
        self.tests = {t["id"]: t for t in document["tests"]}
        names = [t["id"] for t in document["tests"]]
        self.sets = [[name for i, name in enumerate(names) if bits >> i & 1] for bits in (int(s, 16) for s in document["sets"])]
        self.code, self.lines, self.changed = {}, {}, []
        for file, known in document["files"].items():
            if not (SOURCE / file).exists():
                self.changed.append(file)
                continue
            sums = checked_sums(SOURCE / file)
            moved = {n: n for n in range(1, len(sums) + 1)}
            if sums != known["sums"]:
                self.changed.append(file)
                blocks = difflib.SequenceMatcher(None, known["sums"], sums, autojunk=False).get_matching_blocks()
                moved = {b.a + i + 1: b.b + i + 1 for b in blocks for i in range(b.size)}
            self.code[file] = [moved[n] for n in known["code"] if n in moved]
            self.lines[file] = {moved[int(n)]: s for n, s in known["executed"].items() if int(n) in moved}

    def of(self, mutant):
        """The tests that execute a mutant, in the order of the map."""
        found = {}
        for line in mutant.mapped:
            found.update(dict.fromkeys(self.sets[self.lines[mutant.file][line]] if line in self.lines[mutant.file] else []))
        return list(found)


# ---- the campaign

class Copy:
    """A copy of the source with a build of its own."""

    def __init__(self, number, options):
        self.options = options
        self.directory = (options.build / f"{'sanitized' if options.survivors else 'copy'}.{number}").resolve()
        self.source, self.build = self.directory / "source", self.directory / "build"
        self.build.mkdir(parents=True, exist_ok=True)
        self.log = self.directory / "build.log"
        self.tests = Tests(self.source, self.build, bool(options.survivors))
        self.objects = {}

    def synchronise(self):
        """Copies what differs from the source, without builds and repositories; removes what is gone."""
        present = set()
        for at, folders, files in os.walk(SOURCE):
            top = pathlib.Path(at) == SOURCE
            folders[:] = [f for f in folders if f not in (".git", "autom4te.cache", "__pycache__", ".hypothesis") and
                          not (top and f.startswith("build") and f != "build-aux")]
            for name in files:
                path = pathlib.Path(at, name)
                relative = path.relative_to(SOURCE)
                present.add(relative)
                there = self.source / relative
                if path.is_symlink() or not path.is_file():
                    continue
                if not there.exists():
                    there.parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy2(path, there)
                elif there.read_bytes() != path.read_bytes():  # such as a mutant that a killed run left: its object is newer
                    shutil.copy(path, there)
        for path in [p for p in self.source.rglob("*") if p.is_file() and not p.is_symlink()]:
            if path.relative_to(self.source) not in present and path.relative_to(self.source).parts[0] in ("src", "tests"):
                path.unlink()

    def prepare(self):
        self.synchronise()
        self.log.write_text("")
        if not (self.source / "configure").exists():
            require(run_quietly(["sh", "-c", "tools/fragments.sh && autoreconf -fi"], self.log, cwd=self.source), "autoreconf", self.log)
        if not (self.build / "Makefile").exists():
            flags = SANITIZERS if self.options.survivors else ["CFLAGS=-O1", "CXXFLAGS=-O1"]
            require(run_quietly(["../source/configure", "-q", f"CC={self.options.cc}", f"CXX={self.options.cxx}", *flags],
                                self.log, cwd=self.build, env=build_environment(self.directory)), "configure", self.log)
        require(self.make("all"), "the build", self.log)
        require(self.make("check", "TESTS="), "the build of the tests", self.log)
        self.objects = {str(p.relative_to(self.build)): hashlib.sha1(p.read_bytes()).digest() for p in self.build.rglob("*.o")}

    def make(self, *targets):
        return run_quietly(["make", "-s", "-j1", "WARN_CFLAGS=-w", *targets], self.log, cwd=self.build, env=build_environment(self.directory))

    def apply(self, mutant):
        lines = (SOURCE / mutant.file).read_text().split("\n")
        for number, before, after in mutant.edits:
            assert lines[number - 1] == before, f"{mutant.file}:{number} has changed"
            lines[number - 1] = after
        (self.source / mutant.file).write_text("\n".join(lines))
        self.applied = time.time_ns()

    def restore(self, mutant):
        (self.source / mutant.file).write_bytes((SOURCE / mutant.file).read_bytes())

    def is_same_code(self, mutant):
        """Whether the compiler made the same objects of the mutant as of the source."""
        stem = pathlib.Path(mutant.file).stem
        found = [p for p in (self.build / mutant.file).parent.glob("*.o")
                 if re.fullmatch(rf"(?:\w+-)?{stem}\.o|\w+_so-{stem}\.o", p.name) and p.stat().st_mtime_ns >= self.applied]
        return bool(found) and all(hashlib.sha1(p.read_bytes()).digest() == self.objects.get(str(p.relative_to(self.build)))
                                   for p in found)


class Campaign:
    def __init__(self, options):
        self.options = options
        self.document = {"seed": options.seed, "count": options.count, "limit": options.limit, "baseline": {}, "mutants": {}}
        if (options.resume or options.only) and options.output.exists():
            self.document = json.loads(options.output.read_text())
        self.map = Executed(options.map)
        if self.map.changed:
            print(f"{len(self.map.changed)} files have changed since the map was made; their changed lines are not mutated")
        self.lock = threading.Lock()
        self.copies = queue.SimpleQueue()
        self.tier_names = ("sanitized",) if options.survivors else TIERS
        self.unsanitized = measuring_tests() if options.survivors else []
        self.tiers = {}
        self.times = {}

    # -- what is chosen

    def choose(self):
        every, sizes = [], collections.Counter()
        for file, code in sorted(self.map.code.items()):
            if faults.SKIPPED_FILES.search(file):
                continue
            text = (SOURCE / file).read_text()
            sizes[faults.folder_of(file)] += text.count("\n")
            every += faults.File(file, text).mutants(code)
        self.faults = {m.id: m for m in faults.identified(every)}
        executed = [m for m in self.faults.values() if self.map.of(m)]
        others = [m for m in self.faults.values() if not self.map.of(m)]
        required = [f for f in self.options.require if f in self.map.code]
        for file in set(self.options.require) - set(required):
            print(f"{file} is not in the map: no mutant is required of it")
        self.chosen, self.spares = faults.choose(executed, sizes, self.options.count, self.options.seed, required)
        unexecuted = faults.Choice(others, self.options.seed)
        self.unexecuted = [m for m in (unexecuted.draw() for _ in range(self.options.count // 10)) if m]
        print(f"{len(executed)} faults of executed lines, {len(others)} of others; chosen: {len(self.chosen)} and "
              f"{len(self.unexecuted)} of lines that no test executes")

    # -- the tests without a fault

    def measure(self, slots):
        """Runs the tests of the mutants without a fault, unless their results are known; leaves out those that fail."""
        spares = [] if self.options.only else [s for m in slots for s in self.spares[m.id]]
        needed = {name for m in [*slots, *spares] for name in self.map.of(m)}
        folders = sorted({i.split("::")[0].rsplit("/", 1)[0] for i in self.map.tests if "::" in i})
        copy = self.copies.get()
        present = set(collect(copy.source, copy.build, folders))
        marked = {tier: set(collect(copy.source, copy.build, folders, tier)) for tier in self.tier_names}
        self.copies.put(copy)
        gone = [i for i in self.map.tests if "::" in i and i not in present]
        if gone:
            print(f"{len(gone)} tests of the map do not exist any more, such as {gone[0]}")
        baseline = self.document["baseline"]
        work = collections.defaultdict(list)
        for name, test in self.map.tests.items():
            self.tiers[name] = self.tier_names[0] if test["kind"] == "unit" else \
                next((tier for tier in self.tier_names if name in marked[tier]), None)
            if self.tiers[name] and name in needed and name not in baseline and name not in gone and \
                    name not in self.unsanitized and not is_skipped(name, self.options.skip):
                work[name.split("::")[0]].append(name)
        with concurrent.futures.ThreadPoolExecutor(self.options.jobs) as pool:
            list(pool.map(self.measure_file, work.items()))
        for name, (outcome, seconds) in baseline.items():
            if outcome == "passed" and name in self.map.tests and name not in gone:
                self.times[name] = seconds
            elif outcome == "failed":
                print(f"left out, since it fails without a fault: {name}")

    def measure_file(self, item):
        file, names = item
        copy = self.copies.get()
        try:
            if file.startswith("tests/unit/"):
                status, seconds = copy.tests.unit(file, NEW_TEST_LIMIT) if (copy.build / file).exists() else (1, 0)
                found = {file: ["passed" if status == 0 else "failed", round(seconds, 3)]}
            else:
                found = self.measure_pytest(copy, names)
        finally:
            self.copies.put(copy)
        with self.lock:
            self.document["baseline"].update(found)
            self.save()

    def measure_pytest(self, copy, names):
        found, left = {}, list(names)
        while left:
            records = copy.tests.pytest(left, {}, files=True)
            found.update({r["id"]: [r["outcome"], r["seconds"]] for r in records})
            rest = [n for n in left if n not in found]
            if len(rest) == len(left) or not records or records[-1].get("hits", 0) != 0 and records[-1]["outcome"] != "failed":
                break
            left = rest
        for name in [n for n, (outcome, _) in found.items() if outcome == "failed"]:  # once more, alone
            for r in copy.tests.pytest([name], {}, files=True):
                found[r["id"]] = [r["outcome"], r["seconds"]]
        return found

    def limit(self, name):
        return 20 + self.options.factor * max(self.times[name], self.map.tests[name]["seconds"])

    # -- one mutant

    def order(self, mutant):
        """The tests of a mutant: unit tests, that of the module first, then pytest tests of each tier; by time."""
        names = [n for n in self.map.of(mutant) if n in self.times]
        own = f"tests/unit/test_{pathlib.Path(mutant.file).stem}"
        units = sorted((n for n in names if "::" not in n), key=lambda n: (n != own, self.times[n], n))
        tests = {tier: sorted((n for n in names if "::" in n and self.tiers[n] == tier), key=lambda n: (self.times[n], n))
                 for tier in self.tier_names}
        return units, tests

    def unit_groups(self, units, mutant):
        """The module's own test alone, then groups that are built together."""
        own = f"tests/unit/test_{pathlib.Path(mutant.file).stem}"
        head = [[own]] if units[:1] == [own] else []
        rest, size = units[len(head):], 4
        while rest:
            head.append(rest[:size])
            rest, size = rest[size:], size * 4
        return head

    def batches(self, names):
        """Groups of tests of one folder, each file in one piece; the measured time of a group grows."""
        left, step = list(names), 0
        while left:
            group, seconds = [], 0.0
            while left and (not group or seconds + self.times[left[0]] < BATCH_SECONDS[min(step, len(BATCH_SECONDS) - 1)]):
                seconds += self.times[left[0]]
                group.append(left.pop(0))
            step += 1
            folders = collections.defaultdict(list)
            for name in group:
                folders[name.split("::")[0].rsplit("/", 1)[0]].append(name)
            for tests in folders.values():
                order = {}
                for name in tests:
                    order.setdefault(name.split("::")[0], len(order))
                yield sorted(tests, key=lambda n: order[n.split("::")[0]])

    def try_tests(self, copy, mutant, record):
        """Builds and runs until the first failure. Fills in the record; returns whether the mutant is valid."""
        units, tests = self.order(mutant)
        spent = 0.0
        checked = False

        def build(*targets):
            nonlocal checked
            start = time.monotonic()
            good = copy.make(*targets)
            record["build_seconds"] += time.monotonic() - start
            if good and not checked:
                checked = True
                if copy.is_same_code(mutant):
                    record.update(result="invalid", how="the same code")
                    return False
            if not good:
                record.update(result="invalid", how="does not compile")
            return good

        def is_over():
            if not self.options.limit or spent <= self.options.limit:
                return False
            left = len(units) + sum(map(len, tests.values())) - record["tests_run"]
            record.update(result="survived", how=f"{left} tests not run: the limit of time was reached")
            return True

        for group in self.unit_groups(units, mutant):
            if not build(*group):
                return
            for name in group:
                status, _ = copy.tests.unit(name, self.limit(name))
                spent += self.times[name]
                record["tests_run"] += 1
                if status != 0:
                    record.update(result="found", tier=self.tier_names[0], by=name, how=ending(status),
                                  words=copy.tests.words()[-400:])
                    return
                if is_over():
                    return
        for tier in self.tier_names:
            if tests[tier] and not build("all"):
                return
            for batch in self.batches(tests[tier]):
                done = copy.tests.pytest(batch, {n: self.limit(n) for n in batch}, "-x")
                spent += sum(self.times[name] for name in batch)
                record["tests_run"] += len(done)
                failed = [r for r in done if r["outcome"] == "failed"]
                if failed:
                    words = failed[0].get("words") or ""
                    record.update(result="found", tier=tier, by=failed[0]["id"], words=words,
                                  how=words if words == "timeout" else "failed")
                    return
                if is_over():
                    return
        record.update(result="survived")

    def record_of(self, mutant):
        names = self.map.of(mutant)
        files = collections.Counter(n.split("::")[0] for n in names if "::" in n)
        return {"id": mutant.id, "file": mutant.file, "line": mutant.line, "operator": mutant.operator,
                "changes": [{"line": n, "before": before.strip(), "after": after.strip()} for n, before, after in mutant.edits],
                "tests": {"unit": [n for n in names if "::" not in n], "pytest": dict(files)}, "result": None, "tier": None,
                "by": None, "how": None, "tests_run": 0, "build_seconds": 0.0, "seconds": 0.0}

    def examine(self, slot):
        """A chosen mutant, or the first of those that replace it that is valid."""
        copy = self.copies.get()
        try:
            for mutant in [slot, *self.spares.get(slot.id, [])]:
                known = self.document["mutants"].get(mutant.id)
                if known and mutant.id not in self.options.only:
                    if known["result"] != "invalid":
                        return
                    continue
                record = self.record_of(mutant)
                start = time.monotonic()
                copy.apply(mutant)
                try:
                    self.try_tests(copy, mutant, record)
                finally:
                    copy.restore(mutant)
                record["seconds"] = round(time.monotonic() - start, 1)
                record["build_seconds"] = round(record["build_seconds"], 1)
                with self.lock:
                    self.document["mutants"][mutant.id] = record
                    self.save()
                    what = f"{record['result']} {record['by'] or record['how'] or ''}"
                    print(f"{mutant.file}:{mutant.line}: {mutant.operator}: {what} ({record['seconds']:.0f} s)", flush=True)
                if record["result"] != "invalid" or self.options.only:
                    return
        except Exception as why:
            print(f"{slot.id}: {why!r}", flush=True)
            raise
        finally:
            self.copies.put(copy)

    def save(self):
        write_json(self.options.output, self.document)

    def run(self):
        self.options.build.mkdir(parents=True, exist_ok=True)
        self.choose()
        if self.options.list:
            for m in self.chosen:
                print(f"{m.id} {m.file}:{m.line} {len(self.map.of(m))} tests\n  - {m.edits[0][1].strip()}\n  + {m.edits[0][2].strip()}")
            return
        copies = [Copy(n + 1, self.options) for n in range(self.options.jobs)]
        for copy in copies:
            print(f"building {copy.directory}", flush=True)
            copy.prepare()
            self.copies.put(copy)
        try:
            slots = self.chosen
            if self.options.survivors:
                survived = [r["id"] for r in json.loads(self.options.survivors.read_text())["mutants"].values()
                            if r["result"] == "survived"]
                self.options.only = [name for name in survived if name in (self.options.only or survived)
                                     and name not in self.document["mutants"]]
            if self.options.only or self.options.survivors:
                for name in set(self.options.only) - set(self.faults):
                    print(f"{name} is not a fault of this source: its line has changed")
                slots = [self.faults[name] for name in self.options.only if name in self.faults]
            self.measure(slots)
            if not self.options.only and not self.options.survivors:
                for m in self.unexecuted:
                    self.document["mutants"].setdefault(m.id, {**self.record_of(m), "result": "not executed"})
            with concurrent.futures.ThreadPoolExecutor(self.options.jobs) as pool:
                list(pool.map(self.examine, slots))
        finally:
            for copy in copies:
                copy.tests.close()
        self.save()


# ---- the results

def counted(records):
    """Executed mutants, found by the first tier, found by both, survived, not executed."""
    found = [r for r in records if r["result"] == "found"]
    number = lambda result: sum(r["result"] == result for r in records)  # noqa: E731
    return [len(found) + number("survived"), sum(r["tier"] == "basic" for r in found), len(found), number("survived"), number("not executed")]


def grouped(records, title, key):
    groups = collections.defaultdict(list)
    for r in records:
        groups[key(r)].append(r)
    return [[f"{title} {name}", *counted(groups[name])] for name in sorted(groups)]


SINCE = "found since by "  # begins the reason of a survivor that a test finds which was added after the campaign


def write_results(document, reasons, sanitized, folder):
    """`reasons`: why a mutant survives, by id; `sanitized`: the records of --survivors, by id."""
    records = [sanitized[r["id"]] if r["result"] == "survived" and sanitized.get(r["id"], {}).get("result") == "found" else r
               for r in document["mutants"].values()]
    valid = [r for r in records if r["result"] in ("found", "survived", "not executed")]
    executed, basic, both, survived, unexecuted = counted(valid)
    invalid = collections.Counter(r["how"] for r in records if r["result"] == "invalid")
    survivors = [r for r in valid if r["result"] == "survived"]
    begins = lambda text: sum(reasons.get(r["id"], "").startswith(text) for r in survivors)  # noqa: E731
    share = lambda n: f"{100 * n / max(executed, 1):.0f}"  # noqa: E731
    summary = [
        ["in lines that tests execute", executed, ""], ["found by the first tier", basic, share(basic)],
        ["found by both tiers", both, share(both)], ["survived", survived, share(survived)], ["of these equivalent", begins("equivalent"), ""],
        ["found by both tiers, with the tests that were added since", both + begins(SINCE), share(both + begins(SINCE))],
        ["in lines that no test executes", unexecuted, ""], ["drawn again: does not compile", invalid["does not compile"], ""],
        ["drawn again: the compiler makes the same code", invalid["the same code"], ""],
        ["tried in the build with sanitizers", len(sanitized), ""],
        ["survivors that were not tried by all tests of their line", sum(bool(r["how"]) for r in survivors), ""],
        ["tests left out, since they fail without a fault", sum(outcome == "failed" for outcome, _ in document["baseline"].values()), ""],
        ["seed", document["seed"], ""], ["limit of the tests of one fault, s", f"{document['limit']:.0f}", ""]]
    results.write(folder / "summary.csv", ["quantity", "number", "percent_of_executed"], summary)
    results.write(folder / "counts.csv", ["group", "executed", "found_by_the_first_tier", "found_by_both", "survived", "not_executed"],
                  [*grouped(valid, "folder", lambda r: faults.folder_of(r["file"])), *grouped(valid, "kind", lambda r: r["operator"])])
    chosen = sorted((r for r in valid if r["result"] != "found"), key=lambda r: (r["result"] != "survived", r["file"], r["line"]))
    results.write(folder / "survivors.csv", ["id", "executed", "place", "before", "after", "reason"], [
        [r["id"], "yes" if r["result"] == "survived" else "no", f"{r['file']}:{r['line']}", r["changes"][0]["before"], r["changes"][0]["after"],
         reasons.get(r["id"], r["how"] or "")] for r in chosen])
    for row in summary:
        print(*row, sep=", ")


# ---- the command

def add_compilers(parser):
    parser.add_argument("--cc", default=default_compiler("gcc"), help="C compiler")
    parser.add_argument("--cxx", default=default_compiler("g++"), help="C++ compiler")
    parser.add_argument("--skip", nargs="*", default=SKIP, metavar="WORD", help="skip tests whose path has one of these words")


def map_options(words):
    parser = argparse.ArgumentParser(prog="mutate.py map", description="Records which test executes which lines of src.")
    parser.add_argument("--build", type=pathlib.Path, required=True, help="directory of the traced build")
    parser.add_argument("--output", type=pathlib.Path, required=True)
    parser.add_argument("--jobs", type=int, default=1, help="of make")
    parser.add_argument("--tests", nargs="*", default=[], metavar="WORD",
                        help="only tests whose path has one of these words, such as tests/unit")
    parser.add_argument("--compose", action="store_true", help="only write the map of what has been recorded")
    parser.add_argument("--base", type=pathlib.Path, metavar="MAP", help="an older map: its tests that have no new record are kept")
    add_compilers(parser)
    return parser.parse_args(words)


def campaign_options(words):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--build", type=pathlib.Path, required=True, help="directory of the copies and their builds")
    parser.add_argument("--map", type=pathlib.Path, required=True, help="what `map` has written")
    parser.add_argument("--output", type=pathlib.Path, required=True, help="records of the mutants, as JSON")
    parser.add_argument("--count", type=int, default=150, help="mutants of lines that tests execute")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2, help="mutants at the same time")
    parser.add_argument("--limit", type=float, default=0,
                        help="seconds of tests, by their measured times, after which a mutant has survived; 0: none")
    parser.add_argument("--factor", type=float, default=3, help="a test may take this many times its measured time, and 20 s")
    parser.add_argument("--require", nargs="*", default=REQUIRED, metavar="FILE", help="files with two mutants at least")
    parser.add_argument("--resume", action="store_true", help="go on with the records of the output")
    parser.add_argument("--only", type=lambda text: text.split(","), default=[], metavar="ID[,ID]", help="repeat these")
    parser.add_argument("--survivors", type=pathlib.Path, metavar="MUTANTS",
                        help="try what survived in these records, in a build with sanitizers")
    parser.add_argument("--sanitized", type=pathlib.Path, metavar="MUTANTS", help="records of --survivors, for the results")
    parser.add_argument("--results", type=pathlib.Path, metavar="FOLDER", help="where to write summary.csv, counts.csv and survivors.csv")
    parser.add_argument("--reasons", type=pathlib.Path, help="JSON: why a mutant survives, by id")
    parser.add_argument("--only-results", action="store_true", help="write the results of the records, run nothing")
    parser.add_argument("--list", action="store_true", help="print what is chosen, run nothing")
    add_compilers(parser)
    return parser.parse_args(words)


def main(words):
    if words[:1] == ["map"]:
        Map(map_options(words[1:])).run()
        return
    options = campaign_options(words)
    if not options.only_results:
        Campaign(options).run()
    if options.results and not options.list:
        reasons = json.loads(options.reasons.read_text()) if options.reasons else {}
        sanitized = json.loads(options.sanitized.read_text())["mutants"] if options.sanitized else {}
        write_results(json.loads(options.output.read_text()), reasons, sanitized, options.results)


if __name__ == "__main__":
    main(sys.argv[1:])
