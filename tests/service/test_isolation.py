# SPDX-License-Identifier: Apache-2.0
"""What one user can learn of another, or do to another, through the cache and through output directories."""
import hashlib
import json
import os
import pathlib
import re
import sqlite3
import struct
import subprocess
import sys
import tempfile
import time

import pytest

from accounts import some
from service import PATIENCE_S, gated_worker, sphere, wait_until


def secret(tmp_path):
    """A job whose own data are all to be recognised."""
    spec = some("marker-name", ["marker-label"], directory=f"{tmp_path}/marker-directory")
    spec["queue"]["webhook"] = "http://127.0.0.1:9/?key=marker-key"
    return spec


def secretive(users, tmp_path):
    (tmp_path / "secret").write_text("0" * 64)
    (tmp_path / "secret").chmod(0o600)
    made = users("--output_roots", tmp_path, "--webhook_hosts", "127.0.0.1:9", "--webhook_tries", 1,
                 "--webhook_secret_file", tmp_path / "secret")
    made.service.start()
    return made


@pytest.mark.sanitized
def test_a_cache_hit_has_no_data_of_the_other_job(users, tmp_path):
    both = secretive(users, tmp_path)
    first = both.run("ann", secret(tmp_path))
    second = both.run("ben", some("other-name"))
    assert both.ask("root", "GET", f"/v1/jobs/{second['id']}").json["cached_from"] == first["id"]
    hers, his = both.results("ann", first["id"]), both.results("ben", second["id"])
    assert b"marker-key" in hers["report.json"] and b"marker" not in his["report.json"]
    assert hers["points.ply"] == his["points.ply"]
    report = json.loads(his["report.json"])
    assert report["spec"] == second["spec"] and report["spec"]["name"] == "other-name"
    assert {**report, "spec": None} == {**json.loads(hers["report.json"]), "spec": None}
    part = both.service.request("GET", f"/v1/jobs/{second['id']}/results/report.json",
                                headers={"Authorization": f"Bearer {both.tokens['ben']}", "Range": "bytes=3-40"})
    assert part.status == 206 and part.body == his["report.json"][3:41]


def link_reports(users, first, second):
    """Leaves what earlier versions did: one report for both jobs."""
    results = users.service.state / "results"
    (results / second / "report.json").unlink()
    os.link(results / first / "report.json", results / second / "report.json")
    for listing in results.glob("*/.listing.json"):
        listing.unlink()


def test_a_start_after_an_upgrade_separates_the_reports_of_equal_jobs(users, tmp_path):
    both = secretive(users, tmp_path)
    first = both.run("ann", secret(tmp_path))
    second = both.run("ben", some("other-name"))
    both.service.end()
    link_reports(both, first["id"], second["id"])
    with sqlite3.connect(both.service.state / "queue.db") as database:
        database.execute("UPDATE service SET linked_reports = 1")
    database.close()
    both.service.start()
    assert b"marker-key" in both.results("ann", first["id"])["report.json"]
    mine = both.results("ben", second["id"])["report.json"]
    assert b"marker" not in mine and json.loads(mine)["spec"] == second["spec"]
    both.service.end()
    before = mine, (both.service.state / "results" / second["id"] / "report.json").stat().st_mtime_ns
    both.service.start()
    report = both.service.state / "results" / second["id"] / "report.json"
    assert (report.read_bytes(), report.stat().st_mtime_ns) == before  # once is enough
    assert "have their own now" not in both.service.log.read_text()


def test_results_that_share_files_are_adopted_without_data_of_a_job(users, tmp_path):
    both = secretive(users, tmp_path)
    first = both.run("ann", secret(tmp_path))
    second = both.run("ben", some("other-name"))
    alone = both.run("ann", {**some("alone", ["mine"]), "sampling": {"count": 61}})
    both.service.end()
    link_reports(both, first["id"], second["id"])
    for path in both.service.state.glob("queue.db*"):
        path.unlink()
    both.service.start("--adopt")
    jobs = {job["id"]: job for job in both.ask("root", "GET", "/v1/jobs").json["jobs"]}
    assert (jobs[alone["id"]]["name"], jobs[alone["id"]]["labels"]) == ("alone", ["mine"])
    for job in (first["id"], second["id"]):
        whole = both.ask("root", "GET", f"/v1/jobs/{job}")
        assert b"marker" not in whole.body and whole.json["name"] is None and whole.json["labels"] == []
        assert whole.json["spec"]["sampling"] == first["spec"]["sampling"]


# ---- files that change while a job runs

TETRAHEDRON = "OFF\n4 4 0\n1 1 1\n1 -1 -1\n-1 1 -1\n-1 -1 1\n3 0 1 2\n3 0 3 1\n3 0 2 3\n3 1 3 2\n"
# runs the real worker, then switches the link to the other file, before the daemon sees the end
SWITCHING_WORKER = """#!/bin/sh
%s/hexad-worker "$@"
status=$?
case "$1" in run) ln -sfn b.off %s/a.link && mv -T %s/a.link %s/a.off;; esac
exit $status
"""


@pytest.fixture(scope="module", autouse=True)
def two_meshes(tmp_path_factory):
    """Made at the beginning: the cache trusts no file that has just changed."""
    where = tmp_path_factory.mktemp("meshes")
    (where / "first.off").write_text(TETRAHEDRON)
    (where / "b.off").write_text(TETRAHEDRON.replace("1 1 1", "2 2 2"))
    (where / "a.off").symlink_to("first.off")
    return where


def test_the_cache_does_not_take_one_file_for_another_that_a_link_names_later(new_service, build, tmp_path, two_meshes):
    wait_until(lambda: time.time() - (two_meshes / "b.off").stat().st_ctime > 3, "the files to be older than the clocks' doubt")
    worker = tmp_path / "worker"
    worker.write_text(SWITCHING_WORKER % (build, two_meshes, two_meshes, two_meshes))
    worker.chmod(0o700)
    service = new_service("--input_roots", two_meshes, "--worker", worker).start()
    spec = {"version": 1, "surface": {"mesh": {"path": str(two_meshes / "a.off")}}, "sampling": {"count": 100},
            "output": {"preview": False}}
    reports = []
    for _ in range(3):
        done = service.wait_state(service.submit(spec), "succeeded")
        reports.append(service.get(f"/v1/jobs/{done['id']}/results/report.json").json)
    hashes = [hashlib.sha256((two_meshes / name).read_bytes()).hexdigest() for name in ("first.off", "b.off")]
    assert [r["inputs"][0]["sha256"] for r in reports] == [hashes[0], hashes[1], hashes[1]]
    assert done["cached_from"] is not None  # what did not change is cached


# ---- output directories

def delivered(path):
    """The report in a directory; the files that it lists have the lengths and hashes that it names."""
    report = json.loads((path / "report.json").read_text())
    for item in report["outputs"]:
        content = (path / item["name"]).read_bytes()
        assert (len(content), hashlib.sha256(content).hexdigest()) == (item["bytes"], item["sha256"])
    return report


def numbered(seed, directory):
    return {**some(directory=str(directory)), "solver": {"seed": seed}}


def test_jobs_with_one_output_directory_deliver_one_after_the_other(users, tmp_path):
    show = tmp_path / "show"
    show.mkdir()
    (show / "notes.txt").write_text("of the user")
    both = users("--output_roots", tmp_path, "--workers", 4)
    both.service.start()
    jobs = [both.submit("ann", numbered(seed, show)) for seed in range(8)]
    for job in jobs:
        assert both.wait("ann", job, "succeeded", "failed")["delivery"]["state"] == "delivered"
    report = delivered(show)
    assert report["spec"]["solver"]["seed"] in range(8)
    assert {p.name for p in show.iterdir()} == {"notes.txt", "points.ply", "report.json"}
    assert (show / "notes.txt").read_text() == "of the user"


def refused(reply, status, code):
    assert (reply.status, reply.json["code"]) == (status, code), reply.body
    assert reply.json["errors"][0]["pointer"] == "/output/directory"
    return reply.json["detail"]


@pytest.mark.sanitized
def test_users_have_output_roots_of_their_own(users, tmp_path):
    """%u in output_roots. The directory of a user is made; what it leads to by a link is not used."""
    (tmp_path / "out").mkdir()
    both = users("--output_roots", f"{tmp_path}/out/%u", "--workers", 1)
    both.service.start()
    mine, other = (f"{tmp_path}/out/{user}/show" for user in ("ann", "ben"))
    assert both.run("ann", some(directory=mine))["delivery"]["state"] == "delivered"
    assert delivered(tmp_path / "out/ann/show")["count"] == 60
    for path in (other, f"{tmp_path}/out/ann", f"{tmp_path}/out/show", f"{tmp_path}/out/%u/show"):
        told = refused(both.ask("ann", "POST", "/v1/jobs", some(directory=path)), 403, "path_forbidden")
        assert f"name a directory below {tmp_path}/out/ann" in told
    assert not (tmp_path / "out/ben").exists()
    (tmp_path / "out/ben").symlink_to(tmp_path / "out/ann")
    refused(both.ask("ben", "POST", "/v1/jobs", some(directory=other)), 403, "path_forbidden")


ANN, BEN = 60003, 60004
AS_USER = "import os, sys; os.setgroups([]); os.setgid(int(sys.argv[1])); os.setuid(int(sys.argv[1])); os.execvp(sys.argv[2], sys.argv[2:])"


def permit(directory, user):
    """`setfacl -m u:USER:rwx,d:u:USER:rwx DIRECTORY` for a directory of mode 0770, by acl(5): tag, permissions, id."""
    entries = ((1, 7, -1), (2, 7, user), (4, 7, -1), (0x10, 7, -1), (0x20, 0, -1))  # owner, user, group, mask, others
    value = struct.pack("<I", 2) + b"".join(struct.pack("<HHi", *entry) for entry in entries)
    for name in ("system.posix_acl_access", "system.posix_acl_default"):
        os.setxattr(directory, name, value)


def test_users_read_and_delete_results_in_directories_that_the_recipe_makes(users):
    """The recipe of operations.md: only the user of the directory, and the service, can use what is in it."""
    if os.geteuid() != 0:
        pytest.skip("only root can be other users")

    def as_user(user, *command):
        return subprocess.run([sys.executable, "-c", AS_USER, str(user), *command], capture_output=True, cwd="/").returncode == 0

    with tempfile.TemporaryDirectory() as place:
        os.chmod(place, 0o755)
        out = f"{place}/out"
        subprocess.run(["install", "-d", "-m", "0755", out], check=True)
        subprocess.run(["install", "-d", "-m", "0770", f"{out}/ann"], check=True)
        try:
            permit(f"{out}/ann", ANN)
        except OSError as why:
            pytest.skip(f"no access control lists here: {why}")
        both = users("--output_roots", f"{out}/%u", "--output_mode", "0660", "--workers", 1)
        both.service.start()
        assert both.run("ann", some(directory=f"{out}/ann/show/shot"))["delivery"]["state"] == "delivered"
        report = f"{out}/ann/show/shot/report.json"
        assert not as_user(BEN, "cat", report) and not as_user(BEN, "ls", f"{out}/ann")
        assert as_user(ANN, "cat", report) and as_user(ANN, "touch", f"{out}/ann/show/shot/notes")
        assert as_user(ANN, "rm", "-r", f"{out}/ann/show") and not os.listdir(f"{out}/ann")


def rename_user(service, token, user):
    """Of a token in the file, as earlier versions accepted it."""
    file = service.state / "tokens"
    digest = hashlib.sha256(token.encode()).hexdigest()
    lines = [re.sub(r"^(\w+) \S+", rf"\1 {user}", line) if digest in line else line for line in file.read_text().splitlines()]
    file.write_text("\n".join(lines) + "\n")


def test_users_that_are_named_like_directories_get_no_new_tokens_and_reach_no_directory_of_others(users, build, tmp_path):
    for name in (".", ".."):
        added = subprocess.run([build / "hexadctl", "token", "add", name, "--file", tmp_path / "tokens"], capture_output=True, text=True)
        assert added.returncode == 2 and f'the user name must not be "{name}"' in added.stderr and "hexad_" not in added.stdout
    out = tmp_path / "out" / "users"
    for directory in ("ann", "below"):
        (out / directory).mkdir(parents=True)
    (out.parent / "film").mkdir()
    both = users("--output_roots", f"{out}/%u")
    rename_user(both.service, both.tokens["ben"], "..")
    rename_user(both.service, both.tokens["ann"], ".")
    both.service.start()
    for user, name in (("ben", ".."), ("ann", ".")):
        job = both.run(user, some())
        assert job["owner"] == name and both.ask(user, "GET", "/v1/jobs?owner=" + name).json["jobs"][0]["id"] == job["id"]
        for path in (f"{out}/{name}/film", f"{out}/ann/film", f"{out}/{name}/ann/film", f"{out.parent}/film"):
            refused(both.ask(user, "POST", "/v1/jobs", some(directory=path)), 403, "path_forbidden")


def test_a_root_of_users_ends_in_the_name(build, tmp_path):
    for root in (f"{tmp_path}/%u/out", f"{tmp_path}/u%u"):
        done = subprocess.run([build / "hexad", "--state_dir", tmp_path / "state", "--output_roots", root],
                              capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 2 and "output_roots: %u must be the last name of a path" in done.stderr


@pytest.mark.sanitized
def test_a_directory_with_another_users_result_is_refused(users, tmp_path):
    show = tmp_path / "show"
    both = users("--output_roots", tmp_path, "--workers", 1)
    both.service.start()
    early = both.submit("ben", {**numbered(1, show), "queue": {"after": [both.submit("ann", numbered(2, show))]}})
    late = both.wait("ben", early, "succeeded", "failed")
    assert late["state"] == "succeeded" and late["delivery"]["code"] == "output_taken"
    assert delivered(show)["spec"]["solver"]["seed"] == 2
    for path in ("/v1/jobs", "/v1/jobs:validate"):
        told = refused(both.ask("ben", "POST", path, numbered(3, show)), 409, "output_taken")
        assert "share_outputs" in told and "ann" not in told
    assert both.run("ann", numbered(4, show))["delivery"] == {"state": "delivered", "code": None, "message": None}
    assert both.ask("ann", "GET", f"/v1/jobs/{early}").json["delivery"] is None  # it is not hers
    both.service.end()
    both.service.start()
    refused(both.ask("ben", "POST", "/v1/jobs", numbered(3, show)), 409, "output_taken")
    (show / "report.json").unlink()
    assert both.ask("ben", "POST", f"/v1/jobs/{early}/deliver").status == 202
    assert wait_until(lambda: both.ask("ben", "GET", f"/v1/jobs/{early}").json["delivery"]["state"] == "delivered", "the copy")
    assert delivered(show)["spec"]["solver"]["seed"] == 1
    both.service.end()
    both.service.start("--share_outputs", 1)
    assert both.run("ann", numbered(5, show))["delivery"]["state"] == "delivered"


# ---- directories that cannot be written

UNWRITABLE = "/sys/kernel"  # not even by root


def test_an_unwritable_output_root_is_told_and_jobs_for_it_are_refused(new_service, tmp_path):
    service = new_service("--output_roots", f"{UNWRITABLE}:{tmp_path}").start()
    warning = [line for line in service.log.read_text().splitlines() if " warning " in line and UNWRITABLE in line]
    assert len(warning) == 1
    ready = service.get("/readyz")
    assert ready.status == 200 and ready.json["checks"]["outputs"] == "unwritable"
    told = refused(service.post("/v1/jobs", some(directory=f"{UNWRITABLE}/hexad/film")), 422, "output_unwritable")
    assert "ReadWritePaths" in told
    if os.statvfs(UNWRITABLE).f_flag & os.ST_RDONLY:  # otherwise the kernel refuses by permissions
        assert f"`systemctl edit hexad.service` as root, add the lines [Service] and ReadWritePaths={UNWRITABLE}, and" in told
    service.wait_state(service.submit(some(directory=f"{tmp_path}/a/b")), "succeeded")
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["b"] and delivered(tmp_path / "a" / "b")


def test_a_parent_of_user_directories_need_not_be_writable(new_service, tmp_path):
    """With %u in a root, hexad writes to the directories of users only. The refusal has the commands that make one."""
    service = new_service("--output_roots", f"{tmp_path}:{UNWRITABLE}/%u").start()
    assert service.get("/readyz").json["checks"]["outputs"] == "ok"
    assert UNWRITABLE not in service.log.read_text()
    user = "anyone"
    own = f"{UNWRITABLE}/{user}"
    told = refused(service.post("/v1/jobs", some(directory=f"{own}/film")), 422, "output_unwritable")
    assert re.search(f"{own} does not exist, .* Run as root: install -d -o [^ ]+ -g [^ ]+ -m 0770 {own} && setfacl -m u:{user}:rwx,d:u:{user}:rwx {own} ",
                     told), told
    assert "chgrp" not in told and "output_mode = 0660" in told


def test_writable_output_roots_are_ready(new_service, tmp_path):
    service = new_service("--output_roots", tmp_path).start()
    assert service.get("/readyz").json["checks"]["outputs"] == "ok"


@pytest.mark.sanitized
def test_a_result_that_cannot_be_delivered_is_kept_and_delivered_later(new_service, build, tmp_path):
    def hexadctl(*words):
        return subprocess.run([build / "hexadctl", *words], capture_output=True, text=True, timeout=PATIENCE_S,
                              env=service.environment())

    show = tmp_path / "show"
    show.mkdir()
    service = new_service("--output_roots", tmp_path, "--worker", gated_worker(tmp_path), "--workers", 1, base=tmp_path).start()
    job = service.submit(some(directory=str(show)))
    after = service.submit({**some(), "queue": {"depends_on": [job]}})
    service.wait_worker(job)
    assert service.job(job)["delivery"] is None
    show.rmdir()
    show.write_text("no directory")
    service.open_gate(job)
    done = service.wait_state(job, "succeeded")
    assert done["error"] is None and done["outcome"] == "converged"
    assert (done["delivery"]["state"], done["delivery"]["code"]) == ("failed", "path_forbidden")
    assert str(show) in done["delivery"]["message"]
    assert service.get(f"/v1/jobs/{job}/results/points.ply").body == b"x"
    service.wait_worker(after)  # it does not wait for the delivery

    again = hexadctl("wait", job)
    assert again.returncode == 0 and "not delivered" in again.stdout and str(show) in again.stdout
    listed = {line.split()[0]: line for line in hexadctl("list").stdout.splitlines()}
    assert "converged, not delivered" in listed[job] and "not delivered" not in listed[after]
    assert "\nhexad_jobs_undelivered 1\n" in service.get("/metrics").body.decode()
    again = hexadctl("deliver", job)  # it waits for the end of the copy
    assert again.returncode == 1 and f"{job} succeeded converged not delivered: " in again.stdout and str(show) in again.stdout
    assert service.job(job)["delivery"]["state"] == "failed"
    show.unlink()
    again = hexadctl("deliver", job)
    assert again.returncode == 0 and again.stdout == f"{job} succeeded converged delivered\n"
    assert service.job(job)["delivery"]["state"] == "delivered"
    assert "\nhexad_jobs_undelivered 0\n" in service.get("/metrics").body.decode()
    again = service.post(f"/v1/jobs/{job}/deliver")
    assert again.status == 202 and again.json["delivery"]["state"] == "pending"
    wait_until(lambda: service.job(job)["delivery"]["state"] == "delivered", "the copy")
    assert (show / "points.ply").read_bytes() == b"x" and (show / "report.json").is_file()
    assert service.post(f"/v1/jobs/{after}/deliver").status == 409
    assert {p.name for p in show.iterdir()} == {"points.ply", "report.json"}


def test_only_the_frames_that_were_not_delivered_are_delivered_again(new_service, tmp_path):
    service = new_service("--output_roots", tmp_path).start()
    spec = some(directory=f"{tmp_path}/film/##")
    spec["queue"] |= {"frames": "1-3", "by_frame": {"/solver/seed": [1, 2, 3]}}
    (tmp_path / "film").mkdir()
    (tmp_path / "film" / "02").write_text("no directory")
    job = service.submit(spec)
    done = service.wait_state(job, "succeeded")
    assert done["delivery"]["state"] == "failed" and "film/02" in done["delivery"]["message"]
    (tmp_path / "film" / "01" / "points.ply").unlink()
    (tmp_path / "film" / "02").unlink()
    assert service.post(f"/v1/jobs/{job}/deliver").status == 202
    wait_until(lambda: service.job(job)["delivery"]["state"] == "delivered", "the copy")
    delivered(tmp_path / "film" / "02")
    assert not (tmp_path / "film" / "01" / "points.ply").exists()
    assert service.post(f"/v1/jobs/{job}/deliver").status == 202  # now all are
    wait_until(lambda: service.job(job)["delivery"]["state"] == "delivered", "the copies")
    for frame in ("01", "02", "03"):
        delivered(tmp_path / "film" / frame)


def processor_times(service):
    """(name, id) of a thread -> its processor time in ns."""
    tasks = pathlib.Path(f"/proc/{service.process.pid}/task")
    return {((task / "comm").read_text().strip(), task.name): int((task / "schedstat").read_text().split()[0])
            for task in tasks.iterdir()}


def share_of_serving_thread(service, act, times):
    """Share of the processor time of the service for acts that the thread that serves all connections needs."""
    before = processor_times(service)
    for _ in range(times):
        act()
    after = processor_times(service)
    needed = {thread: after[thread] - before.get(thread, 0) for thread in after}
    return needed[next(thread for thread in needed if thread[0] == "serving")] / sum(needed.values())


@pytest.mark.sanitized
def test_long_documents_hold_up_no_connection(users):
    """Other threads read and write them than the one that serves all connections."""
    both, frames, parts = users(), 1000, 32
    service = both.service.start()
    assert both.ask("root", "POST", "/v1/admin/hold").status == 200
    spec = some()
    spec["surface"] = {"union": [sphere()["surface"]] * parts}
    spec["queue"] = {"frames": f"1-{frames}", "by_frame": {
        f"/surface/union/{part}/analytic/radius": [1.5] * frames for part in range(parts)}}
    job = both.submit("ann", spec)
    listing = json.dumps([{"a": 0}] * 20000)
    for act in (lambda: both.ask("ann", "GET", f"/v1/jobs/{job}"),
                lambda: service.request("POST", "/v1/session", listing, {"Content-Type": "application/json"})):
        assert share_of_serving_thread(service, act, 5) < .5
