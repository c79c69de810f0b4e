# SPDX-License-Identifier: Apache-2.0
"""Deaths of the daemon and of the host during a job: none counts against it, up to a bound of their own."""
import random
import shutil
import sqlite3
import time
import uuid

from farm import FINAL, Book, Daemon, Violation, spec, wait_until

DEATHS_A_ROUND = 25  # then the jobs are left alone, and have to succeed
BOUNDS = (0, 0, 0, 1, 2, 5)  # max_interruptions of a round; 0: none
ATTEMPTS = (1, 3)  # max_attempts of its jobs, which run side by side
COUNT = 40000  # points; takes longer than such a job is left alone
RUN_S = 0.1  # the longest time from the start of the attempts to the death
# the deaths, and what the reason of an attempt says of them
REASONS = {"host": "the host restarted during the attempt", "daemon": "the daemon ended during the attempt"}


def change_boot_id(daemon):
    """The last start is one of an earlier boot, as after a reboot."""
    database = sqlite3.connect(daemon.state / "queue.db")
    with database:
        changed = database.execute("UPDATE instance SET boot_id = ?", (str(uuid.uuid4()),)).rowcount
    database.close()
    if changed != 1:
        raise RuntimeError(f"the table instance has {changed} rows")


class Jobs:
    """What the daemon says of the attempts of some jobs, held against the deaths that there were."""

    def __init__(self, daemon, book, bound):
        self.daemon, self.book, self.bound = daemon, book, bound
        self.deaths = {}  # of each job, by the number of the attempt: what ended it

    def submit(self, name):
        for most in ATTEMPTS:
            job = self.book.submit(self.daemon, spec(f"{name}.{most}", count=COUNT, limits={"max_attempts": most}))
            self.deaths[job] = {}

    def are_running(self):
        return bool(self.daemon.ask("GET", "/v1/workers").json["workers"])

    def attempts(self, job):
        return self.daemon.ask("GET", f"/v1/jobs/{job}/attempts").json["attempts"]

    def check(self, died=None):
        """After a start; `died` is who did. Every attempt that it ended says so, and no job fails before its time."""
        for job, known in self.deaths.items():
            now = self.daemon.ask("GET", f"/v1/jobs/{job}").json
            for attempt in self.attempts(job):
                reason = attempt.get("reason") or ""
                who = next((who for who, text in REASONS.items() if text in reason), None)
                number = attempt["number"]
                if who and known.setdefault(number, died) != who:
                    raise Violation(f"the attempt {number} of {job} ended with the {known[number]}, and says: {reason}")
            self.check_state(job, now, known)

    def check_state(self, job, now, known):
        times, bound = len(known), self.bound
        if now["state"] == "failed":
            if not bound or times != bound + 1 or now["error"]["code"] != "interrupted":
                raise Violation(f"the job {job} failed after {times} interruptions, of which {bound} are allowed:"
                                f" {now['error']}")
        elif bound and times > bound and now["state"] != "succeeded":
            raise Violation(f"the job {job} is {now['state']} after {times} interruptions, of which {bound} are allowed")
        elif now["state"] in FINAL and now["state"] != "succeeded":
            raise Violation(f"the job {job} is {now['state']}: {now['error']}")

    def unfinished(self):
        return [job for job in self.deaths if self.daemon.ask("GET", f"/v1/jobs/{job}").json["state"] not in FINAL]


def die(daemon, jobs, rng, figures):
    """The end of the daemon or of the host while attempts run, and a start."""
    wait_until(lambda: jobs.are_running() or not jobs.unfinished(), "an attempt")
    # the moment is the random thing that is tested, so it is slept for, not waited for
    time.sleep(rng.uniform(0, RUN_S))
    who = rng.choice(list(REASONS))
    daemon.kill()
    daemon.await_nobody()
    daemon.check_database()
    if who == "host":
        change_boot_id(daemon)
    daemon.start()
    jobs.check(who)
    figures["deaths"][who] += 1


def count(jobs, figures):
    for job, known in jobs.deaths.items():
        now = jobs.daemon.ask("GET", f"/v1/jobs/{job}").json
        figures["jobs"][now["state"]] = figures["jobs"].get(now["state"], 0) + 1
        figures["most interruptions of a job that succeeded"] = max(
            figures["most interruptions of a job that succeeded"], len(known) if now["state"] == "succeeded" else 0)
        figures["interruptions"] += len(known)


def play(daemon, book, bound, deaths, seed, figures):
    """A round on a daemon that is not started yet."""
    rng, jobs = random.Random(seed), Jobs(daemon, book, bound)
    daemon.start()
    for k in range(deaths):
        if not jobs.unfinished():
            jobs.submit(f"{seed}.{k}")
        die(daemon, jobs, rng, figures)
    wait_until(lambda: not jobs.unfinished() or daemon.dead(), "the jobs' end")
    jobs.check()
    count(jobs, figures)
    daemon.end_by_drain()


def run(build, where, deaths, seed, say, new_daemon=Daemon):
    """So many deaths; the figures. Raises Violation with the seed and the place."""
    figures = {"deaths": dict.fromkeys(REASONS, 0), "jobs": {}, "interruptions": 0,
               "most interruptions of a job that succeeded": 0}
    done = 0
    while done < deaths:
        base = where / f"round.{done}"
        shutil.rmtree(base, ignore_errors=True)
        some = min(DEATHS_A_ROUND, deaths - done)
        bound = BOUNDS[done // DEATHS_A_ROUND % len(BOUNDS)]
        daemon = new_daemon(build, base, "--workers", len(ATTEMPTS))
        daemon.options[daemon.options.index("--max_interruptions") + 1] = str(bound)
        book = Book(base / "accepted")
        try:
            play(daemon, book, bound, some, f"{seed}.{done}", figures)
        except Exception as e:
            raise Violation(f"death {seed}.{done} in {base}: {e}") from e
        finally:
            if daemon.process and not daemon.dead():
                daemon.kill()
            book.close()
        done += some
        say(f"{done} of {deaths} deaths of daemon and host")
        shutil.rmtree(base)
    return figures
