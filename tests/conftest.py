"""Lets pytest speak TAP, and says where the build, the source and the shared data are.

HEXAD_BUILD    directory of the built programs (needed)
HEXAD_SOURCE   the source tree; default: above this file
HEXAD_SHARED   directory of the shared data; default: ../shared/data beside the source tree
HEXAD_TAP_FD   descriptor for TAP; without it pytest reports as usual
"""
import os
import pathlib

import pytest

_report = {}


def _tap(line):
    fd = os.environ.get("HEXAD_TAP_FD")
    if fd:
        os.write(int(fd), (line + "\n").encode())


def pytest_configure(config):
    config.addinivalue_line("markers", "plain: left out of sanitized builds, since tests beside it run the same code there")


def pytest_collection_finish(session):
    _tap(f"1..{len(session.items)}")


def pytest_runtest_logreport(report):
    """One line a test, after its teardown: any part that failed makes it fail."""
    state = _report.setdefault(report.nodeid, {"failed": False, "skip": None, "todo": None})
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


@pytest.fixture(autouse=True)
def spare_sanitizers(request):
    if request.node.get_closest_marker("plain") and request.getfixturevalue("sanitized"):
        pytest.skip("in the plain build only: with sanitizers tests beside it run the same code")


@pytest.fixture(scope="session")
def shared_data(source):
    """The directory of files from outside, or a skip that says so."""
    where = pathlib.Path(os.environ.get("HEXAD_SHARED", source.parent / "shared" / "data"))
    if not where.is_dir():
        pytest.skip(f"there is no {where}: set HEXAD_SHARED to the directory of the shared data")
    return where
