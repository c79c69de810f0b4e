"""The web page in a real browser, headless Chromium, in front of a real daemon with real jobs. One browser for all tests."""
import shutil
import signal

import pytest

from service import gated_worker, sphere, wait_until
from test_access import closed_service, new_token  # noqa: F401

webdriver = pytest.importorskip("selenium.webdriver", reason="no python3-selenium")
from selenium.webdriver.chrome.service import Service as Driver  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.common.exceptions import StaleElementReferenceException  # noqa: E402

FLAGS = ("--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking"
         " --disable-component-update --disable-sync --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader")


class Browser:
    """What the tests do in the browser, in words of the page."""

    def __init__(self, driver):
        self.driver = driver

    def open(self, service, where="#/", scheme="http"):
        self.driver.get("about:blank")
        self.driver.get(f"{scheme}://{service.address}/{where}")

    def all(self, selector):
        return self.driver.find_elements(By.CSS_SELECTOR, selector)

    def one(self, selector):
        return wait_until(lambda: next(iter(self.all(selector)), None), selector)

    def text(self, selector="body"):
        def read():
            try:
                return self.one(selector).text
            except StaleElementReferenceException:
                return None
        return wait_until(lambda: read() is not None and (read() or " "), selector)

    def wait_text(self, text, selector="body"):
        wait_until(lambda: text in self.text(selector), f"{text!r} in {selector}, instead of:\n{self.text()}")

    def press(self, word, within="body"):
        def found():
            return [e for e in self.one(within).find_elements(By.CSS_SELECTOR, "button, a") if e.text.strip() == word]
        wait_until(found, f"something to press: {word}")[0].click()

    def run(self, script, *words):
        return self.driver.execute_script(script, *words)

    def faults(self):
        """What the browser complains of, without requests that were refused on purpose."""
        return [entry["message"] for entry in self.driver.get_log("browser")
                if entry["level"] == "SEVERE" and "Failed to load resource" not in entry["message"]]


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if not program or not driver:
        pytest.skip("no chromium and chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for flag in (*FLAGS.split(), f"--user-data-dir={tmp_path_factory.mktemp('browser')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    started = webdriver.Chrome(service=Driver(driver), options=options)
    yield Browser(started)
    started.quit()


@pytest.fixture
def browser(chromium, build):
    if not (build / "page/made").exists():
        pytest.skip("the page was not built: run npm ci in page, and make")
    chromium.faults()
    yield chromium
    faults = chromium.faults()
    chromium.driver.delete_all_cookies()
    chromium.driver.get("about:blank")
    assert not faults


@pytest.fixture
def gated(new_service, tmp_path):
    return new_service("--worker", gated_worker(tmp_path), "--workers", 1).start()


def test_a_token_signs_in(closed_service, browser):  # noqa: F811
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
    browser.press("Sign out")
    browser.wait_text("Your token")


def test_a_revoked_token_ends_the_session(closed_service, browser):  # noqa: F811
    browser.open(closed_service)
    browser.one("#token").send_keys(new_token(closed_service, "carol"))
    browser.press("Sign in")
    browser.wait_text("Queue", "h1")
    (closed_service.state / "tokens").write_text("")
    browser.all(".filter input")[0].send_keys("x\n")  # whatever it asks for next
    browser.wait_text("Your token")


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


def test_jobs_are_filtered_sorted_and_changed(gated, browser):
    for name in ("beta", "alpha", "gamma"):
        gated.submit(sphere(name=name, queue={"labels": [name]}))
    browser.open(gated)
    wait_until(lambda: len(browser.all("tbody tr")) == 3, "three rows")

    def names():
        return [link.text for link in browser.all("tbody .name a")]
    assert names() == ["gamma", "alpha", "beta"]
    browser.press("Job", "thead")
    wait_until(lambda: names() == ["alpha", "beta", "gamma"], "the order by name")
    browser.one("tbody tr:nth-child(3) input").click()
    browser.press("Cancel", ".actions")
    browser.wait_text("Cancelled", "tbody tr:nth-child(3)")
    field = browser.all(".filter input")[2]
    field.send_keys("alpha\n")
    wait_until(lambda: names() == ["alpha"], "the rows of a label")


def test_a_service_that_is_killed_and_comes_back(gated, browser):
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
    assert not browser.all("main img, main script, main b") and "owned" not in browser.driver.title
