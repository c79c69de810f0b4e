# SPDX-License-Identifier: Apache-2.0
"""The soak test: a short run without timing, an interrupted run, and the verdicts on figures with a known fault.

`measurements/reliability/soak.py` runs for an hour by default."""
import json
import pathlib
import signal
import subprocess
import sys

import pytest

MEASUREMENTS = pathlib.Path(__file__).resolve().parents[2] / "measurements"
sys.path[:0] = [str(MEASUREMENTS / "reliability"), str(MEASUREMENTS / "common")]

import results  # noqa: E402
import verdicts  # noqa: E402

pytestmark = pytest.mark.extended  # measuring programs, not the service

MINUTES = 0.2  # 50 jobs, so that each kind of measurements/reliability/soak.py is submitted at least twice


def words(source, build, where, *more):
    return [sys.executable, "-B", source / "measurements/reliability/soak.py", "--built", build, "--output", where / "soak.csv", "--figures",
            where / "soak.json", "--minutes", str(MINUTES), *more]


def test_a_short_load_leaves_nothing_behind(source, build, tmp_path):
    done = subprocess.run(words(source, build, tmp_path, "--untimed"), capture_output=True, text=True)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    told = json.loads((tmp_path / "soak.json").read_text())
    assert told["whole"] and len(told["parts"]) == 10 and not told["faults"]
    assert all(v["met"] is not False for v in told["verdicts"])
    judged = {v["text"].split(",")[0] for v in told["verdicts"] if v["met"]}
    wanted = {"Open descriptors at the end", "Threads at the end",
              "Growth of the daemon's private memory after the first tenth"}
    assert wanted <= judged
    assert told["parts"][-1]["held"] >= round(10000 * MINUTES / 60)
    assert sum(p["jobs"] for p in told["parts"]) > 200 * MINUTES
    rows = results.read(tmp_path / "soak.csv")
    assert [row["outcome"] in ("met", "not judged") for row in rows if row["bound"]] == [True] * len(told["verdicts"])
    tenths = results.read(tmp_path / "soak_tenths.csv")
    assert [row["tenth"] for row in tenths] == [str(n) for n in range(1, 11)]
    assert all(float(value) >= 0 for row in tenths for value in row.values())


def test_a_run_that_is_broken_off_prints_what_it_has(source, build, tmp_path):
    with subprocess.Popen(words(source, build, tmp_path), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as run:
        assert run.stdout.readline().startswith("tenth 1: ")
        run.send_signal(signal.SIGINT)
        out, err = run.communicate()
    assert run.returncode == 2 and "broken off" in out and "tenth, jobs_ended, " in out, out + err
    assert json.loads((tmp_path / "soak.json").read_text())["whole"] is False
    assert not (tmp_path / "soak.csv").exists()


def parts(jobs=1440, waiting=1000):
    """Of a run of an hour in which nothing grows but the queue."""
    part = {"jobs": jobs, "followers": 600, "cpu_s": 14.0, "cpu_ms_a_job": 9.7, "yardstick_ms": 4.0, "cost": 2.4, "rss_mb": 30.0,
            "anonymous_mb": 20.0, "descriptors": 20, "threads": 41, "database_mb": 8.0}
    part |= {f"{what}_{which}_ms": ms for what in ("submit", "status", "list") for which, ms in (("p50", 1.0), ("p99", 8.0))}
    return [{**part, "held": waiting * (i + 1), "stored": (waiting + jobs) * (i + 1), "events": 9000 * (i + 1)}
            for i in range(10)]


def missed(run, answers=None, faults=(), timed=True):
    return [v.text for v in verdicts.judge(run, answers or {200: 5}, list(faults), timed, 10000) if v.met is False]


def with_growth(key, per_job):
    run = parts()
    for part in run:
        part[key] = type(part[key])(part[key] + per_job * part["stored"])
    return run


@pytest.mark.parametrize("key, per_job, text", [
    ("descriptors", 1 / 100, "Open descriptors"), ("threads", 1 / 100, "Threads"),
    ("anonymous_mb", 1024 / 2**20, "Growth of the daemon's private memory"),
    ("cost", 2.4 / 20000, "CPU time"), ("list_p50_ms", 1 / 2000, "Time of an answer to list, median"),
    ("status_p99_ms", 8 / 1000, "Time of an answer to status, 99th"), ("submit_p99_ms", 8 / 1000, "Time of an answer to submit, 99th")])
def test_the_judges_see_what_grows_with_the_jobs(key, per_job, text):
    found = missed(with_growth(key, per_job))
    assert found and all(f.startswith(text) for f in found)


def test_the_judges_see_failures():
    assert missed(parts()) == []
    assert missed(parts(), {200: 5, 503: 1})[0].startswith("Answers")
    assert missed(parts(), faults=["lost"])[0].startswith("Jobs with an unexpected end")
    short = parts()
    short[-1]["held"] = 9000
    assert missed(short)[0].startswith("Waiting jobs")
    assert missed(with_growth("cost", 1), timed=False) == []
    assert missed(parts()[:2], {500: 1})[0].startswith("Answers")
