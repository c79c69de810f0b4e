# SPDX-License-Identifier: Apache-2.0
"""A plugin of pytest, used by measurements/mutations/mutate.py: writes results, limits the time of a test, records executed blocks.

HEXAD_MUTATE names a JSON file: `results` (a file that gets one JSON object per line), `limits` (seconds by test),
`limit` (seconds of the others), `blocks` (null, or the directory of the traced build's files).
"""
import json
import os
import threading
import time

import pytest

import executed_lines

TIME_OVER = 98  # exit status: the time of a test was over

_work = {}


def _write(**parts):
    with open(_work["results"], "a", encoding="utf-8") as out:
        out.write(json.dumps(parts) + "\n")


def pytest_configure(config):
    with open(os.environ["HEXAD_MUTATE"], encoding="utf-8") as file:
        _work.update(json.load(file))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item, nextitem):
    """A test whose time is over ends the process: the processes that it started are killed by tests/contain."""
    _write(begin=item.nodeid)
    limit = threading.Timer(_work["limits"].get(item.nodeid, _work["limit"]), lambda: os._exit(TIME_OVER))
    limit.daemon = True
    limit.start()
    _work.update(start=time.monotonic(), failed=False, skipped=False, words="")
    yield
    limit.cancel()
    hits = executed_lines.take(_work["blocks"]) if _work["blocks"] else None
    outcome = "failed" if _work["failed"] else "skipped" if _work["skipped"] else "passed"
    _write(end=item.nodeid, outcome=outcome, seconds=round(time.monotonic() - _work["start"], 3), hits=hits,
           words=_work["words"])


def pytest_runtest_logreport(report):
    if report.failed:
        _work["failed"] = True
        _work["words"] = _work["words"] or str(report.longrepr)[-400:]
    _work["skipped"] |= report.skipped


if "HEXAD_MUTATE" in os.environ:
    import _pytest.runner

    _protocol = _pytest.runner.runtestprotocol

    def _alone(item, log=True, nextitem=None):
        """With blocks: ends all fixtures, also of modules, after each test, so that their blocks are the test's."""
        return _protocol(item, log=log, nextitem=None if _work["blocks"] else nextitem)

    _pytest.runner.runtestprotocol = _alone
