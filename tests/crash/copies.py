# SPDX-License-Identifier: Apache-2.0
"""Copies of results in the directories that their jobs name (output.directory), which are not the service's own."""
import hashlib
import json

from farm import Violation


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def check_whole(outputs):
    """At any time while nothing is written: a directory with a report has all that the report lists."""
    for report in outputs.glob("*/report.json"):
        for listed in json.loads(report.read_bytes())["outputs"]:
            path = report.parent / listed["name"]
            if not path.exists() or digest(path) != listed["sha256"]:
                raise Violation(f"{report} is there, and {listed['name']} is not what it says")


def find_temporaries(outputs):
    """No file of a result has a name that begins with a point."""
    return list(outputs.rglob(".*"))


def check_at_rest(outputs, book):
    """When all jobs have ended: every job that succeeded has its copy, and nothing unfinished lies about. How many there
    are."""
    check_whole(outputs)
    left = find_temporaries(outputs)
    if left:
        raise Violation(f"temporary files are left: {[str(path) for path in left[:5]]}, {len(left)} in all")
    copied = 0
    for job, (state, digests) in book.ended.items():
        where = book.sent[book.accepted[job]]["output"].get("directory")
        if not where or state != "succeeded" or job in book.deleted:
            continue
        report = outputs / where.rpartition("/")[2] / "report.json"
        if not report.exists() or digest(report) != digests[0]:
            raise Violation(f"the job {job} succeeded, and its copy is not in {report.parent}")
        names = {"report.json", *(listed["name"] for listed in json.loads(report.read_bytes())["outputs"])}
        if names != {path.name for path in report.parent.iterdir()}:
            raise Violation(f"{report.parent} holds other files than the result of {job}")
        copied += 1
    return copied
