# SPDX-License-Identifier: Apache-2.0
"""The client for Node and browsers (clients/typescript): against a real daemon, and as its types say."""
import contextlib
import functools
import http.server
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import threading

import pytest

from accounts import new_token
from browser import Browser, is_there
from lost_answers import LosesAnswers, on_a_socket
from service import PATIENCE_S, gated_worker, sphere, wait_until

ROOT = pathlib.Path(__file__).parents[2]
PACKAGE = ROOT / "clients/typescript"
WRITTEN_BY_TSC = ("hexad.d.ts", "node.d.ts", "sha256.d.ts")

needs_node = pytest.mark.extended  # and tsc or a browser


@pytest.fixture
def node(tmp_path):
    """Runs a module in Node in a directory where the package is installed; returns what it prints last, as JSON."""
    if not shutil.which("node"):
        pytest.skip("no node")
    (tmp_path / "node_modules").mkdir()
    (tmp_path / "node_modules/hexad").symlink_to(PACKAGE)

    def start(text, **environment):
        (tmp_path / "script.mjs").write_text(text)
        return subprocess.Popen(["node", "script.mjs"], cwd=tmp_path, env={**os.environ, **environment},
                                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def finish(process):
        out, errors = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, out + errors
        assert errors == ""
        return json.loads(out.splitlines()[-1]) if out else None

    def run(text, **environment):
        return finish(start(text, **environment))

    run.start, run.finish = start, finish
    return run


@pytest.fixture(scope="module")
def service(build, tmp_path_factory):
    made = on_a_socket(build, tmp_path_factory.mktemp("typescript")).start()
    yield made
    made.clean_up()


def check_session(seen):
    assert seen == {
        "same": True, "ended": "succeeded", "outcome": "converged", "found": True, "count": 300, "head": "ply\n",
        "names": ["points.ply", "report.json"], "sphere": {"shape": "sphere", "center": [0.5, 0.5, 0.5], "radius": 1}, "path": True,
        "refused": "Problem spec_invalid /sampling/count", "failed": "JobFailed input_damaged",
        "missing": "Problem not_found", "none": "HexadError undefined", "cancelled": "cancelled", "version": "string",
        "log": "string"}


def start_with_token(service):
    """Starts a daemon that answers callers with a token only; returns one."""
    at = service.options.index("--tcp_without_tokens")
    del service.options[at:at + 2]
    service.state.mkdir(mode=0o700)
    token = new_token(service, "alice")
    service.start()
    return token


SESSION = """
import * as hexad from "hexad";
import {session} from "./session.mjs";
console.log(JSON.stringify(await session(hexad, %s, "in node")));
"""


@needs_node
@pytest.mark.parametrize("transport", ["socket", "tcp"])
def test_a_session_in_node(service, new_service, node, tmp_path, transport):
    options = {}
    if transport == "tcp":
        service = new_service()
        options = {"token": start_with_token(service)}
    address = service.address if transport == "socket" else f"http://{service.address}"
    shutil.copy(ROOT / "tests/typescript/session.js", tmp_path / "session.mjs")
    check_session(node(SESSION % json.dumps(options), HEXAD_SERVER=address))


@contextlib.contextmanager
def pages_of(directory):
    """The address of a server of files, of another origin than the daemon."""
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=directory))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()


@needs_node
def test_a_session_in_a_browser(new_service, tmp_path):
    if not is_there():
        pytest.skip("no chromium, chromium-driver and python3-selenium")
    site = tmp_path / "site"
    site.mkdir()
    for name in ("hexad.js", "api.js", "sha256.js"):
        shutil.copy(PACKAGE / name, site)
    shutil.copy(ROOT / "tests/typescript/session.js", site)
    (site / "index.html").write_text("<!doctype html><title>a page</title>")
    with pages_of(site) as origin:
        service = new_service("--page_origins", origin)
        token = start_with_token(service)
        options = {"server": f"http://{service.address}", "token": token}
        browser = Browser(tmp_path / "browser")
        try:
            browser.driver.get(f"{origin}/index.html")
            seen = browser.driver.execute_async_script("""
                const [options, done] = arguments;
                Promise.all([import("/hexad.js"), import("/session.js")])
                  .then(([hexad, {session}]) => session(hexad, options, "in a browser")).then(done, error => done(`${error.stack}`));
                """, options)
            check_session(seen)
        finally:
            browser.close()


@needs_node
def test_files_are_fetched_once_and_frames_into_directories(service, node, tmp_path):
    frames = sphere(200, output={"preview": False},
                    queue={"frames": "1-2", "by_frame": {"/surface/analytic/radius": {"from": 1, "to": 2}}})
    seen = node(f"""
        import {{stat}} from "node:fs/promises";
        import {{Client}} from "hexad";
        const job = await new Client().submit({json.dumps(frames)}, {{wait: true}});
        const paths = await job.fetch("out");
        const inodes = async () => (await Promise.all(paths.map(path => stat(path)))).map(({{ino}}) => ino);
        const before = await inodes();
        const again = await job.fetch("out");
        console.log(JSON.stringify({{paths, again, before, after: await inodes(), id: job.id}}));
        """, HEXAD_SERVER=service.address)
    names = [f"out/{frame}/{name}" for frame in (1, 2) for name in ("points.ply", "report.json")]
    assert seen["paths"] == names == seen["again"] and seen["before"] == seen["after"]
    for frame in (1, 2):
        for result in service.get(f"/v1/jobs/{seen['id']}/results?frame={frame}").json["results"]:
            assert (tmp_path / "out" / str(frame) / result["name"]).stat().st_size == result["bytes"]
    assert len([p for p in (tmp_path / "out").rglob("*") if p.is_file()]) == 4  # no temporary file stays


@needs_node
def test_the_stage_of_all_frames_is_fetched_into_the_directory_above(service, node, tmp_path):
    frames = sphere(200, output={"preview": False, "points_usda": True},
                    queue={"frames": "1-2", "by_frame": {"/surface/analytic/radius": {"from": 1, "to": 2}}})
    seen = node(f"""
        import {{Client}} from "hexad";
        const job = await new Client().submit({json.dumps(frames)}, {{wait: true}});
        console.log(JSON.stringify({{paths: await job.fetch("out"), accepted: job.accepted, outcome: job.outcome}}));
        """, HEXAD_SERVER=service.address)
    assert seen["accepted"] == (seen["outcome"] == "converged")
    assert "out/points_stage.usda" in seen["paths"] and (tmp_path / "out/points_stage.usda").is_file()
    assert not list((tmp_path / "out").glob("*/points_stage.usda"))


@needs_node
def test_a_damaged_file_does_not_arrive(service, node, tmp_path):
    job = service.submit(sphere(210, output={"preview": False}))
    service.wait_state(job, "succeeded")
    stored = service.state / "results" / job / "points.ply"
    data = bytearray(stored.read_bytes())
    data[-1] ^= 1
    stored.chmod(0o600)
    stored.write_bytes(data)
    seen = node(f"""
        import {{Client}} from "hexad";
        const job = await new Client().job("{job}");
        const nameOf = promise => promise.then(() => "none", error => error.name);
        console.log(JSON.stringify([await nameOf(job.fetch("out")), await nameOf(job.read("points.ply"))]));
        """, HEXAD_SERVER=service.address)
    assert seen == ["Damaged", "Damaged"] and [*(tmp_path / "out").iterdir()] == []


@needs_node
def test_events_across_a_crash_of_the_daemon(build, tmp_path, node):
    service = on_a_socket(build, tmp_path, "--worker", gated_worker(tmp_path)).start()
    try:
        job = service.submit(sphere())
        follower = node.start(f"""
            import {{appendFileSync}} from "node:fs";
            import {{Client}} from "hexad";
            const client = new Client();
            const all = (async () => {{
              const seen = [];
              for await (const {{type, data}} of client.events({{after: "0"}})) {{
                seen.push(data);
                appendFileSync("seen", "a");
                if (type === "state" && data.state === "succeeded") return seen;
              }}
            }})();
            const job = await client.job("{job}");
            const ours = [];
            for await (const event of job.events()) if (event.type !== "progress") ours.push(event);
            const more = [];
            for await (const event of job.events({{after: ours.at(-1).id}})) more.push(event);
            console.log(JSON.stringify({{ours: ours.map(({{data}}) => data), all: await all, more}}));
            """, HEXAD_SERVER=service.address)
        wait_until(lambda: (tmp_path / "seen").exists() and service.job(job)["state"] == "running", "the first events")
        service.end(signal.SIGKILL)
        service.start()
        service.open_gate(job)
        seen = node.finish(follower)
        page = service.get("/v1/events?after=0").json["events"]
        assert [e["state"] for e in page if e["type"] == "state"] == ["queued", "running", "queued", "running", "succeeded"]
        assert seen == {"ours": page, "all": page, "more": []}
    finally:
        service.clean_up()


@needs_node
def test_a_submission_whose_answer_is_lost_makes_one_job(service, node, tmp_path):
    proxy = LosesAnswers(tmp_path / "proxy", service.address.removeprefix("unix:"))
    seen = node(f"""
        import {{Client}} from "hexad";
        console.log(JSON.stringify((await new Client().submit({json.dumps(sphere(name="lost to node"))})).id));
        """, HEXAD_SERVER=f"unix:{tmp_path}/proxy")
    assert proxy.asked == 2
    assert [j["id"] for j in service.get("/v1/jobs?name=lost+to+node").json["jobs"]] == [seen]


@needs_node
def test_waiting_and_following_end_when_the_caller_says(build, node, tmp_path):
    service = on_a_socket(build, tmp_path, "--worker", gated_worker(tmp_path)).start()
    try:
        seen = node(f"""
            import {{Client}} from "hexad";
            const nameOf = promise => promise.then(() => "none", error => error.name);
            const client = new Client();
            const job = await client.submit({json.dumps(sphere())});
            const late = await nameOf(job.wait({{timeout: 0.1}}));
            const waiting = new AbortController(), following = new AbortController();
            const aborted = nameOf(job.wait({{signal: waiting.signal}}));
            waiting.abort();
            const followed = nameOf((async () => {{
              for await (const {{data}} of client.events({{after: "0", signal: following.signal}})) following.abort();
            }})());
            const nowhere = new Client({{server: "unix:{tmp_path}/nowhere", patience: 0.1}});
            console.log(JSON.stringify([late, await aborted, await followed, await nameOf(nowhere.job(job.id)),
              (await job.cancel()).id === job.id, (await (await job.cancel()).wait({{check: false}})).state]));
            """, HEXAD_SERVER=service.address)
        assert seen == ["WaitTimeout", "AbortError", "AbortError", "Unreachable", True, "cancelled"]
    finally:
        service.clean_up()


@needs_node
@pytest.mark.parametrize("page", ["doc/clients.md", "clients/typescript/README.md"])
def test_the_examples_of_the_pages(service, node, source, tmp_path, page):
    """Each block in turn, as one module."""
    blocks = re.findall(r"^```js\n(.*?)^```$", (source / page).read_text(), re.M | re.S)
    assert len(blocks) == {"doc/clients.md": 4}.get(page, 1)
    process = node.start("\n".join(blocks), HEXAD_SERVER=service.address)
    out, errors = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0 and errors == "", out + errors
    for said in re.findall(r"console\.log\(.*// (\S+)$", "\n".join(blocks), re.M):
        assert said in out.split(), out
    assert {p.name for p in (tmp_path / ("ball" if page.startswith("doc") else "sphere")).iterdir()} >= {"points.ply", "report.json"}


def test_the_package_needs_nothing_else():
    described = json.loads((PACKAGE / "package.json").read_text())
    assert not [name for name in described if "ependencies" in name]
    for name in ("hexad.js", "node.js", "sha256.js", "api.js"):
        for module in re.findall(r'^(?:import|export) .*from "(.*)";$', (PACKAGE / name).read_text(), re.M):
            assert module.startswith("./") and (PACKAGE / module).exists() or name == "node.js" and module.startswith("node:")


def generate(build, directory):
    subprocess.run([sys.executable, "-B", PACKAGE / "generate.py", build, directory], check=True, timeout=PATIENCE_S)


def test_what_is_generated_is_current(build, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")  # without tsc
    generate(build, tmp_path)
    for name in ("api.js", "api.d.ts"):
        assert (tmp_path / name).read_text() == (PACKAGE / name).read_text(), "run make typescript-client"


@pytest.fixture(scope="module")
def tsc():
    found = shutil.which("tsc")
    if not found or not (pathlib.Path(found).resolve().parents[2] / "@types/node").exists():
        pytest.skip("no tsc and types of Node of Debian's node-typescript and nodejs")
    return found


@needs_node
def test_the_types_are_those_of_the_modules(build, tsc, tmp_path):
    generate(build, tmp_path)  # fails where a module is not as its types say
    for name in WRITTEN_BY_TSC:
        assert (tmp_path / name).read_text() == (PACKAGE / name).read_text(), "run make typescript-client"


@needs_node
def test_the_types_are_strict_and_find_mistakes(tsc, tmp_path):
    """Without the types of Node, which users need not have."""
    (tmp_path / "node_modules").mkdir()
    (tmp_path / "node_modules/hexad").symlink_to(PACKAGE)
    shutil.copy(ROOT / "tests/typescript/mistakes.ts", tmp_path / "mistakes.mts")
    done = subprocess.run([tsc, "--noEmit", "--strict", "--target", "es2020", "--module", "node16", "--lib", "es2020,dom",
                           "mistakes.mts"], cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 0, done.stdout
