# SPDX-License-Identifier: Apache-2.0
"""Lets pytest speak TAP, and says where the build, the source and the shared data are.

HEXAD_BUILD    directory of the built programs (needed)
HEXAD_SOURCE   the source tree; default: above this file
HEXAD_SHARED   directory of the shared data; default: ../shared/data beside the source tree
HEXAD_TAP_FD   descriptor for TAP; without it pytest reports as usual
HEXAD_TIER     basic: tests that show whether a build works; extended: the others; sanitized: those that run in a build with
               sanitizers; default: all

A test belongs to the extended tier if it has the marker `extended`, or if it needs the shared data, which are no part of
the source. The tests of the sanitized tier have the marker `sanitized`. Files of neither tier, which `make farmtest` runs, have
the marker `campaign` beside `extended`.

tools/fragments.sh reads the tiers of a file from its text, without importing it: the marker as a decorator of a test or of a
parameter, `pytestmark` in one line, and the fixture `shared_data` as a parameter of a test.
"""
import os
import pathlib

import pytest

_report = {}


def _tap(line):
    fd = os.environ.get("HEXAD_TAP_FD")
    if fd:
        os.write(int(fd), (line + "\n").encode())


def pytest_addoption(parser):
    parser.addoption("--tiers", action="store_true", help="print the tiers of each test")


def pytest_configure(config):
    for text in ("extended: takes long or needs an external program; `./bootstrap check-all` runs it",
                 "campaign: runs in neither tier; `make farmtest` runs its file",
                 "sanitized: runs in builds with sanitizers: it executes code that no unit test executes, or gives malformed input"):
        config.addinivalue_line("markers", text)


def tiers_of(item):
    is_extended = item.get_closest_marker("extended") or "shared_data" in item.fixturenames
    found = {"extended" if is_extended else "basic"}
    if item.get_closest_marker("sanitized"):
        found.add("sanitized")
    return found


def _is_selected(item):
    tier = os.environ.get("HEXAD_TIER")
    return not tier or tier in tiers_of(item)


def pytest_collection_modifyitems(config, items):
    left_out = [item for item in items if not _is_selected(item)]
    if left_out:
        items[:] = [item for item in items if _is_selected(item)]
        config.hook.pytest_deselected(items=left_out)


def pytest_collection_finish(session):
    if session.config.getoption("--tiers"):
        for item in session.items:
            print("tiers of", item.location[0], *sorted(tiers_of(item)))
    _tap(f"1..{len(session.items)}")


def pytest_runtest_logreport(report):
    """One line a test, after its teardown: any part that failed makes it fail."""
    state = _report.setdefault(report.nodeid, {"failed": False, "skip": None, "todo": None, "seconds": 0})
    state["seconds"] += report.duration
    if report.failed:
        state["failed"] = True
    elif report.skipped and hasattr(report, "wasxfail"):
        state["todo"] = report.wasxfail.removeprefix("reason: ")
    elif report.skipped:
        state["skip"] = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    if report.when != "teardown":
        return
    number = _report["count"] = _report.get("count", 0) + 1
    name = report.nodeid.rsplit("/", 1)[-1].replace("#", "_")
    if state["failed"]:
        _tap(f"not ok {number} - {name}")
    elif state["todo"] is not None:
        _tap(f"not ok {number} - {name} # TODO {state['todo']}")
    elif state["skip"] is not None:
        _tap(f"ok {number} - {name} # SKIP {state['skip'].removeprefix('Skipped: ')}")
    else:
        _tap(f"ok {number} - {name}")
    _tap(f"# {state['seconds']:.2f} s in {name}")


def pytest_collectreport(report):
    if report.failed:
        _tap("Bail out! a test file cannot be loaded")


@pytest.fixture(scope="session")
def diagnose():
    """Says a measured figure: a TAP diagnostic, or a line of pytest's own report."""
    return lambda text: _tap(f"# {text}") if os.environ.get("HEXAD_TAP_FD") else print(text)


@pytest.fixture(scope="session")
def source():
    return pathlib.Path(os.environ.get("HEXAD_SOURCE", pathlib.Path(__file__).parent.parent)).resolve()


@pytest.fixture(scope="session")
def build():
    where = os.environ.get("HEXAD_BUILD")
    if not where:
        pytest.fail("HEXAD_BUILD does not say where the programs are")
    return pathlib.Path(where).resolve()


@pytest.fixture(scope="session")
def sanitized(build):
    return b"__asan_init" in (build / "hexad-worker").read_bytes()


@pytest.fixture(scope="session")
def shared_data(source):
    """The directory of files from outside, or a skip that says so."""
    where = pathlib.Path(os.environ.get("HEXAD_SHARED", source.parent / "shared" / "data"))
    if not where.is_dir():
        pytest.skip(f"there is no {where}: set HEXAD_SHARED to the directory of the shared data")
    return where
