#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Makes the state directory that an upgrade is tested from, with the programs of an earlier build.

    make_state.py HEXAD WORKER OUTPUT

HEXAD and WORKER are the earlier build's programs; OUTPUT must not exist. The folders of tests/upgrade are named after the commits of
their builds. The daemon is killed while one job runs, by a worker that waits; other jobs wait, are paused, have succeeded (one with the
result of an equal job), failed or been cancelled. OUTPUT gets the directories of the state directory, queue.db as SQL, and jobs.json:
members of each job before the kill, by GET /v1/jobs.
"""
import hashlib
import json
import os
import pathlib
import pwd
import shutil
import sqlite3
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "service"))
from service import Service, wait_until  # noqa: E402

TETRAHEDRON = "OFF\n4 4 0\n{0} {0} {0}\n{0} -{0} -{0}\n-{0} {0} -{0}\n-{0} -{0} {0}\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"
PATIENT_WORKER = """#!/bin/sh
spec=$(cat)
case $spec in *'"name":"runs"'*) echo half >"$4/points.ply.new"; echo '{"phase":"relax","fraction":0.5}' >&3; exec sleep 3600 ;; esac
echo "$spec" | exec %s "$@"
"""

KEPT = ("id", "name", "state", "outcome", "labels", "priority", "cached_from")


class Earlier(Service):
    """The earlier daemon, with options that it has."""

    def __init__(self, program, base, worker, inputs):
        super().__init__(program.parent, base)
        self.options = ["--listen", f"unix:{base}/socket", "--workers", "1", "--threads", "1", "--max_attempts", "2", "--worker",
                        worker, "--input_roots", inputs]


def ball(name, radius, **parts):
    return {"version": 1, "name": name, "surface": {"analytic": {"shape": "sphere", "center": [0, 0, 0], "radius": radius}},
            "sampling": {"count": 60}, "output": {"preview": False}, **parts}


def mesh(name, path, **parts):
    return {"version": 1, "name": name, "surface": {"mesh": {"path": path, "voxel_size": 0.1}}, "sampling": {"count": 60},
            "output": {"preview": False}, **parts}


def send(service, text):
    """Uploads a file; the path that specs name it by."""
    reply = service.request("PUT", f"/v1/inputs/{hashlib.sha256(text.encode()).hexdigest()}", text)
    assert reply.status == 201, reply.body
    return reply.json["path"]


def write_frames(inputs):
    for number in (1, 2):
        (inputs / f"grows.{number:04d}.off").write_text(TETRAHEDRON.format(number))


def fill(service, inputs):
    """Submits jobs of all kinds, and returns when one runs for ever and the rest waits behind it."""
    write_frames(inputs)
    sent = send(service, TETRAHEDRON.format(1))
    service.wait_state(service.submit(mesh("sent", sent, queue={"labels": ["shot=1"]})), "succeeded")
    service.wait_state(service.submit(mesh("frames", "grows.####.off", queue={"frames": "1-2"})), "succeeded")
    service.wait_state(service.submit(mesh("broken", send(service, "OFF\n4 4 0\n"))), "failed")
    service.wait_state(service.submit(mesh("cached", sent)), "succeeded")
    runs = service.submit(ball("runs", 1))
    wait_until(lambda: service.job(runs)["progress"], "progress")
    service.submit(ball("waits", 2, queue={"priority": 10, "labels": ["shot=2", "night"]}))
    service.submit(ball("after", 3, queue={"depends_on": [runs]}))
    service.submit(mesh("waits with a sent file", sent, sampling={"count": 70}, queue={"priority": -5}))
    service.submit(mesh("waits, equal to sent", sent, queue={"depends_on": [runs]}))
    service.submit(mesh("waits with defaults", sent, output={"preview": {"size": [64, 64]}}))
    service.submit({**ball("waits with a removed member", 1), "sampling": {"time_s": 5}})
    service.submit(mesh("waiting frames", "grows.####.off", queue={"frames": "1-2"}))
    service.post(f"/v1/jobs/{service.submit(ball('paused', 4))}/pause")
    service.post(f"/v1/jobs/{service.submit(ball('cancelled', 5))}/cancel")


def put_back(earlier, state):
    """Copies a directory that main() has made into an empty state directory, but for the database. Times are new, because unused inputs
    are deleted after some days. Uploads are those of the user that runs this."""
    for part in ("attempts", "inputs", "results"):
        shutil.copytree(earlier / part, state / part, copy_function=shutil.copyfile)
    user = hashlib.sha256(pwd.getpwuid(os.getuid()).pw_name.encode()).hexdigest()
    for record in (state / "inputs").glob("sender:*"):
        record.rename(f"{str(record).rpartition(':')[0]}:{user}")
    if (earlier / "instance").exists():
        shutil.copyfile(earlier / "instance", state / "instance")


def make_database(earlier, path):
    with sqlite3.connect(path) as database:
        database.executescript((earlier / "queue.sql").read_text())
    database.close()


def read_jobs(earlier):
    return {job["name"]: job for job in json.loads((earlier / "jobs.json").read_text())}


def main():
    program, worker, output = map(pathlib.Path, sys.argv[1:])
    output.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as where:
        base = pathlib.Path(where)
        inputs = base / "inputs"
        inputs.mkdir()
        patient = base / "worker"
        patient.write_text(PATIENT_WORKER % worker.resolve())
        patient.chmod(0o755)
        service = Earlier(program.resolve(), base, patient, inputs).start()
        fill(service, inputs)
        jobs = service.get("/v1/jobs?limit=100").json["jobs"]
        service.process.kill()
        service.process.wait()
        (output / "jobs.json").write_text(json.dumps([{name: job[name] for name in KEPT} for job in jobs], indent=1, sort_keys=True) + "\n")
        for entry in sorted(service.state.iterdir()):
            if entry.is_dir() and any(entry.iterdir()):
                shutil.copytree(entry, output / entry.name)
        if (service.state / "instance").exists():
            shutil.copyfile(service.state / "instance", output / "instance")
        with sqlite3.connect(service.state / "queue.db") as database:
            version = database.execute("PRAGMA user_version").fetchone()[0]
            dump = "\n".join([f"PRAGMA user_version = {version};", *database.iterdump()])
        (output / "queue.sql").write_text(dump + "\n")


if __name__ == "__main__":
    main()
