# SPDX-License-Identifier: Apache-2.0
"""make crashtest: what is killed, filled, broken and cut off, and whether anything was lost; measurements/reliability has the results."""
import argparse
import datetime
import json
import math
import pathlib
import platform
import sys
import time

import arrays
import calls
import damage
import faults
import kills
import mutations
import power
import reboots
import restores
import shortage
import space
import tables
import upgrades
import volume
from farm import Violation, setclock

# of all kills
SHARES = {"kills": 0.3, "clocks": 0.22, "reboots": 0.21, "space": 0.06, "restores": 0.05, "damage": 0.04, "arrays": 0.08, "upgrades": 0.04}
SUPERVISED = {"faults", "power", "mutations"}


def parse(words):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=pathlib.Path, required=True, help="directory of the built programs")
    parser.add_argument("--work", type=pathlib.Path, required=True, help="directory for state and figures")
    parser.add_argument("--kills", type=int, default=4000, help=f"in all, shared out among parts: {SHARES}")
    parser.add_argument("--losses", type=int, default=400, help="power losses")
    parser.add_argument("--shortages", type=int, default=50, help="services whose clients take all descriptors")
    parser.add_argument("--every", type=int, default=1, help="only one in so many faults")
    parser.add_argument("--seed", default="1")
    parser.add_argument("--parts", default=",".join([*SHARES, "shortage", "faults", "power", "mutations"]),
                        help="which, perhaps none; figures of others are kept")
    parser.add_argument("--output", type=pathlib.Path,
                        help="where to write the results of all parts' last figures, as CSV, with files for damage, faults and mutations beside it")
    return parser.parse_args(words)


def say(text):
    print(text, flush=True)


def choose(parts):
    """Those that are possible here."""
    chosen = list(filter(None, parts.split(",")))
    missing = calls.why_not()
    if missing and SUPERVISED & set(chosen):
        sys.exit(f"crashtest: {missing}; --parts {','.join(SHARES)} works without")
    if setclock.why_not() and "clocks" in chosen:
        say(f"no part clocks: {setclock.why_not()}")
        chosen.remove("clocks")
    unmounted = volume.why_not()
    if unmounted and "space" in chosen:
        say(f"no part space: {unmounted}")
        chosen.remove("space")
    return chosen


def main(words):
    options = parse(words)
    chosen = choose(options.parts)
    build, work, seed = options.build.resolve(), options.work.resolve(), options.seed
    work.mkdir(parents=True, exist_ok=True)
    times = {name: math.ceil(share * options.kills) for name, share in SHARES.items()}
    parts = {
        "kills": lambda: kills.run(build, work / "kills", times["kills"], seed, say),
        "clocks": lambda: kills.run_with_steps(build, work / "clocks", times["clocks"], seed, say),
        "reboots": lambda: reboots.run(build, work / "reboots", times["reboots"], seed, say),
        "space": lambda: space.run(build, work / "space", times["space"], seed, say),
        "restores": lambda: restores.run(build, work / "restores", times["restores"], seed, say),
        "damage": lambda: damage.run(build, work / "damage", times["damage"], seed, say),
        "arrays": lambda: arrays.run(build, work / "arrays", times["arrays"], seed, say),
        "upgrades": lambda: upgrades.run(build, work / "upgrades", times["upgrades"], seed, say),
        "shortage": lambda: shortage.run(build, work / "shortage", options.shortages, seed, say),
        "faults": lambda: faults.run(build, work / "faults", seed, say, options.every),
        "power": lambda: power.run(build, work / "power", options.losses, seed, say),
        "mutations": lambda: {"caught": mutations.run(build, work / "mutations", seed, say)},
    }
    for name in chosen:
        began = time.monotonic()
        try:
            figures = parts[name]()
        except Violation as e:
            sys.exit(f"crashtest: {e}")
        figures["about"] = {"seed": seed, "minutes": (time.monotonic() - began) / 60, "kernel": platform.release(),
                            "date": datetime.date.today().isoformat(),
                            "every": options.every}
        (work / f"{name}.json").write_text(json.dumps(figures, indent=1))
    if options.output:
        known = {name: json.loads((work / f"{name}.json").read_text()) for name in parts
                 if (work / f"{name}.json").exists()}
        for row in tables.quantities(known):
            say(", ".join(map(str, row)))
        tables.write(known, options.output)


if __name__ == "__main__":
    main(sys.argv[1:])
