"""doc/measured/reliability.md out of the figures of the last runs."""

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
- a result is deleted when somebody asked for that, and never else: one that the database does not know stands in
  `lost+found/`, byte for byte;
- `/readyz` says `storage_full` and `database_damaged` when that is so, and only then;
- a copy in an `output.directory` that has a report is whole, and no temporary file stays there;
- no process of the service outlives the daemon; the daemon itself neither dies of a fault nor refuses to start after it;
- `PRAGMA integrity_check` and `foreign_key_check` find nothing, in a copy made before SQLite repairs anything.

None of this was violated in the runs below, in which the daemon or its workers were killed {kills} times: the command fails
at the first violation, and writes no page.
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
        "## Deaths of the daemon and of the host", "",
        f"{sum(deaths.values())} deaths during attempts of jobs that may have one attempt or three:"
        f" {deaths['daemon']} of the daemon by kill -9, and {deaths['host']} in which, besides, the next start finds that the"
        f" host was started meanwhile (another boot id). {about(f)} No such attempt counts: each says what ended it, and the"
        f" jobs succeed, one of them after {f['most interruptions of a job that succeeded']} interruptions. Where"
        " `max_interruptions` sets a bound, they fail with `interrupted` at the first beyond it.", "",
        *rows(["", "jobs"], *([f"ended {state}", number] for state, number in sorted(f["jobs"].items()))), ""]


def write_space(f):
    filled, emptied = f["filled"], f["emptied"]
    return [
        "## Disks that fill and empty", "",
        "The state directory and the directory of the copies lie on small disks of their own, which are filled to a random"
        " rest, often to nothing or a few pages, and emptied, under the load and between the kills. No job fails of it,"
        f" whatever it may be tried. {about(f)}", "",
        *rows(["", "state directory", "`output.directory`"], ["filled", filled["state"], filled["output"]],
              ["emptied", emptied["state"], emptied["output"]]), "",
        *rows(["", "times"], ["killed", f["kills"]], ["drained", f["drains"]],
              ["started on a full disk", f["started on a full disk"]],
              ["`/readyz` said `storage_full`, and it was so", f["readyz said that the disk is full"]],
              ["`/readyz` said ok, and there was room", f["readyz said that it has room"]],
              ["deleted on a full disk", f["deleted on a full disk"]],
              ["cancelled on a full disk", f["cancelled on a full disk"]]), "",
        f"At the end {sum(f['ended'].values())} jobs had ended, {f['ended'].get('succeeded', 0)} of them with their results,"
        f" in {f['attempts']} attempts, one of them {f['most attempts of a job']}.", ""]


def write_restores(f):
    return [
        "## Backups put back, databases lost", "",
        f"{f['backups']} backups were made with `hexad --backup` under the load, each whole and with every job that was"
        f" accepted before. {about(f)} After a kill ({f['kills']}) or a drain ({f['drains']}) one of the last three is put back, or the database is removed."
        " What the daemon refuses then it refuses in one line, and changes nothing.", "",
        *rows(["", "times"], ["backups put back", f["backups put back"]],
              ["jobs that they knew", f["jobs that a backup knows"]],
              ["of these, ended from a result that was delivered later", f["jobs ended from a result that was delivered later"]],
              ["jobs that they did not know", f["jobs that it does not know"]],
              ["results put into `lost+found/`", f["results kept in lost+found"]],
              ["databases removed, refused and adopted", f["databases adopted"]],
              ["jobs adopted from their results", f["jobs adopted"]]), ""]


def write_damage(f):
    columns = ["refused to start", "served and said so", "harmless"]
    lines = [[kind, *(row.get(c) or "" for c in columns)] for kind, row in sorted(f["damage"].items())]
    return [
        "## Damage in the database", "",
        f"After a kill ({f['kills']}) or a drain ({f['drains']}) under the load the database is damaged at a random place; then"
        f" the daemon starts. {about(f)} Refused to start: in one line that names the database and the backup. Served and said so: `/readyz` says"
        " `database_damaged`, submissions are refused with that, and no wrong result was served before. Harmless: SQLite's"
        " `integrity_check` finds nothing in a copy either, all jobs that it knows are served, and results of others stand"
        " in `lost+found/`. In all three nothing was removed from `results/`, and the backup that was made before brought"
        " back all that it knew.", "",
        *rows(["damage", *columns], *lines), ""]


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


def count_kills(figures):
    """In all parts that are there."""
    counts = {"kills": lambda f: sum(f["cycles"].values()), "clocks": lambda f: sum(f["cycles"].values()), "reboots": lambda f: sum(f["deaths"].values())}
    return sum(counts.get(name, lambda f: f["kills"])(figures[name])
               for name in ("kills", "clocks", "reboots", "space", "restores", "damage") if name in figures)


def write(figures):
    parts = {"kills": write_kills, "clocks": write_clocks, "reboots": write_reboots, "space": write_space, "restores": write_restores,
             "damage": write_damage, "faults": write_faults, "power": write_power, "mutations": write_mutations}
    lines = [HEAD.format(kills=count_kills(figures))]
    for name, write_part in parts.items():
        if name in figures:
            lines += write_part(figures[name])
    return "\n".join(lines).rstrip() + "\n"
