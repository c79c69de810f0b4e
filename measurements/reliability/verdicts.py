# SPDX-License-Identifier: Apache-2.0
"""What soak.py has measured, a row for each tenth of a run: the verdicts over them, and the rows of the results.

A level is what the daemon holds when a tenth has ended, nothing runs and no other client is connected. The
first tenth is for warming up: levels at its end are held against those at the run's end, and the cost and the latencies of
the second tenth against those of the last.
"""
import collections

Verdict = collections.namedtuple("Verdict", "text wanted found met")  # met None: not judged in this run

# Of the same work: what other programs on the machine do to a processor's caches stays below that.
COST_MOST = 1.3
# Of medians, and of 99th percentiles, which neighbours stretch more; a list that is searched from end to end is ten times
# slower with ten times as many jobs.
LATENCY_MOST = {"p50_ms": 2.0, "p99_ms": 3.0}
# Memory of its own that may come after the first tenth. Not for jobs, which are in the database, but for what fills as it is
# used and then stays: SQLite's cache of pages (2 MiB), the newest 4096 lines of progress (2 MiB), and what is free in the
# arenas that malloc has for the threads (16 of them on two processors, half a MiB each).
MEMORY_BASE = 12 << 20
# One string of a job that is forgotten is more.
MEMORY_OF_JOB = 256
# In the second half of a run all that has long been filled, if it was long enough for that.
HALF_BASE, HALF_OF_JOB, HALF_JOBS = 2 << 20, 128, 5000
FEWEST_PARTS = 3

# of a tenth: the key of the figure, the name of the column, the form
COLUMNS = (("jobs", "jobs_ended", "{:d}"), ("held", "in_the_queue", "{:d}"), ("events", "events", "{:d}"),
           ("followers", "followers", "{:d}"), ("cpu_s", "cpu_s", "{:.2f}"), ("cpu_ms_a_job", "cpu_ms_a_job", "{:.2f}"),
           ("yardstick_ms", "yardstick_ms", "{:.2f}"), ("cost", "cost_of_a_job", "{:.3f}"),
           ("rss_mb", "rss_mib", "{:.1f}"), ("anonymous_mb", "private_mib", "{:.1f}"),
           ("descriptors", "descriptors", "{:d}"), ("threads", "threads", "{:d}"), ("database_mb", "database_mib", "{:.1f}"),
           *((f"{what}_{which}_ms", f"{what}_{name}_ms", "{:.2f}") for what in ("submit", "status", "list")
             for which, name in (("p50", "median"), ("p99", "p99"))))
PART_NAMES = ["tenth", *(name for _, name, _ in COLUMNS)]
VERDICT_NAMES = ["quantity", "bound", "measured", "outcome"]


def latency(parts, key):
    return parts[-1][key] / parts[1][key]


def growth(text, first, last, base, of_job, judged=True):
    came = last["stored"] - first["stored"]
    most, grown = (base + of_job * came) / 2**20, last["anonymous_mb"] - first["anonymous_mb"]
    return Verdict(f"{text}, with {came} more jobs, MiB", f"at most {most:.1f}", f"{grown:.1f}", grown <= most if judged else None)


def judge(parts, answers, faults, timed, more, sanitized=False):
    """All verdicts of a run. `answers`: number of answers by status; `faults`: what was wrong, in words;
    `more`: the jobs that wait in the queue when it is whole, None: it was broken off. Of a `sanitized` daemon memory is not
    judged: it keeps what was freed."""
    enough = len(parts) >= FEWEST_PARTS
    server_errors = sum(n for status, n in answers.items() if int(status) >= 500)
    verdicts = [
        Verdict("Answers with a status 5xx", "0", str(server_errors), server_errors == 0),
        Verdict("Jobs with an unexpected end, incomplete results, streams out of order", "0",
                str(len(faults)), not faults)]
    if not enough:
        return verdicts + [Verdict("Everything else", f"{FEWEST_PARTS} tenths of a run", str(len(parts)), None)]
    first, last = parts[0], parts[-1]
    for key, text in (("descriptors", "Open descriptors"), ("threads", "Threads")):
        verdicts.append(Verdict(f"{text} at the end, as after the first tenth", str(first[key]), str(last[key]),
                                last[key] == first[key]))
    verdicts.append(growth("Growth of the daemon's private memory after the first tenth", first, last, MEMORY_BASE, MEMORY_OF_JOB,
                           not sanitized))
    middle = parts[len(parts) // 2 - 1]
    verdicts.append(growth("Growth of the daemon's private memory in the second half", middle, last, HALF_BASE, HALF_OF_JOB,
                           not sanitized and last["stored"] - middle["stored"] >= HALF_JOBS))
    cost = last["cost"] / parts[1]["cost"]
    verdicts.append(Verdict("CPU time of the daemon for a job, in yardsticks, last tenth over second tenth",
                            f"at most {COST_MOST}", f"{cost:.2f}", cost <= COST_MOST if timed else None))
    for what in ("submit", "status", "list"):
        for which, name in (("p50_ms", "median"), ("p99_ms", "99th percentile")):
            ratio = latency(parts, f"{what}_{which}")
            verdicts.append(Verdict(f"Time of an answer to {what}, {name}, last tenth over second tenth",
                                    f"at most {LATENCY_MOST[which]:g}", f"{ratio:.2f}",
                                    ratio <= LATENCY_MOST[which] if timed else None))
    if more is not None:
        verdicts.append(Verdict("Waiting jobs at the end", f"{more}", f"{last['held']}", last["held"] >= more))
    return verdicts


def rows_of_parts(parts):
    return [[number, *(form.format(part[key]) for key, _, form in COLUMNS)] for number, part in enumerate(parts, 1)]


def rows_of_verdicts(verdicts):
    words = {True: "met", False: "missed", None: "not judged"}
    return [[v.text, v.wanted, v.found, words[v.met]] for v in verdicts]


def rows_about(about):
    """The machine and the load, as further rows of the verdicts."""
    return [[text, "", f"{about[key]:.1f}" if key == "load" else about[key], ""] for text, key in (
        ("Processor", "cpu"), ("Processor cores", "cores"), ("Date", "when"), ("Load average at the start", "load"), ("Minutes", "minutes"),
        ("Jobs a second", "rate"), ("Followers a minute", "followers"))]
