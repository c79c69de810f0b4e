"""doc/reliability.md out of the figures of the last runs."""

HEAD = """# What was killed, broken and cut off

Written by `make crashtest`; nothing here is by hand. The service under test is the built one, whole: daemon, workers,
SQLite, sockets. Clients write down every acceptance (a 201 that was read to its end) where the daemon cannot reach,
and every end that they were told, with the hash of the result. After each kill, fault or loss the daemon is started again
and held against that:

- every accepted job is there, under its name, and none is there twice or was never sent;
- every job ends: with one result, the same for ever, each file of which is served with the length and the SHA-256 of
  its listing; or failed with a code and a reason, and (but for faults) when its attempts are spent, no sooner,
  where those do not count that ended with the daemon; or cancelled,
  when that was asked;
- what a client was told of a job's end stays so;
- `results/` holds exactly the results of the jobs that succeeded, `attempts/` no more than logs (but for a power loss
  after a failed fsync, which may bring back what was removed);
- no process of the service outlives the daemon; the daemon itself neither dies of a fault nor refuses to start after it;
- `PRAGMA integrity_check` and `foreign_key_check` find nothing, in a copy made before SQLite repairs anything.

None of this was violated in the runs below: the command fails at the first violation, and writes no page.
"""


def about(figures):
    a = figures["about"]
    return f"Seed {a['seed']}, {a['minutes']:.0f} minutes, Linux {a['kernel']}."


def rows(*lines):
    table = [f"| {' | '.join(str(cell) for cell in line)} |" for line in lines]
    return [table[0], "|" + "---|" * len(lines[0]), *table[1:]]


def write_kills(f):
    ended, total = f["ended"], sum(f["cycles"].values())
    return [
        "## kill -9", "",
        f"{total} kills at random moments, while two clients submit, one reads and fetches, and some jobs are"
        f" cancelled. {about(f)} The seed gives the moments and the load; what the machine is just doing then it does"
        " not.", "",
        *rows(["killed", "times"], *sorted(f["cycles"].items())), "",
        *rows(["", "jobs"], ["accepted", f["submissions"].get("201", 0) + f["submissions"].get("201 again", 0)],
              ["of them when sent again under the same key, the first answer being cut off or an error",
               f["submissions"].get("201 again", 0)],
              ["sequences of two frames", f["sequences"]], ["given the result of an equal one", f["served from the cache"]],
              *([f"ended {state}", ended[state]] for state in sorted(ended)), ["deleted", f["deleted"]]), "",
        f"The jobs took {f['attempts']} attempts, one of them {f['most attempts of a job']}."
        f" {f['results found at a start']} times the kill fell between the rename of a result and the transaction that"
        f" ends its job. {f['files fetched']} files were fetched and compared.", ""]


def write_faults(f):
    columns = ["went on", "said so", "refused to start", "not reached"]
    sampled = f" One in {f['about']['every']} of them was tried." if f["about"]["every"] > 1 else ""
    lines = [[*key.split("|"), *(row.get(c, "") for c in columns)] for key, row in sorted(f["table"].items())]
    sums = ["", "all", *(sum(row.get(c, 0) for row in f["table"].values()) for c in columns)]
    return [
        "## Faults of the disk", "",
        f"One job's way from the start of a daemon to its served result makes {f['calls']} system calls on files of the"
        " state directory, in the daemon, in SQLite and in the worker. Each is failed, in each way that it can, in a"
        f" run of its own: {f['faults']} runs (of the hundreds of pieces in which a picture is written and read, a"
        f" dozen is taken).{sampled} {about(f)} Afterwards another job is submitted, the daemon is drained or killed, and"
        " started without faults.", "",
        "Went on: the job succeeded and no request saw anything. Said so: a request was answered with an error, or the"
        " job failed with one. Refused to start: the daemon ended with a message. Not reached: that run had fewer such"
        " calls.", "",
        *rows(["call", "fault", *columns], *lines, sums), ""]


def write_power(f):
    return [
        "## Power loss", "",
        f"{f['records']} records of a loaded service, each begun from what a loss of the one before had left:"
        f" {f['calls']} changes, {f['syncs']} of them calls of fsync, {f['jobs']} jobs accepted. In the second half"
        f" some calls of fsync fail ({f['failed syncs']}), and what waited for them may be lost although a later call"
        " succeeds, as it is on Linux. From"
        f" {sum(f['losses'].values())} random points a disk is made as a power loss may leave it and a daemon started"
        f" there. {about(f)} What was synced is there; of the rest:", "",
        *rows(["left over", "losses"], *f["losses"].items()), "",
        "Any of it: each page of 4 KiB that was written, each change of a name and each truncation stays or goes by"
        " itself, and pages tear between sectors of 512 bytes. In order: names as by a journal, pages as above."
        " Replayed to their ends the records gave the state directories byte by byte.", ""]


def write_mutations(f):
    return [
        "## That the test can fail", "",
        "The same service, broken on purpose. Each of these is caught, or the command fails:", "",
        *rows(["broken", "caught by"], *([what, part] for what, part, _ in f["caught"])), ""]


def write(figures):
    parts = {"kills": write_kills, "faults": write_faults, "power": write_power, "mutations": write_mutations}
    lines = [HEAD]
    for name, write_part in parts.items():
        if name in figures:
            lines += write_part(figures[name])
    return "\n".join(lines).rstrip() + "\n"
