# SPDX-License-Identifier: Apache-2.0
"""An add-on for Blender 3.4 and later, an example of a submitter: it samples the active mesh object by a hexad service.

Copy this folder, /usr/share/hexad/blender/hexad_sampler of the package hexad or share/blender/hexad_sampler of a clone, into
Blender's folder scripts/addons. Blender needs the Python client as well. Debian's Blender finds that of the package
python3-hexad. For another Blender, copy /usr/lib/python3/dist-packages/hexad, or clients/python/hexad of a clone, into
scripts/modules. Enable the add-on in the preferences. In the 3-D view press N and choose the tab hexad. The points become vertices of a new object, with every property as an attribute; Blender stays usable while the
job runs. HEXAD_SERVER and HEXAD_TOKEN name the service, or the fields of the panel do.
"""
import threading

import bpy
import hexad

from .submission import submit

bl_info = {"name": "hexad sampler", "description": "Evenly packed points on a mesh", "author": "The hexad authors",
           "version": (1, 0, 0), "blender": (3, 4, 0), "location": "View3D > Sidebar > hexad", "category": "Object"}

LOOK_S = 0.25  # how often a timer looks at the job


def mesh_of(thing):
    """The corners in world space and the faces of an object, with its modifiers."""
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    try:
        corners = [tuple(evaluated.matrix_world @ vertex.co) for vertex in mesh.vertices]
        return corners, [tuple(face.vertices) for face in mesh.polygons]
    finally:
        evaluated.to_mesh_clear()


def show(points, name):
    """Makes an object of points."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(points.count)
    mesh.vertices.foreach_set("co", points.positions.ravel())
    for key in points:
        if key not in ("x", "y", "z"):
            mesh.attributes.new(key, "FLOAT", "POINT").data.foreach_set("value", points[key].astype(float))
    mesh.update()
    bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, mesh))


class Sampling(threading.Thread):
    """A job, from its submission to its points. Blender's data are only used in Blender's own thread, by `look`."""

    def __init__(self, client, name, corners, faces, count):
        super().__init__(daemon=True)
        self.client, self.given = client, (name, corners, faces, count)
        self.points = self.fault = None

    def run(self):
        try:
            job = submit(self.client, *self.given)
            self.points = job.wait().points()
        except (hexad.HexadError, OSError) as fault:
            self.fault = fault

    def look(self):
        """For bpy.app.timers: the seconds until it is called again; None: not again."""
        if self.is_alive():
            return LOOK_S
        if self.points is not None:
            show(self.points, f"{self.given[0]} points")
        else:
            text = str(self.fault)
            bpy.context.window_manager.popup_menu(lambda menu, _: menu.layout.label(text=text), title="hexad", icon="ERROR")
        return None


class HEXAD_OT_sample(bpy.types.Operator):
    """Sample the active mesh object by hexad"""
    bl_idname = "hexad.sample"
    bl_label = "Sample"

    @classmethod
    def poll(cls, context):
        return context.object is not None and context.object.type == "MESH"

    def execute(self, context):
        scene = context.scene
        try:
            client = hexad.Client(scene.hexad_server or None, scene.hexad_token or None)
        except ValueError as fault:
            self.report({"ERROR"}, str(fault))
            return {"CANCELLED"}
        sampling = Sampling(client, context.object.name, *mesh_of(context.object), scene.hexad_count)
        sampling.start()
        bpy.app.timers.register(sampling.look)
        return {"FINISHED"}


class HEXAD_PT_panel(bpy.types.Panel):
    bl_label = "hexad"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "hexad"

    def draw(self, context):
        for name in ("hexad_count", "hexad_server", "hexad_token"):
            self.layout.prop(context.scene, name)
        self.layout.operator(HEXAD_OT_sample.bl_idname)


CLASSES = (HEXAD_OT_sample, HEXAD_PT_panel)


def register():
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.hexad_count = bpy.props.IntProperty(name="Points", default=1000, min=1)
    bpy.types.Scene.hexad_server = bpy.props.StringProperty(name="Server", description="Empty: HEXAD_SERVER, or this host's service")
    bpy.types.Scene.hexad_token = bpy.props.StringProperty(name="Token", subtype="PASSWORD", options={"SKIP_SAVE"})


def unregister():
    for name in ("hexad_count", "hexad_server", "hexad_token"):
        delattr(bpy.types.Scene, name)
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
