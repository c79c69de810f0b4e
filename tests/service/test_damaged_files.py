# SPDX-License-Identifier: Apache-2.0
"""A byte of a result or of an upload has changed: each consumer finds it, and what helps does help."""
import contextlib
import hashlib
import json
import os
import pathlib
import shutil
import sqlite3
import subprocess
import sys

import pytest

from commands import control, run_hexad
from lost_answers import on_a_socket
from service import PATIENCE_S, exchange, expect_problem, last_words, sphere, wait_until

ROOT = pathlib.Path(__file__).parents[2]
TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n" + "# " + "x" * 1000 + "\n"
SENT = hashlib.sha256(TETRAHEDRON.encode()).hexdigest()
FRAMES = {"frames": "1-2", "by_frame": {"/surface/analytic/radius": {"from": 1, "to": 1.1}}}
PLAIN = {"output": {"preview": False}}


def flip(file, at=-1):
    """Changes one bit of a byte; neither the length nor the inode changes."""
    data = bytearray(file.read_bytes())
    data[at] ^= 1
    with open(file, "r+b") as stream:
        stream.write(data)


def damaged(file="points.ply"):
    return f"the result file {file} is damaged"


def log_has(service, *words):
    return any(all(w in line for w in words) for line in service.log.read_text().splitlines())


def succeed(service, **parts):
    return service.wait_state(service.submit(sphere(**parts)), "succeeded")


def result_of(service, job, name="points.ply"):
    return service.state / "results" / job / name


@pytest.fixture
def socket_service(build, tmp_path):
    """On a Unix socket, where the user of the tests is an administrator."""
    made = on_a_socket(build, tmp_path)
    yield made
    made.clean_up()


# ---- consumers of a result: each is given a service, a job that has succeeded, and the damaged file of its result

def deliver(service, job, name, **_):
    """hexadctl deliver and POST /deliver: the copy has the damaged file under no name, and no report."""
    where = pathlib.Path(service.job(job)["spec"]["output"]["directory"])
    assert service.post(f"/v1/jobs/{job}/deliver").status < 300
    done = wait_until(lambda: (j := service.job(job))["delivery"]["state"] == "failed" and j, "the delivery")["delivery"]
    assert done["code"] == "input_damaged" and "output.directory" in done["message"], done
    assert damaged(name) in done["message"] and "Submit the job again" in done["message"]
    assert log_has(service, "not delivered", job, damaged(name))
    assert not (where / "report.json").exists() and not list(where.glob(".*"))
    if name != "report.json":
        assert (where / name).read_bytes() != result_of(service, job, name).read_bytes()  # the good one before


def use_again(service, job, name, spec, **_):
    """The cache does not link it; the equal job is computed, and then its result is used."""
    again = service.wait_state(service.submit(spec), "succeeded")
    assert again["cached_from"] is None
    assert log_has(service, "cannot use a cached result", again["id"], job, damaged(name))
    assert result_of(service, again["id"], "points.ply").stat().st_nlink == 1
    later = service.wait_state(service.submit(spec), "succeeded")
    assert later["cached_from"] == again["id"]


def fetch(service, job, name, tmp_path, **_):
    status, _, errors = control(service, "fetch", job, "--output", str(tmp_path / "fetched"))
    assert status == 1 and name in errors and "damaged" in errors and "Submit the job again" in errors, errors
    assert not (tmp_path / "fetched" / name).exists() and not (tmp_path / "fetched" / "report.json").exists()


def fetch_in_python(service, job, name, tmp_path, **_):
    sys.path.insert(0, str(ROOT / "clients/python"))
    import hexad
    with pytest.raises(hexad.Damaged, match="Submit the job again"):
        hexad.Client(f"http://{service.address}").job(job).fetch(tmp_path / "fetched")
    assert not (tmp_path / "fetched" / name).exists()


def fetch_in_typescript(service, job, name, tmp_path, **_):
    (tmp_path / "script.mjs").write_text(f"""import {{Client}} from "{ROOT}/clients/typescript/node.js";
const job = await new Client({{server: "http://{service.address}"}}).job("{job}");
await job.read("{name}").catch(error => console.log(error.name, error.message));
await job.fetch("fetched").catch(error => console.log(error.name, error.message));""")
    done = subprocess.run(["node", "script.mjs"], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S)
    lines = done.stdout.splitlines()
    assert len(lines) == 2 and all(l.startswith("Damaged") and "Submit the job again" in l for l in lines), done
    assert not (tmp_path / "fetched" / name).exists()


def adopt(service, job, name, **_):
    """It becomes no job; the sound one does."""
    sound = succeed(service, count=151)["id"]
    assert service.end() == 0
    for file in service.state.glob("queue.db*"):
        file.unlink()
    service.start("--adopt")
    assert [j["id"] for j in service.get("/v1/jobs").json["jobs"]] == [sound]
    assert log_has(service, "cannot adopt a result", job, damaged(name))
    assert (service.state / "lost+found/results" / job / name).exists()


def check(service, job, name, **_):
    """Plain --check looks at lengths and says so; --contents at the bytes."""
    sound = succeed(service, count=151)["id"]
    assert service.end() == 0
    options = ["--state_dir", service.state, "--check"]
    plain = run_hexad(service.build, *options)
    assert plain.returncode == 0 and "2 results: their files are there, with their lengths" in plain.stdout
    done = run_hexad(service.build, *options, "--contents")
    lines = done.stdout.splitlines()
    assert done.returncode == 1 and len(lines) == 2, done
    assert lines[0].startswith(f"result of {job}: {damaged(name)}") and sound not in done.stdout
    assert "compared 2 results, 0 of about 0 MiB, and 0 uploads" in done.stderr.splitlines()[-1]


RESULT = [deliver, use_again, fetch, fetch_in_python, adopt, check,
          pytest.param(fetch_in_typescript, marks=pytest.mark.extended)]


@pytest.mark.sanitized
@pytest.mark.parametrize("name", ["points.ply", "report.json"])
@pytest.mark.parametrize("consumer", RESULT)
def test_a_damaged_result_is_found_by(consumer, name, new_service, tmp_path):
    service = new_service("--output_roots", tmp_path, "--workers", 1).start()
    spec = sphere(150, output={"preview": False, "directory": f"{tmp_path}/copies"})
    job = service.wait_state(service.submit(spec), "succeeded")["id"]
    flip(result_of(service, job, name), -100)
    consumer(service=service, job=job, name=name, spec=spec, tmp_path=tmp_path)


def test_a_damaged_preview_is_not_used_again(new_service):
    """Each file of a result is compared, not only the points."""
    service = new_service().start()
    job = succeed(service)["id"]
    flip(result_of(service, job, "preview.png"))
    assert succeed(service)["cached_from"] is None
    assert log_has(service, "cannot use a cached result", job, damaged("preview.png"))


def test_an_equal_job_of_a_damaged_result_waits_for_a_worker(new_service, tmp_path):
    """It was to be given the result while all workers are busy, and is queued as any other job."""
    service = new_service("--workers", 1).start()
    first = succeed(service)["id"]
    flip(result_of(service, first))
    busy = service.submit(sphere(count=20000, solver={"max_sweeps": 1000000, "step_tolerance": 1e-12, "energy_tolerance": 1e-12}))
    service.wait_worker(busy)
    again = service.submit(sphere())
    wait_until(lambda: log_has(service, "cannot use a cached result", again), "the comparison")
    service.wait_state(again, "queued")
    assert service.post(f"/v1/jobs/{busy}/cancel").status == 202
    assert service.wait_state(again, "succeeded")["cached_from"] is None


def test_a_damaged_frame_is_not_fetched(new_service, tmp_path):
    service = new_service().start()
    job = succeed(service, queue=FRAMES, **PLAIN)["id"]
    flip(result_of(service, f"{job}.2"))
    status, _, errors = control(service, "fetch", job, "--output", str(tmp_path / "all"))
    assert status == 1 and "/2/points.ply" in errors and "Submit the job again" in errors, errors
    assert not (tmp_path / "all" / "2" / "points.ply").exists()


def test_the_check_names_the_frame_that_is_damaged(new_service):
    service = new_service().start()
    job = succeed(service, queue=FRAMES, **PLAIN)["id"]
    flip(result_of(service, f"{job}.2"))
    service.end()
    done = run_hexad(service.build, "--state_dir", service.state, "--check", "--contents")
    assert done.returncode == 1 and done.stdout.startswith(f"result of {job}.2: {damaged()}"), done


def test_a_hash_that_an_earlier_build_copied_from_another_report_is_corrected(new_service, tmp_path):
    """Between an upgrade of the package and the restart of the service, the old daemon had workers of the new build."""
    service = new_service().start()
    jobs = [succeed(service, name=name)["id"] for name in ("a", "b")]
    assert service.job(jobs[1])["cached_from"] == jobs[0]
    assert service.end() == 0
    summaries = [result_of(service, job, "summary.json") for job in jobs]
    first, second = (json.loads(s.read_text()) for s in summaries)
    assert first["report_sha256"] != second["report_sha256"]
    summaries[1].write_text(json.dumps({**second, "report_sha256": first["report_sha256"]}))
    with contextlib.closing(sqlite3.connect(service.state / "queue.db")) as database, database:
        database.execute("UPDATE service SET linked_reports = 1")  # as the migration does
    service.start()
    status, _, errors = control(service, "fetch", jobs[1], "--output", str(tmp_path / "fetched"))
    assert status == 0, errors


# A worker whose result is damaged at its first attempt: its report states the hash of "x".
DAMAGES = """#!/bin/sh
cat > /dev/null
cd "$4"
printf %%s "$( [ "${4##*.}" = 1 ] && echo y || echo x )" > points.ply
printf '{"outcome":"converged","count":7,"outputs":[{"name":"points.ply","bytes":1,"sha256":"%s"}]}' > report.json
""" % hashlib.sha256(b"x").hexdigest()


@pytest.mark.sanitized
def test_a_result_that_is_damaged_before_its_copy_is_computed_again(new_service, tmp_path):
    worker = tmp_path / "damages"
    worker.write_text(DAMAGES.replace("%%", "%"))
    worker.chmod(0o700)
    service = new_service("--worker", worker, "--output_roots", tmp_path, "--retry_s", 0.01).start()
    done = succeed(service, output={"directory": f"{tmp_path}/copies"})
    assert len(done["attempts"]) == 2 and done["delivery"]["state"] == "delivered"
    assert damaged() in done["attempts"][0]["reason"] and done["attempts"][0]["reason"].startswith("storage_failed")
    assert (tmp_path / "copies/points.ply").read_text() == "x"


@pytest.mark.sanitized
def test_a_damaged_result_does_not_end_a_job_of_a_restored_backup(socket_service, tmp_path):
    """The database is older than the result: the job runs again, and the result is put aside."""
    service = socket_service.start()
    assert service.post("/v1/admin/hold").status == 200
    jobs = [service.submit(sphere(count=200 + i)) for i in range(2)]
    backup = tmp_path / "backup.db"
    assert run_hexad(service.build, "--state_dir", service.state, "--port_file", service.port_file, *service.options,
                     "--backup", backup).returncode == 0
    assert service.post("/v1/admin/release").status == 200
    for job in jobs:
        service.wait_state(job, "succeeded")
    assert service.end() == 0
    for file in service.state.glob("queue.db*"):
        file.unlink()
    shutil.copy(backup, service.state / "queue.db")
    flip(result_of(service, jobs[0]))
    service.start()
    assert [service.job(job)["state"] for job in jobs] == ["queued", "succeeded"]
    assert log_has(service, jobs[0], damaged())
    assert (service.state / "lost+found/results" / jobs[0] / "points.ply").exists()
    assert service.post("/v1/admin/release").status == 200
    service.wait_state(jobs[0], "succeeded")


@pytest.mark.sanitized
@pytest.mark.parametrize("name", ["points.ply", "report.json"])
@pytest.mark.parametrize("threads", [1, 2])
def test_a_frame_does_not_start_from_a_damaged_one(build, tmp_path, name, threads):
    """The worker compares while it reads, on a thread of its own if it has one."""
    def run(frame, *more):
        return subprocess.run([build / "hexad-worker", "run", "-", "--output", tmp_path / str(frame), "--frame", str(frame),
                               "--threads", str(threads), *more], input=json.dumps(sphere(100, queue={**FRAMES, "coherent": True}, **PLAIN)), text=True,
                              capture_output=True, timeout=PATIENCE_S)
    assert run(1).returncode in (0, 10)
    assert run(2, "--previous", tmp_path / "1").returncode in (0, 10)
    flip(tmp_path / "1" / name, -100)
    done = run(2, "--previous", tmp_path / "1")
    said = last_words(done)
    assert done.returncode == 3 and said["code"] == "input_damaged" and f"its {name} is damaged" in said["message"], said
    assert "Submit the job again" in said["message"] and not (tmp_path / "2/report.json").exists()


# ---- uploads

def put(service, data=TETRAHEDRON, **headers):
    return service.request("PUT", f"/v1/inputs/{SENT}", data, headers)


def reading(name=f"sha256:{SENT}.obj", **parts):
    return sphere(surface={"mesh": {"path": name, "resolution": 24}}, **parts)


@pytest.fixture
def damaged_upload(new_service):
    """A service with an upload of which a byte has changed that its reader does not miss, or one that it refuses."""
    def make(at=-10, *options):
        service = new_service(*options).start()
        assert put(service).status == 201
        flip(service.state / "inputs" / f"sha256:{SENT}", at)
        return service
    return make


CONSUMERS_OF_UPLOADS = {
    "a mesh": lambda: reading(),
    "given points": lambda: sphere(sampling={"count": 200, "points": {"path": f"sha256:{SENT}.obj", "mode": "keep"}}),
    "a part of a union": lambda: sphere(surface={"union": [reading()["surface"], sphere()["surface"]]}),
    "a file of a data set": lambda: reading("{file}", queue={"files": [f"sha256:{SENT}.obj"]}),
}


@pytest.mark.sanitized
@pytest.mark.parametrize("at", [-10, 0], ids=["comment", "keyword"])
@pytest.mark.parametrize("spec", CONSUMERS_OF_UPLOADS)
def test_a_damaged_upload_ends_its_job_and_can_be_sent_again(damaged_upload, spec, at):
    service = damaged_upload(at)
    job = service.submit(CONSUMERS_OF_UPLOADS[spec]())
    service.wait_state(job, "failed")
    error = service.job(job)["error"] or service.get(f"/v1/jobs/{job}/tasks").json["tasks"][0]["error"]
    assert error["code"] == "input_damaged" and f"sha256:{SENT}.obj: the uploaded file is damaged" in error["message"], error
    assert "Send the file again" in error["message"] and "then retry the job" in error["message"]
    assert log_has(service, "damaged input removed", SENT)
    # all clients ask first whether it is there
    expect_problem(service.get(f"/v1/inputs/{SENT}"), 404, "not_found")
    assert put(service).status == 201
    assert service.post(f"/v1/jobs/{job}/retry").status == 200
    service.wait_state(job, "succeeded", "failed")
    assert (service.state / "inputs" / f"sha256:{SENT}").read_text() == TETRAHEDRON


def test_a_damaged_upload_is_sent_again_by_hexadctl(damaged_upload, tmp_path):
    """The message has the name that its sender gave it."""
    service = damaged_upload()
    (tmp_path / "a.obj").write_text(TETRAHEDRON)
    assert service.request("PUT", f"/v1/inputs/{SENT}?name=a.obj", b"").status == 200
    job = service.submit(reading())
    message = service.wait_state(job, "failed")["error"]["message"]
    assert f"a.obj (sha256:{SENT[:8]}...): the uploaded file is damaged" in message, message
    assert control(service, "upload", str(tmp_path / "a.obj"))[:2] == (0, f"sha256:{SENT}.obj\n")
    assert service.post(f"/v1/jobs/{job}/retry").status == 200
    service.wait_state(job, "succeeded")


@pytest.mark.sanitized
def test_sending_an_upload_again_replaces_a_damaged_file(damaged_upload):
    """Also before any job has read it; an undamaged file is kept, since a worker may be reading it."""
    service = damaged_upload()
    file = service.state / "inputs" / f"sha256:{SENT}"
    assert put(service).status == 200 and file.read_text() == TETRAHEDRON
    assert log_has(service, "damaged input replaced", SENT)
    kept = file.stat().st_ino
    assert put(service).status == 200 and file.stat().st_ino == kept
    assert put(service, b"").status == 200 and file.stat().st_ino == kept  # without the bytes
    expect_problem(put(service, b"other bytes"), 422, "digest_mismatch")
    assert file.stat().st_ino == kept and not list(file.parent.glob(f"{file.name}.*"))
    service.wait_state(service.submit(reading()), "succeeded")


def upload_by_hexadctl(service, tmp_path):
    assert control(service, "upload", str(tmp_path / "a.obj"))[:2] == (0, f"sha256:{SENT}.obj\n")


def upload_in_python(service, tmp_path):
    sys.path.insert(0, str(ROOT / "clients/python"))
    import hexad
    client = hexad.Client(f"http://{service.address}")
    assert client.upload(tmp_path / "a.obj") == client.upload(tmp_path / "a.obj", again=True) == f"sha256:{SENT}.obj"


def upload_in_typescript(service, tmp_path):
    (tmp_path / "script.mjs").write_text(f"""import {{Client}} from "{ROOT}/clients/typescript/node.js";
import {{readFileSync}} from "fs";
console.log(await new Client({{server: "http://{service.address}"}}).upload(readFileSync("a.obj"), ".obj", true));""")
    done = subprocess.run(["node", "script.mjs"], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.stdout == f"sha256:{SENT}.obj\n", done


@pytest.mark.parametrize("upload", [upload_by_hexadctl, upload_in_python,
                                    pytest.param(upload_in_typescript, marks=pytest.mark.extended)])
def test_clients_replace_a_damaged_file_that_is_stored(damaged_upload, tmp_path, upload):
    service = damaged_upload()
    (tmp_path / "a.obj").write_text(TETRAHEDRON)
    assert service.request("PUT", f"/v1/inputs/{SENT}?name=a.obj", b"").status == 200
    upload(service, tmp_path)
    assert (service.state / "inputs" / f"sha256:{SENT}").read_text() == TETRAHEDRON


def test_a_stored_upload_needs_no_room_to_be_sent_again(new_service):
    """Where no second copy fits, the received bytes are ignored."""
    service = new_service("--user_upload_bytes", len(TETRAHEDRON), "--upload_total_bytes", len(TETRAHEDRON)).start()
    assert put(service).status == 201
    assert put(service).status == 200
    pieces = f"PUT /v1/inputs/{SENT} HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\nConnection: close\r\n\r\n" \
             f"{len(TETRAHEDRON):x}\r\n{TETRAHEDRON}\r\n0\r\n\r\n"
    assert exchange(service, pieces.encode()).startswith(b"HTTP/1.1 200 ")
    assert service.request("DELETE", f"/v1/inputs/{SENT}").status == 204
    assert put(service).status == 201  # nothing was counted twice


def test_an_estimate_of_a_damaged_upload_finds_it(damaged_upload):
    service = damaged_upload()
    refused = service.post("/v1/jobs:validate", reading())
    problem = expect_problem(refused, 422, "input_damaged")
    assert "Send the file again" in problem["detail"]
    expect_problem(service.get(f"/v1/inputs/{SENT}"), 404, "not_found")


# ---- files that take many minutes to compare: sparse ones of a terabyte

ENDLESS_BYTES = 2**40
SMALL = """#!/bin/sh
cat > /dev/null
cd "$4"
echo -n x > points.ply
echo '{"outcome":"converged","count":7,"inputs":[],"outputs":[{"name":"points.ply","bytes":1,"sha256":"%s"}]}' > report.json
""" % hashlib.sha256(b"x").hexdigest()
REFUSES = """#!/bin/sh
cat > /dev/null
echo '{"code":"input_damaged","message":"damaged"}' >&2
touch "$0.ends"
exit 3
"""


@pytest.fixture
def with_worker(new_service, tmp_path):
    def make(script, *options):
        worker = tmp_path / "worker"
        worker.write_text(script)
        worker.chmod(0o700)
        return new_service("--worker", worker, *options).start()
    return make


def test_a_stop_does_not_wait_until_a_result_is_compared(with_worker):
    """The equal job is queued again, and no worker is started for it."""
    service = with_worker(SMALL, "--drain_s", 0.1)
    first = succeed(service)["id"]
    report = result_of(service, first, "report.json")
    report.write_text(report.read_text().replace('"bytes":1,', f'"bytes":{ENDLESS_BYTES},'))
    os.truncate(result_of(service, first), ENDLESS_BYTES)
    again = service.submit(sphere())
    service.wait_state(again, "running")
    assert service.end() == 0
    assert log_has(service, "attempt ended", again, "not started: the daemon is being stopped", "state=queued")
    assert not log_has(service, "attempt started", again)


def test_a_stop_does_not_wait_until_uploads_are_compared(with_worker, tmp_path):
    service = with_worker(REFUSES, "--drain_s", 2)
    assert put(service).status == 201
    os.truncate(service.state / "inputs" / f"sha256:{SENT}", ENDLESS_BYTES)
    job = service.submit(reading())
    wait_until((tmp_path / "worker.ends").exists, "the end of the worker")
    assert service.end() == 0
    assert log_has(service, "attempt ended", job, "state=failed", "code=input_damaged")


def test_an_estimate_ends_in_time_although_an_upload_is_large(with_worker):
    service = with_worker(REFUSES)
    assert put(service).status == 201
    os.truncate(service.state / "inputs" / f"sha256:{SENT}", ENDLESS_BYTES)
    expect_problem(service.post("/v1/jobs:validate?within_ms=1000", reading()), 422, "input_damaged")


def test_an_undamaged_upload_of_a_malformed_mesh_stays(new_service):
    service = new_service().start()
    broken = b"v 0 0\n"
    name = hashlib.sha256(broken).hexdigest()
    assert service.request("PUT", f"/v1/inputs/{name}", broken).status == 201
    service.wait_state(service.submit(reading(f"sha256:{name}.obj")), "failed")
    assert service.get(f"/v1/inputs/{name}").status == 200


# ---- hexad --check --contents

@pytest.mark.sanitized
def test_the_check_of_contents_of_a_sound_service(socket_service):
    service = socket_service.start()
    assert put(service).status == 201
    job = service.wait_state(service.submit(reading(output={"preview": False})), "succeeded")["id"]
    options = ["--state_dir", service.state, "--port_file", service.port_file, *service.options, "--check", "--contents"]
    refused = run_hexad(service.build, *options)
    assert refused.returncode == 1 and "stop hexad, or name a copy" in refused.stderr and not refused.stdout
    assert service.end() == 0
    before = {p: p.stat().st_mtime_ns for p in service.state.glob("*/*")}
    done = run_hexad(service.build, *options)
    assert done.returncode == 0 and done.stdout == ("no faults in the database and 1 results: their bytes, and those of 1 "
                                                    "uploads, have their hashes\n"), done
    assert done.stderr.startswith("compared 1 results, 0 of about 0 MiB, and ")
    assert {p: p.stat().st_mtime_ns for p in service.state.glob("*/*")} == before and job


def test_the_check_of_contents_names_a_damaged_upload(damaged_upload):
    service = damaged_upload()
    assert service.end() == 0
    done = run_hexad(service.build, "--state_dir", service.state, "--check", "--contents")
    assert done.returncode == 1 and done.stdout.startswith(f"upload sha256:{SENT} is damaged: "), done
    assert f"hexadctl delete-upload --all sha256:{SENT}" in done.stdout


@pytest.mark.parametrize("replace, reason", [(lambda file: file.symlink_to("elsewhere"), "it cannot be opened: "),
                                             (lambda file: file.mkdir(), "cannot be read for its hash: ")])
def test_the_check_of_contents_names_an_upload_that_cannot_be_read(new_service, replace, reason):
    service = new_service().start()
    assert put(service).status == 201
    assert service.end() == 0
    file = service.state / "inputs" / f"sha256:{SENT}"
    file.unlink()
    replace(file)
    done = run_hexad(service.build, "--state_dir", service.state, "--check", "--contents")
    assert done.returncode == 1 and f"upload sha256:{SENT} cannot be compared: " in done.stdout and reason in done.stdout, done


@pytest.mark.parametrize("words", [["--contents"], ["--check-settings", "--contents"]])
def test_contents_belongs_to_check(build, words):
    done = run_hexad(build, *words)
    assert done.returncode == 2 and "--contents requires --check: add it, or remove --contents" in done.stderr
