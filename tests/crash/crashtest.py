"""make crashtest: what is killed, broken and cut off, and whether anything was lost; writes doc/reliability.md."""
import argparse
import json
import pathlib
import platform
import sys
import time

import calls
import faults
import kills
import mutations
import page
import power
from farm import Violation


def parse(words):
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=pathlib.Path, required=True, help="directory of the built programs")
    parser.add_argument("--work", type=pathlib.Path, required=True, help="directory for state and figures")
    parser.add_argument("--cycles", type=int, default=1000, help="kills")
    parser.add_argument("--losses", type=int, default=400, help="power losses")
    parser.add_argument("--every", type=int, default=1, help="only one in so many faults")
    parser.add_argument("--seed", default="1")
    parser.add_argument("--parts", default="kills,faults,power,mutations", help="which, perhaps none; figures of others are kept")
    parser.add_argument("--page", type=pathlib.Path, help="where to write the page, from all parts' last figures")
    return parser.parse_args(words)


def say(text):
    print(text, flush=True)


def main(words):
    options = parse(words)
    missing = calls.why_not()
    if missing and options.parts != "kills":
        sys.exit(f"crashtest: {missing}; --parts kills works without")
    build, work, seed = options.build.resolve(), options.work.resolve(), options.seed
    work.mkdir(parents=True, exist_ok=True)
    parts = {
        "kills": lambda: kills.run(build, work / "kills", options.cycles, seed, say),
        "faults": lambda: faults.run(build, work / "faults", seed, say, options.every),
        "power": lambda: power.run(build, work / "power", options.losses, seed, say),
        "mutations": lambda: {"caught": mutations.run(build, work / "mutations", seed, say)},
    }
    for name in filter(None, options.parts.split(",")):
        began = time.monotonic()
        try:
            figures = parts[name]()
        except Violation as e:
            sys.exit(f"crashtest: {e}")
        figures["about"] = {"seed": seed, "minutes": (time.monotonic() - began) / 60, "kernel": platform.release(),
                            "every": options.every}
        (work / f"{name}.json").write_text(json.dumps(figures, indent=1))
    if options.page:
        known = {name: json.loads((work / f"{name}.json").read_text()) for name in parts
                 if (work / f"{name}.json").exists()}
        options.page.write_text(page.write(known))


if __name__ == "__main__":
    main(sys.argv[1:])
