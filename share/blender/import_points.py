# SPDX-License-Identifier: Apache-2.0
"""Points of hexad in Blender 3.4 and later: with colours and radii, which Blender's own importer of PLY leaves out.

In Blender: open this file in the text editor, set FILE, and run it. From a shell:

    blender --background --python /usr/share/hexad/blender/import_points.py -- points.ply [picture.png]

This is the path of the package hexad. In a clone it is share/blender/import_points.py, and after `make install`
PREFIX/share/hexad/blender/import_points.py.

It makes a mesh of vertices with every property of the file as an attribute, a colour attribute `Cd` of red, green and
blue, and a modifier of geometry nodes that shows each point as a sphere of its radius in its colour. With a second
argument it renders a picture. Write the points with "output": {"ply": {"properties": "blender"}}.
"""
import math
import os
import sys

import bpy
import numpy
from mathutils import Vector

FILE = ""

TYPES = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4", "uint": "<u4"}


def read_ply(path):
    """{name: array} of the vertices of a PLY file of hexad."""
    with open(path, "rb") as file:
        head, _, body = file.read().partition(b"end_header\n")
    words = [line.split() for line in head.decode("ascii").splitlines()]
    count = next(int(w[2]) for w in words if w[:2] == ["element", "vertex"])
    types = [(w[2], TYPES[w[1]]) for w in words if w[0] == "property" and w[1] in TYPES]
    if words[1][1] == "ascii":
        rows = numpy.array([line.split() for line in body.decode("ascii").splitlines()[:count]], float)
        return {name: rows[:, k] for k, (name, _) in enumerate(types)}
    table = numpy.frombuffer(body, types, count)
    return {name: table[name].astype(float) for name, _ in types}


def linear(srgb):
    """From what a screen shows to light."""
    return numpy.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def make_mesh(name, columns):
    place = numpy.stack([columns[axis] for axis in "xyz"], -1)
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(place))
    mesh.vertices.foreach_set("co", place.ravel())
    for key, values in columns.items():
        if key not in ("x", "y", "z"):
            mesh.attributes.new(key, "FLOAT", "POINT").data.foreach_set("value", values)
    if "red" in columns:
        color = numpy.stack([columns[c] for c in ("red", "green", "blue")], -1) / 255
        whole = numpy.c_[linear(color), numpy.ones(len(color))]
        mesh.attributes.new("Cd", "FLOAT_COLOR", "POINT").data.foreach_set("color", whole.ravel())
    mesh.update()
    return mesh


def make_material():
    material = bpy.data.materials.new("points")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    color = nodes.new("ShaderNodeAttribute")
    color.attribute_name, color.attribute_type = "Cd", "GEOMETRY"
    links.new(color.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return material


def make_nodes(material, has_radius):
    """Vertices to points of the radius, in the material."""
    group = bpy.data.node_groups.new("points of hexad", "GeometryNodeTree")
    group.inputs.new("NodeSocketGeometry", "Geometry")
    group.outputs.new("NodeSocketGeometry", "Geometry")
    start, end = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    points, shade = group.nodes.new("GeometryNodeMeshToPoints"), group.nodes.new("GeometryNodeSetMaterial")
    shade.inputs["Material"].default_value = material
    if has_radius:
        radius = group.nodes.new("GeometryNodeInputNamedAttribute")
        radius.data_type = "FLOAT"
        radius.inputs["Name"].default_value = "radius"
        group.links.new(next(o for o in radius.outputs if o.enabled and o.type == "VALUE"), points.inputs["Radius"])
    group.links.new(start.outputs[0], points.inputs["Mesh"])
    group.links.new(points.outputs[0], shade.inputs["Geometry"])
    group.links.new(shade.outputs[0], end.inputs[0])
    return group


def load(path):
    columns = read_ply(path)
    thing = bpy.data.objects.new(os.path.basename(path), make_mesh("points", columns))
    bpy.context.scene.collection.objects.link(thing)
    material = make_material()
    thing.data.materials.append(material)
    thing.modifiers.new("points", "NODES").node_group = make_nodes(material, "radius" in columns)
    return thing


def render(thing, picture):
    """From the right, the front and above, with Cycles on the processor."""
    scene = bpy.context.scene
    corners = numpy.array([v for v in thing.bound_box])
    middle, size = (corners.min(0) + corners.max(0)) / 2, numpy.linalg.norm(numpy.ptp(corners, axis=0))
    eye = Vector(middle) + Vector((0.9, -1.2, 0.8)).normalized() * 2.2 * size
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = eye
    camera.rotation_euler = (Vector(middle) - eye).to_track_quat("-Z", "Y").to_euler()
    camera.data.angle, camera.data.clip_end = 0.5, 10 * size
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 3, (math.radians(50), 0, math.radians(30))
    for item in (camera, sun):
        scene.collection.objects.link(item)
    scene.camera = camera
    world = scene.world or bpy.data.worlds.new("world")
    scene.world = world
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.6
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 16
    scene.cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = 480
    scene.view_settings.view_transform = "Standard"
    scene.render.filepath = picture
    bpy.ops.render.render(write_still=True)


def main():
    given = sys.argv[sys.argv.index("--") + 1:] if "--" in sys.argv else [FILE]
    if not bpy.app.background and not FILE:
        raise SystemExit("set FILE to the path of a points.ply")
    if bpy.app.background:
        bpy.ops.wm.read_factory_settings(use_empty=True)
    thing = load(given[0])
    names = sorted(a.name for a in thing.data.attributes)
    print(f"hexad: {len(thing.data.vertices)} points with {' '.join(names)}")
    if len(given) > 1:
        render(thing, os.path.abspath(given[1]))


main()
