# SPDX-License-Identifier: Apache-2.0
"""measurements/reliability/reliability.md out of the figures of the last runs."""

HEAD = """# Reliability: kills, faults and power losses

`make crashtest` writes this page; no part of it is written by hand. The test runs the built service: daemon, workers, SQLite and sockets. Clients
record, where the daemon has no access, every acceptance (a 201 that was read to its end) and every end of a job that they received, with the
hash of the result. After each kill, fault or loss the daemon is started again and compared with this record:

- Every accepted job exists under its name. No job exists twice or without a submission.
- Every job ends: with one result that never changes, each file of which is served with the length and the SHA-256 of its listing;
  or failed with a code and a reason; or cancelled, if that was requested. Without faults of the disk, a job fails only after its last
  attempt, and attempts that ended with the daemon do not count.
- The end of a job that a client received does not change.
- `results/` has exactly the results of the jobs that succeeded, and `attempts/` has at most logs. After a failed fsync, a power loss may
  restore what was removed.
- A result is deleted only by request. A result that is not in the database is kept in `lost+found/`, byte for byte.
- `/readyz` reports `storage_full` and `database_damaged` exactly while they are true.
- A copy in an `output.directory` that has a report is complete, and no temporary file remains there.
- No process of the service outlives the daemon. The daemon neither stops because of a fault nor refuses to start after it.
- `PRAGMA integrity_check` and `foreign_key_check` find nothing, in a copy made before SQLite repairs anything.

The command stops at the first violation, and then writes no page. In the runs below the daemon or its workers were killed {kills} times.
"""


def about(figures):
    a = figures["about"]
    date = f", {a['date']}" if "date" in a else ""
    return f"Seed {a['seed']}, {a['minutes']:.0f} minutes, Linux {a['kernel']}{date}."


def rows(*lines):
    table = [f"| {' | '.join(str(cell) for cell in line)} |" for line in lines]
    return [table[0], "|" + "---|" * len(lines[0]), *table[1:]]


def write_kills(f):
    ended, total = f["ended"], sum(f["cycles"].values())
    return [
        "## kill -9", "",
        f"{total} kills at random moments, while two clients submit, one reads and fetches, and some jobs are"
        f" cancelled. {about(f)} The seed determines the moments and the load, but not the state of the machine.", "",
        *rows(["killed", "times"], *sorted(f["cycles"].items())), "",
        *rows(["", "jobs"], ["accepted", f["submissions"].get("201", 0) + f["submissions"].get("201 again", 0)],
              ["- with the same key again, after an incomplete answer or an error",
               f["submissions"].get("201 again", 0)],
              ["sequences of two frames", f["sequences"]], ["results of an equal job from the cache", f["served from the cache"]],
              *([f"ended {state}", ended[state]] for state in sorted(ended)), ["deleted", f["deleted"]]), "",
        f"The jobs took {f['attempts']} attempts, one of them {f['most attempts of a job']}."
        f" {f['results found at a start']} times the kill fell between the rename of a result and the transaction that"
        f" ends its job. {f['files fetched']} files were fetched and compared. {f['copies in output.directory']} results were"
        f" copied to an `output.directory`; kills left {f['temporary files left by kills']} temporary files there, which the"
        " next starts removed.", ""]


def write_clocks(f):
    return ["## kill -9 with clock steps", "",
            f"The same with {sum(f['cycles'].values())} kills, and in each cycle a step of the wall clock by up to ten hours forward"
            f" or back while the daemon runs. {about(f)} {sum(f['ended'].values())} jobs ended and"
            f" {f['files fetched']} files were fetched and compared.", ""]


def write_reboots(f):
    deaths = f["deaths"]
    return [
        "## Stops of the daemon and of the host", "",
        f"{sum(deaths.values())} stops during attempts of jobs that may have one attempt or three:"
        f" {deaths['daemon']} of the daemon by kill -9, and {deaths['host']} in which, besides, the next start finds that the"
        f" host was started meanwhile (another boot id). {about(f)} Such attempts do not count, and have the reason of"
        f" their end. The jobs succeed, one of them after {f['most interruptions of a job that succeeded']} interruptions. With"
        " `max_interruptions`, a job fails with `interrupted` at the first interruption above it.", "",
        *rows(["", "jobs"], *([f"ended {state}", number] for state, number in sorted(f["jobs"].items()))), ""]


def write_space(f):
    filled, emptied = f["filled"], f["emptied"]
    return [
        "## Disks that fill and empty", "",
        "The state directory and the directory of the copies are on small disks of their own. Under the load and between the"
        " kills, these are filled until a random space, often none or a few pages, is free, and emptied. No job fails because of"
        f" this. {about(f)}", "",
        *rows(["", "state directory", "`output.directory`"], ["filled", filled["state"], filled["output"]],
              ["emptied", emptied["state"], emptied["output"]]), "",
        *rows(["", "times"], ["killed", f["kills"]], ["drained", f["drains"]],
              ["started on a full disk", f["started on a full disk"]],
              ["`/readyz` reported `storage_full` on a full disk", f["readyz said that the disk is full"]],
              ["`/readyz` reported ok with free space", f["readyz said that it has room"]],
              ["deleted on a full disk", f["deleted on a full disk"]],
              ["cancelled on a full disk", f["cancelled on a full disk"]]), "",
        f"At the end {sum(f['ended'].values())} jobs had ended, {f['ended'].get('succeeded', 0)} of them with their results,"
        f" in {f['attempts']} attempts, one of them {f['most attempts of a job']}.", ""]


def write_restores(f):
    return [
        "## Restored backups, lost databases", "",
        f"{f['backups']} backups were made with `hexad --backup` under the load, each whole and with every job that was"
        f" accepted before. {about(f)} After a kill ({f['kills']}) or a drain ({f['drains']}) one of the last three is"
        " restored, or the database is removed. If the daemon then refuses to start, it prints one line and changes nothing.", "",
        *rows(["", "times"], ["backups restored", f["backups put back"]],
              ["jobs in these backups", f["jobs that a backup knows"]],
              ["- ended from a result that was delivered later", f["jobs ended from a result that was delivered later"]],
              ["jobs that are not in the backup", f["jobs that it does not know"]],
              ["results put into `lost+found/`", f["results kept in lost+found"]],
              ["databases removed; start refused, then results adopted", f["databases adopted"]],
              ["jobs adopted from their results", f["jobs adopted"]]), ""]


def write_damage(f):
    columns = ["refused to start", "served and said so", "harmless"]
    lines = [[kind, *(row.get(c) or "" for c in columns)] for kind, row in sorted(f["damage"].items())]
    return [
        "## Damage in the database", "",
        f"After a kill ({f['kills']}) or a drain ({f['drains']}) under the load the database is damaged at a random place; then"
        f" the daemon starts. {about(f)} In every case nothing was removed from `results/`, and the backup that was made before"
        " restored all of its jobs.", "",
        "- refused to start: the daemon prints one line that names the database and the backup.",
        "- reported: `/readyz` reports `database_damaged`, submissions are refused with that code, and no wrong result was"
        " served before.",
        "- harmless: SQLite's `integrity_check` finds nothing in a copy either, all jobs in the database are served, and results"
        " of other jobs are in `lost+found/`.", "",
        *rows(["damage", "refused to start", "reported", "harmless"], *lines), ""]


def write_faults(f):
    columns = ["went on", "said so", "refused to start", "not reached"]
    sampled = f" One in {f['about']['every']} of the calls was tried." if f["about"]["every"] > 1 else ""
    lines = [[*key.split("|"), *(row.get(c, "") for c in columns)] for key, row in sorted(f["table"].items())]
    sums = ["", "all", *(sum(row.get(c, 0) for row in f["table"].values()) for c in columns)]
    return [
        "## Faults of the disk", "",
        f"From the start of a daemon to the served result of one job, the daemon, SQLite and the worker make {f['calls']} system"
        " calls on files of the state directory. Each call is made to fail in each possible way, in a run of its own:"
        f" {f['faults']} runs. A dozen of the hundreds of calls that write and read a picture is tried.{sampled} {about(f)}"
        " Afterwards another job is submitted, the daemon is drained or killed, and started without faults.", "",
        "- unaffected: the job succeeded and no request had an error.",
        "- reported: a request was answered with an error, or the job failed with one.",
        "- refused to start: the daemon ended with a message.",
        "- not reached: the run had fewer calls of this kind.", "",
        *rows(["call", "fault", "unaffected", "reported", "refused to start", "not reached"], *lines, sums), ""]


def write_power(f):
    return [
        "## Power loss", "",
        f"{f['records']} records of a service under load. Each begins with the state that a loss of the previous one left:"
        f" {f['calls']} changes, {f['syncs']} of them calls of fsync, {f['jobs']} jobs accepted. In the second half"
        f" some calls of fsync fail ({f['failed syncs']}). As on Linux, their data may be lost although a later call succeeds. At"
        f" {sum(f['losses'].values())} random points a disk is constructed as a power loss may leave it, and a daemon is started"
        f" there. {about(f)} What was synced is kept. The rest:", "",
        *rows(["left over", "losses"], *f["losses"].items()), "",
        "- any of it is left: each page of 4 KiB that was written, each change of a name and each truncation is kept or lost by"
        " itself, and pages tear between sectors of 512 bytes.",
        "- names are left in order: names as with a journal, pages as above.", "",
        "Replayed to its end, each record gave the state directory byte by byte.", ""]


def write_shortage(f):
    seconds = ", and ".join(f"{what} after {f['slowest'][kind]:.3f} s" for kind, what in
                            (("healthz", "/healthz"), ("POST", "a submission")) if f["slowest"][kind] is not None)
    return [
        "## Shortage of descriptors", "",
        f"{f['tries']} services with a limit of 40 to 1 024 open files, and 1 to 2 000 connections of clients that send nothing, a"
        f" part of a request or a request. {about(f)} The limit was set while the service ran in {f['limit set while it ran']} tries,"
        f" and reached in {f['limit reached']}. Within 2 s after the connections have ended, `/healthz` is answered, and from a limit"
        f" of 120 on a job is accepted ({f['jobs accepted']} tries); at the latest {seconds}. The log names what was lacking.", ""]


def write_mutations(f):
    return [
        "## Deliberate faults", "",
        "The test must detect each of these deliberate faults in the service, or the command fails:", "",
        *rows(["fault", "detected by"], *([what, part] for what, part, _ in f["caught"])), ""]


def count_kills(figures):
    """In all parts that are there."""
    counts = {"kills": lambda f: sum(f["cycles"].values()), "clocks": lambda f: sum(f["cycles"].values()), "reboots": lambda f: sum(f["deaths"].values())}
    return sum(counts.get(name, lambda f: f["kills"])(figures[name])
               for name in ("kills", "clocks", "reboots", "space", "restores", "damage") if name in figures)


def write(figures):
    parts = {"kills": write_kills, "clocks": write_clocks, "reboots": write_reboots, "space": write_space, "restores": write_restores,
             "damage": write_damage, "shortage": write_shortage, "faults": write_faults, "power": write_power, "mutations": write_mutations}
    lines = [HEAD.format(kills=count_kills(figures))]
    for name, write_part in parts.items():
        if name in figures:
            lines += write_part(figures[name])
    return "\n".join(lines).rstrip() + "\n"
