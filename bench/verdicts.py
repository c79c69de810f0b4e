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
           ("rss_mb", "RSS MiB", "{:.1f}"), ("anonymous_mb", "its own MiB", "{:.1f}"),
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
        Verdict("Answers that are the server's failures (5xx)", "0", str(server_errors), server_errors == 0),
        Verdict("Jobs with another end than theirs, results that are not whole, streams out of order", "0",
                str(len(faults)), not faults)]
    if not enough:
        return verdicts + [Verdict("Everything else", f"{FEWEST_PARTS} tenths of a run", str(len(parts)), None)]
    first, last = parts[0], parts[-1]
    for key, text in (("descriptors", "Open descriptors"), ("threads", "Threads")):
        verdicts.append(Verdict(f"{text} at the end, as after the first tenth", str(first[key]), str(last[key]),
                                last[key] == first[key]))
    verdicts.append(growth("Growth of the daemon's own memory after the first tenth", first, last, MEMORY_BASE, MEMORY_OF_JOB,
                           not sanitized))
    middle = parts[len(parts) // 2 - 1]
    verdicts.append(growth("Growth of the daemon's own memory in the second half", middle, last, HALF_BASE, HALF_OF_JOB,
                           not sanitized and last["stored"] - middle["stored"] >= HALF_JOBS))
    cost = last["cost"] / parts[1]["cost"]
    verdicts.append(Verdict("Processor time of the daemon for a job, in yardsticks, by that of the second tenth",
                            f"at most {COST_MOST}", f"{cost:.2f}", cost <= COST_MOST if timed else None))
    for what in ("submit", "status", "list"):
        for which, name in (("p50_ms", "median"), ("p99_ms", "99th percentile")):
            ratio = latency(parts, f"{what}_{which}")
            verdicts.append(Verdict(f"Time of an answer to {what}, {name}, by that of the second tenth",
                                    f"at most {LATENCY_MOST[which]:g}", f"{ratio:.2f}",
                                    ratio <= LATENCY_MOST[which] if timed else None))
    if more is not None:
        verdicts.append(Verdict("Jobs in the queue that wait, at the end", f"{more}", f"{last['held']}", last["held"] >= more))
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
    return markdown(["", "wanted", "found", ""], [[v.text, v.wanted, v.found, words[v.met]] for v in verdicts])


HEAD = """# The service under mixed load for long

Written by `make soak` ([bench/soak.py](../../bench/soak.py)); do not edit. One run on one machine: {cpu}, {cores} cores, {when},
load average {load:.1f} at its start; {minutes:g} minutes of load. A daemon on its defaults (but for the cache of documents, \
which
is small enough to be full after the first tenth) is given {rate:g} jobs a second: small ones, sequences of three frames, ones
with a damaged input, ones with too little memory, ones that are cancelled, ones that had been run before, and jobs that wait for
ever. Every fourth that ended is fetched and compared, every fourth deleted. Beside them a client looks at ten jobs a second and lists
some, and {followers:g} followers a minute come, stay for seconds, and go.

- `CPU` is the daemon's own processor time, without its workers'. The yardstick is the processor time of a fixed piece of work that
  the client does all the while; the cost of a job is CPU by jobs by yardstick, so that what neighbours do to the processor counts
  twice and falls out.
- Memory, descriptors, threads and the database are looked at when a tenth has ended, nothing runs and nobody else is connected.
- Latencies are those of a client in Python on the same machine: they tell of a change, not of the service alone. A 99th percentile
  is the median of those of ten slices of the tenth.

"""


def page(about, parts, verdicts):
    return HEAD.format(**about) + table_of_verdicts(verdicts) + "\nBy tenths of the run:\n\n" + table_of_parts(parts)
