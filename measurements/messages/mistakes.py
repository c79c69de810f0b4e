#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes typical mistakes of users with the built programs and writes the messages as CSV.

    measurements/messages/mistakes.py --built build --output measurements/messages/messages.csv
    measurements/messages/mistakes.py --built build --only hexadctl

A mistake is a command, a request or a file with an error, the result that it must have, and the object that the message must
name. The program ends with 1 when a result differs, when a message does not name its object, or when it has neither an instruction
nor the values that are accepted; a warning may say instead what the program does. Directories, ports and ids differ from run to run:
the results have WORK, PORT and ID instead.
"""
import argparse
import contextlib
import http.client
import json
import os
import pathlib
import re
import shutil
import signal
import socket
import ssl
import struct
import subprocess
import sys
import tempfile
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "common"))

import results  # noqa: E402

PATIENCE_S = 300
ANYONE = "anyone-on-this-machine-may-submit-and-cancel"

# An instruction: a verb in the imperative, or a bound or list of accepted values.
INSTRUCTION = re.compile(
    r"(?i)(?:^|[.:;,(] ?|\bor |\band |, )(?:add|ask|cancel|check|choose|compare|convert|copy|correct|create|delete|deliver|did you mean|end|export|fetch|give|"
    r"increase|leave|list|listen|lower|make|mark|move|name|pause|resume|omit|open|pass|put|raise|reduce|rename|remove|repair|repeat|replace|report|"
    r"restore|retry|run|sample|save|see|send|set|shorten|smooth|start|stop|submit|try|turn|unset|use|wait|write)\b"
    r"|\bmust (?:be|have|not|start|name|contain|end)\b|\brequires\b|\brequired\b|\bthe members here are\b|\bexcludes\b|\bhexadctl [a-z]+")


class World:
    """A directory with input files, and the daemons that the mistakes are made with."""

    def __init__(self, built, where):
        self.built, self.where = pathlib.Path(built).resolve(), pathlib.Path(where)
        self.daemons, self.jobs = [], {}
        self.write_files()

    # ---- files

    @property
    def beginning(self):
        """The beginning that the ids of the jobs have in common."""
        return os.path.commonprefix([self.jobs["waiting"], self.jobs["waiting too"]])[:8]

    def write_files(self):
        put = self.put
        put("in/.keep", "")
        self.run("hexad-worker", "make-example", "in/ball.vdb")
        whole = (self.where / "in/ball.vdb").read_bytes()
        put("in/cut.vdb", whole[:len(whole) // 2])
        put("in/empty.vdb", b"")
        put("in/text.vdb", "a volume\n")
        put("in/pointer.vdb", "version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n")
        cube = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
        faces = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1), (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4),
                 (1, 5, 7), (1, 7, 3)]
        put("in/cube.obj", obj(cube, faces))
        put("in/twice.obj", obj(cube, faces + faces[:1]))
        put("in/open.obj", obj(cube, faces[2:]))
        put("in/nan.obj", obj([("nan", 0, 0), *cube[1:]], faces))
        put("in/index.obj", obj(cube, [*faces, (0, 1, 99)]))
        put("in/points.obj", obj(cube, []))
        put("in/empty.obj", "")
        put("in/part.step", "ISO-10303-21;\nHEADER;\nENDSEC;\n")
        put("in/mesh.xyz", "1 2 3\n4 5 6\n")
        put("in/cut.ply", "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
                          "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n")
        labels = [[[1 if z < 4 else 2 for z in range(8)] for _ in range(8)] for _ in range(8)]
        put("in/labels.nrrd", nrrd("uint8", b"".join(bytes(row) for plane in labels for row in plane)))
        put("in/one.nrrd", nrrd("uint8", bytes([1]) * 512))
        put("in/short.nrrd", nrrd("float", bytes(100)))
        put("in/flat.nrrd", nrrd("float", struct.pack("<512f", *[2.0] * 512)))
        put("in/picture.png", b"\x89PNG\r\n\x1a\n" + bytes(64))
        put("spec.json", json.dumps(sphere()))
        put("in/scan.dcm", bytes(128) + b"DICM" + bytes(64))
        put("in/short.f32", bytes(40))
        put("in/frame.0001.obj", obj(cube, faces))
        put("in/big.obj", obj(cube, faces) + "# a comment\n" * 200000)

    def put(self, name, data):
        path = self.where / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
        return path

    # ---- programs

    def run(self, program, *words, text=None, environment=None, seconds=PATIENCE_S):
        kept = {k: v for k, v in os.environ.items() if not k.startswith("HEXAD_")}
        return subprocess.run([self.built / program, *map(str, words)], cwd=self.where, input=text, text=True,
                              capture_output=True, timeout=seconds, env={**kept, **(environment or {})})

    def daemon(self, name, *options):
        """Starts a daemon with a state directory of its own and returns its address."""
        file = self.where / f"{name}.address"
        process = subprocess.Popen(
            [self.built / "hexad", "--state_dir", f"{name}.state", "--port_file", file, "--reserve_mb", "1", *map(str, options)],
            cwd=self.where, stderr=open(self.where / f"{name}.log", "wb"), stdin=subprocess.DEVNULL)
        self.daemons.append(process)
        start = time.monotonic()
        while not file.exists():
            if process.poll() is not None or time.monotonic() > start + PATIENCE_S:
                raise SystemExit(f"the daemon {name} does not start: " + (self.where / f"{name}.log").read_text())
            time.sleep(0.02)
        return file.read_text().strip()

    def try_daemon(self, *words):
        """The exit status and the messages of a daemon, which is stopped if it starts."""
        file, log = self.where / "tried.address", self.where / "tried.log"
        file.unlink(missing_ok=True)
        kept = {k: v for k, v in os.environ.items() if not k.startswith("HEXAD_")}
        with open(log, "wb") as stream:
            process = subprocess.Popen([self.built / "hexad", *words, *([] if "--threads" in words[-1:] else ["--port_file", file])],
                                       cwd=self.where, stderr=stream, stdin=subprocess.DEVNULL, env=kept)
        while process.poll() is None and not file.exists():
            time.sleep(0.02)
        if process.poll() is not None:
            return f"exit {process.returncode}", re.sub(r"^\S+ info .*\n", "", log.read_text(), flags=re.M).strip()
        for number in (signal.SIGTERM, signal.SIGINT):  # the second one stops it at once
            process.send_signal(number)
        process.wait(PATIENCE_S)
        return "starts, warning", "\n".join(line for line in log.read_text().splitlines() if " warning " in line)

    def start(self):
        """Two daemons: `server` on a Unix socket, where the caller is an administrator, and `port` on TCP, with tokens."""
        (self.where / "out").mkdir()
        (self.where / "locked").mkdir()
        self.server = self.daemon("service", "--listen", f"unix:{self.where}/hexad.sock", "--input_roots", self.where / "in",
                                  "--output_roots", self.where / "out", "--body_limit_bytes", 20000, "--upload_limit_bytes", 1000000,
                                  "--host_memory_mb", 2048, "--webhook_hosts", "")
        self.tokens = {}
        for name, user, words in (("full", "alice", ()), ("read", "bob", ("--scopes", "read")), ("low", "carol", ("--max-priority", "5"))):
            self.tokens[name] = self.run("hexadctl", "token", "add", user, "--file", "tokens", *words).stdout.strip()
        self.port = self.daemon("tcp", "--listen", "127.0.0.1:0", "--token_file", self.where / "tokens")
        self.control("hold")
        small = json.dumps(sphere())
        while not self.jobs or len(self.beginning) < 8:  # ids begin with the time in units of about a second
            for name in ("waiting", "waiting too"):
                self.jobs[name] = self.control("submit", "-", text=small).stdout.strip()
        self.jobs["ended"] = self.control("submit", "-", text=small).stdout.strip()
        self.control("cancel", self.jobs["ended"])

    def control(self, *words, text=None, **environment):
        return self.run("hexadctl", *words, text=text, environment={"HEXAD_SERVER": self.server, **environment})

    def request(self, method, path, body=None, token=None, headers=None, encrypted=False):
        """To the Unix socket, or with a token, which may be empty, to the port."""
        if token is None:
            connection = http.client.HTTPConnection("localhost", timeout=PATIENCE_S)
            connection.sock = socket.socket(socket.AF_UNIX)
            connection.sock.settimeout(PATIENCE_S)
            connection.sock.connect(str(self.where / "hexad.sock"))
        else:
            connection = http.client.HTTPConnection(self.port, timeout=PATIENCE_S)
        with contextlib.closing(connection):
            headers = dict(headers or {})
            if body is not None and "Content-Type" not in headers:
                headers["Content-Type"] = "application/json"
            if token:
                headers["Authorization"] = f"Bearer {self.tokens.get(token, token)}"
            text = body if isinstance(body, (str, bytes, type(None))) else json.dumps(body)
            with contextlib.suppress(BrokenPipeError):  # an answer before the end of the body
                connection.request(method, path, text, headers)
            reply = connection.getresponse()
            return reply.status, reply.read().decode()

    def end(self):
        for process in self.daemons:
            process.send_signal(signal.SIGTERM)
        for process in self.daemons:
            process.send_signal(signal.SIGINT)  # the second one stops it at once
            process.wait(PATIENCE_S)

    def plain(self, text):
        """Without what differs from run to run."""
        for name, job in self.jobs.items():
            text = text.replace(job, "ID")
        text = text.replace(str(self.where), "WORK").replace(str(self.built), "BUILD")
        text = re.sub(r"\b[0-7][0-9a-hjkmnp-tv-z]{25}\b", "ID", text)
        text = text.replace(self.beginning, "PREFIX")
        text = re.sub(r"of \d+ job IDs(.*?)(\n  ID .*)+", r"of N job IDs\1\n  ID queued", text, flags=re.S)
        text = re.sub(r"\b127\.0\.0\.1:(\d{4,5})\b", "127.0.0.1:PORT", text)
        text = re.sub(r"(?<=process )\d+", "PID", text)
        return re.sub(r"^\d{4}-\d\d-\d\dT\S+ (?=error|warning)", "", text, flags=re.M)


def obj(vertices, faces):
    return "".join(f"v {x} {y} {z}\n" for x, y, z in vertices) + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)


def nrrd(kind, data, size=8):
    return (f"NRRD0004\ntype: {kind}\ndimension: 3\nsizes: {size} {size} {size}\nendian: little\nencoding: raw\n\n").encode() + data


# ---- specs

def sphere(**parts):
    return {"version": 1, "surface": {"analytic": {"shape": "sphere", "radius": 1}}, "sampling": {"count": 100}, **parts}


def of(surface, **parts):
    return sphere(surface=surface, **parts)


def mesh(path, **parts):
    return of({"mesh": {"path": f"in/{path}", **parts}})


def vdb(path, **parts):
    return of({"vdb": {"path": f"in/{path}", **parts}})


def asks(**sampling):
    return sphere(sampling=sampling)


# ---- kinds of mistakes. A row: kind, mistake, how it is shown, the result that it must have, what the message names, what makes it

ROWS = []


def worker(what, spec, result, names, words=()):
    """hexad-worker with a spec, given as an object or as text."""
    text = spec if isinstance(spec, str) else json.dumps(spec)
    shown = text if isinstance(spec, str) else text_of_change(spec)

    def make(world):
        shutil.rmtree(world.where / "result", ignore_errors=True)
        done = world.run("hexad-worker", "run", "-", "--output", "result", *words, text=text)
        return worker_result(world, done)
    ROWS.append(("worker", what, " ".join([shown, *words]), result, names, make))


def worker_words(what, words, result, names):
    ROWS.append(("worker", what, " ".join(["hexad-worker", *words]), result, names,
                 lambda world: worker_result(world, world.run("hexad-worker", *words, text=""))))


def worker_result(world, done):
    if done.returncode in (0, 10, 11):
        report = json.loads((world.where / "result" / "report.json").read_text())
        notes = report["surface"]["warnings"] + report.get("advice", [])
        return f"exit {done.returncode}, warning", " / ".join(n if isinstance(n, str) else n["message"] for n in notes)
    last = done.stderr.strip().splitlines()[-1]
    if not last.startswith("{"):
        return f"exit {done.returncode}", done.stderr.strip()
    error = json.loads(last)
    message = faults_text(error) if len(error.get("errors", [])) > 1 else error["message"]
    return f"exit {done.returncode}, {error['code']}", message


def faults_text(document):
    """The list `errors` of an error or a problem document."""
    return " / ".join(": ".join(str(v) for k, v in e.items() if k != "code") for e in document.get("errors", []))


def control(what, words, result, names, text=None, server=None, environment=None):
    def make(world):
        filled = [w.format(beginning=world.beginning, **world.jobs) if "{" in w else w for w in words]
        address = server(world) if server else world.server
        done = world.run("hexadctl", *filled, text=text, environment={"HEXAD_SERVER": address, **(environment or {})})
        return f"exit {done.returncode}", (done.stderr or done.stdout).strip()
    shown = " ".join(["hexadctl", *(re.sub(r"\{.*\}", "ID", w) for w in words)])
    ROWS.append(("hexadctl", what, f"{shown} < {text}" if text else shown, result, names, make))


def daemon(what, words, result, names, config=None):
    def make(world):
        more = []
        if config is not None:
            world.put("hexad.conf", config)
            more = ["--config", "hexad.conf"]
        filled = [w.format(where=world.where, port=world.port) for w in words]
        return world.try_daemon(*more, *filled)
    shown = " ".join(["hexad", *(["--config hexad.conf"] if config is not None else []), *words]).replace("{where}", "WORK").replace(
        "{port}", "127.0.0.1:PORT")
    ROWS.append(("hexad", what, shown + (f" with `{config.strip()}`" if config else ""), result, names, make))


def request(what, method, path, result, names, body=None, token=None, headers=None):
    def make(world):
        filled = path.format(**world.jobs) if "{" in path else path
        status, answer = world.request(method, filled, body, token, headers)
        problem = json.loads(answer)
        faults = faults_text(problem)
        detail = problem.get("detail", "")
        known = all(e["detail"] in detail and e.get("pointer", "") in detail for e in problem.get("errors", []))
        return f"{status} {problem['code']}", detail if known else f"{detail} [{faults}]"
    shown = f"{method} {re.sub('{.*}', 'ID', path)}"
    if headers:
        shown += "".join(f", {k}: {v}" for k, v in headers.items())
    if body is not None:
        shown += ", body " + (text_of_change(body) if isinstance(body, dict) else str(body)[:60])
    ROWS.append(("REST", what, shown, result, names, make))


def text_of_change(spec):
    """The members of a spec that differ from those of sphere()."""
    usual = sphere()
    return json.dumps({k: v for k, v in spec.items() if usual.get(k) != v}) or "{}"


# ---- the mistakes

def list_mistakes():
    spec_2, input_3, surface_4 = "exit 2, spec_invalid", "exit 3, input_", "exit 4, no_surface"

    # the text of a spec
    worker("comment in JSON", '{"version": 1, // a sphere\n"sampling": {"count": 10}}', spec_2, "line 1")
    worker("trailing comma", '{"version": 1,\n"sampling": {"count": 10},\n}', spec_2, "line 3")
    worker("single quotes", "{'version': 1}", spec_2, "line 1")
    worker("incomplete file", '{"version": 1, "sampling": {"count": 10}', spec_2, "line 1")
    worker("Python's None", '{"version": 1, "name": None}', spec_2, "line 1")
    worker("member given twice", '{"version": 1, "version": 1}', spec_2, "version")
    worker("an array instead of an object", "[1, 2]", spec_2, "")
    worker("empty spec", "", spec_2, "line 1")
    worker("number with a leading zero", '{"version": 01}', spec_2, "line 1")

    # members
    worker("misspelt member", sphere(sampling={"cuont": 10}), spec_2, "/sampling")
    worker("member in the wrong place", sphere(count=10), spec_2, "count")
    worker("wrong type", asks(count="many"), spec_2, "/sampling/count")
    worker("version of the future", sphere(version=2), spec_2, "/version")
    worker("version is missing", {k: v for k, v in sphere().items() if k != "version"}, spec_2, "/version")
    worker("count 0", asks(count=0), spec_2, "/sampling/count")
    worker("count 1e12", asks(count=1e12), spec_2, "/sampling/count")
    worker("count 10.5", asks(count=10.5), spec_2, "/sampling/count")
    worker("both count and spacing", asks(count=10, spacing=0.1), spec_2, "/sampling")
    worker("no target", asks(), spec_2, "/sampling")
    worker("negative spacing", asks(spacing=-1), spec_2, "/sampling/spacing")
    worker("spacing larger than the surface", asks(spacing=100), spec_2, "/sampling/spacing")
    worker("spacing in another unit than the surface", asks(spacing=1e-7), spec_2, "/sampling/spacing")
    worker("resolve with a count", asks(count=10, resolve=True), spec_2, "/sampling")
    worker("min_spacing above max_spacing", asks(count=1000, curvature={"ratio": 4}, min_spacing=2, max_spacing=1), spec_2, "max_spacing")
    worker("unknown shape", of({"analytic": {"shape": "bal", "radius": 1}}), spec_2, "/surface/analytic/shape")
    worker("member of another shape", of({"analytic": {"shape": "sphere", "radius": 1, "height": 2}}), spec_2, "/surface/analytic/height")
    worker("radius is missing", of({"analytic": {"shape": "sphere"}}), spec_2, "/surface/analytic/radius")
    worker("two surfaces", of({"analytic": {"shape": "sphere", "radius": 1}, "mesh": {"path": "in/cube.obj"}}), spec_2, "/surface")
    worker("half-space without an end", of({"analytic": {"shape": "halfspace", "axis": [0, 0, 1]}}), spec_2, "/surface")
    worker("vector of two numbers", of({"analytic": {"shape": "sphere", "radius": 1, "center": [0, 0]}}), spec_2, "/surface/analytic/center")
    worker("singular matrix", of({"transform": {"surface": sphere()["surface"], "matrix": [0] * 15 + [1]}}), spec_2, "matrix")
    worker("negative limit", sphere(limits={"memory_mb": -1}), spec_2, "/limits/memory_mb")
    worker("limit in bytes", sphere(limits={"memory_mb": 1e12}), spec_2, "/limits/memory_mb")
    worker("wrong unit of a time", sphere(limits={"timeout_s": "10 min"}), spec_2, "/limits/timeout_s")
    worker("memory limit too small", asks(count=1000000) | {"limits": {"memory_mb": 64}}, "exit 5, limit_memory", "memory_mb")
    worker("unknown property", sphere(output={"ply": {"properties": ["colour"]}}), "exit 3, attribute_missing", "colour")
    worker("inverted range", sphere(output={"preview": {"range": [2, 1]}}), spec_2, "/output/preview/range")
    worker("preview size as text", sphere(output={"preview": {"size": "512x512"}}), spec_2, "/output/preview/size")
    worker("alpha with method sized", asks(count=10, alpha={}) | {"solver": {"method": "sized"}}, spec_2, "sampling.alpha")
    worker("label meshes without labels", sphere(output={"mesh": True, "label_meshes": True}), spec_2, "/output/label_meshes")
    worker("unknown measure in outcome.require", sphere(outcome={"require": {"hexfraction": {"min": 0.9}}}), spec_2, "/outcome/require")

    # what one tries by analogy with other programs
    worker("a path as the surface", sphere(surface="in/cube.obj"), spec_2, "its members are vdb, mesh")
    worker("a path as the mesh", of({"mesh": "in/cube.obj"}), spec_2, '{"path": "in/cube.obj"}')
    worker("a number as the sampling", sphere(sampling=1000), spec_2, "count")
    worker("a number as the grading", asks(count=100, curvature=4), spec_2, "ratio")
    worker("a name as an attribute", sphere(attributes=["weight"]), spec_2, "/attributes/0")
    worker("an object as the parts of a union", of({"union": sphere()["surface"]}), spec_2, "/surface/union")
    worker("a union of one part", of({"union": [sphere()["surface"]]}), spec_2, "2 to 64")
    worker("a number as the grid of a VDB file", vdb("ball.vdb", grid=0), spec_2, "/surface/vdb/grid")
    worker("an isovalue as text", vdb("ball.vdb", isovalue="0.5"), spec_2, "/surface/vdb/isovalue")
    worker("a count as text", asks(count="10k"), spec_2, '"10k"')
    worker("a spacing with a unit", asks(spacing="2mm"), spec_2, '"2mm"')
    worker("a list of the first and last frame", mesh("frame.####.obj") | {"queue": {"frames": [1, 10]}}, spec_2, "/queue/frames", ["--frame", "1"])
    worker("frames from the last to the first", mesh("frame.####.obj") | {"queue": {"frames": "10-1"}}, spec_2, "10-1", ["--frame", "1"])
    worker("units of a mesh", mesh("cube.obj", units="mm"), spec_2, "the members here are path")
    worker("scale of a mesh", mesh("cube.obj", scale=100), spec_2, "/surface/mesh/scale")
    worker("translation of a transform", of({"transform": {"surface": sphere()["surface"], "translate": [1, 0, 0]}}), spec_2, "matrix")
    worker("centre of a region", sphere(region={"center": [0, 0, 0], "size": 1}), spec_2, "inside, min, max")
    worker("letters of the textbook for a torus", of({"analytic": {"shape": "torus", "R": 1, "r": 0.4}}), spec_2, "/surface/analytic/major_radius")
    worker("tube of a torus thicker than its ring", of({"analytic": {"shape": "torus", "major_radius": 0.4, "minor_radius": 1}}), spec_2,
           "major_radius, 0.4")
    worker("an expression as a formula", of({"analytic": {"expression": "x^2+y^2+z^2-1"}}), spec_2, "expression")
    worker("a grading by less than 1", asks(count=100, curvature={"ratio": 0.5}), spec_2, "/sampling/curvature/ratio")
    worker("misspelt pattern", asks(count=100, pattern="bluenoise"), spec_2, "blue_noise")
    worker("unknown colour of a preview", sphere(output={"preview": {"color": "normals"}}), spec_2, "shading")
    worker("a format as a member of output", sphere(output={"csv": True}), spec_2, "points_npz")
    worker("weights in the plural", sphere(attributes=[{"from": "geometry", "name": "weights"}]), spec_2, "weight")
    worker("given points without a file", asks(count=100, points={"mode": "keep"}), spec_2, "/sampling/points/path")
    worker("a picture as a mesh", mesh("picture.png"), input_3, "PNG")
    worker("a solid that misses the surface", sphere(region={"inside": {"analytic": {"shape": "sphere", "radius": 1, "center": [100, 0, 0]}}}),
           surface_4, "/region/inside")
    worker("spacing of a mesh far too small", mesh("cube.obj") | {"sampling": {"spacing": 1e-9}}, spec_2, "/sampling/spacing")
    worker("a path of Windows", mesh("C:\\models\\cube.obj"), "exit 3, input_missing", "C:\\models\\cube.obj")
    worker("a web address as a path", of({"mesh": {"path": "https://example.com/cube.obj"}}), "exit 3, input_missing", "example.com")

    # sequences
    worker("frames without ####", mesh("cube.obj") | {"queue": {"frames": "1-10"}}, spec_2, "####", ["--frame", "1"])
    worker("frames in another notation", mesh("frame.####.obj") | {"queue": {"frames": "1..10"}}, spec_2, "/queue/frames", ["--frame", "1"])
    worker("a sequence without --frame", mesh("frame.####.obj") | {"queue": {"frames": "1-10"}}, spec_2, "--frame")
    worker("--frame for one job", sphere(), spec_2, "--frame", ["--frame", "1"])
    worker("frame whose file is missing", mesh("frame.####.obj") | {"queue": {"frames": "1-10"}}, "exit 3, input_missing", "frame.0002.obj",
           ["--frame", "2"])

    # input files
    worker("wrong path", mesh("cubes.obj"), "exit 3, input_missing", "in/cubes.obj")
    worker("directory instead of a file", mesh(""), input_3, "in/")
    worker("path outside the input roots", of({"mesh": {"path": "/etc/passwd"}}), "exit 3, path_forbidden", "/etc/passwd", ["--input-root", "in"])
    worker("path with ..", of({"mesh": {"path": "in/../in/cube.obj"}}), "exit 3, path_forbidden", "..", ["--input-root", "in"])
    worker("wrong grid", vdb("ball.vdb", grid="density"), "exit 3, grid_missing", "density")
    worker("isovalue out of range", vdb("ball.vdb", isovalue=1000), surface_4, "ball.vdb")
    worker("truncated VDB file", vdb("cut.vdb"), "exit 3, input_damaged", "cut.vdb")
    worker("empty VDB file", vdb("empty.vdb"), "exit 3, input_damaged", "empty.vdb")
    worker("text as VDB file", vdb("text.vdb"), input_3, "text.vdb")
    worker("Git LFS pointer", vdb("pointer.vdb"), input_3, "pointer.vdb")
    worker("mesh as VDB file", vdb("cube.obj"), input_3, "cube.obj")
    worker("VDB file as mesh", mesh("ball.vdb"), input_3, "ball.vdb")
    worker("empty mesh file", mesh("empty.obj"), input_3, "empty.obj")
    worker("mesh without triangles", mesh("points.obj"), surface_4, "points.obj")
    worker("mesh with a NaN coordinate", mesh("nan.obj"), input_3, "nan.obj")
    worker("mesh with an index out of range", mesh("index.obj"), input_3, "index.obj")
    worker("PLY file without faces", mesh("cut.ply"), "exit 3, input_damaged", "cut.ply")
    worker("STEP file", mesh("part.step"), input_3, "part.step")
    worker("point list as mesh", mesh("mesh.xyz"), input_3, "mesh.xyz")
    worker("triangle given twice", mesh("twice.obj"), "exit 0, warning", "duplicates")
    worker("open mesh in a combination", of({"union": [{"mesh": {"path": "in/open.obj"}}, sphere()["surface"]]}), input_3[:7], "open.obj")
    worker("open mesh", mesh("open.obj"), "exit 0, warning", "the mesh is open")
    worker("labels: a label that is not in the file", of({"labels": {"path": "in/labels.nrrd", "labels": [1, 7]}}), spec_2, "7")
    worker("labels: one label only", of({"labels": {"path": "in/one.nrrd"}}), surface_4, "one.nrrd")
    worker("labels given as a mesh", of({"labels": {"path": "in/cube.obj"}}), input_3, "cube.obj")
    worker("dense volume without an isovalue", of({"volume": {"path": "in/flat.nrrd"}}), spec_2, "/surface/volume/isovalue")
    worker("constant volume", of({"volume": {"path": "in/flat.nrrd", "isovalue": 1}}), surface_4, "flat.nrrd")
    worker("volume with too few bytes", of({"volume": {"path": "in/short.nrrd", "isovalue": 1}}), "exit 3, input_damaged", "short.nrrd")
    worker("DICOM file", of({"volume": {"path": "in/scan.dcm", "isovalue": 1}}), input_3, "scan.dcm")
    worker("coefficients with the wrong size", of({"bspline": {"dims": [4, 4, 4], "domain": {"min": [0, 0, 0], "max": [1, 1, 1]},
                                                                "path": "in/short.f32"}}), input_3, "short.f32")
    worker("attribute that the file does not have", mesh("cube.obj") | {"attributes": [{"from": "surface", "name": "heat"}]},
           "exit 3, attribute_missing", "heat")
    worker("region without surface", sphere(region={"min": [5, 5, 5], "max": [6, 6, 6]}), surface_4, "(5, 5, 5)")
    worker("region upside down", sphere(region={"min": [0, 0, 1], "max": [1, 1, 0]}), spec_2, "/region")
    worker("intersection of solids that do not meet", of({"intersection": [
        {"analytic": {"shape": "sphere", "radius": 1}}, {"analytic": {"shape": "sphere", "radius": 1, "center": [9, 0, 0]}}]}), surface_4, "")
    worker("offset larger than the shape", of({"offset": {"surface": sphere()["surface"], "distance": -2}}), surface_4, "-2")

    # words of hexad-worker
    worker_words("spec file that does not exist", ["run", "sepc.json", "--output", "result"], "exit ", "sepc.json")
    worker_words("no output directory", ["run", "spec.json"], "exit 2, spec_invalid", "--output")
    worker_words("mesh instead of a spec", ["run", "in/cube.obj", "--output", "result"], spec_2, "hexad-worker sample in/cube.obj")
    worker("output that is a file", sphere(), "exit ", "in/cube.obj", ["--output", "in/cube.obj"])
    worker_words("misspelt option", ["run", "-", "--ouput", "result"], "exit 2, spec_invalid", "--ouput")
    worker_words("unknown command", ["smaple", "spec.json"], "exit 2, spec_invalid", "smaple")
    worker_words("unknown member of the spec's help", ["spec-help", "cuont"], "exit 2", "cuont")
    worker_words("inspect without a file", ["inspect"], "exit 2, spec_invalid", "inspect")
    worker_words("inspect of a missing file", ["inspect", "in/bal.vdb"], "exit 3, input_missing", "in/bal.vdb")

    # hexadctl
    no_server = lambda world: "unix:/nonexistent/hexad.sock"  # noqa: E731
    secure = lambda world: f"https://{world.port}"  # noqa: E731
    plain = lambda world: f"http://{world.port}"  # noqa: E731
    control("no server", ["list"], "exit 3", "/nonexistent/hexad.sock", server=no_server)
    control("address without a scheme", ["list"], "exit 2", "localhost:8642", server=lambda world: "localhost:8642")
    control("https to an http port", ["list"], "exit 3", "https://127.0.0.1", server=secure)
    control("http to an https port", ["list"], "exit 3", "http://127.0.0.1", server=tls_port)
    control("no token", ["list"], "exit 2", "HEXAD_TOKEN", server=plain)
    control("wrong token", ["list"], "exit 2", "HEXAD_TOKEN", server=plain, environment={"HEXAD_TOKEN": "hexad_wrong"})
    control("a word after hold", ["hold", "{waiting}"], "exit 2", "ID")
    control("priority without --priority", ["priority", "{waiting}", "20"], "exit 2", "20")
    control("priority without a number", ["priority", "{waiting}"], "exit 2", "--priority")
    control("priority as a word", ["priority", "{waiting}", "--priority", "high"], "exit 2", "high")
    control("priority out of range", ["priority", "{waiting}", "--priority", "5000"], "exit 2", "priority")
    control("unknown command", ["sumbit", "spec.json"], "exit 2", "sumbit")
    control("command status", ["status"], "exit 2", "status")
    control("misspelt option", ["submit", "-", "--lable", "x"], "exit 2", "--lable")
    control("option of another command", ["show", "{waiting}", "--priority", "3"], "exit 2", "--priority")
    control("option without a value", ["list", "--limit"], "exit 2", "--limit")
    control("limit 0", ["list", "--limit", "0"], "exit 2", "--limit")
    control("unknown state", ["list", "--state", "done"], "exit 2", "state")
    control("time in another notation", ["list", "--since", "yesterday"], "exit 2", "yesterday")
    control("submit without a spec", ["submit"], "exit 2", "submit")
    control("spec file that does not exist", ["submit", "sepc.json"], "exit 2", "sepc.json")
    control("spec with two faults", ["submit", "-"], "exit 2", "/sampling", text='{"version": 1, "surface": {}, "sampling": {"cuont": 1}}')
    control("unknown id", ["show", "01arz3ndektsv4rrffq69g5fav"], "exit 4", "ID")
    control("beginning of an id that is too short", ["show", "01ar"], "exit 4", "01ar")
    control("name that no job has", ["show", "trefoli"], "exit 4", "trefoli")
    control("help for an unknown command", ["help", "sumbit"], "exit 2", "sumbit")
    control("member without a slash", ["submit", "-", "--set", "count=5"], "exit 2", "count=5", text="{}")
    control("sample of a file that does not exist", ["sample", "in/cubes.obj"], "exit 2", "in/cubes.obj")
    control("sample of a directory", ["sample", "in"], "exit 2", "in is a directory")
    control("sample into a directory that exists", ["sample", "in/cube.obj", "--output", "in"], "exit 2", "in")
    control("sample by count and spacing", ["sample", "in/cube.obj", "--count", "100", "--spacing", "1"], "exit 2", "--spacing")
    control("count as a word", ["sample", "in/cube.obj", "--count", "many"], "exit 2", "many")
    control("grading that does not exist", ["sample", "in/cube.obj", "--grade", "feature"], "exit 2", "feature")
    control("grading by a word", ["sample", "in/cube.obj", "--grade", "curvature=high"], "exit 2", "high")
    control("grading by less than 1", ["sample", "in/cube.obj", "--grade", "curvature=0.5"], "exit 2", "0.5")
    control("misspelt pattern", ["sample", "in/cube.obj", "--pattern", "bluenoise"], "exit 2", "bluenoise")
    control("count in thousands", ["sample", "in/cube.obj", "--count", "10k"], "exit 2", "10k")
    control("spacing 0", ["sample", "in/cube.obj", "--spacing", "0"], "exit 2", "spacing")
    control("sample without a file", ["sample"], "exit 2", "FILE")
    control("sample of two files", ["sample", "in/cube.obj", "in/open.obj"], "exit 2", "in/open.obj")
    control("sample with a misspelt member", ["sample", "in/cube.obj", "--set", "/sampling/cuont=5"], "exit 2", "cuont")
    control("sample of a spec", ["sample", "spec.json"], "exit 2", "spec.json")
    control("mesh instead of a spec", ["submit", "in/cube.obj"], "exit 2", "hexadctl sample in/cube.obj")
    control("frames of a spec without ####", ["submit", "-", "--frames", "1-3"], "exit 2", "####", text=json.dumps(sphere()))
    control("dependency by a name that no job has", ["submit", "-", "--depends-on", "trefoli"], "exit 4", "trefoli", text=json.dumps(sphere()))
    control("wait without an id", ["wait"], "exit 2", "ID")
    control("cancel of a name that no job has", ["cancel", "trefoli", "--yes"], "exit 4", "trefoli")
    control("beginning of an id that does not exist", ["show", "01arz3ndek"], "exit 4", "01arz3ndek")
    control("beginning of several ids", ["show", "{beginning}"], "exit 2", "PREFIX")
    control("cancel of a job that ended", ["cancel", "{ended}"], "exit 4", "ID")
    control("cancel by label and by id", ["cancel", "{waiting}", "--label", "x"], "exit 2", "--label")
    control("retry of a job that waits", ["retry", "{waiting}"], "exit 4", "ID")
    control("delete of a job that waits", ["delete", "{waiting}"], "exit 4", "ID")
    control("delete of latest without --yes", ["delete", "latest"], "exit 2", "latest")
    control("fetch before the end", ["fetch", "{waiting}"], "exit 4", "ID")
    control("fetch of frames of a job without frames", ["fetch", "{waiting}", "--frame", "1-3"], "exit 2", "--frame")
    control("log of an attempt that does not exist", ["log", "{waiting}"], "exit 4", "ID")
    control("deliver without an output directory", ["deliver", "{ended}"], "exit 4", "ID")
    control("upload of a file that does not exist", ["upload", "in/cubes.obj"], "exit 2", "in/cubes.obj")
    control("upload of a directory", ["upload", "in"], "exit 2", "in")
    control("file too large", ["upload", "in/big.obj"], "exit 2", "big.obj")
    control("token for a name with a blank", ["token", "add", "Jane Doe", "--file", "tokens"], "exit 2", "Jane Doe")
    control("unknown scope", ["token", "add", "jane", "--scopes", "write", "--file", "tokens"], "exit 2", "write")
    control("revoke of an unknown token", ["token", "revoke", "abc", "--file", "tokens"], "exit 4", "abc")
    control("file of tokens that does not exist", ["token", "list", "--file", "token"], "exit ", "token")

    # hexad
    start = ["--state_dir", "other.state"]
    daemon("unknown setting", [], "exit 2", "hexad.conf:1", config="worker_count = 4\n")
    daemon("misspelt setting", [], "exit 2", "hexad.conf:1", config="threds = 4\n")
    daemon("a setting that is no number", [], "exit 2", "threads", config="threads = many\n")
    daemon("a setting out of range", [], "exit 2", "threads", config="threads = -1\n")
    daemon("wrong unit of a size", [], "exit 2", "memory_mb", config="memory_mb = 4GB\n")
    daemon("a line without =", [], "exit 2", "hexad.conf:2", config="threads = 2\nworkers 4\n")
    daemon("a section", [], "exit 2", "hexad.conf:2", config="[service]\nthreads = 2\n")
    daemon("a setting twice", [], "exit 2", "threads", config="threads = 2\nthreads = 3\n")
    daemon("configuration file that does not exist", ["--config", "hexda.conf"], "exit 2", "hexda.conf")
    daemon("unknown option", ["--thread", "4"], "exit 2", "--thread")
    daemon("option without a value", ["--threads"], "exit 2", "--threads")
    daemon("port in use", [*start, "--listen", "{port}", "--tcp_without_tokens", ANYONE], "exit 1", "127.0.0.1:PORT")
    daemon("socket in use", [*start, "--listen", "unix:{where}/hexad.sock"], "exit 2", "hexad.sock")
    daemon("two daemons on one state directory", ["--state_dir", "service.state", "--listen", "unix:{where}/two.sock"], "exit 1",
           "service.state")
    daemon("port without tokens", [*start, "--listen", "127.0.0.1:0"], "exit 2", "127.0.0.1:0")
    daemon("port for all machines without tokens", [*start, "--listen", "0.0.0.0:0"], "exit 2", "0.0.0.0:0")
    daemon("address without a port", [*start, "--listen", "localhost"], "exit 2", "localhost")
    daemon("relative path of a socket", [*start, "--listen", "unix:hexad.sock"], "exit 2", "hexad.sock")
    daemon("state directory that cannot be made", ["--state_dir", "/proc/hexad"], "exit 1", "/proc/hexad")
    daemon("state directory that is a file", ["--state_dir", "in/cube.obj"], "exit 1", "in/cube.obj")
    daemon("input root that does not exist", [*start, "--input_roots", "{where}/volumes"], "exit 1", "volumes")
    daemon("output root that does not exist", [*start, "--output_roots", "{where}/results"], "starts", "results")
    daemon("relative output root", [*start, "--output_roots", "results"], "exit 2", "results")
    daemon("worker that does not exist", [*start, "--worker", "/nonexistent/hexad-worker"], "exit 1", "/nonexistent/hexad-worker")
    daemon("mode that is not octal", [*start, "--output_mode", "rw-r--r--"], "exit 2", "output_mode")
    daemon("group that does not exist", [*start, "--output_group", "nogroup-of-hexad"], "exit 2", "nogroup-of-hexad")
    daemon("user that does not exist", [*start, "--unix_users", "nouser-of-hexad"], "starts, warning", "nouser-of-hexad")
    daemon("mapping without =", [*start, "--path_mappings", "Z:/show"], "exit 2", "Z:/show")
    daemon("weight that is no number", [*start, "--user_weights", "alice:high"], "exit 2", "alice:high")
    daemon("webhooks without a secret", [*start, "--webhook_hosts", "example.com"], "exit 2", "webhook_secret_file")
    daemon("slurm without a shared directory", [*start, "--engine", "slurm"], "exit 2", "work_dir")
    daemon("backup that names a directory", ["--state_dir", "service.state", "--backup", "out"], "exit 1", "out")
    daemon("check of a directory without a database", ["--state_dir", "in", "--check"], "exit 1", "in")

    # requests
    request("body that is not JSON", "POST", "/v1/jobs", "400 json_invalid", "line 1", body="{version: 1}")
    request("form data", "POST", "/v1/jobs", "415 ", "Content-Type", body="a=b", headers={"Content-Type": "application/x-www-form-urlencoded"})
    request("body that is too large", "POST", "/v1/jobs", "413 ", "body_limit_bytes", body=json.dumps(sphere(name="x" * 30000)))
    request("path outside the input roots", "POST", "/v1/jobs", "403 path_forbidden", "/etc/passwd", body=of({"mesh": {"path": "/etc/passwd"}}))
    request("file that was not uploaded", "POST", "/v1/jobs", "422 ", "inputs/", body=of({"mesh": {"path": "inputs/" + "0" * 64}}))
    request("output directory outside the output roots", "POST", "/v1/jobs", "403 ", "/tmp/elsewhere",
            body=sphere(output={"directory": "/tmp/elsewhere"}))
    request("more memory than the service has", "POST", "/v1/jobs:validate", "", "memory_mb", body=sphere(limits={"memory_mb": 100000}))
    request("dependency that does not exist", "POST", "/v1/jobs", "422 ", "/queue/depends_on/0", body=sphere(queue={"depends_on": ["01arz3ndektsv4rrffq69g5fav"]}))
    request("webhook to a host that is not allowed", "POST", "/v1/jobs", "422 ", "/queue/webhook", body=sphere(queue={"webhook": "https://example.com/"}))
    request("unknown path", "GET", "/v1/job", "404 not_found", "/v1/job")
    request("unknown id", "GET", "/v1/jobs/01arz3ndektsv4rrffq69g5fav", "404 not_found", "ID")
    request("method that is not allowed", "PUT", "/v1/jobs", "405 ", "PUT")
    request("unknown parameter", "GET", "/v1/jobs?status=queued", "400 ", "status")
    request("limit out of range", "GET", "/v1/jobs?limit=100000", "400 ", "limit")
    request("cursor of nowhere", "GET", "/v1/jobs?cursor=abc", "400 ", "cursor")
    request("stale ETag", "PATCH", "/v1/jobs/{waiting}", "412 ", "the job ID", body={"priority": 3}, headers={"If-Match": '"0"'})
    request("change of a member that cannot be changed", "PATCH", "/v1/jobs/{waiting}", "422 ", "name", body={"name": "x"})
    request("results before the end", "GET", "/v1/jobs/{waiting}/results", "409 ", "ID")
    request("result that does not exist", "GET", "/v1/jobs/{ended}/results/points.obj", "", "ID")
    request("upload under a name", "PUT", "/v1/inputs/cube.obj", "", "cube.obj", body="x", headers={"Content-Type": "application/octet-stream"})
    request("upload with another hash", "PUT", "/v1/inputs/" + "0" * 64, "", "SHA-256", body="x",
            headers={"Content-Type": "application/octet-stream"})
    request("no token", "GET", "/v1/jobs", "401 unauthorized", "Authorization", token="")
    request("wrong token", "GET", "/v1/jobs", "401 unauthorized", "token", token="hexad_wrong")
    request("scope is missing", "POST", "/v1/jobs", "403 forbidden", "submit", body=sphere(), token="read")
    request("command of administrators", "POST", "/v1/admin/drain", "403 forbidden", "admin", token="full")
    request("priority above that of the token", "POST", "/v1/jobs", "403 priority_forbidden", "priority", body=sphere(queue={"priority": 9}),
            token="low")
    request("page of another site", "GET", "/v1/jobs", "403 ", "page_origins", token="", headers={"Origin": "https://example.com"})
    request("another host", "GET", "/v1/jobs", "421 ", "example.com", token="", headers={"Host": "example.com"})


@contextlib.contextmanager
def listener(handle):
    with socket.create_server(("127.0.0.1", 0)) as listening:
        def serve():
            with contextlib.suppress(OSError):
                while True:
                    handle(listening.accept()[0])
        threading.Thread(target=serve, daemon=True).start()
        yield "127.0.0.1:%d" % listening.getsockname()[1]


def tls_port(world):
    """An address that answers over TLS only."""
    if not (world.where / "key.pem").exists():
        subprocess.run(["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days", "2",
                        "-subj", "/CN=localhost", "-keyout", world.where / "key.pem", "-out", world.where / "certificate.pem"], check=True,
                       capture_output=True, timeout=PATIENCE_S)
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(world.where / "certificate.pem", world.where / "key.pem")

        def handle(connection):
            with contextlib.suppress(OSError), connection:
                context.wrap_socket(connection, server_side=True)
        world.tls = world.stack.enter_context(listener(handle))
    return f"http://{world.tls}"


# ---- the results

COLUMNS = ["mistake", "made_by", "result", "message"]


def faults_of(row, result, message):
    """What is wrong with a message, as texts."""
    _, what, _, expected, names, _ = row
    found = []
    if not result.startswith(expected):
        found.append(f"{what}: the result is {result} instead of {expected}")
    if names not in message:
        found.append(f"{what}: the message does not name {names}: {message}")
    if "warning" not in result and not INSTRUCTION.search(message):
        found.append(f"{what}: the message has no instruction: {message}")
    return found


def name_of(row):
    """The program, and the mistake."""
    return f"{row[0]}: {row[1]}"


def all_rows():
    if not ROWS:
        list_mistakes()
    return ROWS


def make_all(built, where, chosen=lambda row: True):
    """(row, result, message) of each mistake that is chosen."""
    world = World(built, where)
    with contextlib.ExitStack() as world.stack:
        world.stack.callback(world.end)
        world.start()
        for row in filter(chosen, all_rows()):
            result, message = row[5](world)
            yield row, result, world.plain(message)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--built", required=True, help="the directory of the built programs")
    parser.add_argument("--output", help="CSV file of the results; without it, each mistake is printed")
    parser.add_argument("--only", help="mistakes of this kind, or with this text in their names")
    chosen = parser.parse_args()
    made, faults = [], []
    with tempfile.TemporaryDirectory(prefix="hexad-mistakes-") as where:
        for row, result, message in make_all(chosen.built, where, lambda row: not chosen.only or chosen.only in (row[0], row[1])):
            made.append((row, result, message))
            faults += faults_of(row, result, message)
            if not chosen.output:
                print(f"{name_of(row)}: {row[2]}\n    {result}\n    {message}")
    if chosen.output:
        results.write(chosen.output, COLUMNS, [[name_of(row), row[2], result, message] for row, result, message in made])
    print(f"{len(made)} mistakes, {len(faults)} faults", *faults, sep="\n", file=sys.stderr)
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
