# SPDX-License-Identifier: Apache-2.0
"""queue.chunk: consecutive frames of an array run one after another. Slurm is in test_slurm.py."""
import collections
import json
import os
import signal

import pytest

from service import gated_worker, sphere, wait_until


def array(count, chunk, **parts):
    """Equal small spheres, apart from their seeds."""
    queue = {"frames": f"1-{count}", "chunk": chunk, "by_frame": {"/solver/seed": list(range(1, count + 1))}}
    return sphere(60, **{**parts, "output": {"preview": False}, "queue": {**queue, **parts.get("queue", {})}})


def events(service, job):
    """(type, frame) of the attempts of the job, oldest first."""
    found, after = [], 0
    while after is not None:
        page = service.get(f"/v1/jobs/{job}/events?after={after}&limit=500").json
        found += [(e["type"], e["frame"]) for e in page["events"] if e["type"] in ("started", "ended")]
        after = page["next"]
    return found


def check_chunks(told, chunk, workers):
    """No two frames of a chunk run at the same time, and their order is that of the frames. No chunk begins while another
    one could go on."""
    running, started = {}, collections.defaultdict(list)
    for kind, frame in told:
        number = (frame - 1) // chunk
        if kind == "started":
            assert number not in running, told
            started[number].append(frame)
            assert sum(len(frames) < chunk or n in running for n, frames in started.items()) <= workers, told
            running[number] = frame
        else:
            assert running.pop(number) == frame, told
    for number, frames in started.items():
        assert frames == list(range(number * chunk + 1, (number + 1) * chunk + 1)), told


def running(service, job):
    return [t["frame"] for t in service.get(f"/v1/jobs/{job}/tasks?limit=500").json["tasks"] if t["state"] == "running"]


def wait_running(service, job, *frames):
    wait_until(lambda: running(service, job) == list(frames), f"frames {frames} to run")


def attempts_of(service, job):
    """Of each frame: how its attempts have ended."""
    found = collections.defaultdict(list)
    for attempt in service.get(f"/v1/jobs/{job}/attempts?limit=500").json["attempts"]:
        found[attempt["frame"]].append(attempt.get("signal", attempt.get("exit_status")))
    return found


@pytest.mark.parametrize("count, chunk, workers", [(16, 4, 2), pytest.param(60, 6, 4, marks=pytest.mark.extended)])
def test_frames_of_a_chunk_run_in_order_and_one_at_a_time(new_service, count, chunk, workers):
    service = new_service("--workers", workers, "--threads", workers).start()
    job = service.submit(array(count, chunk))
    assert service.wait_state(job, "succeeded")["spec"]["queue"]["chunk"] == chunk
    check_chunks(events(service, job), chunk, workers)
    tasks = service.get(f"/v1/jobs/{job}/tasks?limit=500").json["tasks"]
    assert [t["frame"] for t in tasks] == list(range(1, count + 1))


def test_a_killed_worker_costs_its_frame_only(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 2, "--threads", 2, "--retry_s", "0.01",
                          base=tmp_path).start()
    job = service.submit(array(8, 4))
    wait_running(service, job, 1, 5)
    service.open_gate(f"{job}.1")
    wait_running(service, job, 2, 5)
    (worker,) = wait_until(lambda: [p for p in service.workers_of(f"{job}.2")], "the worker of frame 2")
    os.kill(worker, signal.SIGKILL)
    wait_until(lambda: attempts_of(service, job)[2][:1] == [signal.SIGKILL], "its end")
    for frame in range(2, 9):
        service.open_gate(f"{job}.{frame}")
    done = service.wait_state(job, "succeeded")
    assert done["tasks"]["succeeded"] == 8
    assert {frame: len(ends) for frame, ends in attempts_of(service, job).items()} == {f: 1 + (f == 2) for f in range(1, 9)}


def test_a_killed_daemon_runs_frames_without_a_result_again(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 2, "--threads", 2, base=tmp_path).start()
    job = service.submit(array(8, 4))
    service.open_gate(f"{job}.1")
    wait_running(service, job, 2, 5)
    service.end(signal.SIGKILL)
    service.start()
    wait_running(service, job, 2, 5)
    for frame in range(2, 9):
        service.open_gate(f"{job}.{frame}")
    service.wait_state(job, "succeeded")
    assert {f: len(ends) for f, ends in attempts_of(service, job).items()} == {f: 1 + (f in (2, 5)) for f in range(1, 9)}
    assert sorted(p.name for p in (service.state / "results").iterdir()) == [f"{job}.{frame}" for frame in range(1, 9)]


def test_max_running_bounds_the_chunks(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 4, "--threads", 4, base=tmp_path).start()
    job = service.submit(array(8, 2, queue={"max_running": 2}))
    later = service.submit(sphere())
    service.wait_state(later, "running")
    assert running(service, job) == [1, 3]
    changed = service.request("PATCH", f"/v1/jobs/{job}", json.dumps({"max_running": 0}), {"Content-Type": "application/json"})
    assert changed.status == 200, changed.body
    wait_running(service, job, 1, 3, 5)  # the fourth worker has the later job
    service.open_gate(later)
    wait_running(service, job, 1, 3, 5, 7)


def test_an_urgent_job_waits_for_one_frame(new_service, tmp_path):
    service = new_service("--worker", gated_worker(tmp_path), "--workers", 1, base=tmp_path).start()
    job = service.submit(array(3, 3))
    wait_running(service, job, 1)
    urgent = service.submit(sphere(queue={"priority": 1}))
    service.open_gate(f"{job}.1")
    service.wait_state(urgent, "running")
    assert running(service, job) == []
    service.open_gate(urgent)
    wait_running(service, job, 2)


def test_a_chunk_is_refused_where_it_has_no_effect(new_service):
    service = new_service().start()
    coherent = {"frames": "1-2", "chunk": 2, "coherent": True, "by_frame": {"/solver/seed": [1, 2]}}
    for queue, words in (({"chunk": 2}, "requires queue.frames"), (coherent, "excludes queue.coherent")):
        refused = service.post("/v1/jobs", sphere(queue=queue))
        assert refused.status == 422, refused.body
        (fault,) = refused.json["errors"]
        assert fault["pointer"] == "/queue/chunk" and words in fault["detail"]
    assert service.post("/v1/jobs", sphere(queue={"chunk": 1})).status == 201
