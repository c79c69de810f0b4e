# SPDX-License-Identifier: Apache-2.0
"""Specs with wrong values, for specs.py --wrong: one member of the worker's schema, or two, have a value that they do not take.

Each spec begins as a correct one with some optional groups, so that rules and defaults that read several groups have
something to read. The order of specs depends on the seed only.
"""
import copy
import http.client
import itertools
import json
import subprocess
import time

ABSENT = object()  # the member is removed
WRONG = [None, True, False, 0, -1, 0.5, 1e300, 2**53, "", "x", "1-3", "a.####.obj", "\u00e4" * 300, [], {}, [None], [[]],
         [[1, 1]], ["temperature"], [0, 0, 0], {"path": "x"}, {"from": 1, "to": 2}, ABSENT]
RIGHT = object()  # beside a wrong value: one that the schema allows
# how often a member is there that need not be; specs.py has the meaning
OFTEN = {"queue": 0.5, "frames": 0.6, "by_frame": 0.15, "output": 0.5, "preview": 0.5, "camera": 0.4, "attributes": 0.2,
         "region": 0.15, "inside": 0.5, "solver": 0.3, "limits": 0.1, "slices": 0.3,
         # what most specs refuse, so that many begin as correct ones
         **dict.fromkeys(("attach", "min_spacing", "max_spacing", "gradation", "curvature", "grid", "points",
                          "witkin_heckbert", "step", "label_meshes", "mesh_usda", "after_frames", "chunk", "coherent"), 0.03)}
# values of texts that have a form
TEXTS = {"frames": ["1-2", "7", "all"], "slices": ["1-3", "1-9x2"], "webhook": ["https://example.com/"],
         "depends_on": ["01ARZ3NDEKTSV4RRFFQ69G5FAV"], "from": ["surface", "geometry", "x.####.vdb"]}
FILES = ["x", "a.####.vdb", "b.stl", "c.$F4.exr"]
BY_FRAME = {"/sampling/count": [10, 20], "/surface/analytic/radius": {"from": 1, "to": 2}, "/solver/seed": [1, 2]}
NESTED = [("surface",), ("surface", "union", 0), ("surface", "difference", 1), ("surface", "offset", "surface"),
          ("surface", "transform", "surface"), ("region", "inside")]
SLOW_MS = 50  # of CPU time for one spec


def alternatives(of):
    """The object schemas of a member: one, or one for each shape; without those that are no object."""
    return [one for one in [of, *of.get("oneOf", [])] if "properties" in one]


class Specs:
    """An endless sequence of specs with wrong values."""

    def __init__(self, draw, targets):
        self.draw, self.rng, self.targets = draw, draw.rng, targets
        self.surface = draw.schema["properties"]["surface"]
        self.places = list(dict.fromkeys(self.below(draw.schema, ())))

    def below(self, of, path):
        """The places of all members below a schema, and of the first element of each list."""
        for one in alternatives(of):
            for name, member in one["properties"].items():
                place = (*path, name)
                yield place
                if member is self.surface:
                    for where in NESTED:
                        yield from self.below(self.surface, where)
                else:
                    yield from self.below(member, place)
        if "items" in of and path[-1] != 0:
            yield (*path, 0)
            yield from self.below(of["items"], (*path, 0))

    def schema_of(self, of, step):
        """Of a member or element; the surface's for surfaces."""
        for one in [of, *of.get("oneOf", [])]:
            if isinstance(step, int) and "items" in one:
                of = one["items"]
            elif step in one.get("properties", {}):
                of = one["properties"][step]
            else:
                continue
            return self.surface if "$ref" in of else of
        return {}

    def group(self, of, member):
        """A right value of a group that may have the member."""
        if of is self.surface:
            return self.draw.surface_of([member], 1)
        fit = [one for one in alternatives(of) if member in one["properties"]]
        return self.draw.members(self.rng.choice(fit), None, 1) if fit else {}

    def fits(self, of, value, member):
        """Whether a group or list may get the member beside what it has."""
        if isinstance(member, int):
            return isinstance(value, list)
        if not isinstance(value, dict):
            return False
        if of is self.surface:
            return member in value
        shapes = [one for one in of.get("oneOf", []) if member in one.get("properties", {})]
        return "shape" not in value or any(value["shape"] == one["properties"].get("shape", {}).get("const")
                                           for one in shapes)

    def put(self, spec, path, value):
        """Sets a member. Groups on its way that cannot have it are replaced."""
        at, of = spec, self.draw.schema
        for step, member in zip(path, path[1:]):
            of = self.schema_of(of, step)
            if isinstance(step, int):
                at.extend(self.group(of, member) for _ in range(len(at), step + 1))
            here = at[step] if isinstance(step, int) else at.get(step)
            if not self.fits(of, here, member):
                at[step] = here = [] if isinstance(member, int) else self.group(of, member)
            at = here
        if path[-1] in self.targets:
            for other in self.targets:
                at.pop(other, None)
        if value is RIGHT:
            of = self.schema_of(of, path[-1])
            value = self.draw.value(of, path[-1], path[-1], 1) if of else None
        if isinstance(path[-1], int):
            at[path[-1]:] = [] if value is ABSENT else [copy.copy(value)]
        elif value is ABSENT:
            at.pop(path[-1], None)
        else:
            at[path[-1]] = copy.copy(value)

    def spec(self):
        spec = self.draw.spec()
        if "inside" not in spec.get("region", {"inside": 0}):
            spec["region"] = {"min": [0, 0, 0], "max": [1, 1, 1]}
        if spec["sampling"].get("resolve"):
            spec["sampling"]["feature"] = {}
        if "by_frame" in spec.get("queue", {}):
            spec["queue"].update(by_frame=self.rng.choice([{k: v} for k, v in BY_FRAME.items()]), frames="1-2")
        return spec

    def alone(self):
        every = list(itertools.product(self.places, WRONG))
        self.rng.shuffle(every)
        for place, value in itertools.cycle(every):
            yield ((place, value),)

    def pairs(self):
        while True:
            first, second = self.rng.sample(self.places, 2)
            yield (first, self.rng.choice([RIGHT, *WRONG])), (second, self.rng.choice(WRONG))

    def __iter__(self):
        for faults in itertools.chain.from_iterable(zip(self.alone(), self.pairs())):
            spec = self.spec()
            for place, value in faults:
                self.put(spec, place, value)
            yield spec


def through_lines(program, specs, runs, log):
    """All specs through one process of fuzz/lines_spec. Its exit status, the last line of its output, and the number of
    the spec that ended it, or None."""
    with open(log, "wb") as said:
        process = subprocess.Popen([program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said)
        try:
            for spec in itertools.islice(specs, runs):
                process.stdin.write(json.dumps(spec).encode() + b"\n")
            process.stdin.close()
        except BrokenPipeError:
            pass
        told = process.stdout.read().decode().strip()
        code = process.wait()
    if code == 0:
        return code, told, None
    with open(log, "rb") as said:
        numbers = [line for line in said if line.strip().isdigit()]
    return code, told, int(numbers[-1]) if numbers else None


class Service:
    """A service of a build on a loopback port, and its one client, whose token has the scope read."""

    def __init__(self, build, folder):
        state, port = folder / "state", folder / "port"
        state.mkdir(mode=0o700, exist_ok=True)
        port.unlink(missing_ok=True)
        added = subprocess.run([build / "hexadctl", "token", "add", "reader", "--scopes", "read", "--file", state / "tokens"],
                               check=True, capture_output=True, text=True)
        with open(folder / "service.log", "wb") as log:
            self.process = subprocess.Popen([build / "hexad", "--listen", "127.0.0.1:0", "--port_file", port, "--state_dir", state,
                                             "--reserve_mb", "1"], stdin=subprocess.DEVNULL, stderr=log)
        while not port.exists():
            if self.process.poll() is not None:
                raise SystemExit("the service does not start: see service.log")
            time.sleep(0.05)
        self.connection = http.client.HTTPConnection(port.read_text().strip(), timeout=300)
        self.headers = {"Authorization": f"Bearer {added.stdout.strip()}", "Content-Type": "application/json"}
        self.clock = (~self.process.pid << 3) | 2  # CPU time of the process, see clock_getcpuclockid(3)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.connection.close()
        self.process.terminate()
        self.process.wait()

    def cpu_ms(self):
        return 1e3 * time.clock_gettime(self.clock)

    def validate(self, spec):
        """The status, and the CPU time of the service until the answer."""
        before = self.cpu_ms()
        self.connection.request("POST", "/v1/jobs:validate", json.dumps(spec), self.headers)
        answer = self.connection.getresponse()
        answer.read()
        return answer.status, self.cpu_ms() - before


def through_service(service, specs, runs, keep):
    """Validates specs one after another; keep(name, spec) stores those that break something. Prints the figures; the
    number of those."""
    ends, broken, total, most = {}, 0, 0, 0
    for number, spec in enumerate(itertools.islice(specs, runs), 1):
        try:
            status, ms = service.validate(spec)
        except (OSError, http.client.HTTPException) as fault:
            keep(f"broken.{number}", spec)
            print(f"{number}: the service does not answer: {fault!r}")
            return broken + 1
        ends[status] = ends.get(status, 0) + 1
        total += ms
        if status >= 500 or ms > SLOW_MS:
            broken += 1
            keep(f"broken.{number}", spec)
            print(f"{number}: status {status}, {ms:.1f} CPU ms", flush=True)
        if ms > most:
            most = ms
            keep("slowest", spec)
    print(", ".join(f"{count} with status {status}" for status, count in sorted(ends.items())))
    print(f"{total / max(1, sum(ends.values())):.3f} CPU ms each, at most {most:.3f} (slowest.json)")
    return broken
