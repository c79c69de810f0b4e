#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""What others rely on, as rows of text: members of specs and reports, routes, answers, codes, settings, metrics, options and exit
codes. doc/stability.md says what holds for each.

    interface.py BUILD    prints the rows of the programs in BUILD, as tests/stability/frozen.txt has them

A row is a key and, after a colon, what is said of it. What clients send begins with `spec`, `sent` or `parameter`.
"""
import json
import pathlib
import re
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).parent.parent / "service"))
from service import PATIENCE_S, Service, sphere  # noqa: E402

SENT = ("spec ", "sent ", "parameter ")
LOWER = ("minimum", "exclusiveMinimum", "minLength", "minItems")
UPPER = ("maximum", "exclusiveMaximum", "maxLength", "maxItems")
FREE_DEFAULTS = "spec /solver/"  # a better method may have others
METHODS = ("get", "put", "post", "patch", "delete")
PROGRAMS = ("hexad", "hexad-worker", "hexadctl")


def of_schema(key, schema, required=False):
    """Rows of a schema and its members. A reference to another is a type of its own."""
    parts = [schema] + [part for word in ("allOf", "anyOf", "oneOf") for part in schema.get(word, [])]
    types = sorted({t for part in parts for t in types_of(part)})
    said = ["|".join(types) or "any"] + ["required"] * required
    for part in parts:
        said += [f"{word} {part[word]:g}" for word in LOWER + UPPER if word in part]
    if "default" in schema and not key.startswith(FREE_DEFAULTS):
        said.append(f"default {json.dumps(schema['default'], separators=(',', ':'))}")
    rows = {key: said}
    for part in parts:
        rows |= {f"{key} = {json.dumps(word)}": [] for word in part.get("enum", [part["const"]] if "const" in part else [])}
        for name, member in part.get("properties", {}).items():
            if member:  # an alternative may name a member without saying more of it
                rows |= of_schema(f"{key}/{name}", member, name in schema.get("required", []))
        if isinstance(part.get("items"), dict):
            rows |= of_schema(f"{key}[]", part["items"])
    return rows


def types_of(schema):
    if "$ref" in schema:
        return [schema["$ref"].rpartition("/")[2]]
    kind = schema.get("type", [])
    return [kind] if isinstance(kind, str) else kind


def of_spec(schema):
    return {row.replace("spec", "spec ", 1): said for row, said in of_schema("spec", schema).items() if row != "spec"}


def of_openapi(document):
    rows = {}
    schemas = document["components"]["schemas"]
    for name, schema in schemas.items():
        if name in ("JobSpec", "Surface", "AnsweredSpec", "AnsweredSurface"):  # the spec's own rows say it
            continue
        kind = "sent" if schema.get("additionalProperties") is False else "answer"
        rows |= of_schema(f"{kind} {name}", schema)
    for path, methods in document["paths"].items():
        for method in set(methods) & set(METHODS):
            operation, route = methods[method], f"{method.upper()} {path}"
            rows[f"route {route}"] = [operation["operationId"], *re.findall(r"Needs the (scope `\w+`)", operation.get("description", ""))]
            for parameter in operation.get("parameters", []):
                rows |= of_schema(f"parameter {route} {parameter['in']} {parameter['name']}", parameter["schema"],
                                  parameter["in"] != "path" and parameter.get("required", False))
            for status, reply in operation["responses"].items():
                if int(status) < 400:
                    rows[f"status {route} {status}"] = [" ".join(types_of(content["schema"])) or "any"
                                                        for content in reply.get("content", {}).values()]
    for name, reply in document["components"]["responses"].items():
        for code in re.findall(r"`(\w+)`:", reply["description"]):
            rows[f"problem {code}"] = [name.removeprefix("Problem")]
    return rows


def of_report(value, key="report "):
    """Members of a document, by example; null says nothing of a type."""
    if isinstance(value, dict):
        rows = {}
        for name, member in value.items():
            if f"{key}/{name}" != "report /spec":  # the spec's own rows say it
                rows |= of_report(member, f"{key}/{name}")
        return rows
    if isinstance(value, list):
        return {key: ["array"]} | (of_report(value[0], f"{key}[]") if value else {})
    kind = {bool: "boolean", int: "number", float: "number", str: "string"}.get(type(value))
    return {key: [kind]} if kind else {}


def of_settings(text):
    """The lines above each setting say its default and range."""
    rows = {}
    for prose, name in re.findall(r"((?:^# .*\n)+)#(\w+) =", text, re.M):
        default = " ".join(prose.replace("# ", "").split()).rpartition("Default: ")[2]
        rows[f"setting {name}"] = [re.match(r"(.*?)(?: \(|\.(?: |$)|$)", default)[1]]
    return rows


def of_help(program, text):
    # those of hexad that are settings have rows of their own
    named = text.partition("Settings, as options")[0]
    rows = {f"option {program} {word}": [] for word in re.findall(r"(?<![\w-])--[a-z][a-z_-]*", named)}
    exits = re.search(r"Exit (?:codes|status):[^\n]*(?:\n(?!\n).*)*", text)[0]
    rows |= {f"exit {program} {code}": [] for code in re.findall(r"(?<![\w.])(\d+) (?=[a-z])", exits)}
    return rows | {f"command {program} {word}": [] for word in re.findall(r"^  ([a-z][a-z-]*) ", text, re.M)}


def of_header(text):
    """The functions of hexad.h."""
    plain = re.sub(r"\s+", " ", re.sub(r"/\*.*?\*/", "", text, flags=re.S))
    rows = {f"library {name}": f"{result}({arguments})".split(", ")
            for result, name, arguments in re.findall(r"HEXAD_API ([^(;]*?)(hexad_\w+)\(([^)]*)\);", plain)}
    rows |= {f"library {name}": members.strip().rstrip(";").split("; ")
             for members, name in re.findall(r"typedef struct \w+ \{([^}]*)\} (\w+);", plain)}
    return rows | {f"library {name}": words.strip().split(", ") for words, name in re.findall(r"typedef enum \w+ \{([^}]*)\} (\w+);", plain)}


def interface(build):
    def say(program, *words):
        return subprocess.run([build / program, *words], check=True, capture_output=True, text=True, timeout=PATIENCE_S).stdout

    rows = of_spec(json.loads(say("hexad-worker", "schema"))) | of_settings(say("hexad", "--print-config"))
    rows |= of_header((pathlib.Path(__file__).parents[2] / "include/hexad.h").read_text())
    for program in PROGRAMS:
        rows |= of_help(program, say(program, "--help", "all"))
    with tempfile.TemporaryDirectory() as where:
        service = Service(build, where).start()
        try:
            rows |= of_openapi(service.get("/v1/openapi.json").json)
            rows |= {f"metric {name}": [kind] for name, kind in
                     re.findall(r"^# TYPE (\w+) (\w+)$", service.get("/metrics").body.decode(), re.M)}
            job = service.submit(sphere(60))
            service.wait_state(job, "succeeded")
            rows |= {f"result {item['name']}": [] for item in service.get(f"/v1/jobs/{job}/results").json["results"]}
            rows |= of_report(service.get(f"/v1/jobs/{job}/results/report.json").json)
            for key, properties in (("default property", "default"), ("property", "all")):
                job = service.submit(sphere(60, output={"ply": {"properties": properties}}))
                service.wait_state(job, "succeeded")
                header = service.get(f"/v1/jobs/{job}/results/points.ply").body.partition(b"end_header")[0].decode()
                rows |= {f"{key} {name}": [kind] for kind, name in re.findall(r"^property (\w+) (\w+)$", header, re.M)}
        finally:
            service.clean_up()
    return rows


def written(rows):
    return "".join(f"{key}: {', '.join(said)}\n" if said else f"{key}\n" for key, said in sorted(rows.items()))


def read(text):
    rows = {}
    for line in text.splitlines():
        key, _, said = line.partition(": ")
        rows[key] = said.split(", ") if said else []
    return rows


def limit_of(said, word):
    return next((float(s.removeprefix(f"{word} ")) for s in said if s.startswith(f"{word} ")), None)


def broken(frozen, now):
    """Sentences about what a client of the frozen interface would no longer find. Additions are none."""
    faults = []
    for key, said in frozen.items():
        if key not in now:
            faults.append(f"{key} is gone")
            continue
        plain, plain_now = (
            [s for s in row if s != "required" and not s.startswith(LOWER + UPPER)] for row in (said, now[key]))
        if plain != plain_now:
            faults.append(f"{key} was {', '.join(plain)}, and is {', '.join(plain_now)}")
        if key.startswith(SENT):
            for words, narrower in ((LOWER, lambda a, b: b > a), (UPPER, lambda a, b: b < a)):
                for word in words:
                    before, after = limit_of(said, word), limit_of(now[key], word)
                    if after is not None and (before is None or narrower(before, after)):
                        faults.append(f"{key} has become narrower: {word} {after:g}")
        elif "required" in said and "required" not in now[key]:
            faults.append(f"{key} need not be in answers any more")
    for key, said in now.items():
        parent = key.rpartition("/")[0]
        if key.startswith(SENT) and "required" in said and "required" not in frozen.get(key, []) and (
                key in frozen or parent in frozen or key.startswith("parameter ")):
            faults.append(f"{key} has become required")
    return faults


if __name__ == "__main__":
    sys.stdout.write(written(interface(pathlib.Path(sys.argv[1]).resolve())))
