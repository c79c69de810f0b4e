# SPDX-License-Identifier: Apache-2.0
"""OME-Zarr 0.4 and 0.5 and plain Zarr arrays, as volumes and as labels. Directories are written by zarr_files.py; what is the same volume as
an NRRD file gives the same bytes of points."""
import hashlib
import json
import os

import numpy
import pytest

from volumes import write_nrrd
from zarr_files import multiscales, write_array_2, write_array_3, write_group_2, write_group_3

SIZE = (15, 13, 14)  # x, y, z
VOXEL = (0.5, 0.25, 0.75)
CHUNKS = (4, 5, 6)


def ball(kind="u2"):
    index = numpy.stack(numpy.meshgrid(*map(numpy.arange, SIZE), indexing="ij"), -1) - (numpy.array(SIZE) - 1) / 2 - 0.125
    return numpy.round(8 * (6 - numpy.linalg.norm(index * (0.9, 1.1, 1), axis=-1)).clip(0)).astype(kind)


def stored(values):
    """As zyx."""
    return numpy.ascontiguousarray(values.transpose(2, 1, 0))


@pytest.fixture
def told(solve):
    """Runs a surface; its report, or the error, with the member `digest` of the points."""
    def run(path, isovalue=8.5, kind="volume", limits=None, region=None, **members):
        surface = {"path": str(path), **({} if kind == "labels" else {"isovalue": isovalue}), **members}
        spec = {"version": 1, "surface": {kind: surface}, "sampling": {"count": 30}, "solver": {"threads": 1, "max_sweeps": 1},
                "output": {"preview": False, "ply": {"precision": "double"}}}
        if limits:
            spec["limits"] = limits
        if region:
            spec["region"] = region
        report, data = solve(spec)
        return {**report, "digest": report["outputs"][0]["sha256"]} if data else report
    return run


@pytest.fixture
def plain(told, tmp_path):
    """The digest of the volume as an NRRD file."""
    def run(matrix=numpy.diag([*VOXEL, 1]), kind="u2", **more):
        write_nrrd(tmp_path / "plain.nrrd", ball(kind), matrix)
        return told(tmp_path / "plain.nrrd", **more)["digest"]
    return run


def warnings(report):
    assert "surface" in report, report
    return [w for w in report["surface"]["warnings"] if "are unresolved" not in w and "walls thinner" not in w]


def expect_same(report, digest, *words):
    assert report.get("digest") == digest, report.get("message") or report["surface"]
    assert len(warnings(report)) == len(words) and all(w in " ".join(warnings(report)) for w in words), warnings(report)


SCALE = VOXEL[::-1]


# ---- ways of storing the same

WAYS_2 = {"plain": {}, "zlib, fortran": {"compressor": "zlib", "order": "F", "separator": "/"},
          "gzip, big-endian": {"compressor": "gzip", "endian": ">"}, "zstd": {"compressor": "zstd"}}
WAYS_3 = {"plain": {}, "gzip, big-endian, transposed": {"codecs": ["gzip"], "big": True, "transpose": (2, 0, 1)},
          "crc32c, v2 keys": {"codecs": ["gzip", "crc32c"], "key": "v2", "separator": "."},
          "blosc": {"codecs": ["blosc"]},
          "shards": {"shards": (8, 10, 12), "codecs": ["gzip"]},
          "shards without checksum": {"shards": (4, 15, 18), "index_first": True, "index_checksum": False, "codecs": ["crc32c"]}}


@pytest.mark.sanitized
@pytest.mark.parametrize("way", WAYS_2)
def test_every_way_of_version_2(told, plain, tmp_path, way):
    write_group_2(tmp_path / "a.zarr", multiscales([SCALE]))
    write_array_2(tmp_path / "a.zarr/0", stored(ball()), CHUNKS, **WAYS_2[way])
    report = told(tmp_path / "a.zarr")
    expect_same(report, plain())
    assert report["surface"]["volume"] == {"size": list(SIZE), "format": "OME-Zarr"}


@pytest.mark.sanitized
@pytest.mark.parametrize("way", WAYS_3)
def test_every_way_of_version_3(told, plain, tmp_path, way):
    write_group_3(tmp_path / "a.zarr", multiscales([SCALE], version="0.5"))
    write_array_3(tmp_path / "a.zarr/0", stored(ball()), CHUNKS, **WAYS_3[way])
    expect_same(told(tmp_path / "a.zarr"), plain())


@pytest.mark.parametrize("kind", ["i1", pytest.param("u4", marks=pytest.mark.extended), "i8", pytest.param("f4", marks=pytest.mark.extended), "f8"])
def test_types(told, plain, tmp_path, kind):
    write_array_2(tmp_path / "a.zarr", stored(ball(kind)), CHUNKS, endian=">")
    expect_same(told(tmp_path / "a.zarr", voxel_size=VOXEL), plain(kind=kind))


# ---- transformations, levels, other axes

def test_transformations_of_both_places_are_applied(told, plain, tmp_path):
    whole = [{"type": "scale", "scale": [1, 1, 2, 2, 2]}, {"type": "translation", "translation": [0, 0, 1, 2, 3]}]
    described = multiscales([(1, 1, *(s / 2 for s in SCALE))], [(0, 0, 0.5, 0.25, -1)], "tczyx", whole=whole)
    write_group_2(tmp_path / "a.zarr", described)
    values = numpy.zeros((2, 3, *SIZE[::-1]), "u2")
    values[1, 2] = stored(ball())
    write_array_2(tmp_path / "a.zarr/0", values, (1, 2, *CHUNKS), "zlib")
    report = told(tmp_path / "a.zarr")
    assert report["code"] == "grid_ambiguous" and "6 volumes of 15 x 13 x 14" in report["message"], report
    matrix = numpy.diag([*VOXEL, 1.0])
    matrix[:3, 3] = [1, 2.5, 2]
    expect_same(told(tmp_path / "a.zarr", index=5), plain(matrix))


def test_levels_and_units(told, plain, tmp_path):
    write_group_3(tmp_path / "a.zarr", multiscales([SCALE, [2 * s for s in SCALE]], unit="micrometer", version="0.5"))
    write_array_3(tmp_path / "a.zarr/0", numpy.zeros((28, 26, 30), "u1"), CHUNKS)
    write_array_3(tmp_path / "a.zarr/1", stored(ball()), CHUNKS)
    report = told(tmp_path / "a.zarr", level=1)
    expect_same(report, plain(numpy.diag([2 * v for v in VOXEL] + [1])), 'unit of length is "micrometer"')
    assert "choose level from 0, the finest, to 1" in told(tmp_path / "a.zarr", level=2)["message"]
    write_nrrd(tmp_path / "v.nrrd", ball(), numpy.eye(4))
    assert "remove level" in told(tmp_path / "v.nrrd", level=0)["message"]


def test_an_array_without_metadata_of_ome(told, plain, tmp_path):
    write_array_3(tmp_path / "a.zarr", stored(ball()), CHUNKS)
    expect_same(told(tmp_path / "a.zarr"), plain(numpy.eye(4)), "without the metadata of OME-Zarr")


# ---- what is read

def test_one_input_with_the_hash_of_its_files(told, tmp_path):
    write_group_2(tmp_path / "a.zarr", multiscales([SCALE]))
    write_array_2(tmp_path / "a.zarr/0", stored(ball()), CHUNKS, "zlib")
    (told_of,) = told(tmp_path / "a.zarr")["inputs"]
    read = sorted(str(p.relative_to(tmp_path / "a.zarr")) for p in (tmp_path / "a.zarr").rglob("*") if p.is_file() and p.name != ".zgroup")
    lines = "".join(f"{hashlib.sha256((tmp_path / 'a.zarr' / name).read_bytes()).hexdigest()}  {name}\n" for name in read)
    assert told_of == {"path": str(tmp_path / "a.zarr"), "sha256": hashlib.sha256(lines.encode()).hexdigest(),
                       "bytes": sum((tmp_path / "a.zarr" / name).stat().st_size for name in read)}


def test_chunks_beside_the_region_are_not_read(told, plain, tmp_path):
    """Those far from it are damaged, which nothing sees."""
    far = numpy.zeros((90, *SIZE[1::-1]), "u2")
    far[:14] = stored(ball())
    write_group_2(tmp_path / "a.zarr", multiscales([SCALE]))
    write_array_2(tmp_path / "a.zarr/0", far, CHUNKS, "zlib")
    (tmp_path / "a.zarr/0/20.1.1").write_bytes(b"damaged")
    region = {"min": [-1, -1, 0], "max": [20, 20, 5.25]}
    write_nrrd(tmp_path / "far.nrrd", far.transpose(2, 1, 0), numpy.diag([*VOXEL, 1]))
    expect_same(told(tmp_path / "a.zarr", region=region), told(tmp_path / "far.nrrd", region=region)["digest"])
    report = told(tmp_path / "a.zarr")
    assert report["code"] == "input_damaged" and "a.zarr: 0/20.1.1: the chunk cannot be unpacked by zlib" in report["message"], report


def test_the_number_of_chunks_is_limited(told, tmp_path):
    write_array_2(tmp_path / "a.zarr", stored(ball()), (1, 1, 1))
    report = told(tmp_path / "a.zarr", limits={"max_chunks": 2729})
    assert report["code"] == "input_unsupported" and "2730 chunks would be read, and the limit is 2729" in report["message"], report


def test_links_are_not_followed(told, tmp_path):
    write_array_2(tmp_path / "a.zarr", stored(ball()), CHUNKS)
    os.rename(tmp_path / "a.zarr/1.1.1", tmp_path / "elsewhere")
    os.symlink("../elsewhere", tmp_path / "a.zarr/1.1.1")
    report = told(tmp_path / "a.zarr")
    assert report["code"] == "path_forbidden" and "1.1.1 is a symbolic link" in report["message"], report
    write_group_2(tmp_path / "b.zarr", multiscales([SCALE]))
    text = (tmp_path / "b.zarr/.zattrs").read_text()
    (tmp_path / "b.zarr/.zattrs").write_text(text.replace('"path": "0"', '"path": "../a.zarr"'))
    report = told(tmp_path / "b.zarr")
    assert report["code"] == "path_forbidden" and "leads out" in report["message"], report


# ---- labels and inspection

@pytest.mark.sanitized
def test_labels_and_an_inspection(told, worker, tmp_path):
    values = numpy.ones((4, 3, 3), "u1")
    values[2:], values[:, 1:] = 2, 0
    write_nrrd(tmp_path / "v.nrrd", values, numpy.diag([*VOXEL, 1]))
    write_group_2(tmp_path / "a.zarr/labels/cells", multiscales([SCALE]))
    write_array_2(tmp_path / "a.zarr/labels/cells/0", stored(values), (2, 2, 3), separator="/")
    assert told(tmp_path / "a.zarr/labels/cells", kind="labels")["digest"] == told(tmp_path / "v.nrrd", kind="labels")["digest"]
    seen = json.loads(worker("a.zarr/labels/cells", "--json", command="inspect", output=None).stdout)
    assert seen["format"] == "OME-Zarr" and seen["volume"]["size"] == [4, 3, 3] and seen["volume"]["voxel_size"] == list(VOXEL)
    assert seen["levels"] == [{"path": "0/", "type": "uint8", "size": [4, 3, 3], "voxel_size": list(VOXEL), "chunk": [3, 2, 2]}]
    assert seen["suggestions"][0]["spec"]["surface"]["labels"] == {"path": "a.zarr/labels/cells", "level": 0}


def test_a_service_takes_a_directory(new_service, tmp_path):
    write_array_2(tmp_path / "in/a.zarr", stored(ball("u1")), CHUNKS)
    service = new_service("--input_roots", tmp_path / "in").start()
    spec = {"version": 1, "surface": {"volume": {"path": "a.zarr", "isovalue": 8.5}}, "sampling": {"count": 30},
            "solver": {"threads": 1, "max_sweeps": 1}, "output": {"preview": False}}
    service.wait_state(service.submit(spec), "succeeded")
    answer = service.post("/v1/inputs:inspect", {"path": "a.zarr"})
    assert answer.status == 200 and answer.json["format"] == "OME-Zarr", answer.body


# ---- what is refused

def fault_2(**changes):
    """What the metadata say is changed; the chunks stay."""
    def write(path):
        write_array_2(path, stored(ball("u1")), CHUNKS)
        document = json.loads((path / ".zarray").read_text())
        (path / ".zarray").write_text(json.dumps({**document, **changes}))
    return write


def fault_3(**changes):
    return lambda path: write_array_3(path, stored(ball("u1")), CHUNKS, **changes)


def in_group(**changes):
    def write(path):
        write_group_2(path, [{**multiscales([SCALE])[0], **changes}])
        write_array_2(path / "0", stored(ball("u1")), CHUNKS)
    return write


def replaced(write, name, find, put):
    def call(path):
        write(path)
        data = (path / name).read_bytes()
        assert find in data
        (path / name).write_bytes(data.replace(find, put, 1))
    return call


SCALED = [{"path": "0", "coordinateTransformations": [{"type": "scale", "scale": [0, 1, 1]}]}]
AFFINE = [{"path": "0", "coordinateTransformations": [{"type": "affine", "affine": []}]}]
REFUSED = {
    "codec 2": (fault_2(filters=[{"id": "delta"}]), "input_unsupported", 'filter "delta"'),
    "codec 3": (replaced(fault_3(codecs=["gzip"]), "zarr.json", b'"gzip"', b'"zfpy"'), "input_unsupported", 'codec "zfpy" is not read: save it with gzip'),
    "type 2": (fault_2(dtype="<c8"), "input_unsupported", 'type "c8"'),
    "type 3": (fault_3(data_type="float16"), "input_unsupported", 'type "float16"'),
    "grid": (fault_3(chunk_grid={"name": "rectangular"}), "input_unsupported", 'chunk_grid "rectangular"'),
    "no json": (replaced(fault_2(), ".zarray", b"{", b"["), "input_damaged", ".zarray"),
    "shape": (fault_2(shape=[14, 13]), "input_damaged", "chunks is not an array of 2 numbers"),
    "large shape": (fault_2(shape=[14, 13, 2000000]), "input_damaged", "claims 2000000 samples"),
    "large chunks": (fault_2(chunks=[100000, 100000, 1]), "input_unsupported", "a chunk has 10000000000 numbers"),
    "no chunks": (fault_2(chunks=[4, 0, 6]), "input_damaged", "a side of 0"),
    "fill": (fault_2(fill_value="0x7fc00000"), "input_unsupported", 'fill_value "0x7fc00000"'),
    "fill of another type": (fault_2(fill_value=2.5), "input_damaged", "fill_value 2.5 is not a number of the array's type"),
    "negative fill": (fault_3(fill_value=-1), "input_damaged", "fill_value -1 is not a number of the array's type"),
    "order": (fault_2(order="Z"), "input_damaged", 'order is "Z"'),
    "scale": (in_group(datasets=SCALED), "input_damaged", "coordinate transformation (scale) has the number 0"),
    "affine": (in_group(datasets=AFFINE), "input_unsupported", 'coordinate transformation "affine"'),
    "axes": (in_group(axes=[{"name": "y", "type": "space"}, {"name": "x", "type": "space"}]), "no_surface", "2 axes of the type space"),
    "no axes": (in_group(axes=None), "input_unsupported", "before OME-Zarr 0.4"),
    "other axes": (in_group(axes=[{"name": "t", "type": "time"}, *multiscales([SCALE])[0]["axes"]], datasets=[{"path": "0"}]), "input_damaged", "3 axes, and multiscales names 4"),
    "no array": (in_group(datasets=[{"path": "7"}]), "input_damaged", "7/.zarray and 7/zarr.json are missing"),
    "no path": (in_group(datasets=[{"path": ""}]), "input_damaged", "path of dataset 0 is empty"),
}


@pytest.mark.sanitized
@pytest.mark.parametrize("fault", REFUSED)
def test_directories_that_are_refused(told, tmp_path, fault):
    write, code, words = REFUSED[fault]
    write(tmp_path / "a.zarr")
    report = told(tmp_path / "a.zarr")
    assert report["code"] == code and words in report["message"] and "a.zarr: " in report["message"], report


def test_directories_that_are_no_image(told, tmp_path):
    for name, content in (("plate", {"plate": {}}), ("bf2raw", {"bioformats2raw.layout": 3}), ("labels", {"labels": ["cells"]})):
        (tmp_path / name).mkdir()
        (tmp_path / name / ".zattrs").write_text(json.dumps(content))
        report = told(tmp_path / name)
        assert report["code"] == "grid_ambiguous" and "name the directory of one of them" in report["message"], report
    (tmp_path / "empty").mkdir()
    assert "OME-Zarr" in told(tmp_path / "empty")["message"]
    report = told(tmp_path / "empty", kind="labels")
    assert report["code"] == "input_unsupported", report


def test_missing_chunks_without_a_fill_value_are_refused(told, tmp_path):
    writers = {"0.0.0": fault_2(fill_value=None), "c/0/0/0": fault_3(fill_value=None),
               "c/0/0/0 ": lambda path: write_array_3(path, stored(ball("u1")), CHUNKS, shards=(8, 10, 12), fill_value=None)}
    for name, write in writers.items():
        write(tmp_path / name.strip().replace("/", "") / "a.zarr")
        report = told(tmp_path / name.strip().replace("/", "") / "a.zarr")
        assert report["code"] == "input_damaged" and "the chunk is missing and fill_value is null" in report["message"], report
        assert "a.zarr: " in report["message"], report


def test_fill_value_null_without_missing_chunks(told, plain, tmp_path):
    write_array_2(tmp_path / "a.zarr", stored(ball("u1")), CHUNKS, fill=None)
    assert told(tmp_path / "a.zarr", voxel_size=VOXEL)["digest"] == plain()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("write", [write_array_2, write_array_3])
def test_chunks_outside_of_the_shape_are_warned_of(told, tmp_path, axis, write):
    """A shape that ends within the last chunk is none of these."""
    write(tmp_path / "a.zarr", stored(ball("u1")), CHUNKS)
    name = ".zarray" if write is write_array_2 else "zarr.json"
    metadata = json.loads((tmp_path / "a.zarr" / name).read_text())
    assert not any("outside of the shape" in w for w in warnings(told(tmp_path / "a.zarr", voxel_size=VOXEL)))
    metadata["shape"][axis] = CHUNKS[axis] * 2
    (tmp_path / "a.zarr" / name).write_text(json.dumps(metadata))
    assert any("outside of the shape" in w for w in warnings(told(tmp_path / "a.zarr", voxel_size=VOXEL)))


def test_metadata_of_both_versions(told, tmp_path):
    write_array_2(tmp_path / "a.zarr", stored(ball("u1")), CHUNKS)
    write_array_3(tmp_path / "a.zarr", stored(ball("u1")), CHUNKS)
    assert any("version 2 (.zarray) and of version 3" in w for w in told(tmp_path / "a.zarr")["surface"]["warnings"])


@pytest.mark.sanitized
def test_chunks_that_are_damaged(told, tmp_path):
    faults = {"gzip": "cannot be unpacked by zlib", "crc32c": "checksum (crc32c) of the chunk is wrong", None: "the chunk has 100 bytes, and 120 are expected"}
    for codec, words in faults.items():
        write_array_3(tmp_path / "a.zarr", stored(ball("u1")), CHUNKS, codecs=[codec] if codec else [])
        file = tmp_path / "a.zarr/c/1/1/1"
        data = file.read_bytes()
        file.write_bytes(data[:100] if codec is None else data[:20] + bytes([data[20] ^ 255]) + data[21:])
        report = told(tmp_path / "a.zarr")
        assert report["code"] == "input_damaged" and "c/1/1/1: " in report["message"] and words in report["message"], report
    write_array_3(tmp_path / "b.zarr", stored(ball("u1")), CHUNKS, shards=(8, 10, 12))
    file = tmp_path / "b.zarr/c/0/0/0"
    data = file.read_bytes()
    file.write_bytes(data[:-5] + bytes([data[-5] ^ 255]) + data[-4:])
    assert "checksum (crc32c)" in told(tmp_path / "b.zarr")["message"]
    file.write_bytes(data[:50])
    assert "shorter than its index" in told(tmp_path / "b.zarr")["message"]


# ---- directories of another writer

@pytest.mark.extended
@pytest.mark.parametrize("codec", ["blosc-lz4", "blosc-zstd-bits", "zstd", "zlib"])
def test_directories_of_zarr(told, plain, tmp_path, codec):
    zarr = pytest.importorskip("zarr", reason="python3-zarr is not installed")
    numcodecs = pytest.importorskip("numcodecs", reason="python3-zarr is not installed")
    made = {"blosc-lz4": lambda: numcodecs.Blosc("lz4"), "blosc-zstd-bits": lambda: numcodecs.Blosc("zstd", shuffle=2),
            "zstd": numcodecs.Zstd, "zlib": numcodecs.Zlib}[codec]()
    zarr.save_array(str(tmp_path / "a.zarr"), stored(ball()), chunks=CHUNKS, compressor=made)
    expect_same(told(tmp_path / "a.zarr", voxel_size=VOXEL), plain())
