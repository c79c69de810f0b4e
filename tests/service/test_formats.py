# SPDX-License-Identifier: Apache-2.0
"""points.npz, points.glb and points.usda, read by NumPy, Khronos's validator and by their definitions, beside points.ply."""
import json
import re
import shutil
import subprocess

import numpy
import pytest

from carried_points import linear_light
from readers import read_columns, read_mesh
from scenes import read_glb, read_usda, stack
from service import sphere

# ---- NumPy

def test_arrays_of_numpy(finished, carried):
    where, columns, report = finished(carried)
    with numpy.load(where / "points.npz") as arrays:
        assert set(arrays) == {"position", "normal", "rgb", "radius", "kappa", "kappa1", "kappa2", "alpha", "energy", "spacing",
                               "spacing_local", "id", "heat", "wind", "Cd", "label"}
        assert (arrays["position"] == stack(columns, *"xyz")).all() and arrays["position"].shape == (500, 3)
        assert (arrays["wind"] == stack(columns, "wind_x", "wind_y", "wind_z")).all()
        assert (arrays["rgb"] == stack(columns, "Cd_r", "Cd_g", "Cd_b")).all()
        assert (arrays["radius"] == columns["spacing_local"] / 2).all() and arrays["radius"].shape == (500,)
        assert (arrays["id"] == numpy.arange(500)).all() and arrays["label"].dtype == numpy.int64
        assert (arrays["heat"] == columns["heat"]).all() and (arrays["label"] == columns["label"]).all()
    assert [o["name"] for o in report["outputs"]] == ["points.ply", "points.npz", "points.glb", "points.usda"]
    again, _, _ = finished(carried, "again")
    for name in ("points.npz", "points.glb", "points.usda"):
        assert (where / name).read_bytes() == (again / name).read_bytes()


# ---- glTF

def test_points_of_gltf(finished, carried):
    where, columns, _ = finished(carried)
    arrays, document = read_glb((where / "points.glb").read_bytes())
    assert (arrays["POSITION"] == stack(columns, *"xyz").astype("f4")).all()
    assert (arrays["NORMAL"] == stack(columns, "nx", "ny", "nz").astype("f4")).all()
    assert (arrays["_WIND"] == stack(columns, "wind_x", "wind_y", "wind_z").astype("f4")).all()
    assert (arrays["_HEAT"] == columns["heat"].astype("f4")).all() and (arrays["_ID"] == numpy.arange(500)).all()
    light = linear_light(numpy.clip(stack(columns, "Cd_r", "Cd_g", "Cd_b"), 0, 1))
    assert numpy.abs(arrays["COLOR_0"] - light).max() < 1e-6
    box = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]]
    assert box["min"] == arrays["POSITION"].min(0).tolist() and box["max"] == arrays["POSITION"].max(0).tolist()
    # the set stands along z, and glTF's y points up
    x, y, z, w = document["nodes"][0]["rotation"]
    assert (y, z) == (0, 0) and abs(x + 0.5 ** 0.5) < 1e-9 and abs(w - 0.5 ** 0.5) < 1e-9


@pytest.fixture
def by_node(source):
    """Runs a script of tests/formats; what it prints."""
    if not shutil.which("node") or not (source / "tests/formats/node_modules").is_dir():
        pytest.skip("no readers: run npm ci in tests/formats")

    def call(script, *paths):
        done = subprocess.run(["node", source / "tests/formats" / script, *paths], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)
    return call


@pytest.mark.extended
def test_khronos_finds_no_fault(finished, carried, by_node):
    for spec in (carried, sphere(300, output={"preview": False, "points_glb": True})):
        where, _, _ = finished(spec)
        report = by_node("validate.js", where / "points.glb")
        assert (report["issues"]["numErrors"], report["issues"]["numWarnings"]) == (0, 0), report["issues"]
        assert report["info"]["totalVertexCount"] == (500 if spec is carried else 300)


# ---- USD

def test_points_of_usd(finished, carried):
    where, columns, _ = finished(carried)
    arrays, stage = read_usda((where / "points.usda").read_text())
    assert stage == {"defaultPrim": '"points"', "metersPerUnit": "1", "upAxis": '"Z"'}
    assert (arrays["point3f[] points"].astype("f4") == stack(columns, *"xyz").astype("f4")).all()
    assert (arrays["normal3f[] normals"].astype("f4") == stack(columns, "nx", "ny", "nz").astype("f4")).all()
    assert (arrays["float[] widths"].astype("f4") == columns["spacing_local"].astype("f4")).all()
    assert (arrays["int64[] ids"] == numpy.arange(500)).all()
    assert (arrays["float3[] primvars:wind"].astype("f4") == stack(columns, "wind_x", "wind_y", "wind_z").astype("f4")).all()
    assert (arrays["int[] primvars:label"] == columns["label"]).all()
    light = linear_light(numpy.clip(stack(columns, "Cd_r", "Cd_g", "Cd_b"), 0, 1))
    assert numpy.abs(arrays["color3f[] primvars:displayColor"] - light).max() < 1e-6
    low, high = arrays["float3[] extent"]
    radius = columns["spacing_local"][:, None] / 2
    at = stack(columns, *"xyz")
    assert numpy.allclose(low, (at - radius).min(0)) and numpy.allclose(high, (at + radius).max(0))


def test_the_mesh_of_usd(finished):
    where, _, report = finished(sphere(300, output={"preview": False, "mesh": True, "mesh_usda": True}))
    text = (where / "mesh.usda").read_text()
    arrays, stage = read_usda(text)
    assert 'def Mesh "mesh"' in text and 'subdivisionScheme = "none"' in text and stage["defaultPrim"] == '"mesh"'
    names, vertices, faces = read_mesh((where / "mesh.ply").read_bytes())
    assert (arrays["int[] faceVertexIndices"].reshape(-1, 3) == faces).all()
    assert (arrays["int[] faceVertexCounts"] == 3).all() and len(arrays["int[] faceVertexCounts"]) == len(faces)
    assert (arrays["point3f[] points"].astype("f4") == vertices[:, :3].astype("f4")).all()
    assert "float[] widths" not in arrays and len(arrays["float[] primvars:radius"]) == 300


@pytest.mark.extended
def test_other_readers_of_usd_find_the_same(finished, carried, by_node):
    """three.js' parser the numbers, and tinyusdz the stage, which it does not take with a word among the numbers."""
    carried["output"].update({"mesh": True, "mesh_usda": True})
    where, columns, _ = finished(carried)
    names = ("points.usda", "mesh.usda")
    found = by_node("read_usd.mjs", *(where / name for name in names))
    for name, one in zip(names, found):
        prim = "/" + name[:-5]
        assert one["stage"] and not one["complaint"] and one["specs"]["/"]["fields"]["upAxis"] == "Z"
        assert one["specs"][prim]["fields"]["typeName"] == ("Mesh" if prim == "/mesh" else "Points")
        arrays, _ = read_usda((where / name).read_text())
        values = {path: spec["fields"] for path, spec in one["specs"].items() if "." in path}
        assert len(arrays) > 15
        for declared, array in arrays.items():
            kind, attribute = declared.split()
            assert values[f"{prim}.{attribute}"]["typeName"] == kind
            assert (numpy.array(values[f"{prim}.{attribute}"]["default"]).reshape(array.shape) == array).all()
        printed, _ = read_usda(one["printed"])
        assert set(printed) == set(arrays) and len(printed["point3f[] points"]) == 500
        assert numpy.allclose(printed["point3f[] points"], stack(columns, *"xyz"), rtol=1e-6, atol=0)
    assert [one["meshes"] for one in found] == [0, 1]
    for name in names:
        (where / ("wrong_" + name)).write_text((where / name).read_text().replace("points = [(", "points = [(x", 1))
    for one in by_node("read_usd.mjs", *(where / ("wrong_" + name) for name in names)):
        assert not one["stage"] and one["complaint"] and one["printed"] is None


@pytest.fixture
def growing(worker, tmp_path):
    """A sphere that grows from frame 7 to 9, one frame after the other; their directories."""
    def call(**output):
        spec = sphere(200, output={"preview": False, "ply": {"precision": "double"}, "points_usda": True, **output})
        spec["queue"] = {"frames": "9,7-8", "by_frame": {"/surface/analytic/radius": [1.2, 1.0, 1.1]}, "coherent": True}
        previous = ()
        for frame in (9, 7, 8):
            done = worker(spec, "--frame", frame, *previous, output=str(frame))
            assert done.returncode in (0, 10, 11), done.stderr
            previous = ("--previous", str(frame))
        return [tmp_path / str(frame) for frame in (9, 7, 8)]
    return call


@pytest.mark.extended
def test_a_sequence_is_one_stage_of_usd(growing, by_node):
    """Its clips are the frames' files, which have their values at the time of their number; read by tinyusdz."""
    first, *others = growing(mesh=True, mesh_usda=True)
    assert not any((other / f"{name}_sequence.usda").exists() for other in others for name in ("points", "mesh"))
    names = ("points", "mesh")
    read = iter(by_node("read_usd.mjs", *(path for name in names for path in (
        first / f"{name}_sequence.usda", *(where / f"{name}.usda" for where in (first, *others))))))
    for name in names:
        text = next(read)["printed"]
        assert re.findall("(start|end)TimeCode = (\\d)", text) == [("start", "7"), ("end", "9")]
        assert "framesPerSecond = 24" in text and "timeCodesPerSecond = 24" in text
        assert f"asset[] assetPaths = [@../7/{name}.usda@, @../8/{name}.usda@, @./{name}.usda@]" in text
        assert f"asset manifestAssetPath = @./{name}_sequence.usda@" in text and f'primPath = "/{name}"' in text
        assert "double2[] active = [(7.0, 0.0), (8.0, 1.0), (9.0, 2.0)]" in text
        assert "double2[] times = [(7.0, 7.0), (8.0, 8.0), (9.0, 9.0)]" in text
        declared = re.findall(r"^    (\w+\[\] [\w:]+)(?: \(|$)", (first / f"{name}_sequence.usda").read_text(), re.M)
        for frame, where in zip((9, 7, 8), (first, *others)):
            one = next(read)
            assert one["stage"] and f"        {frame}: [" in one["printed"], one["complaint"]
            arrays, stage = read_usda(one["printed"])
            assert set(declared) == set(arrays) and stage["startTimeCode"] == stage["endTimeCode"] == str(frame)
            columns = read_columns((where / "points.ply").read_bytes())
            assert numpy.allclose(arrays["point3f[] points"], stack(columns, *"xyz"), rtol=1e-6, atol=1e-9)
            velocity = stack(columns, "velocity_x", "velocity_y", "velocity_z")
            assert numpy.allclose(arrays["vector3f[] velocities"], 24 * velocity, rtol=1e-6, atol=1e-9)
            assert "interpolation" in one["printed"].split("primvars:kappa ")[1][:30]
    assert numpy.abs(velocity).max() > 0.05


@pytest.mark.sanitized
def test_the_stage_of_a_sequence_lists_its_clips(growing):
    """The first frame that runs has the stage; each file has its values at the time of its number."""
    first, *others = growing(mesh=True, mesh_usda=True)
    assert not any((other / f"{name}_sequence.usda").exists() for other in others for name in ("points", "mesh"))
    for name in ("points", "mesh"):
        text = (first / f"{name}_sequence.usda").read_text()
        for line in ("startTimeCode = 7", "endTimeCode = 9", "framesPerSecond = 24", "timeCodesPerSecond = 24",
                     "double2[] active = [(7, 0), (8, 1), (9, 2)]", "double2[] times = [(7, 7), (8, 8), (9, 9)]",
                     f"asset[] assetPaths = [@../7/{name}.usda@, @../8/{name}.usda@, @./{name}.usda@]",
                     f"asset manifestAssetPath = @./{name}_sequence.usda@", f'string primPath = "/{name}"'):
            assert f"    {line}\n" in text, line
        declared = re.findall(r"^    (\w+\[\] [\w:]+)(?: \(|$)", text, re.M)
        for frame, where in zip((9, 7, 8), (first, *others)):
            of_frame = (where / f"{name}.usda").read_text()
            arrays, stage = read_usda(of_frame)
            assert set(declared) == set(arrays) and stage["startTimeCode"] == stage["endTimeCode"] == str(frame)
            assert f"        {frame}: [" in of_frame
            columns = read_columns((where / "points.ply").read_bytes())
            assert numpy.allclose(arrays["point3f[] points"], stack(columns, *"xyz"), rtol=1e-6, atol=1e-9)
            velocity = stack(columns, "velocity_x", "velocity_y", "velocity_z")
            assert numpy.allclose(arrays["vector3f[] velocities"], 24 * velocity, rtol=1e-6, atol=1e-9)
    assert numpy.abs(velocity).max() > 0.05


def test_a_stage_is_for_the_directory_above_the_frames(growing):
    """It is the stage beside the first frame, but for the paths."""
    first, *others = growing(mesh=True, mesh_usda=True)
    assert not any((other / f"{name}_stage.usda").exists() for other in others for name in ("points", "mesh"))
    for name in ("points", "mesh"):
        stage, sequence = (first / f"{name}_stage.usda").read_text(), (first / f"{name}_sequence.usda").read_text()
        assert f"assetPaths = [@./7/{name}.usda@, @./8/{name}.usda@, @./9/{name}.usda@]" in stage
        moved = sequence.replace("@../", "@./").replace(f"@./{name}.usda@", f"@./9/{name}.usda@")
        assert stage == moved.replace("_sequence.usda", "_stage.usda")


def test_the_stage_follows_the_output_directory(growing, tmp_path):
    for directory, paths in (("/shots/a/####", ["../0007", "../0008", "."]), ("/shots/%d/b", ["../../7/b", "../../8/b", "."]),
                             ("/shots/a@1/f_####.usd", ["../f_0007.usd", "../f_0008.usd", "."]), ("/shots/#@/x", ["../../7@/x", "../../8@/x", "."])):
        first, *_ = growing(directory=directory)
        listed = re.search(r"assetPaths = \[(.*)\]", (first / "points_sequence.usda").read_text())[1]
        assert [p.strip("@").removesuffix("/points.usda") for p in listed.split(", ")] == paths
        above = re.search(r"assetPaths = \[(.*)\]", (first / "points_stage.usda").read_text())[1].split(", ")
        top = directory[:re.search("/[^/]*(####|%d|#@)", directory).start()]
        numbers = (("0007", "0008", "0009") if "####" in directory else ("7", "8", "9"))
        for path, number in zip(above, numbers):
            frame = directory[len(top):].replace("####", number).replace("%d", number).replace("#@", f"{number}@")
            assert path.strip("@") == f".{frame}/points.usda"


def test_velocities_of_a_file_are_those_of_usd(finished, carried):
    """A file tells them for a second, as USD wants them."""
    carried["attributes"][1]["as"] = "v"
    where, columns, _ = finished(carried)
    arrays, _ = read_usda((where / "points.usda").read_text())
    assert (arrays["vector3f[] velocities"].astype("f4") == stack(columns, "v_x", "v_y", "v_z").astype("f4")).all()


# ---- VTK

@pytest.mark.extended
def test_points_of_vtk(finished, carried):
    xml = pytest.importorskip("vtkmodules.vtkIOXML", reason="python3-vtk9 is not installed")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    carried["output"] = {"preview": False, "ply": {"precision": "double"}, "points_npz": True, "points_vtp": True}
    where, columns, _ = finished(carried)
    reader = xml.vtkXMLPolyDataReader()
    reader.SetFileName(str(where / "points.vtp"))
    reader.Update()
    data = reader.GetOutput()
    values = data.GetPointData()
    assert reader.GetErrorCode() == 0
    assert (data.GetNumberOfPoints(), data.GetNumberOfVerts(), data.GetNumberOfCells()) == (500, 500, 500)
    assert (vtk_to_numpy(data.GetPoints().GetData()) == stack(columns, *"xyz")).all()
    assert values.GetNormals().GetName() == "normal"
    assert [data.GetCell(k).GetPointId(0) for k in (0, 1, 499)] == [0, 1, 499]
    with numpy.load(where / "points.npz") as arrays:
        names = [values.GetArrayName(k) for k in range(values.GetNumberOfArrays())]
        assert sorted(names) == sorted(set(arrays) - {"position"})
        for name in names:
            read = vtk_to_numpy(values.GetArray(name))
            assert (read == arrays[name]).all() and read.dtype == arrays[name].dtype, name
