# SPDX-License-Identifier: Apache-2.0
"""The web page in headless Chromium, with real daemons and real jobs.

All tests share one browser. Most tests share one daemon, or one daemon whose worker waits for the test.
"""
import datetime
import hashlib
import json
import signal
import socket
import subprocess
import threading

import pytest

from accounts import new_token, with_token
from browser import Browser, Keys, is_there, wait_until
from proxies import Front
from service import PARTLY_UNRESOLVED, gated_worker, long_sphere, sphere

pytestmark = pytest.mark.extended


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    if not is_there():
        pytest.skip("no chromium, chromium-driver and python3-selenium")
    started = Browser(tmp_path_factory.mktemp("browser"))
    yield started
    started.close()


@pytest.fixture
def browser(chromium, build):
    if not (build / "page/uplot.js").exists():
        pytest.skip("the page was not built: run npm ci in page, and make")
    chromium.faults()
    yield chromium
    faults = chromium.faults()
    chromium.command("Network.clearBrowserCookies")
    chromium.driver.get("about:blank")
    assert not faults


@pytest.fixture
def service(clean_service):
    return clean_service


@pytest.fixture
def gated(clean_gated):
    return clean_gated


ONE_THREAD = {"max_sweeps": 1000000, "step_tolerance": 1e-12, "energy_tolerance": 1e-12, "threads": 1}


def sign_in(browser, service, user="carol", secret=None):
    secret = secret or new_token(service, user)
    browser.open(service)
    browser.one("#token").send_keys(secret)
    browser.press("Sign in")
    browser.one("header")
    return secret


def test_a_token_signs_in(closed_service, browser):
    browser.open(closed_service)
    browser.wait_text("Your token")
    browser.one("#token").send_keys("hexad_wrong")
    browser.press("Sign in")
    browser.wait_text("the token is unknown")
    browser.one("#token").clear()
    secret = new_token(closed_service, "carol", "--scopes", "read")
    browser.one("#token").send_keys(secret)
    browser.press("Sign in")
    browser.wait_text("carol", "header")
    assert "New job" not in browser.text("header")  # this token may not submit
    seen = browser.run("return document.cookie + JSON.stringify({...localStorage})")
    assert secret not in seen and "hexad_" not in seen
    assert browser.run("return document.activeElement.id") == "main"  # the focus of the form is not lost
    browser.press("Sign out")
    browser.wait_text("Your token")
    wait_until(lambda: browser.run("return document.activeElement.id") == "token", "the focus in the form")


def test_a_revoked_token_ends_the_session(closed_service, browser):
    sign_in(browser, closed_service)
    browser.wait_text("Queue", "h1")
    (closed_service.state / "tokens").write_text("")
    browser.run("location.hash = '#/submit'")  # whatever it asks for next
    browser.wait_text("Your token")


def test_a_session_that_is_over_asks_for_the_token_again(closed_service, browser):
    secret = sign_in(browser, closed_service)
    browser.wait_text("Queue", "h1")
    browser.command("Network.clearBrowserCookies")  # as at the end of the session
    # nobody touches the page: the first event behind the end tells it
    wait_until(lambda: with_token(closed_service, secret, "POST", "/v1/jobs", sphere()) and browser.all("#token"), "the form")
    wait_until(lambda: browser.run("return document.activeElement.id") == "token", "the focus in the form")
    browser.keys(secret, Keys.ENTER)  # by the keyboard alone
    browser.one("header")
    wait_until(lambda: browser.run("return document.activeElement.id") == "main", "the focus in the view")


def test_the_queue_follows_what_happens(gated, browser):
    browser.open(gated)
    browser.wait_text("No jobs yet")
    first = gated.submit(sphere(name="first", queue={"labels": ["red"]}))
    browser.wait_text("first", "table")
    browser.wait_text("50 %", "table")  # the progress of a worker that stands at its gate
    second = gated.submit(sphere(name="second"))
    browser.wait_text("second", "table")
    browser.wait_text("Waiting", "table")
    gated.open_gate(first)
    browser.wait_text("Done", "table")
    gated.open_gate(second)
    wait_until(lambda: browser.text("table").count("Done") == 2, "both to be done")


def test_jobs_of_others_are_followed(closed_service, browser, tmp_path):
    """In the queue, and on their own: as far as everyone may see them."""
    closed_service.end()
    closed_service.start("--worker", gated_worker(tmp_path))
    sign_in(browser, closed_service)
    browser.wait_text("No jobs yet")
    array = {"frames": "1-2", "by_frame": {"/surface/analytic/radius": [1, 1.1]}}
    first, second = (with_token(closed_service, closed_service.token, "POST", "/v1/jobs", spec).json["id"]
                     for spec in (sphere(name="first"), sphere(name="second", queue=array)))
    browser.wait_text("Running", "table")
    closed_service.open_gate(first)
    browser.wait_text("Done", "table")
    browser.press("first", "table")
    browser.wait_text("Done", "h1")
    assert "of 0" not in browser.text("main")  # the largest number of attempts is known to the owner only
    browser.press("Queue", "main")
    browser.press("second", "table")
    browser.wait_text("Running", "h1")
    browser.wait_text("Only root and administrators see the rest")
    browser.wait_text("You are signed in as ")
    for frame in (1, 2):
        closed_service.open_gate(f"{second}.{frame}")
    browser.wait_text("Done", "h1")
    assert not browser.all(".trouble")


# Streams open, and answers with jobs arrive, when the test lets them; answers have no progress, as if they were made
# before the worker's first line.
SLOW = """
  const gates = {stream: null, jobs: null}, Stream = EventSource, ask = fetch;
  const pass = (kind, action) => (gates[kind] ? gates[kind].push(action) : action());
  window.hold = kind => { gates[kind] = []; };
  window.held = kind => gates[kind].length;
  window.letOne = (kind, which) => gates[kind].splice(which, 1)[0]();
  window.letAll = kind => {
    for (const action of gates[kind].splice(0)) action();
    gates[kind] = null;
  };
  window.told = []; // types of events that have come
  window.EventSource = class {
    listeners = [];
    constructor(url) {
      queueMicrotask(() => pass("stream", () => { // the listeners are there
        if (this.closed) return;
        this.stream = new Stream(url);
        this.stream.onopen = () => { window.told.push("open"); this.onopen && this.onopen(); };
        this.stream.onerror = () => this.onerror && this.onerror();
        for (const [type, listener] of this.listeners)
          this.stream.addEventListener(type, event => { window.told.push(type); listener(event); });
      }));
    }
    addEventListener(...words) { this.listeners.push(words); }
    close() { this.closed = true; if (this.stream) this.stream.close(); }
  };
  window.fetch = async (url, ...words) => {
    const answer = await ask(url, ...words);
    if (!/v1\\/jobs([?]|\\/[0-9a-z]{26}$)/.test(url)) return answer;
    const text = (await answer.text()).replace(/"progress":{[^}]*}/g, '"progress":null');
    await new Promise(done => pass("jobs", done));
    return new Response(text, {status: answer.status});
  };
"""


def open_slow(service, browser, *kinds, where="#/"):
    with browser.before_the_page(SLOW + "".join(f"hold('{kind}');" for kind in kinds)):
        browser.open(service, where)
    for kind in kinds:
        wait_until(lambda: browser.run("return held(arguments[0])", kind), f"a {kind} that is held")


def test_what_happens_before_the_stream_is_open_is_shown(gated, browser):
    open_slow(gated, browser, "stream")
    browser.wait_text("No jobs yet")
    gated.wait_worker(gated.submit(sphere(name="early")))
    browser.run("letAll('stream')")
    browser.wait_text("early", "table")


def test_progress_is_shown_over_an_older_list(gated, browser):
    open_slow(gated, browser)
    browser.wait_text("No jobs yet")
    wait_until(lambda: browser.run("return told.includes('open')"), "the stream")
    browser.run("hold('jobs')")
    job = gated.submit(sphere(name="first"))
    wait_until(lambda: browser.run("return told.includes('progress')"), "progress")
    browser.run("letAll('jobs')")
    browser.wait_text("50 %", "table")


def test_progress_stays_when_a_job_is_read_again(gated, browser):
    open_slow(gated, browser)
    wait_until(lambda: browser.run("return told.includes('open')"), "the stream")
    job = gated.submit(sphere(name="first"))
    for where, label in (("table", "label-1"), (".live", "label-2")):
        browser.wait_text("50 %", where)
        edited = gated.request("PATCH", f"/v1/jobs/{job}", f'{{"labels": ["{label}"]}}', {"Content-Type": "application/json"})
        assert edited.status == 200
        browser.wait_text(label, "main")
        assert "50 %" in browser.text(where)
        if where == "table":
            browser.press("first", "table")


def test_an_answer_that_comes_late_replaces_no_newer_one(gated, browser):
    open_slow(gated, browser, "jobs")
    gated.submit(sphere(name="first"))
    wait_until(lambda: browser.run("while (held('jobs') > 1) letOne('jobs', 1); return document.body.innerText.includes('first')"),
               "a later answer")
    assert "first" in browser.run("""
        letOne('jobs', 0);
        return new Promise(done => setTimeout(() => requestAnimationFrame(() => done(document.body.innerText))));""")


PROGRESS_SHOWN = "return [...document.querySelectorAll('tbody progress')].map(e => e.value).join()"


def test_rows_of_waiting_jobs_have_their_order(gated, browser):
    first = gated.submit(sphere(name="first"))
    gated.wait_worker(first)
    later = [gated.submit(sphere(name=name, queue={"priority": priority})) for name, priority in (("second", 0), ("third", 0), ("urgent", 1))]
    needs = gated.submit(sphere(name="needs", queue={"depends_on": [later[1]]}))
    browser.open(gated)
    browser.wait_text("needs", "tbody")

    def states():
        """The line below the state, of each row."""
        return dict(zip(browser.texts("tbody .name a[href^='#/jobs/']"), browser.texts("tbody .row-state")))
    wait_until(lambda: "next of anyone" in states().get("urgent", ""), "the order")
    assert "after 1 of anyone" in states()["second"] and "after 2 of anyone" in states()["third"]
    assert "of anyone" not in states()["first"] + states()["needs"]
    browser.press("third", "tbody")
    browser.wait_text("after 2 earlier or more urgent jobs of anyone", ".lead")
    browser.press("Queue", "header")
    browser.press("needs", "tbody")
    browser.wait_text("The job starts when the jobs that it depends on have ended", ".lead")
    browser.press("third", ".facts-list")  # the job that it waits for, by its name
    browser.wait_text("third", "h1")
    browser.press("Queue", "header")
    for job in (first, later[2], later[0], later[1], needs):
        gated.open_gate(job)
        gated.wait_state(job, "succeeded")
    wait_until(lambda: all("Done" in text for text in states().values()), "the end of all")


def test_rows_have_the_outcome_and_the_worst_rating(service, browser):
    job = service.submit(sphere(name="rated"))
    service.wait_state(job, "succeeded")
    report = service.get(f"/v1/jobs/{job}/results/report.json").json
    ratings = [measure["rating"] for measure in report["ratings"].values()]
    worst = next(word for word in ("poor", "fair", "good") if word in ratings)
    browser.open(service)
    browser.wait_text(f"converged, packing {worst}", "tbody .row-state")


def test_jobs_are_filtered_sorted_and_changed(gated, browser):
    for name in ("beta", "alpha", "gamma"):
        gated.submit(sphere(name=name, queue={"labels": [name]}))
    browser.open(gated)
    wait_until(lambda: len(browser.all("tbody tr")) == 3, "three rows")

    def names():
        return browser.texts("tbody .name a[href^='#/jobs/']")
    assert names() == ["gamma", "alpha", "beta"]
    browser.press("Job", "thead")
    wait_until(lambda: names() == ["alpha", "beta", "gamma"], "the order by name")
    browser.one("tbody tr:nth-child(3) input").click()
    browser.press("Cancel", ".actions")
    browser.wait_text("Cancelled", "tbody tr:nth-child(3)")
    # all of them, at once
    browser.one(".actions input").click()
    browser.wait_text("3 selected", ".actions")

    def all_rows_say(word, column=".row-state"):
        wait_until(lambda: all(word in text for text in browser.texts(f"tbody {column}")), word)
    for button, word in (("Cancel", "Cancelled"), ("Retry", "ing"), ("Pause", "Paused"), ("Resume", "ing")):
        browser.press(button, ".actions")
        all_rows_say(word)
    browser.press("Priority …", ".actions")
    prompt = browser.driver.switch_to.alert
    prompt.send_keys("7")
    prompt.accept()
    all_rows_say("7", ".priority")
    text, _, label = browser.all(".filter input")
    text.send_keys("AM\n")
    wait_until(lambda: names() == ["gamma"], "the rows with that in their names")
    text.send_keys(Keys.BACKSPACE, Keys.BACKSPACE)
    label.send_keys("alpha\n")
    wait_until(lambda: names() == ["alpha"], "the rows of a label")


def test_filters_keep_what_is_typed_while_a_job_runs(service, browser):
    """Each line of progress renders the queue again."""
    for name in ("alpha", "beta"):
        service.wait_state(service.submit(sphere(name=name, queue={"labels": [f"of {name}"]})), "succeeded")
    running = service.submit(long_sphere(name="running") | {"solver": ONE_THREAD})
    browser.open(service)
    browser.wait_text("Relaxing", "tbody")

    def names():
        return browser.texts("tbody .name a[href^='#/jobs/']")
    field = browser.one(".filter input")
    browser.run("arguments[0].focus()", field)
    for typed in ("a", "al", "alp"):
        browser.keys(typed[-1])
        before = browser.run(PROGRESS_SHOWN)
        wait_until(lambda: names() != ["running", "beta", "alpha"] or browser.run(PROGRESS_SHOWN) != before, "a rendering")
        assert browser.run("return [arguments[0].value, document.activeElement === arguments[0]]", field) == [typed, True]
    wait_until(lambda: names() == ["alpha"], "the rows, without Enter")
    assert browser.run("return location.hash") == "#/?text=alp"
    browser.driver.refresh()
    wait_until(lambda: names() == ["alpha"], "the rows of the address")
    assert browser.run("return document.querySelector('.filter input').value") == "alp"
    browser.press("of alpha", "tbody")
    wait_until(lambda: "label=of+alpha" in browser.run("return location.hash"), "the label in the address")
    browser.press("Queue", "header")
    wait_until(lambda: len(names()) == 3, "all rows")
    browser.run("document.querySelector('tbody a.state.running').click()")
    wait_until(lambda: names() == ["running"], "the rows of a state")
    assert browser.run("return location.hash") == "#/?state=running"
    browser.run("history.back()")
    wait_until(lambda: len(names()) == 3, "all rows again")
    service.post(f"/v1/jobs/{running}/cancel")


def test_buttons_for_selected_jobs_stay_in_sight(gated, browser):
    for number in range(30):
        gated.submit(sphere(name=f"job {number}"))
    browser.open(gated)
    wait_until(lambda: len(browser.all("tbody tr")) == 30, "all rows")
    browser.one("tbody tr:last-child input").click()  # scrolls to the end
    browser.run("scrollTo(0, document.documentElement.scrollHeight)")
    browser.wait_text("1 selected", ".actions")
    seen = browser.run("""const button = document.querySelector(".actions button"), {left, top, width, height} = button.getBoundingClientRect();
        return button.contains(document.elementFromPoint(left + width / 2, top + height / 2));""")
    assert seen, "the first button lies outside of the window or under something"


# Whether something covers the middle of what has the focus; null: it lies outside of the window.
COVERED = """
  const e = document.activeElement, {left, right, top, bottom} = e.getBoundingClientRect();
  if (bottom <= 0 || top >= innerHeight) return null;
  const found = document.elementFromPoint(Math.min(left + 4, (left + right) / 2), (Math.max(top, 0) + Math.min(bottom, innerHeight)) / 2);
  return !(e.contains(found) || found && found.contains(e) && !found.closest(".actions"));
"""


@pytest.mark.parametrize("width", [800, 390])
def test_focus_is_never_behind_the_bar(gated, browser, width):
    for number in range(20):
        gated.submit(sphere(name=f"job {number}"))
    browser.command("Emulation.setDeviceMetricsOverride", width=width, height=500, deviceScaleFactor=1, mobile=False)
    try:
        browser.open(gated)
        wait_until(lambda: len(browser.all("tbody tr")) == 20, "all rows")
        browser.one("tbody tr:nth-child(20) input").click()
        browser.wait_text("1 selected", ".actions")
        seen = []
        for _ in range(80):  # upwards: what gets the focus is at the top of the window
            browser.chord(Keys.SHIFT, Keys.TAB)
            seen.append(browser.run("const e = document.activeElement; return [e.innerText || e.ariaLabel || e.tagName, Boolean(e.closest('tbody'))]"))
            assert browser.run(COVERED) is False, seen[-3:]
            if not seen[-1][1]:
                break
        assert len(seen) > 30 and not seen[-1][1]
    finally:
        browser.command("Emulation.clearDeviceMetricsOverride")


# Stands for the notifications of the browser, which no test can see.
NOTIFIED = """
  window.notified = [];
  window.Notification = class {
    constructor(text) { window.notified.push(text); }
    static async requestPermission() { window.asked = (window.asked || 0) + 1; return window.answer; }
  };
  window.answer = "granted";
"""


def test_a_notification_comes_at_the_end_if_it_was_permitted(gated, browser):
    jobs = {answer: gated.submit(sphere(name=answer)) for answer in ("granted", "denied")}
    with browser.before_the_page(NOTIFIED):
        for answer, job in jobs.items():
            gated.wait_worker(job)
            browser.open(gated, f"#/jobs/{job}")
            browser.wait_text("50 %", ".live")
            browser.run("window.answer = arguments[0]", answer)
            browser.press("Notify me at the end", ".live")
            if answer == "granted":
                browser.wait_text("A notification follows", ".live")
            wait_until(lambda: browser.run("return window.asked") == 1, "the question")
            assert browser.run("return window.notified") == []  # not before the end
            gated.open_gate(job)
            browser.wait_text("Done", "h1")
            expected = ["granted: Done"] if answer == "granted" else []
            wait_until(lambda: browser.run("return window.notified") == expected, "the notification")


def test_the_queue_shows_previews_of_own_jobs(closed_service, browser):
    secret = new_token(closed_service, "carol")
    frames = {"frames": "1-2", "by_frame": {"/surface/analytic/radius": [1, 2]}}
    jobs = [with_token(closed_service, token, "POST", "/v1/jobs", sphere(name=name, **more)).json["id"]
            for token, name, more in ((secret, "own", {}), (closed_service.token, "other", {}), (secret, "without", {"output": {"preview": False}}),
                                      (secret, "film", {"queue": frames}))]
    wait_until(lambda: all(with_token(closed_service, closed_service.token, "GET", f"/v1/jobs/{job}").json["state"] == "succeeded" for job in jobs), "the ends")
    sign_in(browser, closed_service, secret=secret)
    shown = wait_until(lambda: browser.run("""const images = [...document.querySelectorAll("td.name img")];
        return images.length === 2 && images.every(image => image.naturalWidth) &&
          images.map(image => [image.getAttribute("src"), image.naturalWidth])"""), "two pictures")
    assert f"/{jobs[3]}/" in shown[0][0] and f"/{jobs[0]}/" in shown[1][0] and shown[0][1] == shown[1][1] == 64  # the newest first
    assert len(browser.all("td.name span.thumbnail")) == 1
    asked = browser.run("return performance.getEntriesByType('resource').map(entry => new URL(entry.name).pathname)")
    assert any(jobs[0] in path for path in asked) and not any(jobs[1] in path for path in asked)
    assert not any(jobs[2] in path and "thumbnail" in path for path in asked)


def test_points_of_a_running_job_are_shown(service, browser):
    job = service.submit(long_sphere(count=2000, name="long"))
    browser.open(service, f"#/jobs/{job}")
    browser.wait_text("2\u202f000 points", ".stats")
    assert browser.run("return document.querySelector('canvas.points').getBoundingClientRect().top < 0.8 * innerHeight")  # above the fold
    wait_until_drawn(browser)
    service.post(f"/v1/jobs/{job}/cancel")
    browser.wait_text("Cancelled", "h1")
    wait_until(lambda: not browser.all("canvas.points"), "no live points")


def test_a_wait_whose_signal_is_aborted_already_ends_at_once(service, browser):
    """A view that is left while it reads a snapshot waits for no further one."""
    browser.open(service)
    assert browser.driver.execute_async_script("""const [done] = arguments;
        import(new URL("page/api.js", document.baseURI)).then(api => api.wait(1000, AbortSignal.abort())).catch(error => done(error.name));
        """) == "AbortError"


def test_an_administrator_sees_what_runs_and_drains(closed_service, browser, tmp_path):
    closed_service.end()
    closed_service.start("--worker", gated_worker(tmp_path))
    sign_in(browser, closed_service, secret=closed_service.token)
    job = with_token(closed_service, closed_service.token, "POST", "/v1/jobs", sphere(name="busy")).json["id"]
    wait_until(lambda: "busy" in browser.texts(".busy li a", "textContent"), "the job that runs")
    for button, then, told in (("Hold", "Release", "an administrator holds the queue"), ("Release", "Hold", None),
                               ("Drain", "Undrain", "an administrator drains it"), ("Undrain", "Drain", None)):
        browser.press(button, ".load")
        browser.wait_text(then, ".load .buttons")
        assert browser.texts(".load .notice") == [] if told is None else told in browser.text(".load .notice")
    closed_service.open_gate(job)
    browser.wait_text("Done", "table")
    wait_until(lambda: not browser.all(".busy"), "nothing to run")


def test_a_keyboard_is_enough(service, browser):
    """From the queue to a job and its points, and these turned."""
    service.wait_state(service.submit(sphere(name="first")), "succeeded")
    browser.open(service)
    browser.wait_text("Done", "table")

    def go_to(word):
        for _ in range(60):
            browser.keys(Keys.TAB)
            if browser.run("const e = document.activeElement; return (e.innerText || e.className).trim()") == word:
                return
        raise AssertionError(f"no TAB leads to {word}")
    go_to("first")
    browser.keys(Keys.ENTER)
    browser.wait_text("The solve has converged")
    assert browser.run("return document.activeElement.id") == "main"  # what is new is read from its beginning
    go_to("Points in 3-D")
    browser.keys(Keys.ENTER)
    browser.wait_text("200 points", ".stats")
    go_to("points")
    before = browser.run(PICTURE, "Home")[0]
    browser.keys(Keys.ARROW_LEFT)
    wait_until(lambda: browser.run(PICTURE, "no key")[0] != before, "the points to be turned")


def test_times_are_in_the_zone_of_the_viewer(service, browser):
    """And numbers have one form, whatever the language of the browser."""
    job = service.submit(sphere(count=1500, name="INFO"))
    service.wait_state(job, "succeeded")
    spacing = service.get(f"/v1/jobs/{job}/results/report.json").json["spacing"]
    created = datetime.datetime.fromisoformat(service.job(job)["created"])
    try:
        for zone, locale in (("Asia/Tokyo", "tr-TR"), ("America/Bogota", "de-DE")):
            browser.command("Emulation.setTimezoneOverride", timezoneId=zone)
            browser.command("Emulation.setLocaleOverride", locale=locale)
            browser.open(service, f"#/jobs/{job}")
            browser.wait_text(f"{spacing:.4g}", ".measures")
            assert "1\u202f500" in browser.text(".measures")
            there = created + datetime.timedelta(hours={"Asia/Tokyo": 9, "America/Bogota": -5}[zone])
            assert f"{there:%H:%M:%S}" in browser.text(".facts-list")
    finally:
        browser.command("Emulation.setTimezoneOverride", timezoneId="")
        browser.command("Emulation.setLocaleOverride")


def test_a_service_that_is_killed_and_comes_back(new_service, browser, tmp_path):
    gated = new_service("--worker", gated_worker(tmp_path), "--workers", 1).start()
    job = gated.submit(sphere(name="one"))
    browser.open(gated)
    browser.wait_text("Running", "table")
    port = gated.address.rpartition(":")[2]
    gated.end(signal.SIGKILL)
    gated.open_gate(job)
    gated.options[gated.options.index("--listen") + 1] = f"127.0.0.1:{port}"
    gated.start()
    gated.wait_state(job, "succeeded")
    browser.wait_text("Done", "table")  # nobody has reloaded the page


HOSTILE = "<img src=x onerror=\"document.title='owned'\"><script>document.title='owned'</script>\u202e${7*7}"


def test_names_from_strangers_are_text(service, browser):
    job = service.submit(sphere(name=HOSTILE, queue={"labels": ["<b>l</b>"]}))
    service.wait_state(job, "succeeded")
    browser.open(service)
    browser.wait_text("onerror", "table")
    browser.wait_text("<b>l</b>", "table")
    assert not browser.all("main img:not(.thumbnail), main script, main b") and browser.driver.title != "owned"


def test_logs_and_messages_from_strangers_are_text(service, browser):
    job = service.submit(sphere(name=HOSTILE))
    service.wait_state(job, "succeeded")
    log = next((service.state / "results" / job).glob("*.log"), None) or service.state / "attempts" / f"{job}.1" / "worker.log"
    log.write_text(f"\x1b[31m{HOSTILE}\n")
    browser.open(service, f"#/jobs/{job}")
    browser.press("Log", "main")
    browser.wait_text("onerror", "pre.log")
    assert not browser.all("main img:not(.preview), main script, main b") and browser.driver.title != "owned"


TALKING_WORKER = """#!/bin/sh
cat >/dev/null
n=0
while :; do
  n=$((n + 1))
  echo "line $n of the log" >&2
  echo '{"phase":"relax","fraction":0.5}' >&3
  sleep 0.05
done
"""


def test_a_log_follows_its_attempt(new_service, tmp_path, browser):
    worker = tmp_path / "talking-worker"
    worker.write_text(TALKING_WORKER)
    worker.chmod(0o700)
    service = new_service("--worker", worker).start()
    job = service.submit(sphere())
    browser.open(service, f"#/jobs/{job}")
    browser.wait_text("line 1 of the log", "pre.log")  # open while the attempt runs
    seen = browser.text("pre.log").count("line")
    browser.wait_text(f"line {seen + 10} of the log", "pre.log")
    assert browser.run("const log = document.querySelector('pre.log'); return log.scrollTop + log.clientHeight + 40 >= log.scrollHeight")
    browser.run("document.querySelector('pre.log').scrollTop = 0")
    seen = browser.text("pre.log").count("line")
    browser.wait_text(f"line {seen + 10} of the log", "pre.log")
    assert browser.run("return document.querySelector('pre.log').scrollTop") == 0  # who reads is not pulled to the end
    service.post(f"/v1/jobs/{job}/cancel")
    service.wait_state(job, "cancelled")


def test_a_job_is_watched_until_it_has_converged(service, browser):
    """The plots move while it runs; afterwards they have all sweeps, and the report is there."""
    job = service.submit(long_sphere(name="long") | {"solver": ONE_THREAD})
    browser.open(service, f"#/jobs/{job}")
    browser.wait_text("Relaxing", ".live")
    wait_until(lambda: len(browser.all("figure.chart canvas")) == 5, "live plots")
    seen = browser.text("figure.chart:nth-child(2) [role=img]", "ariaLabel")
    wait_until(lambda: browser.text("figure.chart:nth-child(2) [role=img]", "ariaLabel") != seen, "new sweeps")
    browser.press("Cancel", "main")
    browser.wait_text("Cancelled", "h1")
    done = service.submit(sphere(count=2000, name="short"))
    browser.open(service, f"#/jobs/{done}")
    browser.wait_text("The solve has converged")
    report = service.get(f"/v1/jobs/{done}/results/report.json").json
    browser.wait_text(f"{report['quality']['hex_fraction']:.4g}", ".measures")
    wait_until(lambda: f"{report['sweeps_total']} sweeps" in browser.text("figure.chart [role=img]", "ariaLabel"), "all sweeps")
    assert set(browser.texts(".results a")) == {"points.ply", "preview.png", "report.json"}


def test_a_failed_job_says_why(service, browser):
    job = service.submit({"version": 1, "name": "empty", "surface": {"bspline": {"dims": [4, 4, 4], "coefficients": [1] * 64}},
                          "sampling": {"count": 100}})
    service.wait_state(job, "failed")
    browser.open(service, f"#/jobs/{job}")
    browser.wait_text(service.job(job)["error"]["message"], ".trouble")
    browser.wait_text("Failed", "h1")


def test_a_result_is_delivered_again(new_service, browser, tmp_path):
    service = new_service("--output_roots", tmp_path).start()
    job = service.submit(sphere(60, output={"preview": False, "directory": f"{tmp_path}/show"}))
    service.wait_state(job, "succeeded")
    (tmp_path / "show" / "points.ply").unlink()
    browser.open(service, f"#/jobs/{job}")
    browser.wait_text("delivered")
    browser.press("Deliver again")
    wait_until(lambda: (tmp_path / "show" / "points.ply").exists() and service.job(job)["delivery"]["state"] == "delivered",
               "the copy")


def test_a_job_is_retried_with_the_jobs_that_depend_on_it(service, browser):
    first = service.submit(long_sphere(limits={"timeout_s": 0.1}))
    service.wait_state(first, "failed", "timed_out")
    second = service.submit(sphere(queue={"depends_on": [first]}))
    before = service.wait_state(second, "failed")["revision"]
    browser.open(service, f"#/jobs/{first}")
    browser.press("Retry with dependents")
    wait_until(lambda: service.job(second)["revision"] > before, "the retry")


def test_the_frames_of_an_array(service, browser):
    job = service.submit(sphere(name="film", queue={"frames": "1-3", "by_frame": {"/surface/analytic/radius": [1, 1.1, 1.2]}}))
    service.wait_state(job, "succeeded")
    browser.open(service, f"#/jobs/{job}")
    wait_until(lambda: len(browser.all("button.frame.succeeded")) == 3, "three cells")
    wait_until(lambda: browser.run("const i = document.querySelector('button.frame img'); return i && i.naturalWidth > 0"), "the picture of the frame")
    browser.one("button.frame:nth-child(2)").click()
    browser.wait_text("points.ply", ".results")
    browser.open(service, f"#/jobs/{job}/points")
    browser.wait_text("Frame 1", ".film")
    browser.press("Play", ".film")
    wait_until(lambda: "Frame 3" in browser.text(".film"), "the film")


def test_the_bar_of_an_array_has_its_frames_by_state(gated, browser):
    job = gated.submit(sphere(name="film", queue={"frames": "1-4", "by_frame": {"/surface/analytic/radius": [1, 1.1, 1.2, 1.3]}}))
    after = gated.submit(sphere(name="later", queue={"depends_on": [job]}))
    browser.open(gated, f"#/jobs/{job}")
    gated.open_gate(f"{job}.1")
    browser.wait_text("1 done", "section[aria-label=Frames]")
    browser.wait_text("left", "section[aria-label=Frames]")
    shares = browser.run("return [...document.querySelectorAll('.bar > span')].map(e => [e.className, e.offsetWidth / e.parentNode.offsetWidth])")
    assert dict(shares)["succeeded"] == pytest.approx(0.25, abs=0.01) and sum(share for _, share in shares) == pytest.approx(1, abs=0.01)
    wait_until(lambda: browser.run("const i = document.querySelector('button.frame img'); return !i || i.hidden"), "no frame of a picture that is missing")
    browser.open(gated, f"#/jobs/{after}")
    browser.wait_text("Waits for", ".facts-list")
    browser.press("film", ".facts-list")  # its name
    browser.wait_text("film", "h1")
    for frame in (2, 3, 4):
        gated.open_gate(f"{job}.{frame}")
    gated.open_gate(after)
    gated.wait_state(after, "succeeded")


def test_an_administrator_sees_what_runs_on_each_host(closed_service, browser, tmp_path):
    closed_service.end()
    closed_service.start("--worker", gated_worker(tmp_path))
    sign_in(browser, closed_service, secret=closed_service.token)
    browser.press("Service", "header")
    browser.wait_text("Nothing runs", "main")
    job = with_token(closed_service, closed_service.token, "POST", "/v1/jobs", sphere(solver={"threads": 1})).json["id"]
    wait_until(lambda: browser.texts(".hosts tbody td")[:3] == [socket.gethostname(), "1", "1"], "the attempt on this host")
    closed_service.open_gate(job)
    browser.wait_text("Nothing runs", "main")


def test_an_administrator_sees_the_tokens(closed_service, browser):
    secret = new_token(closed_service, "dora", "--scopes", "read,submit", "--max-priority", "5")
    sign_in(browser, closed_service, secret=closed_service.token)
    browser.press("Service", "header")
    browser.wait_text("dora", ".tokens")
    cells = browser.texts(".tokens tbody td")
    row = cells.index("dora")
    assert cells[row + 1:row + 3] == ["read, submit", "5"] and len(cells[row + 4]) == 12
    assert secret not in browser.run("return document.body.innerHTML")


def test_an_administrator_sees_what_users_hold(closed_service, browser):
    secret = new_token(closed_service, "erin")
    job = with_token(closed_service, secret, "POST", "/v1/jobs", sphere(name="held")).json["id"]
    wait_until(lambda: with_token(closed_service, secret, "GET", f"/v1/jobs/{job}").json["state"] == "succeeded", "the end")
    sign_in(browser, closed_service, secret=secret)
    assert "Service" not in browser.text("header")
    browser.press("Sign out")
    browser.one("#token")
    sign_in(browser, closed_service, secret=closed_service.token)
    assert browser.run("return document.activeElement.id") == "main"  # the focus of the form is not lost
    browser.press("Service", "header")
    row = wait_until(lambda: next((text for text in browser.texts(".users tbody tr") if text.startswith("erin")), None), "the user")
    assert row.split()[1:3] == ["0", "0"] and row.split()[5] == "1"  # no attempt, no thread; 0 B of memory; a result
    browser.press("Jobs", ".users")
    browser.wait_text("held", "tbody")


def test_unresolved_frames_are_marked(service, browser):
    service.wait_state(job := service.submit(PARTLY_UNRESOLVED), "succeeded")
    browser.open(service, f"#/jobs/{job}")
    wait_until(lambda: len(browser.all("button.frame")) == 5, "five cells")
    assert [text.split() for text in browser.texts("button.frame.warning", "textContent")] == [
        [f"!{frame}:", "Done,", "unresolved"] for frame in (2, 4, 5)]
    assert len(browser.all("button.frame.succeeded")) == 2


def test_a_warning_of_several_frames_is_shown_once(service, browser):
    """The walls of frames 1 and 2 are thin, by other measures."""
    box = {"analytic": {"shape": "box", "center": [0, 0, 0], "half_size": [1, 1, 0.5]}}
    job = service.submit({"version": 1, "surface": box, "features": True, "sampling": {"count": 400}, "output": {"preview": False},
                          "queue": {"frames": "1-3", "by_frame": {"/surface/analytic/half_size": [[1, 1, 0.02], [1, 1, 0.015], [1, 1, 0.5]]}}})
    service.wait_state(job, "succeeded")
    text = service.get(f"/v1/jobs/{job}/tasks").json["tasks"][0]["notes"]["warnings"][0]
    browser.open(service, f"#/jobs/{job}")
    browser.wait_text("Frames 1-2: ", "[aria-label=Frames]")
    assert browser.texts("[aria-label=Frames] .notice") == [f"Frames 1-2: {text} (the numbers are those of the first frame)"]


@pytest.fixture
def narrow(browser):
    """The browser with the screen of a telephone."""
    browser.command("Emulation.setDeviceMetricsOverride", width=390, height=800, deviceScaleFactor=1, mobile=False)
    yield browser
    browser.command("Emulation.clearDeviceMetricsOverride")


def test_tables_of_a_job_fit_a_narrow_screen(service, narrow):
    service.wait_state(job := service.submit(sphere(name="film", queue={
        "frames": "1-2", "by_frame": {"/surface/analytic/radius": [1, 1.1]}})), "succeeded")
    narrow.open(service, f"#/jobs/{job}?frame=1")
    narrow.wait_text("points.ply", ".results")
    narrow.wait_text("Six neighbours", ".measures")
    hidden = dict(narrow.run("""return [...document.querySelectorAll("div.scroll")].map(part =>
        [part.getAttribute("aria-label"), part.scrollWidth - part.clientWidth])"""))
    assert hidden["Files"] == hidden["Measures"] == 0, hidden
    # of an attempt, how it ended and the button for its log are in sight; its host and memory need not be
    ends = narrow.run("""return [...document.querySelectorAll("[aria-label='List of attempts'] th")].map(heading =>
        [heading.innerText, heading.getBoundingClientRect().right])""")
    button = narrow.run("return document.querySelector(\"[aria-label='List of attempts'] td button\").getBoundingClientRect().right")
    assert dict(ends)["End"] <= 390 and button <= 390, (ends, button)
    # the sentence of a measure has half of the width
    assert narrow.run("return document.querySelector('.measures .hint').offsetWidth") >= 180


def test_measures_of_two_jobs_fit_a_narrow_screen(service, narrow):
    service.wait_state(job := service.submit(sphere(name="graded torus")), "succeeded")
    narrow.open(service, f"#/compare/{job}/{job}")
    narrow.one(".measures")
    assert narrow.run("const part = document.querySelector('.measures').parentNode; return part.scrollWidth - part.clientWidth") == 0


PICTURE = """
  const canvas = document.querySelector("canvas.points"), picture = document.createElement("canvas");
  [picture.width, picture.height] = [canvas.width, canvas.height];
  return new Promise(done => requestAnimationFrame(() => {
    canvas.dispatchEvent(new KeyboardEvent("keydown", {key: arguments[0], bubbles: true}));
    requestAnimationFrame(() => {
      picture.getContext("2d").drawImage(canvas, 0, 0);
      const {data} = picture.getContext("2d").getImageData(0, 0, picture.width, picture.height);
      let hash = 0, drawn = 0;
      for (let i = 0; i < data.length; i += 4) {
        hash = (hash * 31 + data[i] + 7 * data[i + 1] + 13 * data[i + 2]) | 0;
        drawn += data[i] + data[i + 1] + data[i + 2] !== data[0] + data[1] + data[2];
      }
      done([hash, drawn / (data.length / 4)]);
    });
  }));
"""


# The same, without a key.
REPAINTED = PICTURE.replace('canvas.dispatchEvent(new KeyboardEvent("keydown", {key: arguments[0], bubbles: true}))', 'dispatchEvent(new Event("theme"))')


def wait_until_drawn(browser):
    """The hash of the picture of points, seen from the first direction, as soon as points cover a tenth of it."""
    def drawn():
        hash_of, share = browser.run(PICTURE, "Home")
        return share > 0.1 and [hash_of]

    return wait_until(drawn, "the points to be drawn")[0]


def test_many_points_are_turned(service, browser):
    job = service.submit(sphere(count=2000, name="many", solver={"max_sweeps": 1}, output={"preview": False, "ply": {"properties": ["all"]}}))
    service.wait_state(job, "succeeded")
    browser.open(service, f"#/jobs/{job}/points")
    browser.wait_text("2\u202f000 points", ".stats")  # drawn by the processor here, so the window is small
    before = wait_until_drawn(browser)
    after, _ = browser.run(PICTURE, "ArrowLeft")
    assert after != before
    up = next(s for s in browser.all(".controls select") if s.text.split() == ["z", "y"])
    browser.choose("y", up)
    wait_until(lambda: browser.run(PICTURE, "no key")[0] != after, "another side to be up")
    browser.choose("z", up)
    canvas = browser.one("canvas.points")
    canvas.click()
    browser.wait_text("kappa1", ".picked")
    for line in ("kappa\n", "spacing_local\n"):
        assert line in browser.text(".picked")


def test_controls_of_the_view_of_points(service, browser):
    """Each changes the picture; size, background, direction, range, centre."""
    job = service.submit(sphere(count=1000, output={"preview": False}))
    service.wait_state(job, "succeeded")
    browser.open(service, f"#/jobs/{job}/points")
    browser.wait_text("1\u202f000 points", ".stats")
    assert not browser.all(".legend")  # plain shading
    wait_until_drawn(browser)
    assert browser.texts(".axes text", "textContent") == ["x", "y", "z"]
    bar = float(browser.text(".scale-bar"))
    assert 0.1 <= bar <= 1 and browser.run("return document.querySelector('.scale-bar').offsetWidth") > 20

    def changes(act, what):
        before = browser.run(REPAINTED)[0]
        act()
        wait_until(lambda: browser.run(REPAINTED)[0] != before, what)

    def slide(label, value):
        browser.run("arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event('input', {bubbles: true}))", browser.one(label), value)
    changes(lambda: slide(".controls label input[type=range]", "0.5"), "smaller points")
    changes(lambda: browser.choose("black", select_of(browser, "As", "the", "page", "White", "Grey", "Black")), "another background")
    directions = select_of(browser, "Free", "Front", "Back", "Right", "Left", "Top", "Bottom")
    changes(lambda: browser.choose("Front", directions), "the front")
    place = browser.run("return [...document.querySelectorAll('.axes line')].map(e => [+e.getAttribute('x2'), +e.getAttribute('y2')].map(Math.round))")
    assert place == [[22, 0], [0, 0], [0, -22]]  # x to the right, z up
    changes(lambda: browser.choose("spacing_local", browser.one(".controls select")), "colours of the spacing")
    browser.wait_text("spacing", ".legend")
    changes(lambda: slide(".histogram input", browser.run("return document.querySelectorAll('.histogram input')[1].value")), "another range")
    double = "const c = document.querySelector('canvas.points'); c.dispatchEvent(new MouseEvent('dblclick', {bubbles: true, clientX: c.getBoundingClientRect().left + c.clientWidth / 2 + 30, clientY: c.getBoundingClientRect().top + c.clientHeight / 2}))"
    changes(lambda: slide(".controls label input[type=range]", "1.5"), "points without gaps")
    changes(lambda: browser.run(double), "another centre")
    browser.press("Full screen", ".controls")
    wait_until(lambda: browser.run("return document.fullscreenElement && document.fullscreenElement.className") == "stage", "the full screen")
    size = "const e = document.querySelector('canvas.points'); return [e.clientWidth, e.clientHeight, innerWidth, innerHeight]"
    wait_until(lambda: (now := browser.run(size))[:2] == now[2:], "the points on the whole screen")
    browser.run("document.exitFullscreen()")
    wait_until(lambda: not browser.run("return document.fullscreenElement"), "the page again")
    wait_until_drawn(browser)


def select_of(browser, *words):
    return next(s for s in browser.all(".controls select") if s.text.split() == list(words))


def test_points_are_upright_as_in_the_report(service, browser):
    for up in "yz":
        job = service.submit(sphere(count=100, output={"preview": {"size": [64, 64], "up": up}}))
        service.wait_state(job, "succeeded")
        assert service.get(f"/v1/jobs/{job}/results/report.json").json["up"] == up
        browser.open(service, f"#/jobs/{job}/points")
        browser.wait_text("100 points", ".stats")
        wait_until(lambda: select_of(browser, "z", "y").get_attribute("value") == up, f"{up} to be up")


# Of the pixels of the canvas that are not its background, the contrast with that (WCAG 2), in order.
CONTRASTS = """
  const canvas = document.querySelector("canvas.points"), picture = document.createElement("canvas");
  [picture.width, picture.height] = [canvas.width, canvas.height];
  const linear = part => (part <= 0.04045 * 255 ? part / 255 / 12.92 : ((part / 255 + 0.055) / 1.055) ** 2.4);
  const light = (data, i) => 0.05 + 0.2126 * linear(data[i]) + 0.7152 * linear(data[i + 1]) + 0.0722 * linear(data[i + 2]);
  return new Promise(done => requestAnimationFrame(() => {
    canvas.dispatchEvent(new KeyboardEvent("keydown", {key: "Home", bubbles: true}));
    requestAnimationFrame(() => {
      picture.getContext("2d").drawImage(canvas, 0, 0);
      const {data} = picture.getContext("2d").getImageData(0, 0, picture.width, picture.height);
      const ground = light(data, 0), found = [];
      for (let i = 0; i < data.length; i += 4)
        if (data[i] !== data[0] || data[i + 1] !== data[1] || data[i + 2] !== data[2])
          found.push(Math.max(light(data, i), ground) / Math.min(light(data, i), ground));
      done(found.sort((a, b) => a - b));
    });
  }));
"""


def test_points_of_the_least_value_are_visible_in_the_dark(service, browser):
    service.wait_state(job := service.submit(sphere(count=300, output={"preview": False, "ply": {"properties": ["all"]}})), "succeeded")
    try:
        browser.emulate(prefers_color_scheme="dark")
        browser.open(service, f"#/jobs/{job}/points")
        browser.wait_text("300 points", ".stats")
        browser.choose("kappa", browser.one(".controls select"))
        for word, value in (("From", "100"), ("To", "200")):  # all are below
            box = wait_until(lambda: next((label for label in browser.all(".controls label") if label.text == word), None), word)
            field = box.find_element("css selector", "input")
            browser.run("arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event('change', {bubbles: true}))", field, value)
            wait_until(lambda: browser.run("return arguments[0].value", field) == value, word)
        contrasts = browser.run(CONTRASTS)
    finally:
        browser.emulate()
    assert len(contrasts) > 10000
    assert contrasts[len(contrasts) // 2] > 2  # half of the pixels
    assert contrasts[len(contrasts) // 10] > 1.4  # and all but rims and the darkest gaps


def test_rims_of_discs_are_antialiased(service, browser):
    """The outline of a disc has pixels between its colours and the background."""
    service.wait_state(job := service.submit(sphere(count=20, output={"preview": False})), "succeeded")
    browser.open(service, f"#/jobs/{job}/points")
    browser.wait_text("20 points", ".stats")
    contrasts = browser.run(CONTRASTS)
    darkest = contrasts[-1]
    assert sum(1 < c < 1 + (darkest - 1) / 8 for c in contrasts) > 50


def test_the_view_of_points_has_no_debug_text(service, browser):
    service.wait_state(job := service.submit(sphere(count=100, output={"preview": False})), "succeeded")
    browser.open(service, f"#/jobs/{job}/points")
    browser.wait_text("100 points", ".stats")
    assert not [word for word in ("draw call", "graphics card", " ms", "script") if word in browser.text("main")]


def test_neighbours_are_counted_as_in_the_report(service, browser):
    """And the mesh is drawn with them."""
    job = service.submit(sphere(count=1000, output={"preview": False, "mesh": True}))
    service.wait_state(job, "succeeded")
    share = service.get(f"/v1/jobs/{job}/results/report.json").json["quality"]["hex_fraction"]
    browser.open(service, f"#/jobs/{job}/points")
    browser.wait_text("1\u202f000 points", ".stats")
    browser.choose("neighbours", browser.one(".controls select"))
    browser.wait_text("six:", ".legend")
    six = int(browser.text(".legend").split("six: ")[1].split(",")[0].replace("\u202f", ""))
    assert abs(six / 1000 - share) < 0.003  # where four cells nearly meet in a point, both are right
    browser.choose("wire", next(s for s in browser.all(".controls select") if "With points" in s.text))
    wait_until(lambda: browser.run("return document.querySelector('canvas.points').dataset.calls") == "2", "points and mesh")
    # of more points than a card is given, a part is kept, evenly
    assert browser.driver.execute_async_script("""const [path, done] = arguments;
        import(new URL("page/ply.js", document.baseURI)).then(ply => ply.loadPoints(path, 300, {onStart() {}, onMore() {}}))
          .then(({step, count, total, columns}) => done([step, count, total, columns.x.length]));""",
        f"v1/jobs/{job}/results/points.ply") == [4, 250, 1000, 250]


def test_points_without_their_spacing_are_drawn(service, browser):
    """A spec chooses what is in the file; the report has the spacing of all."""
    job = service.submit(sphere(count=300, output={"preview": False, "ply": {"properties": ["minimal"]}}))
    service.wait_state(job, "succeeded")
    browser.open(service, f"#/jobs/{job}/points")
    browser.wait_text("300 points", ".stats")
    wait_until_drawn(browser)


CUBE = """v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\nv -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1
f 1 4 3\nf 1 3 2\nf 5 6 7\nf 5 7 8\nf 1 2 6\nf 1 6 5\nf 2 3 7\nf 2 7 6\nf 3 4 8\nf 3 8 7\nf 4 1 5\nf 4 5 8\n"""


def drop(browser):
    browser.one(".drop")
    browser.run("""
        const data = new DataTransfer();
        data.items.add(new File([arguments[0]], "cube.obj"));
        document.querySelector(".drop").dispatchEvent(new DragEvent("drop", {dataTransfer: data, bubbles: true}));""", CUBE)


# a worker whose looks at specs and files begin when a file is there
WAITING = """#!/bin/sh
case "$1" in estimate | inspect) while ! [ -e "%s" ]; do sleep 0.01; done ;; esac
exec "%s" "$@"
"""


def test_a_look_that_was_refused_is_asked_for_again(new_service, browser, tmp_path, build):
    """The only estimate that the service makes at once is another client's; when that has ended, ours is made."""
    gate, program = tmp_path / "gate", tmp_path / "waiting"
    program.write_text(WAITING % (gate, build / "hexad-worker"))
    program.chmod(0o700)
    service = new_service("--worker", program, "--estimates", 1).start()
    other = threading.Thread(target=lambda: service.post("/v1/jobs:validate", sphere()))
    other.start()
    try:
        wait_until(service.children, "the other's worker")
        browser.open(service, "#/submit")
        browser.wait_text("after those of others", ".estimate")
        drop(browser)
        browser.wait_text("cube.obj waits", ".drop")
    finally:
        gate.touch()
        other.join()
    browser.wait_text("area", ".inspection")
    browser.wait_text("Memory", ".estimate")


def test_a_mesh_is_dropped_and_becomes_points(closed_service, browser):
    """The way of somebody who is new: sign in, drop a mesh, submit, watch, turn, download."""
    sign_in(browser, closed_service, "dora")
    browser.press("New job", "header")
    drop(browser)
    browser.wait_text("area", ".inspection")
    assert "sha256:" in browser.text("#json", "value")
    browser.wait_text("Memory", ".estimate")
    count = browser.one("[id='f/sampling/count']")
    count.clear()
    count.send_keys("500")
    wait_until(lambda: "500" in browser.text(".estimate"), "the new estimate")
    browser.press("Submit", "aside")
    browser.wait_text("cube.obj", "h1")  # the name of the file: the job has none
    jobs = with_token(closed_service, closed_service.token, "GET", "/v1/jobs").json["jobs"]
    assert [(job["name"], job["input"]) for job in jobs] == [(None, None)]  # for the administrator
    browser.wait_text("points.ply", ".results")
    size = browser.run("return fetch(document.querySelector('.results a').href).then(r => r.arrayBuffer()).then(b => b.byteLength)")
    assert size > 500 * 28
    browser.press("Points in 3-D", "main")
    browser.wait_text("500 points", ".stats")
    assert browser.run(PICTURE, "Home")[0] != browser.run(PICTURE, "ArrowLeft")[0]


def test_form_and_help_call_a_member_by_its_title(service, browser, build):
    browser.open(service, "#/submit")
    browser.one(".estimate dl")
    titles = browser.run("return [...document.querySelectorAll('fieldset .field > label')].map(e => e.innerText.replace(' *', ''))")
    help_of = subprocess.run([build / "hexad-worker", "spec-help", "sampling"], capture_output=True, text=True, check=True).stdout
    assert "Number of points" in titles and "Smallest spacing" in browser.texts(".field > label", "textContent")
    seen = browser.run("return [...document.querySelectorAll('fieldset label, fieldset summary')].filter(e => e.checkVisibility()).map(e => e.innerText)")
    assert {"Pattern", "Denser where curved"} <= set(seen) and "Smallest spacing" not in seen  # few fields first
    for title in ("Number of points", "Smallest spacing"):
        assert f"\n    {title}.\n" in help_of


def test_faults_are_shown_where_they_are(service, browser):
    browser.open(service, "#/submit")
    browser.one(".sketch")
    wait_until(lambda: browser.run("""const canvas = document.querySelector(".sketch");
        const {data} = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
        return new Set(new Uint32Array(data.buffer)).size""") > 20, "a shaded sphere")
    radius = browser.one("[id='f/surface/analytic/radius']")
    radius.clear()
    radius.send_keys("-1")
    wait_until(lambda: browser.one("[id='f/surface/analytic/radius']").get_attribute("aria-invalid"), "the fault")
    assert not browser.one("aside button.main").is_enabled()
    browser.run("location.hash = '#/'")


def test_a_fault_of_the_inputs_is_shown_before_the_submission(new_service, browser, build, tmp_path):
    subprocess.run([build / "hexad-worker", "make-example", tmp_path / "trefoil.vdb"], check=True)
    browser.open(new_service("--input_roots", tmp_path).start(), "#/submit")
    browser.wait_text("Memory", ".estimate")
    spec = {"version": 1, "surface": {"vdb": {"path": str(tmp_path / "trefoil.vdb"), "grid": "nonsense"}}, "sampling": {"count": 100}}
    browser.run("arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event('input', {bubbles: true}))",
                browser.one("#json"), json.dumps(spec))
    browser.wait_text("nonsense", "aside .trouble")
    assert not browser.one("aside button.main").is_enabled()


def test_submit_is_disabled_while_the_json_is_invalid(service, browser):
    browser.open(service, "#/submit")
    browser.wait_text("Memory", ".estimate")
    text, submit = browser.one("#json"), browser.one("aside button.main")
    good = text.get_attribute("value")
    assert submit.is_enabled()

    def write(words):
        browser.run("arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event('input', {bubbles: true}))", text, words)
    for bad in (good[:-1], "", "null", "5"):
        write(bad)
        wait_until(lambda: not submit.is_enabled(), f"no way to submit {bad[-10:]!r}")
    write(good.replace("10000", "123"))
    wait_until(submit.is_enabled, "a way to submit")
    write("{")
    wait_until(lambda: not submit.is_enabled(), "no way to submit")
    count = browser.one("[id='f/sampling/count']")  # the form makes good JSON of its own
    count.send_keys(Keys.CONTROL + "a" + Keys.NULL + "77")
    wait_until(submit.is_enabled, "a way to submit")
    assert '"count": 77' in browser.text("#json", "value")


def test_a_view_that_opens_has_no_frame_around_it(service, browser):
    browser.open(service)
    browser.one("main h1")
    browser.keys(Keys.TAB)  # browsers frame what has the focus of somebody who uses the keyboard
    browser.run("location.hash = '#/submit'")
    browser.wait_text("New job", "h1")
    wait_until(lambda: browser.run("return document.activeElement.id") == "main", "the focus")
    assert browser.run("return getComputedStyle(document.activeElement).outlineStyle") == "none"


def test_a_changed_copy(service, browser):
    job = service.submit(sphere(name="original"))
    browser.open(service, f"#/jobs/{job}")
    browser.press("Submit a changed copy", "main")
    wait_until(lambda: '"original"' in browser.text("#json", "value"), "the spec")


def test_files_of_the_input_roots_are_chosen(new_service, browser, tmp_path):
    root = tmp_path / "root"
    (root / "shots").mkdir(parents=True)
    (root / "shots" / "cube.obj").write_text(CUBE)
    service = new_service("--input_roots", root).start()
    browser.open(service, "#/submit")
    browser.one("details summary").click()
    browser.press(f"{root}/", ".drop")
    browser.press("shots/", ".drop")
    browser.press("cube.obj", ".drop")
    browser.wait_text("area", ".inspection")
    assert f"{root}/shots/cube.obj" in browser.text("#json", "value")
    browser.wait_text("Memory", ".estimate")


def test_uploads_are_chosen_and_deleted(closed_service, browser):
    secret = sign_in(browser, closed_service, "frank")
    for name, text in (("a.obj", CUBE), ("b.obj", CUBE + "# b\n")):
        where = f"/v1/inputs/{hashlib.sha256(text.encode()).hexdigest()}?name={name}"
        assert closed_service.request("PUT", where, text.encode(), {"Authorization": f"Bearer {secret}"}).status == 201
    browser.press("New job", "header")
    browser.one(".uploads summary").click()
    wait_until(lambda: sorted(browser.texts(".uploads td.name button")) == ["a.obj", "b.obj"], "the uploads")
    browser.press("a.obj", ".uploads")
    browser.wait_text("area", ".inspection")
    path = json.loads(browser.text("#json", "value"))["surface"]["mesh"]["path"]
    assert path == f"sha256:{hashlib.sha256(CUBE.encode()).hexdigest()}.obj"
    browser.wait_text("Memory", ".estimate")
    job = with_token(closed_service, secret, "POST", "/v1/jobs", json.loads(browser.text("#json", "value")) | {"name": "own"}).json["id"]
    wait_until(lambda: with_token(closed_service, secret, "GET", f"/v1/jobs/{job}").json["state"] == "succeeded", "the end")
    browser.driver.execute_script(f"location.hash = '#/jobs/{job}'")
    browser.wait_text("a.obj", "[aria-label='Inputs'] td.name")
    browser.press("New job", "header")
    browser.one(".uploads summary").click()
    browser.wait_text("1 job", ".uploads tbody")
    browser.one("[aria-label='Delete a.obj']").click()
    assert browser.driver.switch_to.alert.text == "Delete the upload a.obj?"
    browser.driver.switch_to.alert.accept()
    wait_until(lambda: browser.texts(".uploads td.name button") == ["b.obj"], "the row to go")
    assert [upload["name"] for upload in with_token(closed_service, secret, "GET", "/v1/inputs").json["inputs"]] == ["b.obj"]


def test_a_sequence_of_files_is_one_row(new_service, browser, tmp_path):
    root = tmp_path / "root"
    root.mkdir()
    for frame in (1, 2, 3, 7):
        (root / f"cube.{frame:04d}.obj").write_text(CUBE)
    (root / "cube.obj").write_text(CUBE)
    service = new_service("--input_roots", root).start()
    browser.open(service, "#/submit")
    browser.one("details summary").click()
    browser.press(f"{root}/", ".drop")
    browser.wait_text("4 files: 1-3, 7", ".files")
    assert browser.texts(".files td.name button") == ["cube.####.obj", "cube.obj"]
    browser.press("cube.####.obj", ".drop")
    browser.wait_text("area", ".inspection")

    def spec():
        return json.loads(browser.text("#json", "value"))
    wait_until(lambda: spec()["surface"].get("mesh", {}).get("path") == f"{root}/cube.####.obj", "the pattern")
    assert spec()["queue"]["frames"] == "1-3,7"
    browser.wait_text("Memory", ".estimate")
    browser.press("cube.obj", ".drop")
    wait_until(lambda: spec()["surface"]["mesh"]["path"] == f"{root}/cube.obj", "the file")
    assert "queue" not in spec()


def test_cameras_of_a_comparison_move_together(service, browser):
    """Of equal points, both pictures stay equal."""
    service.wait_state(job := service.submit(sphere(count=200, output={"preview": False})), "succeeded")
    browser.open(service, f"#/compare/{job}/{job}")
    wait_until(lambda: len(browser.all(".stats")) == 2 and not browser.all(".loading-points"), "both clouds")

    def pictures(key):
        return browser.run("""
          const canvases = [...document.querySelectorAll("canvas.points")];
          return new Promise(done => requestAnimationFrame(() => {
            canvases[0].dispatchEvent(new KeyboardEvent("keydown", {key: arguments[0], bubbles: true}));
            requestAnimationFrame(() => done(canvases.map(canvas => canvas.toDataURL())));
          }));""", key)
    first = pictures("Home")
    assert first[0] == first[1]
    for key in ("ArrowLeft", "+"):
        then = pictures(key)
        assert then[0] == then[1] != first[0]
        first = then


def test_two_jobs_are_compared(service, browser):
    jobs = [service.submit(sphere(count=count, name=f"of {count}")) for count in (300, 600)]
    for job in jobs:
        service.wait_state(job, "succeeded")
    browser.open(service, f"#/compare/{jobs[0]}/{jobs[1]}")
    wait_until(lambda: len(browser.all(".stats")) == 2, "both clouds")
    browser.wait_text("600", ".measures")
    wait_until(lambda: browser.all("figure.chart canvas"), "plots of both")


def test_below_a_prefix_of_a_proxy(closed_service, browser, source, certificate, tmp_path):
    """Over TLS, as doc/systemd.md says: nothing is asked for at the root, and the cookie is Secure."""
    front = Front("nginx", source, certificate, tmp_path / "front", closed_service.address, prefix="/hexad/")
    closed_service.end()
    closed_service.options[closed_service.options.index("--listen") + 1] = closed_service.address
    closed_service.start("--page_origins", f"https://{front.address}")
    browser.driver.get(f"https://{front.address}/hexad/")
    browser.one("#token").send_keys(new_token(closed_service, "carol"))
    browser.press("Sign in")
    browser.wait_text("No jobs yet")
    cookie, = browser.command("Network.getAllCookies")["cookies"]
    assert cookie["secure"] and cookie["httpOnly"] and cookie["sameSite"] == "Strict" and cookie["path"] == "/hexad/v1"
    browser.press("New job", "header")
    browser.wait_text("Memory", ".estimate")
    browser.press("Submit", "aside")
    browser.wait_text("The solve has converged")
    browser.press("Points in 3-D", "main")
    browser.wait_text("points.", ".stats")
    front.process.terminate()
    front.process.wait()


# arguments: the rules, empty: all; a callback, which gets a line for each violation
AUDIT = """
const [rules, done] = arguments;
const options = {resultTypes: ["violations"], ...(rules.length ? {runOnly: rules} : {})};
axe.run(document, options).then(found => done(found.violations.map(violation =>
  `${violation.id}: ${violation.help}: ${violation.nodes.map(node => node.html.slice(0, 120) + " " + (node.any[0] || {}).message).join(" | ")}`)), error => done([String(error)]));
"""


@pytest.fixture
def audit(browser, source):
    """Checks the page with axe-core in the light theme, and its width on a narrow screen. The dark theme changes only
    colours, so that only contrasts are checked in it."""
    program = source / "page/node_modules/axe-core/axe.min.js"
    if not program.exists():
        pytest.skip("no axe-core: run npm ci in page")

    def run():
        where = browser.driver.current_url
        # the page lets no text become a script: a tool of the browser brings it in
        browser.command("Runtime.evaluate", expression=program.read_text())
        for theme, rules in (("light", []), ("dark", ["color-contrast"])):
            browser.emulate(prefers_color_scheme=theme)
            assert browser.driver.execute_async_script(AUDIT, rules) == [], (where, theme)
        browser.command("Emulation.setDeviceMetricsOverride", width=390, height=800, deviceScaleFactor=1, mobile=False)
        assert browser.run("return document.documentElement.scrollWidth") <= 390, where
        browser.command("Emulation.clearDeviceMetricsOverride")

    yield run
    browser.emulate()


def test_an_audit_finds_no_barrier(closed_service, browser, audit):
    browser.open(closed_service)
    browser.one("#token").send_keys("hexad_wrong")
    browser.press("Sign in")
    browser.wait_text("the token is unknown")
    audit()
    secret = sign_in(browser, closed_service, "dora")
    job = with_token(closed_service, secret, "POST", "/v1/jobs", sphere(count=1000, name="audited", queue={"labels": ["x"]})).json["id"]
    for where, there in ((f"#/jobs/{job}", ".measures"), ("#/", "tbody tr"), (f"#/jobs/{job}/points", ".stats"),
                         (f"#/compare/{job}/{job}", ".measures"), ("#/submit", ".estimate dl")):
        browser.open(closed_service, where)
        browser.one(there)
        audit()


def test_axes_of_charts_have_numbers_that_do_not_overlap(service, browser):
    """Whatever the range of the values; scales that are not linear have no numbers of their own in some."""
    browser.open(service)
    found = browser.driver.execute_async_script("""
        const done = arguments[arguments.length - 1];
        Promise.all([import("/page/chart.js"), import("/page/uplot.js")]).then(([{optionsOf, QUANTITIES}, {default: uPlot}]) => {
          const ranges = [[.0031, .0085], [.031, .039], [0, .004], [-.002, .07], [.002, 3], [1e-7, .3], [.5, 40], [.2, .2], [-2, 0]];
          const plots = QUANTITIES.slice(0, 2).flatMap(quantity => ranges.filter(([low]) => quantity.key !== "rms_step" || low > 0).map(range => {
            const place = document.body.appendChild(document.createElement("div"));
            return [quantity.key, range, new uPlot(optionsOf(quantity, ["run"], 400), [[1, 2], range], place)];
          }));
          setTimeout(() => done(plots.map(([key, range, plot]) => { // plots are drawn when the script has ended
            const {_splits: ticks, _values: texts} = plot.axes[1];
            const shown = ticks.map((tick, i) => [tick, texts[i]]).filter(([, text]) => text !== "");
            return [key, range, shown.map(([tick, text]) => [tick, text, plot.valToPos(tick, "y")])];
          })));
        }, fault => done(String(fault)));""")
    assert len(found) > 10, found
    for key, (low, high), shown in found:
        places = sorted(place for _, _, place in shown)
        assert len(shown) >= 2 and all(b - a >= 20 for a, b in zip(places, places[1:])), (key, low, high, shown)
        assert all(float(text.replace("\u202f", "")) == tick for tick, text, _ in shown), shown


def test_reports_of_earlier_builds_are_read(service, browser):
    """They have the members of `diagnostics` beside it."""
    browser.open(service)
    found = browser.driver.execute_async_script("""
        const done = arguments[arguments.length - 1];
        Promise.all([import("/page/report.js"), import("/page/chart.js")]).then(([{valueAt}, {rowsOfReport}]) => {
          const members = {threads: 3, energy: {ideal: 2}}, sweeps = [{energy: 3}];
          done([{...members, sweeps}, {diagnostics: members, sweeps}].map(report =>
            [valueAt(report, "diagnostics.threads"), valueAt(report, "diagnostics.sigma") ?? null, rowsOfReport(report)[0].energy_excess]));
        }, fault => done(String(fault)));""")
    assert found == [[3, None, 0.5], [3, None, 0.5]]
