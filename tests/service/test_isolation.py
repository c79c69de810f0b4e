"""What one user can learn of another, or do to another, through the cache and through output directories."""
import hashlib
import json
import os
import sqlite3

import pytest

from service import OPEN_TCP, sphere, wait_until
from test_access import new_token, with_token

USERS = ("ann", "ben")


class Users:
    """A service on a port, and requests of two users who may submit."""

    def __init__(self, service):
        self.service = service
        service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
        service.state.mkdir(mode=0o700)
        self.tokens = {user: new_token(service, user, "--scopes", "read,submit,cancel") for user in USERS}
        self.tokens["root"] = new_token(service, "root", "--scopes", "admin")

    def ask(self, user, method, path, document=None):
        return with_token(self.service, self.tokens[user], method, path, document)

    def submit(self, user, spec):
        reply = self.ask(user, "POST", "/v1/jobs", spec)
        assert reply.status == 201, reply.body
        return reply.json["id"]

    def wait(self, user, job, *states):
        return wait_until(lambda: (lambda j: j if j["state"] in states else None)(self.ask(user, "GET", f"/v1/jobs/{job}").json),
                          f"{job} to be {states}")

    def run(self, user, spec, state="succeeded"):
        return self.wait(user, self.submit(user, spec), state)

    def results(self, user, job):
        """name -> content of the files of a result, each held against its listing and its ETag."""
        found = {}
        for item in self.ask(user, "GET", f"/v1/jobs/{job}/results").json["results"]:
            reply = self.ask(user, "GET", item["href"])
            found[item["name"]] = reply.body
            digest = hashlib.sha256(reply.body).hexdigest()
            assert (item["sha256"], item["bytes"], reply.headers["ETag"]) == (digest, len(reply.body), f'"{digest}"')
        return found


@pytest.fixture
def users(new_service):
    return lambda *options: Users(new_service(*options))


def some(name=None, labels=(), **output):
    """A small job with the given data of its owner."""
    spec = sphere(count=60, queue={"labels": list(labels)}, output={"preview": False, **output})
    return {**spec, "name": name} if name else spec


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
    assert second["cached_from"] == first["id"]
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
