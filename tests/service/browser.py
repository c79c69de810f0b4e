# SPDX-License-Identifier: Apache-2.0
"""Debian's Chromium without a screen, as tests and measurements/service/web_page.py use it. Without chromium-driver or python3-selenium there is
none."""
import contextlib
import functools
import shutil

from service import PATIENCE_S, wait_until as wait_for_condition

try:
    from selenium import webdriver
    from selenium.common.exceptions import StaleElementReferenceException
    from selenium.webdriver.chrome.service import Service as Driver
    from selenium.webdriver.common.by import By
    from selenium.webdriver.common.keys import Keys
except ImportError:
    webdriver = Keys = None

# no traffic of its own; WebGL by the processor
FLAGS = ("--headless=new --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking"
         " --disable-component-update --disable-sync --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader"
         # a page that is opened needs no further process: starts of processes were a quarter of the work
         " --disable-features=SpareRendererForSitePerProcess,BackForwardCache,ProactivelySwapBrowsingInstance"
         " --disable-site-isolation-trials --renderer-process-limit=1")
WINDOW = (800, 500)  # small: the processor draws all pixels
# an evaluation of a condition is work for the test, the driver and the browser
wait_until = functools.partial(wait_for_condition, interval=0.05)


def is_there():
    return webdriver and shutil.which("chromium") and shutil.which("chromedriver")


class Browser:
    """A browser, and what one does in it in words of the page."""

    def __init__(self, directory, size=WINDOW):
        options = webdriver.ChromeOptions()
        options.binary_location = shutil.which("chromium")
        for flag in (*FLAGS.split(), f"--user-data-dir={directory}", f"--window-size={size[0]},{size[1]}"):
            options.add_argument(flag)
        options.accept_insecure_certs = True  # made for a test
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = webdriver.Chrome(service=Driver(shutil.which("chromedriver")), options=options)
        self.driver.set_script_timeout(PATIENCE_S)  # one picture of many points takes a minute beside other load
        self.driver.command_executor.set_timeout(2 * PATIENCE_S)

    def close(self):
        self.driver.quit()

    def emulate(self, **features):
        """As prefers_color_scheme="dark"; nothing: as it was."""
        self.command("Emulation.setEmulatedMedia", features=[
            {"name": name.replace("_", "-"), "value": value} for name, value in features.items()])

    def command(self, name, **words):
        return self.driver.execute_cdp_cmd(name, words)

    def open(self, service, where="#/"):
        self.driver.get("about:blank")
        self.driver.get(f"http://{service.address}/{where}")

    def all(self, selector):
        return self.driver.find_elements(By.CSS_SELECTOR, selector)

    def one(self, selector):
        return wait_until(lambda: next(iter(self.all(selector)), None), selector)

    def texts(self, selector, of="innerText"):
        """Of all that match, at one moment: elements may be replaced between two questions."""
        return self.run("return [...document.querySelectorAll(arguments[0])].map(e => e[arguments[1]])", selector, of)

    def text(self, selector="body", of="innerText"):
        return wait_until(lambda: self.texts(selector, of), selector)[0]

    def wait_text(self, text, selector="body"):
        try:
            wait_until(lambda: text in self.text(selector), f"{text!r} in {selector}")
        except AssertionError as error:
            raise AssertionError(f"{error}; the page says:\n{self.text()}") from None

    def press(self, word, within="body"):
        def press():
            try:
                found = [e for e in self.one(within).find_elements(By.CSS_SELECTOR, "button, a") if e.text.strip() == word and e.is_enabled()]
                if found:
                    found[0].click()
                return found
            except StaleElementReferenceException:
                return None  # the page has drawn it anew
        wait_until(press, f"something to press: {word}")

    def keys(self, *keys):
        """To whatever has the focus."""
        webdriver.ActionChains(self.driver).send_keys(*keys).perform()

    def chord(self, held, key):
        """A key while another one is held."""
        webdriver.ActionChains(self.driver).key_down(held).send_keys(key).key_up(held).perform()

    def choose(self, value, select):
        self.run("arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event('change', {bubbles: true}))",
                 select, value)

    def run(self, script, *words):
        return self.driver.execute_script(script, *words)

    @contextlib.contextmanager
    def before_the_page(self, script):
        """Documents that are opened meanwhile run the script before their own."""
        added = self.command("Page.addScriptToEvaluateOnNewDocument", source=script)
        try:
            yield
        finally:
            self.command("Page.removeScriptToEvaluateOnNewDocument", **added)

    def faults(self):
        """What the browser complains of, without requests that were refused on purpose."""
        return [entry["message"] for entry in self.driver.get_log("browser")
                if entry["level"] == "SEVERE" and "Failed to load resource" not in entry["message"]]
