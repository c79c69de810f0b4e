#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What the web page costs in a real browser: bytes, the time to the first view, frames while 100 000 jobs wait and events
come, and points in 3-D.

    measurements/service/web_page.py --built BUILD [--output measurements/service/web_page.csv] [--jobs 100000] [--points 1000000]
                                     [--seconds 20]

Prints the results and writes them; ends with 1 when a bound is missed. There is no graphics card here: of points the results have
the memory that the card would get, and the time of the script alone.
"""
import argparse
import concurrent.futures
import contextlib
import datetime
import json
import os
import pathlib
import re
import statistics
import sys
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1] / "tests" / "service"), str(HERE.parent / "common")]

import results  # noqa: E402
from browser import Browser, is_there  # noqa: E402
from service import Service, cpu_seconds, gated_worker, processes, sphere, wait_until  # noqa: E402

MOST_BYTES, MOST_VIEW_MS, MOST_FRAME_MS, MOST_MEMORY = 1_000_000, 300, 100, 200_000_000
EVENTS = 50  # a second
# the time between frames while something happens
WATCH = """window.frames = []; let last = performance.now();
(function next() { const now = performance.now(); frames.push(now - last); last = now; requestAnimationFrame(next); })();"""


FIRST_VIEW = """new MutationObserver((_, watcher) => { if (document.querySelector("tbody tr")) requestAnimationFrame(() =>
  { window.firstView = window.firstView || performance.now(); watcher.disconnect(); }); }).observe(document, {childList: true, subtree: true});"""


# reads a file of points as the view does, and draws none
LOAD = """const [path, done] = arguments, begun = performance.now();
import(new URL("page/ply.js", document.baseURI)).then(ply => ply.loadPoints(path, 2e6, {onStart() {}, onMore() {}}))
  .then(() => done(performance.now() - begun));"""


def number(value):
    return f"{value:.{1 if value < 10 else 0}f}"


class Table:
    def __init__(self):
        self.rows, self.missed = [], 0

    def add(self, what, value, unit, most=None):
        met = most is None or value <= most
        self.missed += not met
        self.rows.append([what, unit, number(value), most or "", "" if most is None else "met" if met else "missed"])
        print(*self.rows[-1], sep=", ", flush=True)


def ask(service, connection, method, path, body=None):
    connection.request(method, path, json.dumps(body) if body is not None else None, {"Content-Type": "application/json"})
    reply = connection.getresponse()
    answer = reply.read()
    assert reply.status < 300, answer
    return json.loads(answer)


def fill(service, count):
    """That many jobs that wait, from 16 clients; their ids."""
    def submit(number):
        connection = service.connection()
        return [ask(service, connection, "POST", "/v1/jobs", sphere(name=f"job {number}.{i}"))["id"] for i in range(count // 16)]
    with concurrent.futures.ThreadPoolExecutor(16) as pool:
        return [job for jobs in pool.map(submit, range(16)) for job in jobs]


class Events(threading.Thread):
    """So many events a second, until it is stopped."""

    def __init__(self, service, jobs):
        super().__init__()
        self.service, self.jobs, self.stopped, self.sent = service, jobs, threading.Event(), 0

    def run(self):
        connection, begun = self.service.connection(), time.monotonic()
        while not self.stopped.wait(max(0, begun + self.sent / EVENTS - time.monotonic())):
            ask(self.service, connection, "PATCH", f"/v1/jobs/{self.jobs[-1 - self.sent % 50]}", {"priority": self.sent % 100})
            self.sent += 1


def pids_of(browser):
    """All processes of the browser."""
    parents = {pid: parent for pid, (parent, _, _) in processes().items()}
    for pid in parents:
        above = pid
        while above and above != browser.driver.service.process.pid:
            above = parents.get(above)
        if above:
            yield pid


def browser_seconds(browser):
    """Processor time of the browser so far, without what has ended."""
    total = 0
    for pid in pids_of(browser):
        with contextlib.suppress(OSError):
            total += cpu_seconds(pid)[0]
    return total


def efforts(service, browser, action, seconds=3):
    """Repeats an action for a while. How often a second, and the processor time that service and browser took, in milliseconds a
    second."""
    before, begun, count = (cpu_seconds(service.process.pid)[0], browser_seconds(browser)), time.monotonic(), 0
    while time.monotonic() < begun + seconds:
        action()
        count += 1
    spent = time.monotonic() - begun
    own, others = cpu_seconds(service.process.pid)[0] - before[0], browser_seconds(browser) - before[1]
    return {"rate": count / spent, "service": 1000 * own / spent, "browser": 1000 * others / spent}


def renderer_bytes(browser):
    """Memory of the process that runs the page, with its share of what it shares."""
    largest = 0
    for pid in pids_of(browser):
        try:
            if b"--type=renderer" in pathlib.Path(f"/proc/{pid}/cmdline").read_bytes():
                pss = re.search(r"^Pss: *(\d+) kB", pathlib.Path(f"/proc/{pid}/smaps_rollup").read_text(), re.M)
                largest = max(largest, 1024 * int(pss[1]))
        except OSError:
            continue  # it has ended
    return largest


def measure_first_view(service, browser, table):
    times = []
    browser.command("Page.addScriptToEvaluateOnNewDocument", source=FIRST_VIEW)
    for _ in range(7):
        browser.command("Network.clearBrowserCache")
        browser.open(service)
        times.append(wait_until(lambda: browser.run("return window.firstView"), "the first view"))
    table.add("first view of the queue, nothing cached (median of 7)", statistics.median(times), "ms", MOST_VIEW_MS)
    table.add("bytes of the first view", browser.run("return [...performance.getEntriesByType('resource'), ...performance.getEntriesByType('navigation')]"
                                          ".filter(e => !e.name.includes('/v1/')).reduce((sum, e) => sum + e.transferSize, 0)"), "bytes")
    whole = sum(len(service.get(f"/page/{f.name}").body) for f in (service.build / "page").iterdir() if f.is_file())
    table.add("bytes of all files of the page", whole, "bytes", MOST_BYTES)


def show_queue(service, browser):
    browser.open(service)
    wait_until(lambda: len(browser.all("tbody tr")) == 50, "the rows")


def measure_queue(service, browser, jobs, seconds, table):
    events = Events(service, jobs)
    begun = time.monotonic()
    events.start()
    show_queue(service, browser)
    browser.run(WATCH)
    time.sleep(seconds)
    frames = sorted(browser.run("return window.frames"))
    objects, memory = browser.run("return performance.memory.usedJSHeapSize"), renderer_bytes(browser)
    connection, found = service.connection(), {"no page open": [], "the page open": []}
    for _ in range(5):  # by turns: other work on this machine changes
        for words, show in (("no page open", lambda: browser.driver.get("about:blank")),
                            ("the page open", lambda: show_queue(service, browser))):
            show()
            idle = efforts(service, browser, lambda: time.sleep(0.1))
            read = efforts(service, browser, lambda: ask(service, connection, "GET", f"/v1/jobs/{jobs[0]}"))
            found[words].append({"idle": idle["service"], "rate": read["rate"], "browser": read["browser"],
                                 "cost": 1000 * (read["service"] - idle["service"]) / read["rate"]})
    events.stopped.set()
    events.join()
    table.add("waiting jobs", len(jobs), "jobs")
    table.add("events", events.sent / (time.monotonic() - begun), "events/s")
    table.add("longest frame while events come", frames[-1], "ms", MOST_FRAME_MS)
    table.add("99th percentile of frames", frames[int(0.99 * len(frames))], "ms")
    table.add("memory of the process that shows the page", memory, "bytes", MOST_MEMORY)
    table.add("memory of objects of the page", objects, "bytes")
    for what, key, unit in (("processor time of the service for these events", "idle", "ms a second"),
                            ("processor time of the service for a status read", "cost", "µs"),
                            (f"status reads of one client on {os.cpu_count()} processors", "rate", "reads/s"),
                            ("processor time of the browser meanwhile", "browser", "ms a second")):
        for words, rounds in found.items():
            table.add(f"{what}, {words} (median of 5)", statistics.median(r[key] for r in rounds), unit)


def measure_points(service, browser, count, table):
    job = service.submit(sphere(count=count, output={"preview": False}))
    service.wait_state(job, "succeeded", seconds=600)
    begun = time.monotonic()
    browser.open(service, f"#/jobs/{job}/points")
    wait_until(lambda: browser.all(".stats") and not browser.all(".loading-points"), "the points", 600)
    table.add(f"{count} points: until all discs are there, drawn by the processor", time.monotonic() - begun, "s")
    table.add(f"{count} points: read without drawing", browser.driver.execute_async_script(LOAD, f"v1/jobs/{job}/results/points.ply") / 1000, "s")
    stats = browser.text(".stats")
    assert stats.replace("\u202f", "").startswith(f"{count} points"), (stats, browser.texts(".trouble"))
    frame = browser.run("return {...document.querySelector('canvas.points').dataset}")
    for what, unit, value in (("draw calls of a frame", "", frame["calls"]), ("script of a frame, without pixels", "ms", f"{float(frame['ms']):.1f}"),
                              ("memory of the graphics card", "MiB", f"{int(frame['bytes']) / 2 ** 20:.1f}")):
        table.rows.append([f"{count} points: {what}", unit, value, "", ""])
        print(*table.rows[-1], sep=", ")


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--built", type=pathlib.Path, required=True)
    parser.add_argument("--output", type=pathlib.Path, default=HERE / "web_page.csv")
    parser.add_argument("--jobs", type=int, default=100000)
    parser.add_argument("--points", type=int, default=1000000)
    parser.add_argument("--seconds", type=float, default=20)
    options = parser.parse_args()
    if not is_there() or not (options.built / "page/uplot.js").exists():
        sys.exit("needs the page (npm ci in page, make), chromium, chromium-driver and python3-selenium")
    table = Table()
    with tempfile.TemporaryDirectory() as where:
        base = pathlib.Path(where)
        (base / "one").mkdir()
        (base / "two").mkdir()
        browser = Browser(base / "browser", (1440, 900))
        full = Service(options.built.resolve(), base / "one", "--worker", gated_worker(base), "--workers", 1, "--log_level", "warning")
        plain = Service(options.built.resolve(), base / "two")
        try:
            full.start()
            jobs = fill(full, options.jobs)
            measure_first_view(full, browser, table)
            measure_queue(full, browser, jobs, options.seconds, table)
            full.end()
            measure_points(plain.start(), browser, options.points, table)
        finally:
            browser.close()
            full.clean_up()
            plain.clean_up()
    table.rows.append(["date", "", f"{datetime.datetime.now(datetime.timezone.utc):%Y-%m-%dT%H:%MZ}", "", ""])
    results.write(options.output, ["quantity", "unit", "measured", "at_most", "outcome"], table.rows)
    sys.exit(1 if table.missed else 0)


if __name__ == "__main__":
    main()
