# SPDX-License-Identifier: Apache-2.0
"""Disks that are full: nothing is lost, nothing fails for good that would succeed later, and what makes room works.

The disks are file systems of some MiB in memory (tmpfs), which take root to mount.
"""
import hashlib
import json
import os
import re
import signal
import subprocess

import pytest

from disks import MIB, figure, service_on, small
from service import last_words, sphere, wait_until

# Room to store jobs, and one whose result does not fit into it.
ROOM = 1200 << 10
LARGE = sphere(6000, solver={"max_sweeps": 1}, limits={"max_attempts": 1},
               output={"preview": False, "ply": {"format": "ascii", "precision": "double", "properties": ["all"]}})


def states(service):
    """id -> document of all jobs."""
    found, cursor = {}, ""
    while cursor is not None:
        page = service.get(f"/v1/jobs?limit=100{cursor and '&cursor='}{cursor}").json
        found.update((job["id"], job) for job in page["jobs"])
        cursor = page["next"]
    return found


def is_full(service):
    reply = service.get("/readyz")
    assert reply.status == 200 or reply.headers["Retry-After"]
    return reply.status == 503 and b"storage_full" in reply.body


def test_submit_says_that_the_job_waits_for_free_space(new_service, tmp_path):
    service = new_service("--free_space_mb", 1000000000).start()
    (tmp_path / "spec.json").write_text(json.dumps(small(1)))
    done = subprocess.run([service.build / "hexadctl", "submit", tmp_path / "spec.json"], env=service.environment(), capture_output=True,
                          text=True, check=True)
    assert service.job(done.stdout.strip())["state"] == "queued"
    assert done.stderr.startswith("storage_full: ") and done.stderr.count("\n") == 1, done.stderr


@pytest.mark.parametrize("count", [20, pytest.param(100, marks=pytest.mark.extended)])
def test_a_full_disk_holds_jobs_and_loses_none(new_disk, new_service, count):
    disk = new_disk(64)
    service = service_on(disk, new_service, "--free_space_mb", 8, "--reserve_mb", 4)
    done = [service.submit(small(seed)) for seed in range(3)]
    for job in done:
        service.wait_state(job, "succeeded")
    assert service.get("/readyz").status == 200
    assert figure(service, "hexad_storage_floor_bytes") == 8 * MIB <= figure(service, "hexad_storage_free_bytes")

    disk.fill(7 * MIB)  # below the floor, and there is room to store jobs
    waiting = [service.submit(small(100 + k)) for k in range(count)]
    assert is_full(service)
    wait_until(lambda: "the disk is full" in service.log.read_text(), "a word in the log")
    now = states(service)
    assert {now[job]["state"] for job in waiting} == {"queued"}

    disk.fill()
    assert figure(service, "hexad_storage_free_bytes") == 0
    refused = service.post("/v1/jobs", small(1))
    assert refused.status == 507 and refused.json["code"] == "storage_full" and refused.headers["Retry-After"]
    full = f"0 MiB are free on the disk of {service.state}"
    assert full in refused.json["detail"] and full in service.get("/readyz").json["detail"]
    upload = service.request("PUT", f"/v1/inputs/{hashlib.sha256(bytes(MIB)).hexdigest()}", bytes(MIB))
    assert upload.status == 507 and full in upload.json["detail"] and "upload_total_bytes" not in upload.json["detail"]
    assert len(states(service)) == count + 3
    cancelled = set(waiting[:count // 10])
    for job in cancelled:
        assert service.post(f"/v1/jobs/{job}/cancel").status == 200
    results = service.state / "results" / done[0]
    assert results.is_dir()
    database = service.state / "queue.db"
    size = database.stat().st_size
    assert service.request("DELETE", f"/v1/jobs/{done[0]}").status == 204
    assert not results.exists()
    assert disk.free() or database.stat().st_size > size  # SQLite takes room that there is for pages of its log

    for end in (signal.SIGKILL, signal.SIGTERM):
        disk.fill()
        service.end(end)
        disk.fill()
        service.start()
        assert is_full(service)
        cancelled.add(waiting[len(cancelled)])
        assert service.post(f"/v1/jobs/{waiting[len(cancelled) - 1]}/cancel").status == 200
    disk.fill()
    assert service.request("DELETE", f"/v1/jobs/{done[1]}").status == 204
    disk.fill()
    assert service.get(f"/v1/jobs/{done[2]}").json["state"] == "succeeded"

    disk.empty()
    left = [job for job in waiting if job not in cancelled]
    for job in left:
        service.wait_state(job, "succeeded")
    now = states(service)
    assert {now[job]["state"] for job in cancelled} == {"cancelled"}
    assert all(len(service.get(f"/v1/jobs/{job}/attempts").json["attempts"]) == 1 for job in left[:5])
    assert service.get("/readyz").status == 200 and "the disk has space again" in service.log.read_text()


def test_a_disk_that_fills_during_an_attempt(new_disk, new_service):
    """The attempt does not count, and the job waits for room."""
    disk = new_disk(32)
    service = service_on(disk, new_service, "--free_space_mb", 0, "--reserve_mb", 1)
    disk.fill(ROOM)
    job = service.submit(LARGE)
    first = wait_until(lambda: [a for a in service.get(f"/v1/jobs/{job}/attempts").json["attempts"] if a["finished"]],
                       "an attempt's end")[0]
    assert first["exit_status"] == 7 and "storage_full" in first["reason"]
    assert service.job(job)["state"] in ("queued", "running")
    disk.empty()
    service.wait_state(job, "succeeded")
    assert not list((service.state / "attempts").glob("*/points.ply*"))


def test_a_disk_that_stays_full_ends_a_job_at_last(new_disk, new_service):
    disk = new_disk(32)
    service = service_on(disk, new_service, "--free_space_mb", 0, "--reserve_mb", 1, "--storage_retries", 2)
    disk.fill(ROOM)
    job = service.submit(LARGE)
    ended = service.wait_state(job, "failed")
    assert ended["error"]["code"] == "storage_full" and "storage_retries" in ended["error"]["message"]
    assert len(ended["attempts"]) == 3


def test_a_full_output_disk_is_waited_for(new_disk, new_service, tmp_path):
    """The result stands, and only its copy is made again."""
    disk = new_disk(2)
    service = new_service("--output_roots", disk.path, "--retry_s", 0.05, "--retry_most_s", 0.2, "--max_attempts", 1)
    service.start()
    disk.fill()
    job = service.submit(sphere(300, output={"directory": str(disk.path / "film"), "preview": False}))
    wait_until(lambda: len(service.job(job)["attempts"]) > 2, "attempts")
    assert "storage_full" in service.get(f"/v1/jobs/{job}/attempts").json["attempts"][0]["reason"]
    other = service.submit(sphere(301, output={"directory": str(disk.path / "other"), "preview": False}))
    wait_until(lambda: len(service.job(other)["attempts"]) > 1, "attempts")
    assert service.post(f"/v1/jobs/{other}/cancel").status in (200, 202)
    service.wait_state(other, "cancelled")
    assert not list((service.state / "attempts").glob(f"{other}.*/report.json"))
    disk.empty()
    service.wait_state(job, "succeeded")
    assert {p.name for p in (disk.path / "film").iterdir()} == {"points.ply", "report.json"}
    listed = service.get(f"/v1/jobs/{job}/results").json["results"]
    for item in listed:
        assert (disk.path / "film" / item["name"]).read_bytes() == service.get(item["href"]).body
    assert len(re.findall(f"attempt started job={job}", service.log.read_text())) == 1
    assert not list((service.state / "attempts").glob(f"{job}.*"))


@pytest.mark.sanitized
def test_a_full_output_disk_ends_a_job_at_last(new_disk, new_service):
    disk = new_disk(2)
    service = new_service("--output_roots", disk.path, "--retry_s", 0.05, "--storage_retries", 1).start()
    disk.fill()
    job = service.submit(sphere(300, output={"directory": str(disk.path / "film"), "preview": False}))
    ended = service.wait_state(job, "failed")
    assert ended["error"]["code"] == "storage_full" and "output.directory" in ended["error"]["message"]
    assert len(ended["attempts"]) == 2 and not list((service.state / "attempts").glob("*/report.json"))


@pytest.mark.parametrize("steps", [5, pytest.param(12, marks=pytest.mark.extended)])
def test_every_output_says_that_the_disk_is_full(new_disk, worker, steps):
    """Wherever in its way the worker runs out of room."""
    disk = new_disk(8)
    everything = {"mesh": True, "points_vdb": True, "convergence": True,
                  "preview": {"size": [64, 64], "turntable": 2}, "ply": {"precision": "double"}}
    whole = worker(sphere(300, output=everything), output=str(disk.path / "whole"))
    assert whole.returncode == 0, whole.stderr
    needed = sum(-(-p.stat().st_size // 4096) * 4096 for p in (disk.path / "whole").iterdir())  # in pages of the disk
    subprocess.run(["rm", "-r", disk.path / "whole"], check=True)
    ends = []
    for leave in [0, 8192] + [round(needed * part / steps / 4096) * 4096 for part in range(1, steps + 2)]:
        disk.fill(leave)
        done = worker(sphere(300, output=everything), output=str(disk.path / "out"))
        ends.append(done.returncode)
        if done.returncode != 0:
            assert done.returncode == 7 and last_words(done)["code"] == "storage_full", (leave, done.stderr)
            assert not (disk.path / "out" / "report.json").exists()
        subprocess.run(["rm", "-rf", disk.path / "out"], check=True)
        disk.empty()
    assert ends.count(7) >= steps and ends[-1] == 0, ends


def test_what_is_set_aside_is_there_again_after_a_stop(new_disk, new_service):
    """And is never read as the log of another database."""
    disk = new_disk(32)
    service = service_on(disk, new_service, "--free_space_mb", 0, "--reserve_mb", 4)
    jobs = [service.submit(small(seed)) for seed in range(3)]
    for job in jobs:
        service.wait_state(job, "succeeded")
    service.end()
    reserve, log = service.state / "reserve", service.state / "queue.db-wal"
    assert not log.exists() and reserve.stat().st_blocks * 512 >= 4 * MIB
    before = (service.state / "queue.db").read_bytes()
    service.start()
    assert os.path.samefile(reserve, log) and reserve.stat().st_blocks * 512 >= 4 * MIB
    assert service.request("DELETE", f"/v1/jobs/{jobs[0]}").status == 204
    service.end()
    (service.state / "queue.db").write_bytes(before)  # a backup, put back
    service.start()
    assert set(states(service)) == set(jobs)
    service.end(signal.SIGKILL)
    log.unlink()
    reserve.unlink()
    service.start()
    assert os.path.samefile(reserve, log) and set(states(service)) == set(jobs)


FRAME_BYTES = 24 + 4096  # in the log of the database
MANY_FRAMES = 4100  # from 4000 on a change waits for the readers of the log
RESERVED_BYTES = (5 + 16) * MIB  # of reserve_mb = 16, with what the log usually takes


@pytest.mark.extended
def test_a_log_that_cannot_be_written_back_grows_no_further_than_its_reserve(new_disk, new_service):
    """The database would grow, and the disk is full. What was acknowledged is there; when the disk has room, all goes on."""
    disk = new_disk(64)
    floor = 30 * MIB
    service = service_on(disk, new_service, "--free_space_mb", floor // MIB, "--reserve_mb", RESERVED_BYTES // MIB - 5)
    disk.fill(floor - MIB)  # no job starts
    jobs = [service.submit(small(seed)) for seed in range(20)]
    disk.fill()
    log, known, refused = service.state / "queue.db-wal", dict.fromkeys(jobs, 0), None
    connection = service.connection()

    def change(priority):
        """Of all jobs; the answer that refuses it, if there is one."""
        for job in jobs:
            connection.request("PATCH", f"/v1/jobs/{job}", json.dumps({"priority": priority}), {"Content-Type": "application/json"})
            reply = connection.getresponse()
            document = json.loads(reply.read())
            if reply.status != 200:
                return reply, document
            known[job] = priority
        return None

    priority = 0
    while not refused:
        priority = priority % 1000 + 1
        refused = change(priority)
        assert log.stat().st_size <= RESERVED_BYTES
    assert log.stat().st_size > MANY_FRAMES * FRAME_BYTES
    assert refused[0].status == 507 and refused[1]["code"] == "storage_full"
    assert {job: document["priority"] for job, document in states(service).items()} == known
    connection.close()
    service.end(signal.SIGKILL)
    service.start()
    assert {job: document["priority"] for job, document in states(service).items()} == known

    os.truncate(disk.ballast, disk.ballast.stat().st_size - floor + MIB)
    connection = service.connection()
    for priority in range(1, 120):
        assert change(priority) is None
    assert log.stat().st_size <= RESERVED_BYTES + 10 * MIB  # it has begun anew: these changes have 20 MiB of frames and more
    connection.close()
    disk.empty()
    for job in jobs:
        service.wait_state(job, "succeeded")


def test_no_room_is_set_aside_where_none_is_wanted(new_service):
    service = new_service("--reserve_mb", 0).start()
    assert not (service.state / "reserve").exists()
    assert json.loads(service.get("/readyz").body)["status"] == "ok"

