# SPDX-License-Identifier: Apache-2.0
"""Points as columns, read from PLY files: arrays of NumPy where there is one, else of `array`."""
from __future__ import annotations

import array
import importlib
import pathlib
import struct
import warnings
from typing import Any, BinaryIO, Iterable, Iterator, Mapping, Sequence

from .errors import Damaged, RowWarning

__all__ = ["Points", "Stack", "obj_of", "read_ply"]

# names of PLY to the codes of struct, array and NumPy
TYPES = {"char": "b", "uchar": "B", "short": "h", "ushort": "H", "int": "i", "uint": "I", "float": "f", "double": "d",
         "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f", "float64": "d"}
try:
    numpy: Any = importlib.import_module("numpy")
except ImportError:
    numpy = None


class Columns(Mapping[str, Any]):
    """Arrays by the names of their properties."""

    columns: dict[str, Any]

    def __getitem__(self, name: str) -> Any:
        if name not in self.columns:
            raise KeyError(f'the points have no {name}, but {", ".join(self.columns)}: sample with the properties "all" '
                           "(output.ply.properties) to have every property")
        return self.columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return len(self.columns)


class Points(Columns):
    """The properties of all points by their names (`x`, `nx`, `spacing`, ...), each an array.

    count: the number of points; len() returns the number of properties, because this is a mapping
    triangles: of a mesh, three indices for each face; None: there are no faces
    """

    def __init__(self, columns: dict[str, Any], count: int, triangles: Any = None) -> None:
        self.columns, self.count, self.triangles = columns, count, triangles

    def __repr__(self) -> str:
        return f"<{self.count} points with {', '.join(self.columns)}>"

    def together(self, *names: str) -> Any:
        """Columns side by side: an array of NumPy of shape (count, columns); without NumPy a list of tuples."""
        columns = [self[name] for name in names]
        return numpy.stack(columns, axis=1) if numpy else list(zip(*columns))

    @property
    def positions(self) -> Any:
        return self.together("x", "y", "z")

    @property
    def normals(self) -> Any:
        return self.together("nx", "ny", "nz")


class Stack(Columns):
    """The points of many results with equal numbers of points: each property by its name, an array of shape (M, N). Requires NumPy.

    names: of the M results, the names of their files, or their frame numbers as texts
    frames: their frame numbers
    missing: the names of the frames without a result
    """

    def __init__(self, sets: Iterable[tuple[str, Points]], frames: Sequence[int | None], missing: Sequence[str]) -> None:
        if not numpy:
            raise ImportError("a stack requires NumPy: install it (python3-numpy)")
        self.names: list[str] = []
        self.frames, self.missing = list(frames), list(missing)
        self.columns: dict[str, Any] = {}
        count = 0
        for row, (name, points) in enumerate(sets):
            if not row:
                count = points.count
                self.columns = {key: numpy.empty((len(self.frames), count), column.dtype) for key, column in points.items()}
            if points.count != count:
                raise ValueError(f"{name} has {points.count} points, and {self.names[0]} has {count}: "
                                 "a stack requires equal numbers. Set sampling.count")
            if list(points) != list(self.columns):
                raise ValueError(f"{name} has other properties than {self.names[0]}: a stack requires the same ones")
            for key, column in points.items():
                self.columns[key][row] = column
            self.names.append(name)
        if "id" in self.columns and (self.columns["id"] != self.columns["id"][:1]).any():
            warnings.warn("row k is not the same point in each frame: match rows by id, or use hexadctl attach", RowWarning, stacklevel=3)

    def __repr__(self) -> str:
        return f"<{len(self.names)} results, {len(self.missing)} missing, with {', '.join(self.columns)}>"

    @property
    def positions(self) -> Any:
        """Of shape (M, N, 3)."""
        return numpy.stack([self[name] for name in ("x", "y", "z")], axis=2)

    @property
    def normals(self) -> Any:
        """Of shape (M, N, 3)."""
        return numpy.stack([self[name] for name in ("nx", "ny", "nz")], axis=2)


class Element:
    """A kind of record: its count, and its properties as (name, code, code of a list's length)."""

    def __init__(self, name: str, count: int) -> None:
        self.name, self.count = name, count
        self.properties: list[tuple[str, str, str | None]] = []

    @property
    def has_lists(self) -> bool:
        return any(length for _, _, length in self.properties)


def read_header(file: BinaryIO) -> tuple[str, list[Element]]:
    """The order of bytes for struct (or `ascii`), and the elements."""
    form, elements = "", []
    if file.readline().strip() != b"ply":
        raise Damaged("the first line of the PLY file is not 'ply': fetch the file again")
    for line in file:
        words = line.decode("ascii", "replace").split()
        if words[:1] == ["format"]:
            form = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}[words[1]]
        elif words[:1] == ["element"]:
            elements.append(Element(words[1], int(words[2])))
        elif words[:2] == ["property", "list"]:
            elements[-1].properties.append((words[4], TYPES[words[3]], TYPES[words[2]]))
        elif words[:1] == ["property"]:
            elements[-1].properties.append((words[2], TYPES[words[1]], None))
        elif words == ["end_header"]:
            return form, elements
    raise Damaged("the header of the PLY file has no end: fetch the file again")


def make_column(code: str, values: list[Any]) -> Any:
    return numpy.array(values, code) if numpy else array.array(code, values)


def read_records(file: BinaryIO, form: str, element: Element) -> dict[str, Any]:
    """The columns of an element without lists."""
    names = [name for name, _, _ in element.properties]
    if form == "ascii":
        rows = [file.readline().split() for _ in range(element.count)]
        if any(len(row) != len(names) for row in rows):
            raise Damaged("the PLY file ends early: fetch the file again")
        return {name: make_column(code, [float(row[i]) if code in "fd" else int(row[i]) for row in rows])
                for i, (name, code, _) in enumerate(element.properties)}
    record = struct.Struct(form + "".join(code for _, code, _ in element.properties))
    data = file.read(record.size * element.count)
    if len(data) != record.size * element.count:
        raise Damaged("the PLY file ends early: fetch the file again")
    if numpy:
        table = numpy.frombuffer(data, [(name, form + code) for name, code, _ in element.properties])
        return {name: numpy.ascontiguousarray(table[name]) for name in names}
    columns = list(zip(*record.iter_unpack(data))) or [()] * len(names)
    return {name: array.array(code, column) for (name, code, _), column in zip(element.properties, columns)}


def read_list(file: BinaryIO, form: str, length_code: str, code: str) -> list[Any]:
    def numbers(what: str, count: int) -> tuple[Any, ...]:
        record = struct.Struct(f"{form}{count}{what}")
        data = file.read(record.size)
        if len(data) != record.size:
            raise Damaged("the PLY file ends early: fetch the file again")
        return record.unpack(data)

    if form == "ascii":
        return [int(word) for word in file.readline().split()[1:]]
    return list(numbers(code, numbers(length_code, 1)[0]))


def read_faces(file: BinaryIO, form: str, element: Element) -> Any:
    """The lists of an element that has one, of three numbers each."""
    _, code, length_code = element.properties[0]
    if len(element.properties) != 1 or length_code is None:
        raise Damaged(f"the PLY file has {element.name}s that are not triangles")
    if numpy and form != "ascii":
        kind = numpy.dtype([("n", form + length_code), ("corners", form + code, 3)])
        data = file.read(kind.itemsize * element.count)
        if len(data) != kind.itemsize * element.count:
            raise Damaged("the PLY file ends early: fetch the file again")
        table = numpy.frombuffer(data, kind)
        if (table["n"] != 3).any():
            raise Damaged(f"the PLY file has {element.name}s that are not triangles")
        return numpy.ascontiguousarray(table["corners"])
    faces = [read_list(file, form, length_code, code) for _ in range(element.count)]
    return numpy.array(faces, code) if numpy else faces


def read_ply(path: str | pathlib.Path) -> Points:
    """The vertices of a PLY file that hexad has written, and its triangles."""
    columns: dict[str, Any] = {}
    count, triangles = 0, None
    with open(path, "rb") as file:
        form, elements = read_header(file)
        for element in elements:
            if element.has_lists:
                triangles = read_faces(file, form, element)
            elif element.name == "vertex":
                columns, count = read_records(file, form, element), element.count
            else:
                read_records(file, form, element)
    return Points(columns, count, triangles)


def obj_of(positions: Iterable[Sequence[float]], faces: Iterable[Sequence[int]]) -> bytes:
    """A mesh as an OBJ file, for `upload`. `faces`: for each the indices of its vertices, from 0, at least three."""
    lines = ["v " + " ".join(repr(float(x)) for x in position) for position in positions]
    lines += ["f " + " ".join(str(int(corner) + 1) for corner in face) for face in faces]
    return ("\n".join(lines) + "\n").encode()
