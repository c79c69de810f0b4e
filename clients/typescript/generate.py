# SPDX-License-Identifier: Apache-2.0
"""Writes api.js and api.d.ts from the OpenAPI document that the service serves, and the types of the other modules.

    generate.py BUILD [DIRECTORY]

BUILD is the directory of the program hexad, which is started for a moment; DIRECTORY is by default the directory of this
file. hexad.d.ts, node.d.ts and sha256.d.ts are written by tsc (Debian's node-typescript) from the comments of the
modules; without tsc they are left as they are.
"""
import json
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import textwrap
from typing import Any, Dict, Iterator, List

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "python"))
from hexad.transport import Transport  # noqa: E402

Schema = Dict[str, Any]
WIDTH = 110
MODULES = ("hexad.js", "node.js", "sha256.js")
LICENCE = "// SPDX-License-Identifier: Apache-2.0\n"
HEAD = LICENCE + "// Written by generate.py from the OpenAPI document; do not edit.\n"
BYTES, JSON = "application/octet-stream", "application/json"
NAMES = {"string": "string", "integer": "number", "number": "number", "boolean": "boolean", "null": "null"}


def prose(text: str, indent: str) -> str:
    """A comment for editors; empty: there is no text."""
    text = " ".join(text.split()).replace("*/", "*\\/")
    if not text:
        return ""
    if len(indent) + len(text) + 7 <= WIDTH:
        return f"{indent}/** {text} */\n"
    wrapped = textwrap.fill(text, WIDTH, initial_indent=f"{indent} * ", subsequent_indent=f"{indent} * ",
                            break_on_hyphens=False, break_long_words=False)
    return f"{indent}/**\n{wrapped}\n{indent} */\n"


def key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z_$][\w$]*", name) else json.dumps(name)


def either(types: List[str]) -> str:
    return " | ".join(dict.fromkeys(types))


def type_of(schema: Schema, indent: str) -> str:
    """The type that a schema describes. Ranges, patterns and which members exclude each other are left to the service."""
    if "$ref" in schema:
        return str(schema["$ref"].rpartition("/")[2])
    if "const" in schema:
        return json.dumps(schema["const"])
    if "enum" in schema:
        return either([json.dumps(word) for word in schema["enum"]])
    if "oneOf" in schema:
        return either([type_of(part, indent) for part in schema["oneOf"]])
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    return either([type_of_kind(kind, schema, indent) for kind in kinds])


def type_of_kind(kind: str, schema: Schema, indent: str) -> str:
    if kind == "array":
        items = type_of(schema["items"], indent) if "items" in schema else "unknown"
        return f"({items})[]" if " | " in items else f"{items}[]"
    if kind != "object":
        return NAMES[kind]
    bases = [type_of(part, indent) for part in schema.get("allOf", []) if "$ref" in part]
    if "properties" not in schema and not bases:
        values = schema.get("additionalProperties")
        return f"{{[name: string]: {type_of(values, indent) if isinstance(values, dict) and values else 'unknown'}}}"
    needed = schema.get("required", [])
    lines = "".join(f"{prose(part.get('description', ''), indent + '  ')}{indent}  {key(name)}{'' if name in needed else '?'}: "
                    f"{type_of(part, indent + '  ')};\n" for name, part in schema.get("properties", {}).items())
    return " & ".join([*bases, f"{{\n{lines}{indent}}}"])


class Operation:
    """What a request of one kind has, and its answer."""

    def __init__(self, method: str, path: str, described: Schema) -> None:
        self.name, self.method, self.path = described["operationId"], method.upper(), path
        self.parameters = described.get("parameters", [])
        content = described.get("requestBody", {}).get("content", {})
        self.body = JSON if JSON in content else next(iter(content), None)
        self.body_schema = content[self.body]["schema"] if self.body else None
        self.prose = f"{described['summary']}. {described.get('description', '')}"
        given = {status: response.get("content", {}) for status, response in described["responses"].items() if status < "4"}
        media = {kind: part["schema"] for kinds in given.values() for kind, part in kinds.items()}
        self.answer_kind = ("json" if JSON in media else "text" if "text/plain" in media else "bytes" if media else "nothing")
        self.answer = {"json": lambda: type_of(media[JSON], "    "), "text": lambda: "string", "bytes": lambda: "Uint8Array",
                       "nothing": lambda: "null"}[self.answer_kind]()
        if self.answer != "null" and not all(given.values()):  # 204: nothing more will come; 304: it has not changed
            self.answer += " | null"
        names = [p["name"] for p in self.parameters]
        assert len({*names, "body"}) == len(names) + 1, f"{self.name}: two parameters of one name"

    def row(self) -> str:
        """How the client sends it."""
        headers = [p["name"] for p in self.parameters if p["in"] == "header"]
        members = {"method": self.method, "path": self.path, "headers": headers, "body": self.body, "answer": self.answer_kind}
        return f"  {self.name}: {{" + ", ".join(f"{name}: {json.dumps(value)}" for name, value in members.items()) + "},\n"

    def types(self) -> str:
        members = ""
        for p in self.parameters:
            members += prose(p.get("description", ""), "      ")
            members += f"      {key(p['name'])}{'' if p.get('required') else '?'}: {type_of(p['schema'], '      ')};\n"
        if self.body_schema:
            members += f"      body: {'Uint8Array' if self.body == BYTES else type_of(self.body_schema, '      ')};\n"
        inside = f"{{\n{members}    }}" if members else "{}"
        return f"{prose(self.prose, '  ')}  {self.name}: {{\n    parameters: {inside};\n    answer: {self.answer};\n  }};\n"


def operations_of(document: Schema) -> Iterator[Operation]:
    for path, methods in document["paths"].items():
        for method, described in methods.items():
            yield Operation(method, path, described)


def write_types(document: Schema) -> str:
    text = HEAD
    for name, schema in document["components"]["schemas"].items():
        text += f"\n{prose(schema.get('description', ''), '')}export type {name} = {type_of(schema, '')};\n"
    text += "\n/** The requests of the service by their names in the OpenAPI document: what each needs, and its answer. */\n"
    text += "export interface Operations {\n" + "".join(o.types() for o in operations_of(document)) + "}\n"
    return text + """
export interface Route {
  method: string;
  /** With {name} for the parameters in it. */
  path: string;
  /** The parameters that are header fields. */
  headers: string[];
  /** The media type of the body. */
  body: string | null;
  answer: "json" | "text" | "bytes" | "nothing";
}
export const operations: {[name in keyof Operations]: Route};
"""


def write_routes(document: Schema) -> str:
    return HEAD + "export const operations = {\n" + "".join(o.row() for o in operations_of(document)) + "};\n"


def document_of(build: pathlib.Path) -> Schema:
    with tempfile.TemporaryDirectory() as state:
        daemon = subprocess.Popen([build / "hexad", "--state_dir", state, "--reserve_mb", "1", "--log_level", "warning"])
        try:
            document: Schema = Transport(f"unix:{state}/hexad.sock").get("/v1/openapi.json")
        finally:
            daemon.terminate()
            daemon.wait()
    return document


def node_types(tsc: str) -> pathlib.Path:
    """The types of Node, which Debian's nodejs has beside the compiler."""
    return pathlib.Path(tsc).resolve().parents[2] / "@types"


def declare(tsc: str, directory: pathlib.Path) -> None:
    """Checks the modules, and writes their types into the directory. It holds api.d.ts."""
    with tempfile.TemporaryDirectory() as work:
        for name in (*MODULES, "tsconfig.json"):
            shutil.copy(HERE / name, work)
        shutil.copy(directory / "api.d.ts", work)
        subprocess.run([tsc, "--project", work, "--outDir", directory, "--typeRoots", node_types(tsc)], check=True)
    for name in MODULES:
        types = (directory / name).with_suffix(".d.ts")
        types.write_text(LICENCE + types.read_text())


def main(build: pathlib.Path, directory: pathlib.Path) -> None:
    document = document_of(build)
    (directory / "api.js").write_text(write_routes(document))
    (directory / "api.d.ts").write_text(write_types(document))
    tsc = shutil.which("tsc")
    if tsc:
        declare(tsc, directory)
    else:
        print("there is no tsc: the types of the other modules are left as they are", file=sys.stderr)


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    main(pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]) if len(sys.argv) == 3 else HERE)
