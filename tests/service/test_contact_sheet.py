# SPDX-License-Identifier: Apache-2.0
"""The picture of a job: the previews of the frames of an array as one contact sheet, or the preview of another job."""
import concurrent.futures
import hashlib
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


def places(sheet, part):
    """Where the sheet has the part, (row, column) of each place."""
    high, wide = part.shape[:2]
    seen = numpy.lib.stride_tricks.sliding_window_view(sheet[..., 0], (high, wide))
    found = numpy.argwhere((seen[:, :, ::9, ::9] == part[::9, ::9, 0]).all(axis=(2, 3)))
    return [(y, x) for y, x in found.tolist() if (sheet[y:y + high, x:x + wide] == part).all()]


def test_a_contact_sheet_has_each_preview_in_the_order_of_the_frames(made):
    service, job = made
    document = service.get(f"/v1/jobs/{job}").json
    assert document["links"]["contact_sheet"] == f"/v1/jobs/{job}/contact_sheet.png"
    reply = service.get(document["links"]["contact_sheet"])
    assert reply.status == 200 and reply.headers["Content-Type"] == "image/png"
    sheet = picture(reply.body)
    found = []
    for frame in (1, 2, 5):
        one, = places(sheet, picture(service.get(f"/v1/jobs/{job}/results/preview.png?frame={frame}").body))
        found.append(one)
    assert found == sorted(found) and found[0][0] == found[1][0] < found[2][0]  # two in a row, then one


def test_large_previews_are_shown_by_means_of_their_pixels(made):
    """A preview of four times the side of a thumbnail: each of its pixels is the mean of 16."""
    service, _ = made
    job = service.submit({"version": 1, "surface": {"mesh": {"path": "a.####.off"}}, "sampling": {"count": 60},
                          "output": {"preview": {"size": 512}}, "queue": {"frames": "2"}})
    service.wait_state(job, "succeeded")
    sheet = picture(service.get(f"/v1/jobs/{job}/contact_sheet.png").body).astype(float)
    whole = picture(service.get(f"/v1/jobs/{job}/results/preview.png?frame=2").body).astype(float)
    means = whole.reshape(128, 4, 128, 4, 3).mean(axis=(1, 3))
    rows, columns = sheet.shape[0] - 127, sheet.shape[1] - 127
    fits = [(y, x) for y in range(rows) for x in range(columns) if abs(sheet[y:y + 128, x:x + 128] - means).max() <= 0.5]
    assert len(fits) == 1


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


def test_the_picture_of_a_job_without_frames_is_its_preview(made, build, tmp_path):
    service, _ = made
    job = service.submit(sphere())
    done = service.wait_state(job, "succeeded")
    assert "contact_sheet" not in done["links"]
    preview = service.get(f"/v1/jobs/{job}/results/preview.png").body
    assert service.get(f"/v1/jobs/{job}/contact_sheet.png").body == preview
    told = show(build, service, job, tmp_path / "one.png")
    assert told.returncode == 0 and (tmp_path / "one.png").read_bytes() == preview


def show(build, service, job, file):
    return subprocess.run([build / "hexadctl", "--server", f"http://{service.address}", "show", job, "--picture", file],
                          capture_output=True, text=True, timeout=PATIENCE_S)


def test_show_saves_the_contact_sheet_of_an_array(made, build, tmp_path):
    service, job = made
    told = show(build, service, job, tmp_path / "sheet.png")
    assert told.returncode == 0 and "failed" in told.stdout and str(tmp_path / "sheet.png") in told.stderr
    assert (tmp_path / "sheet.png").read_bytes() == service.get(f"/v1/jobs/{job}/contact_sheet.png").body


def test_a_job_without_previews_has_no_picture(made, build, tmp_path):
    service, _ = made
    plain = {"preview": False}
    array = {"version": 1, "surface": {"mesh": {"path": "a.####.off"}}, "sampling": {"count": 60}, "output": plain,
             "queue": {"frames": "1-2"}}
    for spec in (sphere(output=plain), array):
        job = service.submit(spec)
        service.wait_state(job, "succeeded")
        reply = service.get(f"/v1/jobs/{job}/contact_sheet.png")
        assert reply.status == 404 and "preview" in reply.json["detail"]
        told = show(build, service, job, tmp_path / "none.png")
        assert told.returncode == 4 and not (tmp_path / "none.png").exists()


@pytest.mark.sanitized
@pytest.mark.parametrize("damage", [lambda data: data[:300], lambda data: b"GIF89a" + data[6:], lambda data: b""],
                         ids=["cut", "another", "empty"])
def test_a_preview_that_cannot_be_read_is_left_out(made, damage):
    """Its frame has a number and no picture; the others are as they were."""
    service, job = made
    file = service.state / f"results/{job}.2/preview.png"
    kept = file.read_bytes()
    first = picture(service.get(f"/v1/jobs/{job}/results/preview.png?frame=1").body)
    try:
        file.chmod(0o600)
        file.write_bytes(damage(kept))
        sheet = picture(service.get(f"/v1/jobs/{job}/contact_sheet.png").body)
    finally:
        file.write_bytes(kept)
    assert len(places(sheet, first)) == 1 and not places(sheet, picture(kept))


# The real worker, except that it makes no thumbnail but the first one. It notes each call.
WAITING_READER = """#!/bin/sh
[ "$1" = read-picture ] && {{ echo x >>{where}/calls; [ $(wc -l <{where}/calls) = 1 ] || exec sleep 1000000; }}
exec {worker} "$@"
"""


def calls(where):
    return (where / "calls").read_text().count("x") if (where / "calls").exists() else 0


@pytest.fixture
def waiting(made, build, new_service, tmp_path):
    """A service whose clock may be set, and the request for the contact sheet of an array of two frames. The process for the
    second frame never ends by itself."""
    if setclock.why_not():
        pytest.skip(setclock.why_not())
    worker = tmp_path / "waiting-reader"
    worker.write_text(WAITING_READER.format(where=tmp_path, worker=build / "hexad-worker"))
    worker.chmod(0o700)
    roots = made[0].options[made[0].options.index("--input_roots") + 1]
    service = new_service("--worker", worker, "--input_roots", roots)
    service.clock = setclock.Clock(tmp_path)
    service.start()
    job = service.submit({"version": 1, "surface": {"mesh": {"path": "a.####.off"}}, "sampling": {"count": 60},
                          "output": {"preview": {"size": SIDE}}, "queue": {"frames": "1,2"}})
    service.wait_state(job, "succeeded")
    with concurrent.futures.ThreadPoolExecutor() as pool:
        request = pool.submit(service.get, f"/v1/jobs/{job}/contact_sheet.png")
        wait_until(lambda: calls(tmp_path) == 2, "the second thumbnail")
        yield service, request


def test_previews_that_are_not_read_in_time_are_left_out_of_a_contact_sheet(made, waiting, tmp_path):
    service, request = waiting
    service.clock.step_monotonic(21)
    reply = request.result()
    first, second = (picture(made[0].get(f"/v1/jobs/{made[1]}/results/preview.png?frame={frame}").body) for frame in (1, 2))
    assert reply.status == 200 and calls(tmp_path) == 2
    assert len(places(picture(reply.body), first)) == 1 and not places(picture(reply.body), second)


def test_a_stop_of_the_service_ends_a_contact_sheet(waiting, tmp_path):
    service, request = waiting
    events = Stream(service, "/v1/events?all=1")
    service.process.terminate()
    list(events)  # the stream ends when the service stops
    assert request.result().status == 503 and calls(tmp_path) == 2
    assert service.process.wait(PATIENCE_S) == 0


# The contract of a worker: each job gets the same preview. The real worker makes thumbnails.
COPYING_WORKER = """#!/bin/sh
[ "$1" = read-picture ] && exec %s "$@"
cp %s "$4/preview.png"
printf x >"$4/points.ply"
printf '{"outcome":"converged","count":7,"outputs":[{"name":"points.ply","bytes":1,"sha256":"%s"}]}' >"$4/report.json"
"""


@pytest.mark.extended
def test_a_contact_sheet_has_at_most_256_frames(made, build, new_service, tmp_path):
    """Of 300 frames the first, the last and others between."""
    service, job = made
    preview = service.get(f"/v1/jobs/{job}/results/preview.png?frame=1").body
    (tmp_path / "preview.png").write_bytes(preview)
    worker = tmp_path / "copying-worker"
    worker.write_text(COPYING_WORKER % (build / "hexad-worker", tmp_path / "preview.png", hashlib.sha256(b"x").hexdigest()))
    worker.chmod(0o700)
    for frame in range(1, 301):
        (tmp_path / f"a.{frame}.off").write_text("OFF")
    other = new_service("--worker", worker, "--input_roots", tmp_path, "--cache", "0").start()
    many = other.submit({"version": 1, "surface": {"mesh": {"path": "a.#.off"}}, "sampling": {"count": 60},
                         "queue": {"frames": "1-300"}})
    other.wait_state(many, "succeeded")
    assert len(places(picture(other.get(f"/v1/jobs/{many}/contact_sheet.png").body), picture(preview))) == 256
