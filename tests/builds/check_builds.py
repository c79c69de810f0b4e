# SPDX-License-Identifier: Apache-2.0
"""Builds hexad without each of its optional parts, and without all of them, and runs a smoke test in each build.

    python3 check_builds.py SOURCE WORK [--only NAME] [VARIABLE=VALUE ...]

WORK has one build for each row of BUILDS; a later run compiles only what has changed. VARIABLE=VALUE goes to configure.
Prints one line for each check. The exit status is 1 if one of them fails.
"""
import argparse
import contextlib
import http.client
import json
import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import time

BUILDS = {
    "daemon": ["--disable-daemon"],
    "slurm": ["--without-slurm"],
    "page": ["--without-page"],
    "preview": ["--disable-preview"],
    "all": ["--disable-daemon", "--without-slurm", "--without-page", "--disable-preview"],
}
# modules of pkg-config and names of shared libraries that a build without the part must not need
LIBRARIES = {
    "--disable-daemon": {"libmicrohttpd": "libmicrohttpd", "sqlite3": "libsqlite3", "libcurl": "libcurl", "inih": "libinih",
                         "libsystemd": "libsystemd"},
    "--disable-preview": {"libdeflate": "libdeflate"},
}
PROGRAMS = {"hexad": "--disable-daemon", "hexadctl": "--disable-daemon", "hexad-node": "--without-slurm", "hexad-worker": None}
SPHERE = {"version": 1, "surface": {"analytic": {"shape": "sphere", "radius": 1}}, "sampling": {"count": 300}}
START_S = 60  # of a daemon, at most


def spec(**members):
    return json.dumps({**SPHERE, **members})


class Unix(http.client.HTTPConnection):
    def __init__(self, path):
        super().__init__("localhost")
        self.path = path

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.sock.connect(str(self.path))


class Build:
    def __init__(self, source, folder, options):
        self.source, self.folder, self.options = source, folder, options
        self.failed = 0

    def check(self, what, holds, shown=""):
        self.failed += not holds
        print(f"{'ok' if holds else 'not ok'} {self.folder.name}: {what}", flush=True)
        if not holds:
            print("".join(f"# {line}\n" for line in str(shown).splitlines()[-20:]), end="", flush=True)
        return holds

    def has(self, option):
        """Whether the part is built."""
        return option not in self.options

    def run(self, *command, text=None):
        return subprocess.run([str(c) for c in command], cwd=self.folder, input=text, capture_output=True, text=True)

    # ---- the build

    def refusing_pkg_config(self):
        """A pkg-config that does not find the libraries of parts that are left out."""
        script = self.folder / "pkg-config-without"
        names = "|".join(f"*{module}*" for option in self.options for module in LIBRARIES.get(option, {}))
        script.write_text(f'#!/bin/sh\ncase "$*" in {names or "no-module"}) exit 1;; esac\nexec pkg-config "$@"\n')
        script.chmod(0o755)
        return script

    def make(self, variables):
        self.folder.mkdir(parents=True, exist_ok=True)
        environment = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MFLAGS", "MAKELEVEL")}
        if not (self.folder / "Makefile").exists():
            done = self.run(os.path.join(os.path.relpath(self.source, self.folder), "configure"), *self.options, f"PKG_CONFIG={self.refusing_pkg_config()}", *variables)
            if not self.check("configure", done.returncode == 0, done.stdout + done.stderr):
                return False
            named = [option for option in self.options if f"({option})" in done.stdout.split("will be built with")[-1]]
            self.check("the summary names each option", named == [o for o in self.options if self.has("--disable-daemon") or
                                                                   o != "--without-page"], done.stdout)
        done = subprocess.run(["make", "-s", f"-j{os.cpu_count()}", "all"], cwd=self.folder, env=environment,
                              capture_output=True, text=True)
        return self.check("make", done.returncode == 0, done.stdout + done.stderr)

    def programs(self):
        for name, option in PROGRAMS.items():
            there = (self.folder / name).exists()
            self.check(f"{name} is {'' if self.has(option) else 'not '}built", there == self.has(option))
            if there:
                said = self.run(self.folder / name, "--version")
                self.check(f"{name} --version", said.returncode == 0, said.stderr)
                linked = self.run("ldd", self.folder / name).stdout
                unwanted = [so for o in self.options for so in LIBRARIES.get(o, {}).values() if so in linked]
                self.check(f"{name} links no library of a part that is left out", not unwanted, unwanted)

    # ---- the worker

    def is_refused(self, what, done, option):
        """Whether a worker has ended with not_supported and named the option."""
        last = done.stderr.splitlines()[-1] if done.stderr else ""
        self.check(f"{what} is not_supported", done.returncode == 2 and '"code":"not_supported"' in last.replace(" ", "")
                   and option in last, f"{done.returncode} {done.stderr}")

    def worker(self, scratch):
        worker, out = self.folder / "hexad-worker", scratch / "out"
        done = self.run(worker, "run", "-", "--output", out, text=spec())
        self.check("a job of the worker", done.returncode == 0, done.stderr)
        report = json.loads((out / "report.json").read_text())
        warned = [w for w in report["surface"]["warnings"] if "--disable-preview" in w]
        drawn = (out / "preview.png").exists()
        self.check("the default preview is drawn, or left out with a warning", drawn == self.has("--disable-preview")
                   and drawn != bool(warned), report["surface"]["warnings"])
        example = scratch / "trefoil.vdb"
        done = self.run(worker, "make-example", example)
        self.check("an example", done.returncode == 0, done.stderr)
        done = self.run(worker, "inspect", example, "--json")
        self.check("inspect", done.returncode == 0 and json.loads(done.stdout), done.stderr)
        if not self.has("--disable-preview"):
            for member in ({"preview": True}, {"preview": {"size": 128}}):
                done = self.run(worker, "run", "-", "--output", scratch / "none", text=spec(output=member))
                self.is_refused(f"output {json.dumps(member)}", done, "--disable-preview")
            done = self.run(worker, "run", "-", "--output", out, text=spec(output={"preview": False}))
            report = json.loads((out / "report.json").read_text())
            self.check("without a preview there is no warning", not report["surface"]["warnings"], report["surface"])
            done = self.run(worker, "inspect", example, "--preview", scratch / "a.png")
            self.is_refused("inspect --preview", done, "--disable-preview")
        if not self.has("--without-slurm"):
            done = self.run(worker, "run", "-", "--output", scratch / "none", text=spec(queue={"slurm": ["--partition=a"]}))
            self.is_refused("queue.slurm", done, "--without-slurm")

    # ---- the daemon

    @contextlib.contextmanager
    def daemon(self, scratch):
        path = scratch / "socket"
        with open(scratch / "log", "w") as log:
            process = subprocess.Popen([self.folder / "hexad", "--state_dir", scratch / "state", "--listen", f"unix:{path}",
                                        "--port_file", scratch / "port"], stderr=log)
        try:
            until = time.monotonic() + START_S
            while not (scratch / "port").exists() and process.poll() is None and time.monotonic() < until:
                time.sleep(0.01)
            yield path
        finally:
            process.terminate()
            process.wait()

    def ask(self, path, method, target, body=None):
        connection = Unix(path)
        connection.request(method, target, body, {"Content-Type": "application/json"} if body else {})
        answer = connection.getresponse()
        text = answer.read().decode(errors="replace")
        connection.close()
        return answer.status, text

    def is_refused_by_daemon(self, what, answer, option):
        status, text = answer
        self.check(f"{what} is not_supported", status == 422 and "not_supported" in text and option in text, answer)

    def service(self, scratch):
        hexad = self.folder / "hexad"
        for option, setting in (("--without-slurm", "engine=slurm"), ("--without-slurm", "slurm_batch_s=5"),
                                ("--without-page", "session_s=60")):
            if not self.has(option):
                done = self.run(hexad, "--state_dir", scratch / "other", f"--{setting}", "--work_dir", scratch / "other")
                self.check(f"{setting} ends the start", done.returncode != 0 and option in done.stderr, done.stderr)
        with self.daemon(scratch) as path:
            os.environ["HEXAD_SERVER"] = f"unix:{path}"
            done = self.run(self.folder / "hexadctl", "submit", "-", "--wait", text=spec())
            self.check("a job of the daemon", done.returncode == 0, done.stderr + (scratch / "log").read_text())
            answer = self.ask(path, "GET", "/")
            if self.has("--without-page"):
                self.check("the page", "--without-page" not in answer[1], answer)
            else:
                self.is_refused_by_daemon("the page", answer, "--without-page")
            if not self.has("--without-slurm"):
                answer = self.ask(path, "POST", "/v1/jobs", spec(queue={"slurm": ["--partition=a"]}))
                self.is_refused_by_daemon("queue.slurm", answer, "--without-slurm")
            if not self.has("--disable-preview"):
                answer = self.ask(path, "POST", "/v1/jobs", spec(output={"preview": True}))
                self.is_refused_by_daemon("output.preview", answer, "--disable-preview")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", type=pathlib.Path)
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--only", choices=BUILDS)
    parser.add_argument("variables", nargs="*")
    given = parser.parse_args()
    failed = 0
    for name, options in BUILDS.items():
        if given.only not in (None, name):
            continue
        build = Build(given.source.resolve(), given.work.resolve() / name, options)
        if build.make(given.variables):
            build.programs()
            with tempfile.TemporaryDirectory() as scratch:
                build.worker(pathlib.Path(scratch))
            if build.has("--disable-daemon"):
                with tempfile.TemporaryDirectory() as scratch:
                    build.service(pathlib.Path(scratch))
        failed += build.failed
    print(f"{failed} checks failed" if failed else "all checks passed")
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
