# SPDX-License-Identifier: Apache-2.0
"""Results that meet a bound: what was delivered goes, the oldest first; nothing else does, and jobs wait or are refused.

HEXAD_BOUNDS_JOBS and HEXAD_BOUNDS_MIB set the size of the last test (make check-bounds: 5 000 jobs on 200 MiB).
"""
import collections
import hashlib
import os
import re
import shutil

import pytest

from commands import control
from disks import MIB, figure, service_on, small
from service import expect_problem, sphere, wait_until

JOBS = int(os.environ.get("HEXAD_BOUNDS_JOBS", 14))
DISK_MIB = int(os.environ.get("HEXAD_BOUNDS_MIB", 16))


def fetch(service, job, query=""):
    """Every file of a result, held against its hash."""
    for one in service.get(f"/v1/jobs/{job}/results{query}").json["results"]:
        got = service.get(one["href"])
        assert got.status == 200 and hashlib.sha256(got.body).hexdigest() == one["sha256"]


def gone(service, job):
    return service.get(f"/v1/jobs/{job}").status == 404 and not (service.state / "results" / job).exists()


def test_only_what_was_fetched_makes_room(new_service):
    service = new_service("--results_count", 3, "--workers", 1).start()
    jobs = [service.submit(small(seed)) for seed in range(4)]
    for job in jobs[:3]:
        service.wait_state(job, "succeeded")
    refused = service.post("/v1/jobs", small(9))
    expect_problem(refused, 507, "results_full")
    assert refused.headers["Retry-After"] and "results_count" in refused.json["detail"]
    ready = service.get("/readyz")
    assert ready.status == 503 and "results_full" in ready.json["detail"] and ready.json["checks"]["results"] == "full"
    assert figure(service, "hexad_results") == 3 and figure(service, "hexad_results_full") == 1
    assert service.job(jobs[3])["state"] == "queued"

    # none of this is the whole result, sent to its owner
    listed = service.get(f"/v1/jobs/{jobs[1]}/results").json["results"]
    for one in listed[1:]:
        assert service.get(one["href"]).status == 200
    assert service.request("HEAD", listed[0]["href"]).status == 200
    assert service.request("GET", listed[0]["href"], headers={"Range": "bytes=0-0"}).status == 206
    fetch(service, jobs[2])
    wait_until(lambda: gone(service, jobs[2]), "room")
    service.wait_state(jobs[3], "succeeded")
    assert service.job(jobs[1])["state"] == "succeeded"

    assert service.get(listed[0]["href"]).status == 200  # the last file
    wait_until(lambda: gone(service, jobs[1]), "room")
    assert service.get("/readyz").status == 200
    wait_until(lambda: figure(service, "hexad_jobs_evicted_total") == 2, "the count")
    service.wait_state(service.submit(small(9)), "succeeded")
    assert {job["id"] for job in service.get("/v1/jobs").json["jobs"]} >= {jobs[0], jobs[3]}


def test_what_was_copied_makes_room(new_service, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    service = new_service("--results_count", 2, "--workers", 1, "--output_roots", out).start()
    for seed in range(6):
        spec = small(seed)
        spec["output"]["directory"] = str(out / str(seed))
        last = service.submit(spec)
    service.wait_state(last, "succeeded")
    wait_until(lambda: figure(service, "hexad_results") < 2, "room")
    assert all((out / str(seed) / "report.json").exists() for seed in range(6))


def test_what_is_deleted_makes_room(new_service):
    service = new_service("--results_count", 1, "--workers", 1).start()
    first, second, third = (service.submit(small(seed)) for seed in range(3))
    service.wait_state(first, "succeeded")
    assert service.request("DELETE", f"/v1/jobs/{first}").status == 204
    service.wait_state(second, "succeeded")
    edited = service.request("PATCH", f"/v1/jobs/{second}", '{"retention_s": 1}', {"Content-Type": "application/json"})
    assert edited.status == 200
    service.wait_state(third, "succeeded")
    assert gone(service, second)


@pytest.mark.sanitized
def test_each_user_has_a_bound(farm):
    shared = farm("--user_results_count", 1)
    first, second = shared.submit("ann"), shared.submit("ann")
    assert shared.running() == ("ann", first)
    bobs = shared.submit("bob")
    assert shared.next() == ("bob", bobs)  # hers waits: there is a result of hers
    refused = shared.ask("ann", "POST", "/v1/jobs", sphere())
    expect_problem(refused, 507, "results_full")
    assert "ann" in refused.json["detail"] and "user_results_count" in refused.json["detail"]
    usage = shared.ask("eve", "GET", "/v1/usage").json
    assert [(u["user"], u["results"], u["results_limit"]) for u in usage["users"]] == [("ann", 1, 1)]
    for user in ("admin", "ann"):  # that an administrator has it is no delivery
        assert shared.ask("bob", "GET", f"/v1/jobs/{second}").json["state"] == "queued"
        for one in shared.ask(user, "GET", f"/v1/jobs/{first}/results").json["results"]:
            assert shared.ask(user, "GET", one["href"]).status == 200
    shared.service.open_gate(bobs)
    wait_until(lambda: shared.ask("admin", "GET", f"/v1/jobs/{second}").json["state"] == "running", "her turn")
    assert shared.ask("ann", "GET", f"/v1/jobs/{first}").status == 404


@pytest.mark.sanitized
def test_the_client_tells_the_usage(new_service):
    service = new_service("--results_mb", 3)
    at = service.options.index("--listen")
    del service.options[at:at + 2]
    service.start()
    service.wait_state(service.submit(small(1)), "succeeded")
    code, out, _ = control(service, "usage")
    assert code == 0 and "of 3.0" in out.splitlines()[1] and len(out.splitlines()) == 3
    # uploads: of all users and of the caller, whose last result is deleted
    content = bytes(3 << 20)
    assert service.request("PUT", f"/v1/inputs/{hashlib.sha256(content).hexdigest()}", content).status == 201
    service.request("DELETE", f"/v1/jobs/{service.get('/v1/jobs').json['jobs'][0]['id']}")
    code, out, _ = control(service, "usage")
    title, whole, own = (re.split(r" {2,}", line.strip()) for line in out.splitlines())
    assert title == ["MIB", "RESULTS", "UPLOAD_MIB", "USER"]
    assert whole[2].startswith("3.0 of ") and own[2].startswith("3.0 of ") and own[1] == "0"


@pytest.mark.sanitized
def test_a_fetch_of_what_is_there_is_a_delivery(new_service, tmp_path):
    """Files of an earlier fetch, of which the service knows nothing after a restart, are not downloaded again."""
    service = new_service("--results_count", 1, "--workers", 1)
    at = service.options.index("--listen")
    del service.options[at:at + 2]
    service.start()
    job = service.submit(small(1))
    service.wait_state(job, "succeeded")
    shutil.copytree(service.state / "results" / job, tmp_path / "out")
    assert control(service, "fetch", job, "--output", tmp_path / "out")[0] == 0
    wait_until(lambda: gone(service, job), "room")


def test_many_jobs_on_a_small_disk(new_disk, new_service):
    """Their results together are larger than the disk; each is fetched, and none is lost."""
    disk = new_disk(DISK_MIB)
    service = service_on(disk, new_service, "--results_mb", DISK_MIB // 2, "--free_space_mb", DISK_MIB // 8,
                         "--reserve_mb", 1, "--cache", 0)
    # few large results, or many small ones
    most_waiting, count = (30, 1500) if JOBS >= 100 else (4, 6000)
    spec = sphere(count, output={"preview": False, "ply": {"format": "ascii", "precision": "double"}})
    waiting, fetched, sent, least = collections.deque(), 0, 0, disk.free()
    while fetched < JOBS:
        while sent < JOBS and len(waiting) < most_waiting:
            spec["solver"] = {"seed": sent + 1, "max_sweeps": 1}
            waiting.append(service.submit(spec))
            sent += 1
        service.wait_state(waiting[0], "succeeded")
        fetch(service, waiting.popleft())
        fetched += 1
        least = min(least, disk.free())
    kept = figure(service, "hexad_results_size_bytes")
    wait_until(lambda: figure(service, "hexad_results_size_bytes") < figure(service, "hexad_results_limit_bytes"), "room")
    evicted = figure(service, "hexad_jobs_evicted_total")
    assert evicted > 0 and least > 0 and service.get("/readyz").status == 200
    print(f"{fetched} jobs on {DISK_MIB} MiB: {evicted:.0f} were deleted to make room, {kept / MIB:.1f} MiB are kept, "
          f"{least / MIB:.1f} MiB were free at least")
