# SPDX-License-Identifier: Apache-2.0
"""What soak.py has measured, a row for each tenth of a run: the verdicts over them, the table, and the page.

A level is what the daemon holds when a tenth has ended, nothing runs and nobody is connected but the one who looks. The
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

COLUMNS = (("jobs", "jobs ended", "{:d}"), ("held", "in the queue", "{:d}"), ("events", "events", "{:d}"),
           ("followers", "followers", "{:d}"), ("cpu_s", "CPU s", "{:.2f}"), ("cpu_ms_a_job", "CPU ms a job", "{:.2f}"),
           ("yardstick_ms", "yardstick ms", "{:.2f}"), ("cost", "cost of a job", "{:.3f}"),
           ("rss_mb", "RSS MiB", "{:.1f}"), ("anonymous_mb", "private MiB", "{:.1f}"),
           ("descriptors", "descriptors", "{:d}"), ("threads", "threads", "{:d}"), ("database_mb", "database MiB", "{:.1f}"),
           *((f"{what}_{which}", f"{what} {name} ms", "{:.2f}") for what in ("submit", "status", "list")
             for which, name in (("p50_ms", "median"), ("p99_ms", "99 %"))))


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


def markdown(names, lines):
    return "\n".join("| " + " | ".join(line) + " |" for line in (names, ["---"] * len(names), *lines)) + "\n"


def cells(part):
    return [form.format(part[key]) for key, _, form in COLUMNS]


def turned(parts):
    """A column for each tenth."""
    columns = [cells(part) for part in parts]
    return [[title, *(column[i] for column in columns)] for i, (_, title, _) in enumerate(COLUMNS)]


def table_of_parts(parts):
    return markdown(["", *(f"{i + 1}" for i in range(len(parts)))], turned(parts))


def table_of_verdicts(verdicts):
    words = {True: "met", False: "**missed**", None: "not in this run"}
    return markdown(["", "bound", "measured", ""], [[v.text, v.wanted, v.found, words[v.met]] for v in verdicts])


HEAD = """# The service under a mixed load

`make soak` ([soak.py](soak.py)) writes this page; do not edit it. One run on one machine: {cpu}, {cores} cores, {when},
load average {load:.1f} at its start; {minutes:g} minutes of load. A daemon with defaults, except for a smaller cache of documents, which is full
after the first tenth, gets {rate:g} jobs a second: small jobs, sequences of three frames, jobs with a damaged input or too
little memory, jobs that are cancelled, jobs whose result is in the cache, and jobs that never start. Every fourth job that ended is fetched and
compared, and every fourth is deleted. A client reads ten jobs a second and lists jobs, and {followers:g} clients a minute
follow events for some seconds.

- `CPU` is the CPU time of the daemon without its workers. The yardstick is the CPU time of a fixed computation that
  the client repeats. The cost of a job is CPU over jobs over yardstick, which cancels the effect of other load on the processor.
- Memory, descriptors, threads and the database are read at the end of a tenth, while nothing runs and no other client is connected.
- Latencies are those of a client in Python on the same machine. They show changes, not the speed of the service alone. A 99th
  percentile is the median of the percentiles of ten slices of the tenth.

"""


def page(about, parts, verdicts):
    return HEAD.format(**about) + table_of_verdicts(verdicts) + "\nBy tenths of the run:\n\n" + table_of_parts(parts)
