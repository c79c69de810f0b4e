#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Pictures of every view of the web page, light and dark, on a wide and on a narrow screen, to be looked at.

    measurements/service/page_pictures.py --built BUILD --to DIRECTORY [--only WORD]

VIEW-WIDTH-THEME.png each; the two of 1120 are those of doc/. A view that is wider than its screen ends the program with 1.
"""
import argparse
import hashlib
import json
import pathlib
import subprocess
import sys
import tempfile
import urllib.parse

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parents[1] / "tests" / "service"))

from browser import Browser, is_there  # noqa: E402
from service import OPEN_TCP, Service, long_sphere, sphere, wait_until  # noqa: E402
from accounts import new_token, with_token  # noqa: E402

HEIGHT, TALLEST = 900, 6000  # of the screen; of a picture
LONG_NAME = "shot_0420_fx_explosion_v012_final_for_review_with_a_name_that_somebody_typed_and_which_does_not_end_soon"
CUBE = "".join(f"v {x} {y} {z}\n" for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)) + \
    "".join(f"f {face}\n" for face in ("1 2 4 3", "5 7 8 6", "1 5 6 2", "3 4 8 7", "1 3 7 5", "2 6 8 4"))

# opens the folder of a sequence of files
SHOTS = """document.querySelector('.drop details').open = true;
    const open = ending => { const found = [...document.querySelectorAll('.files button')].find(b => b.innerText.endsWith(ending));
      if (found) found.click(); else setTimeout(() => open(ending), 50); return found; };
    const inner = () => [...document.querySelectorAll('.files button')].some(b => b.innerText === 'shots/') ? open('shots/') : setTimeout(inner, 50);
    open('/'); inner();"""

SETTLED = "return !document.querySelector('.loading, .loading-points, [aria-busy=true]')"


def jobs_of(service, token):
    """One of each kind, by a word."""
    def submit(spec):
        reply = with_token(service, token, "POST", "/v1/jobs", spec)
        assert reply.status == 201, reply.body
        return reply.json["id"]

    def state(job):
        return with_token(service, token, "GET", f"/v1/jobs/{job}").json
    trefoil = json.loads((HERE.parents[1] / "examples/trefoil.json").read_text())
    trefoil.update(name="trefoil", sampling={"count": 4000}, output={"mesh": True}, queue={"labels": ["demo", "knots"]})
    torus = {"analytic": {"shape": "torus", "center": [0, 0, 0], "axis": [0, 0, 1], "major_radius": 1, "minor_radius": 0.4}}
    jobs = {
        "job": submit(trefoil),
        "rough": submit(sphere(name="graded torus", surface=torus, sampling={"count": 1500}, solver={"max_sweeps": 40})),
        "graded": submit({"version": 1, "name": "graded quartic", "surface": {"analytic": {"shape": "quartic"}},
                          "sampling": {"count": 6000, "curvature": {"ratio": 6}}}),
        "failed": submit({"version": 1, "name": LONG_NAME, "surface": {"bspline": {"dims": [4, 4, 4], "coefficients": [1] * 64}},
                          "sampling": {"count": 100}}),
        "array": submit(sphere(name="film", queue={"frames": "1-24", "by_frame": {
            "/surface/analytic/radius": {"from": 1, "to": 2}, "/solver/max_sweeps": [2000] * 22 + [1] * 2}})),
    }
    for name, copies in (("cube.obj", 1), ("a mesh with a name of several words.obj", 20000)):
        content = (CUBE + "# \n" * copies).encode()
        service.request("PUT", f"/v1/inputs/{hashlib.sha256(content).hexdigest()}?{urllib.parse.urlencode({'name': name})}", content,
                        {"Authorization": f"Bearer {token}"})
    for word, job in jobs.items():
        wait_until(lambda: state(job)["state"] in ("succeeded", "failed"), word)
    jobs["live"] = submit(long_sphere(name="running"))
    wait_until(lambda: (state(jobs["live"])["progress"] or {}).get("sweep", 0) > 20, "sweeps")
    jobs["waits"] = submit(sphere(name="waits for another", queue={"depends_on": [jobs["live"]]}))
    jobs["turn"] = submit(sphere(name="waits for its turn", solver={"threads": 64}))  # all threads: it waits for the running one
    paused = submit(sphere(name="paused", queue={"depends_on": [jobs["live"]], "priority": 10}))
    assert with_token(service, token, "POST", f"/v1/jobs/{paused}/pause").status < 300
    return jobs


def views_of(jobs):
    """Of each view, by a word: its address, a selector of what is there then; a script that does something to it, and a
    selector of what is there after that."""
    drop = f"""const data = new DataTransfer();
        data.items.add(new File([{json.dumps(CUBE)}], "cube.obj"));
        document.querySelector(".drop").dispatchEvent(new DragEvent("drop", {{dataTransfer: data, bubbles: true}}));"""
    views = {"queue": ("#/", "tbody tr", None, None),
             "selected": ("#/", "tbody tr", "document.querySelectorAll('tbody input').forEach((box, i) => i < 2 && box.click())", "tr.chosen"),
             "submit": ("#/submit", ".estimate dl", None, None),
             "dropped": ("#/submit", ".estimate dl", drop, ".inspection"),
             "files": ("#/submit", ".estimate dl", "document.querySelector('.drop details').open = true", ".files button"),
             "uploads": ("#/submit", ".estimate dl", "document.querySelector('.uploads').open = true", ".uploads td button"),
             "sequence": ("#/submit", ".estimate dl", SHOTS, ".files .detail"),
             "faults": ("#/submit", ".estimate dl", """const field = document.getElementById("f/surface/analytic/radius");
                 field.value = "-1"; field.dispatchEvent(new Event("input", {bubbles: true}));""", ".fault"),
             "more": ("#/submit", ".estimate dl", "document.querySelectorAll('details').forEach(part => { part.open = true; })", "details[open]"),
             "compare": (f"#/compare/{jobs['job']}/{jobs['rough']}", ".stats", None, None),
             "film": (f"#/jobs/{jobs['array']}/points", ".stats", None, None),
             "points": (f"#/jobs/{jobs['graded']}/points", ".stats", """const by = document.querySelector(".controls select");
                 by.value = "spacing"; by.dispatchEvent(new Event("change", {bubbles: true}));""", ".legend"),
             "neighbours": (f"#/jobs/{jobs['rough']}/points", ".stats", """const by = document.querySelector(".controls select");
                 by.value = "neighbours"; by.dispatchEvent(new Event("change", {bubbles: true}));""", ".legend .hint"),
             "service": ("#/service", ".users", None, None),
             "filtered": ("#/?text=torus", "tbody tr", None, None),
             "lost": ("#/nothing", "h1", None, None)}
    for word in ("job", "rough", "failed", "array", "waits", "turn"):
        views[word] = (f"#/jobs/{jobs[word]}", ".measures" if word in ("job", "rough") else ".facts-list", None, None)
    views["live"] = (f"#/jobs/{jobs['live']}", ".stats", None, None)
    views["frame"] = (f"#/jobs/{jobs['array']}?frame=3", ".measures", None, None)
    views["log"] = (f"#/jobs/{jobs['job']}", ".measures", """[...document.querySelectorAll("main button")].find(b => b.innerText === "Log").click()""", "pre.log")
    return views


class Camera:
    def __init__(self, browser, service, where):
        self.browser, self.service, self.where, self.wide = browser, service, where, []

    def resize(self, width, height):
        self.browser.command("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def take(self, word, width, theme, view, whole=True):
        """Of the whole view, or of what one sees first."""
        address, there, script, then = view
        self.browser.emulate(prefers_color_scheme=theme)
        self.resize(width, HEIGHT)
        self.browser.open(self.service, address)
        self.browser.one(there)
        if script:
            self.browser.run(script)
            self.browser.one(then)
        wait_until(lambda: self.browser.run(SETTLED), "what loads")
        if self.browser.run("return document.documentElement.scrollWidth") > width:
            self.wide.append(f"{word} is wider than {width}")
        if whole:
            self.resize(width, max(HEIGHT, min(TALLEST, self.browser.run("return document.documentElement.scrollHeight"))))
        else:
            self.browser.run("document.documentElement.style.overflow = 'hidden'")
        # what is painted has met the new size
        self.browser.driver.execute_async_script("requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
        self.browser.driver.save_screenshot(str(self.where / f"{word}-{width}-{theme}.png"))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--built", type=pathlib.Path, required=True)
    parser.add_argument("--to", type=pathlib.Path, required=True)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    if not is_there() or not (options.built / "page/uplot.js").exists():
        sys.exit("needs the page (npm ci in page, make), chromium, chromium-driver and python3-selenium")
    options.to.mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory() as where:
        base = pathlib.Path(where)
        (base / "cube.obj").write_text(CUBE)
        (base / "shots").mkdir()
        for frame in range(1, 25):
            (base / "shots" / f"cube.{frame:04d}.obj").write_text(CUBE)
        subprocess.run([options.built / "hexad-worker", "make-example", base / "trefoil.vdb"], check=True)
        service = Service(options.built.resolve(), base, "--estimate_timeout_s", 60, "--input_roots", base)
        service.options = [o for o in service.options if o not in ("--tcp_without_tokens", OPEN_TCP)]
        service.state.mkdir(mode=0o700)
        token = new_token(service, "alice", "--scopes", "admin")
        browser = Browser(base / "browser", (1440, HEIGHT))
        camera = Camera(browser, service.start(), options.to)
        sizes = [(width, theme) for width in (1280, 390) for theme in ("light", "dark")]
        try:
            for width, theme in sizes:
                camera.take("sign-in", width, theme, ("#/", "#token", None, None))
            browser.one("#token").send_keys(token)
            browser.press("Sign in")
            browser.one("header")
            for width, theme in sizes:
                camera.take("empty", width, theme, ("#/", ".empty", None, None))
            views = views_of(jobs_of(service, token))
            for word, view in views.items():
                for width, theme in sizes if options.only in word else ():
                    camera.take(word, width, theme, view)
            for word in ("job", "points"):
                camera.take(word, 1120, "light", views[word], whole=False)
        finally:
            browser.close()
            service.clean_up()
    sys.exit("\n".join(camera.wide) or 0)


if __name__ == "__main__":
    main()
