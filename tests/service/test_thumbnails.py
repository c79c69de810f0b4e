# SPDX-License-Identifier: Apache-2.0
"""Pictures of a job: thumbnails of previews, made by another process, and the preview that hexadctl saves."""
import concurrent.futures
import pathlib
import subprocess
import sys

import numpy
import pytest

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent))
import setclock  # noqa: E402
from readers import read_png  # noqa: E402
from service import PATIENCE_S, Service, Stream, long_sphere, sphere, wait_until  # noqa: E402

SIDE = 64  # pixels of a preview: small enough to be shown as it is


@pytest.fixture(scope="module")
def made(build, tmp_path_factory):
    """A service with an array of the frames 1, 2, 3 and 5, of which 3 has no file, that has ended, and its id."""
    where = tmp_path_factory.mktemp("frames")
    for frame in (1, 2, 5):  # taller ones look different
        corners = [(1, 1, frame), (1, -1, -frame), (-1, 1, -frame), (-1, -1, frame)]
        faces = "3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"
        (where / f"a.{frame:04d}.off").write_text("OFF\n4 4 0\n" + "".join("%d %d %d\n" % c for c in corners) + faces)
    service = Service(build, tmp_path_factory.mktemp("service"), "--input_roots", where).start()
    try:
        job = service.submit({"version": 1, "surface": {"mesh": {"path": "a.####.off"}}, "sampling": {"count": 60},
                              "output": {"preview": {"size": SIDE}}, "queue": {"frames": "1-3,5"}})
        service.wait_state(job, "failed")
        yield service, job
    finally:
        service.clean_up()


def picture(data):
    wide, high, rows = read_png(data)[:3]
    return numpy.asarray(rows).reshape(high, wide, 3)


def test_small_previews_are_their_own_thumbnails(made):
    service, job = made
    for frame in (1, 2, 5):
        whole = picture(service.get(f"/v1/jobs/{job}/results/preview.png?frame={frame}").body)
        assert (picture(service.get(f"/v1/jobs/{job}/thumbnail.png?frame={frame}").body) == whole).all() and whole.shape[0] == SIDE


def test_the_removed_route_of_contact_sheets_names_another_one(made):
    service, job = made
    assert "contact_sheet" not in service.get(f"/v1/jobs/{job}").json["links"]
    reply = service.get(f"/v1/jobs/{job}/contact_sheet.png")
    assert (reply.status, reply.json["code"]) == (410, "gone") and f"/v1/jobs/{job}/thumbnail.png?frame=N" in reply.json["detail"]


def test_a_thumbnail_has_means_of_the_pixels_of_the_preview_and_may_be_cached(made):
    service, _ = made
    job = service.submit(sphere(output={"preview": {"size": 256}}))
    service.wait_state(job, "succeeded")
    path = f"/v1/jobs/{job}/thumbnail.png"
    reply = service.get(path)
    whole = picture(service.get(f"/v1/jobs/{job}/results/preview.png").body).astype(float)
    assert (reply.status, reply.headers["Content-Type"]) == (200, "image/png") and "immutable" in reply.headers["Cache-Control"]
    assert abs(picture(reply.body) - whole.reshape(128, 2, 128, 2, 3).mean(axis=(1, 3))).max() <= 0.5
    again = service.request("GET", path, headers={"If-None-Match": reply.headers["ETag"]})
    assert (again.status, again.body, again.headers["ETag"]) == (304, b"", reply.headers["ETag"])


def test_the_thumbnail_of_an_array_is_that_of_its_first_frame_with_results(made):
    service, job = made
    reply = service.get(f"/v1/jobs/{job}/thumbnail.png")
    assert reply.status == 200 and "immutable" not in reply.headers["Cache-Control"]
    assert reply.body == service.get(f"/v1/jobs/{job}/thumbnail.png?frame=1").body
    none = service.submit(long_sphere(queue={"frames": "1-2", "by_frame": {"/surface/analytic/radius": [1, 2]}}))
    service.post(f"/v1/jobs/{none}/cancel")
    service.wait_state(none, "cancelled")
    assert service.get(f"/v1/jobs/{none}/thumbnail.png").status == 404


def test_that_a_job_has_no_thumbnail_may_be_cached(made):
    service, _ = made
    job = service.submit(sphere(output={"preview": False}))
    assert service.get(f"/v1/jobs/{job}/thumbnail.png").status in (404, 409)
    service.wait_state(job, "succeeded")
    reply = service.get(f"/v1/jobs/{job}/thumbnail.png")
    assert reply.status == 404 and "immutable" in reply.headers["Cache-Control"]


def show(build, service, job, *options):
    return subprocess.run([build / "hexadctl", "--server", f"http://{service.address}", "show", job, "--picture", *options],
                          capture_output=True, text=True, timeout=PATIENCE_S)


def test_show_saves_the_preview_of_a_job_or_of_a_frame(made, build, tmp_path):
    service, array = made
    single = service.submit(sphere())
    service.wait_state(single, "succeeded")
    for job, query, options, state in ((single, "", (), "succeeded"), (array, "?frame=2", ("--frame", "2"), "failed")):
        told = show(build, service, job, tmp_path / "one.png", *options)
        assert told.returncode == 0 and state in told.stdout and str(tmp_path / "one.png") in told.stderr
        assert (tmp_path / "one.png").read_bytes() == service.get(f"/v1/jobs/{job}/results/preview.png{query}").body
    told = show(build, service, array, tmp_path / "none.png")
    assert told.returncode == 2 and "--frame" in told.stderr and not (tmp_path / "none.png").exists()


def test_a_job_without_previews_has_no_picture(made, build, tmp_path):
    service, _ = made
    plain = {"preview": False}
    array = {"version": 1, "surface": {"mesh": {"path": "a.####.off"}}, "sampling": {"count": 60}, "output": plain,
             "queue": {"frames": "1-2"}}
    for spec, options in ((sphere(output=plain), ()), (array, ("--frame", "1"))):
        job = service.submit(spec)
        service.wait_state(job, "succeeded")
        reply = service.get(f"/v1/jobs/{job}/thumbnail.png")
        assert reply.status == 404 and "preview" in reply.json["detail"]
        told = show(build, service, job, tmp_path / "none.png", *options)
        assert told.returncode == 4 and "preview.png" in told.stderr and not (tmp_path / "none.png").exists()


@pytest.mark.sanitized
@pytest.mark.parametrize("damage", [lambda data: data[:300], lambda data: b"GIF89a" + data[6:], lambda data: b""],
                         ids=["cut", "another", "empty"])
def test_a_damaged_preview_has_no_thumbnail(made, damage):
    service, job = made
    file = service.state / f"results/{job}.2/preview.png"
    kept = file.read_bytes()
    try:
        file.chmod(0o600)
        file.write_bytes(damage(kept))
        reply = service.get(f"/v1/jobs/{job}/thumbnail.png?frame=2")
    finally:
        file.write_bytes(kept)
    assert (reply.status, reply.json["code"]) == (422, "input_damaged")


# The real worker, except that it makes no thumbnail. It notes each call.
WAITING_READER = """#!/bin/sh
[ "$1" = read-picture ] && {{ echo x >>{where}/calls; exec sleep 1000000; }}
exec {worker} "$@"
"""


@pytest.fixture
def waiting(build, new_service, tmp_path):
    """A service whose clock may be set, and the request for a thumbnail, whose process never ends by itself."""
    if setclock.why_not():
        pytest.skip(setclock.why_not())
    worker = tmp_path / "waiting-reader"
    worker.write_text(WAITING_READER.format(where=tmp_path, worker=build / "hexad-worker"))
    worker.chmod(0o700)
    service = new_service("--worker", worker)
    service.clock = setclock.Clock(tmp_path)
    service.start()
    job = service.submit(sphere(output={"preview": {"size": SIDE}}))
    service.wait_state(job, "succeeded")
    with concurrent.futures.ThreadPoolExecutor() as pool:
        request = pool.submit(service.get, f"/v1/jobs/{job}/thumbnail.png")
        wait_until((tmp_path / "calls").exists, "the process for the thumbnail")
        yield service, request


def test_a_preview_that_is_not_read_in_time_has_no_thumbnail(waiting):
    service, request = waiting
    service.clock.step_monotonic(11)
    reply = request.result()
    assert reply.status == 503 and "thumbnail_timeout_s" in reply.json["detail"]


def test_a_stop_of_the_service_ends_a_thumbnail(waiting):
    service, request = waiting
    events = Stream(service, "/v1/events?all=1")
    service.process.terminate()
    list(events)  # the stream ends when the service stops
    assert request.result().status == 503
    assert service.process.wait(PATIENCE_S) == 0
