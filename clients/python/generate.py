# SPDX-License-Identifier: Apache-2.0
"""Writes hexad/spec.py and hexad/problems.py, from the documents that the service serves:

    generate.py BUILD [DIRECTORY]

BUILD is the directory of the program hexad, which is started for a moment; DIRECTORY is by default hexad/ beside this file.
"""
import keyword
import pathlib
import subprocess
import sys
import tempfile
import textwrap
from typing import Any, Dict, Iterator, List, Tuple

from hexad.transport import Transport

Schema = Dict[str, Any]
WIDTH = 110

LICENCE = "# SPDX-License-Identifier: Apache-2.0\n"

SPEC_HEAD = LICENCE + '''"""The members of a spec, for editors and type checkers. Written by generate.py; do not edit.

Each class is a dict. A spec may be written with them or as plain dicts and lists; a member that is left out has its
default. Ranges are of the service, which checks them.
"""
from typing import Any, Literal, Mapping, Sequence, TypedDict, Union

__all__ = [
'''

PROBLEMS_HEAD = LICENCE + '''"""The errors of the service, a class for each code. Written by generate.py; do not edit."""
from typing import Dict, Type

from .errors import Problem

__all__ = [
'''

SAMPLE_CLASSES = ("Sampling", "SurfaceMesh", "SurfaceVolume", "SurfaceVdb")
SAMPLE_ARGUMENTS = ("path", "count")  # which are no keywords
SAMPLE_ARRAYS = {"grid": "Union[str, Mapping[str, Any]]", "points": "Any"}  # a part may be an array


def camel(text: str) -> str:
    return "".join(part[:1].upper() + part[1:] for part in text.replace("-", "_").split("_"))


class SpecWriter:
    """Classes in the order in which they are met, those that a class needs before it."""

    def __init__(self) -> None:
        self.classes: Dict[str, str] = {}
        self.members: Dict[str, Dict[str, str]] = {}  # of each class

    def type_of(self, schema: Schema, name: str) -> str:
        """The annotation of a schema; objects become classes of this name."""
        if "$ref" in schema:
            return '"Surface"'
        if "const" in schema and schema.get("type") == "string":
            return f'Literal["{schema["const"]}"]'
        if "enum" in schema:
            return f'Literal[{", ".join(repr(word) for word in schema["enum"])}]'.replace("'", '"')
        if "oneOf" in schema:
            return self.union(schema["oneOf"], name)
        if schema["type"] == "array":
            return f'Sequence[{self.type_of(schema["items"], name + "Item") if "items" in schema else "Any"}]'
        if schema["type"] == "object":
            return self.object_type(schema, name)
        return {"string": "str", "integer": "int", "number": "float", "boolean": "bool"}[schema["type"]]

    def union(self, ways: List[Schema], name: str) -> str:
        types: List[str] = []
        for way in ways:
            constants = [p["const"] for p in way.get("properties", {}).values() if "const" in p]
            kind = self.type_of(way, camel(constants[0]) if constants else name)
            if kind not in types:
                types.append(kind)
        return types[0] if len(types) == 1 else f'Union[{", ".join(types)}]'

    def object_type(self, schema: Schema, name: str) -> str:
        if "properties" in schema:
            self.add(schema, name)
            return name
        values = schema.get("additionalProperties")
        return f"Mapping[str, {self.type_of(values, name + 'Value') if isinstance(values, dict) else 'Any'}]"

    def add(self, schema: Schema, name: str) -> None:
        prefix = "" if name == "Spec" else name
        members = self.members[name] = {m: self.type_of(part, prefix + camel(m)) for m, part in schema["properties"].items()}
        needed = [m for m in schema.get("required", []) if m != "version"]  # which the client puts in
        groups = [(f"_{name}Needed", needed, ""), (f"_{name}Rest", [m for m in members if m not in needed], ", total=False")]
        text = ""
        bases = []
        for base, names, total in groups:
            if not names:
                continue
            bases.append(base)
            if any(keyword.iskeyword(m) for m in names):
                inside = "".join(f'    "{m}": {members[m]},\n' for m in names)
                text += f'{base} = TypedDict("{base}", {{\n{inside}}}{total})\n\n\n'
            else:
                text += f"class {base}(TypedDict{total}):\n" + "".join(f"    {m}: {members[m]}\n" for m in names) + "\n\n"
        text += f'class {name}({", ".join(bases)}):\n    """{"".join(self.prose(schema))}    """\n'
        self.classes[name] = text

    def add_sample_members(self) -> None:
        """The class of the keywords of hexad.sample: the members of several classes."""
        types: Dict[str, List[str]] = {}
        for name in SAMPLE_CLASSES:
            for member, kind in self.members[name].items():
                if member not in SAMPLE_ARGUMENTS and kind not in types.setdefault(member, []):
                    types[member].append(kind)
        kinds = {m: kind[0] if len(kind) == 1 else f'Union[{", ".join(kind)}]' for m, kind in types.items()}
        kinds.update(SAMPLE_ARRAYS)
        self.classes["SampleMembers"] = (
            'class SampleMembers(TypedDict, total=False):\n    """Keywords of hexad.sample: members of sampling and of the surface. '
            'An array may be in place of a path."""\n\n' + "".join(f"    {m}: {kind}\n" for m, kind in kinds.items()))

    @staticmethod
    def prose(schema: Schema) -> Iterator[str]:
        def wrap(text: str, first: str, rest: str) -> str:
            text = text.replace("\\", "\\\\").replace('"""', "'''")
            return textwrap.fill(text, WIDTH, initial_indent=first, subsequent_indent=rest) + "\n"

        constants = [repr(part["const"]) for part in schema["properties"].values() if "const" in part]
        about = schema.get("description", f"The shape {constants[0]}." if constants else "Members of a spec.")
        yield wrap(about, " " * 7, " " * 4).lstrip()
        yield "\n"
        for member, part in schema["properties"].items():
            if "description" in part:
                default = f" Default: {part['default']!r}." if "default" in part else ""
                yield wrap(f"{member}: {part['description']}{default}", " " * 4, " " * 8)


def write_spec(schema: Schema) -> str:
    writer = SpecWriter()
    writer.add(schema, "Spec")
    writer.add_sample_members()
    names = [name for name in writer.classes]
    listed = "".join(f'    "{name}",\n' for name in sorted(names))
    return SPEC_HEAD + listed + "]\n" + "".join(f"\n\n{text}" for text in writer.classes.values())


def problems_of(document: Schema) -> Iterator[Tuple[str, int, str]]:
    """(code, status, title) of all problems."""
    for name, response in document["components"]["responses"].items():
        for part in response["description"].split("; `"):
            code, _, title = part.strip("`").partition("`: ")
            yield code, int(name[len("Problem"):]), title


def write_problems(document: Schema) -> str:
    known = {code: (status, title) for code, status, title in problems_of(document)}
    codes = document["components"]["schemas"]["ProblemCode"]["enum"]
    assert set(codes) == set(known)
    listed = "".join(f'    "{camel(code)}",\n' for code in sorted(codes)) + '    "BY_CODE",\n'
    classes = "".join(f'\n\nclass {camel(code)}(Problem):\n    """{known[code][1]} ({known[code][0]})."""\n' for code in codes)
    table = "".join(f'    "{code}": {camel(code)},\n' for code in codes)
    return PROBLEMS_HEAD + listed + "]\n" + classes + f"\n\nBY_CODE: Dict[str, Type[Problem]] = {{\n{table}}}\n"


def main(build: pathlib.Path, directory: pathlib.Path) -> None:
    with tempfile.TemporaryDirectory() as state:
        daemon = subprocess.Popen([build / "hexad", "--state_dir", state, "--reserve_mb", "1", "--log_level", "warning"])
        try:
            transport = Transport(f"unix:{state}/hexad.sock")
            schema, document = transport.get("/v1/schema.json"), transport.get("/v1/openapi.json")
        finally:
            daemon.terminate()
            daemon.wait()
    (directory / "spec.py").write_text(write_spec(schema))
    (directory / "problems.py").write_text(write_problems(document))


if __name__ == "__main__":
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    build, *rest = map(pathlib.Path, sys.argv[1:])
    main(build.resolve(), rest[0] if rest else pathlib.Path(__file__).parent / "hexad")
