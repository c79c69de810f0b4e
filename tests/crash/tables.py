# SPDX-License-Identifier: Apache-2.0
"""Results of crashtest.py as CSV, from the figures of the last run of each part: crash.csv, and a table each for damage, faults and
deliberate faults."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "measurements" / "common"))
import results  # noqa: E402

# how a damaged database, or a fault of the disk, ended: the key of the figures, and the column
DAMAGE = {"refused to start": "refused_to_start", "served and said so": "reported", "harmless": "harmless"}
FAULTS = {"went on": "unaffected", "said so": "reported", "refused to start": "refused_to_start", "not reached": "not_reached"}


def ended(f):
    return [("jobs ended", sum(f["ended"].values())), ("jobs ended succeeded", f["ended"].get("succeeded", 0))]


def attempts(f):
    return [("attempts", f["attempts"]), ("most attempts of a job", f["most attempts of a job"])]


def of_kills(f):
    again = f["submissions"].get("201 again", 0)
    return [("kills", sum(f["cycles"].values())), *((f"killed {what}", n) for what, n in sorted(f["cycles"].items())),
            ("jobs accepted", f["submissions"].get("201", 0) + again), ("jobs accepted with the same key again", again),
            ("sequences of two frames", f["sequences"]), ("results of an equal job from the cache", f["served from the cache"]),
            *((f"jobs ended {state}", n) for state, n in sorted(f["ended"].items())), ("jobs deleted", f["deleted"]), *attempts(f),
            ("kills between the rename of a result and its transaction", f["results found at a start"]),
            ("files fetched and compared", f["files fetched"]), ("results copied to an output.directory", f["copies in output.directory"]),
            ("temporary files that kills left there", f["temporary files left by kills"])]


def of_clocks(f):
    return [("kills", sum(f["cycles"].values())), ("jobs ended", sum(f["ended"].values())), ("files fetched and compared", f["files fetched"])]


def of_reboots(f):
    return [("stops", sum(f["deaths"].values())), ("stops of the daemon", f["deaths"]["daemon"]), ("stops of the host", f["deaths"]["host"]),
            *((f"jobs ended {state}", n) for state, n in sorted(f["jobs"].items())),
            ("most interruptions of a job that succeeded", f["most interruptions of a job that succeeded"])]


def of_space(f):
    places = {"state": "state directory", "output": "output.directory"}
    return [*((f"{place} {what}", f[what][key]) for what in ("filled", "emptied") for key, place in places.items()),
            ("killed", f["kills"]), ("drained", f["drains"]), ("started on a full disk", f["started on a full disk"]),
            ("/readyz reported storage_full on a full disk", f["readyz said that the disk is full"]),
            ("/readyz reported ok with free space", f["readyz said that it has room"]),
            ("deleted on a full disk", f["deleted on a full disk"]), ("cancelled on a full disk", f["cancelled on a full disk"]),
            *ended(f), *attempts(f)]


def of_restores(f):
    return [("backups", f["backups"]), ("kills", f["kills"]), ("drains", f["drains"]), ("backups restored", f["backups put back"]),
            ("jobs in these backups", f["jobs that a backup knows"]),
            ("ended from a result that was delivered later", f["jobs ended from a result that was delivered later"]),
            ("jobs that are not in the backup", f["jobs that it does not know"]),
            ("results put into lost+found/", f["results kept in lost+found"]),
            ("databases removed; start refused, then results adopted", f["databases adopted"]),
            ("jobs adopted from their results", f["jobs adopted"])]


def of_damage(f):
    return [("kills", f["kills"]), ("drains", f["drains"])]


def of_arrays(f):
    again = "kills while a start completed changes"
    return [("kills", f["kills"]), (again, f[again]), *((f"{action} {how}", n) for action, counts in f["changes"].items() for how, n in counts.items()),
            ("data sets", f["data sets"]), ("arrays that wait for frames of another", f["waiting arrays"])]


def of_upgrades(f):
    return [("kills", f["kills"]), ("kills before the service was ready", f["kills before the service was ready"]),
            *((f"states of {build}", n) for build, n in f["states"].items())]


def of_shortage(f):
    slowest = [(f"slowest {what} after the connections have ended, s", f"{f['slowest'][kind]:.3f}")
               for kind, what in (("healthz", "/healthz"), ("POST", "submission")) if f["slowest"][kind] is not None]
    return [("tries", f["tries"]), ("limit set while the service ran", f["limit set while it ran"]), ("limit reached", f["limit reached"]),
            ("jobs accepted", f["jobs accepted"]), *slowest]


def of_faults(f):
    return [("system calls from the start to a served result", f["calls"]), ("runs", f["faults"]), ("one in so many calls was tried", f["about"]["every"])]


def of_power(f):
    return [("records", f["records"]), ("changes", f["calls"]), ("calls of fsync", f["syncs"]), ("calls of fsync that fail", f["failed syncs"]),
            ("jobs accepted", f["jobs"]), ("losses", sum(f["losses"].values())), *((f"losses, {left}", n) for left, n in f["losses"].items())]


PARTS = {"kills": of_kills, "clocks": of_clocks, "reboots": of_reboots, "space": of_space, "restores": of_restores, "damage": of_damage,
         "arrays": of_arrays, "upgrades": of_upgrades, "shortage": of_shortage, "faults": of_faults, "power": of_power}


def count_kills(figures):
    """In all parts that are there."""
    counts = {"kills": lambda f: sum(f["cycles"].values()), "clocks": lambda f: sum(f["cycles"].values()), "reboots": lambda f: sum(f["deaths"].values())}
    return sum(counts.get(name, lambda f: f["kills"])(figures[name])
               for name in ("kills", "clocks", "reboots", "space", "restores", "damage", "arrays", "upgrades") if name in figures)


def quantities(figures):
    rows = [["all: kills of the daemon or its workers", count_kills(figures)]]
    for name, of_part in PARTS.items():
        if name in figures:
            about = figures[name]["about"]
            conditions = [("seed", about["seed"]), ("minutes", f"{about['minutes']:.0f}"), ("kernel", f"Linux {about['kernel']}"),
                          *([("date", about["date"])] if "date" in about else [])]
            rows += [[f"{name}: {what}", value] for what, value in (*of_part(figures[name]), *conditions)]
    return rows


def counted(table, columns):
    return [[name.replace("|", " "), *(row.get(key, 0) for key in columns)] for name, row in sorted(table.items())]


def write(figures, output):
    """Writes the tables of the parts that are there: --output, and files beside it."""
    def beside(part, header, rows):
        results.write(output.with_name(f"{output.stem}_{part}.csv"), header, rows)

    results.write(output, ["quantity", "measured"], quantities(figures))
    if "damage" in figures:
        beside("damage", ["damage", *DAMAGE.values()], counted(figures["damage"]["damage"], DAMAGE))
    if "faults" in figures:
        rows = counted(figures["faults"]["table"], FAULTS)
        beside("faults", ["fault", *FAULTS.values()], [*rows, ["all", *map(sum, list(zip(*rows))[1:])]])
    if "mutations" in figures:
        beside("mutations", ["fault", "detected_by"], [[what, part] for what, part, _ in figures["mutations"]["caught"]])
