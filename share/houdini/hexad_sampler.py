# SPDX-License-Identifier: Apache-2.0
"""A script for a shelf of Houdini, an example of a submitter: it samples the selected SOP by a hexad service.

Put this file and the Python client into a folder of Houdini's Python path, such as $HOUDINI_USER_PREF_DIR/python3.9libs. With
packages they are /usr/share/hexad/houdini/hexad_sampler.py (hexad) and /usr/lib/python3/dist-packages/hexad (python3-hexad); in
a clone, share/houdini/hexad_sampler.py and clients/python/hexad. The script of the shelf tool is:

    import hexad_sampler
    hexad_sampler.sample_selected()

It has a field for the number of points, sends the polygons of the selected SOP, shows the progress and makes a File SOP that reads
the points, with Cd and pscale. HEXAD_SERVER and HEXAD_TOKEN name the service.
"""
import os

import hexad


def submit(client, name, corners, faces, count):
    """Sends a mesh to the service and submits a job that samples it; returns the job.

    corners: its points as sequences of three numbers
    faces: their indices, at least three for each face
    """
    path = client.upload(hexad.obj_of(corners, faces), ".obj")
    return client.submit({
        "name": name,
        "surface": {"mesh": {"path": path}},
        "sampling": {"count": count},
        "output": {"preview": False, "ply": {"properties": "houdini"}},
        "queue": {"labels": ["houdini"]},
    })


def follow(job, show):
    """Gives the fraction of the progress to `show` until the job has ended. If `show` raises, the job is cancelled."""
    try:
        for event in job.events():
            if event.progress:
                show(event.progress["fraction"])
    except BaseException:
        job.cancel()
        raise
    return job.wait()


def sample_selected():
    import hou  # only Houdini has it

    selected = [node for node in hou.selectedNodes() if isinstance(node, hou.SopNode)]
    if not selected:
        raise hou.Error("Select a SOP with polygons.")
    source = selected[0]
    button, text = hou.ui.readInput("Number of points", buttons=("Sample", "Cancel"), close_choice=1, initial_contents="1000")
    if button != 0:
        return
    geometry = source.geometry()
    corners = [tuple(point.position()) for point in geometry.points()]
    # Houdini orders the corners of a face clockwise
    faces = [[vertex.point().number() for vertex in reversed(face.vertices())] for face in geometry.prims()
             if face.type() == hou.primType.Polygon]
    try:
        job = submit(hexad.Client(), source.name(), corners, faces, int(text))
        with hou.InterruptableOperation("hexad", "Sampling", open_interrupt_dialog=True) as operation:
            follow(job, lambda fraction: operation.updateProgress(fraction))
        place = os.path.join(hou.text.expandString("$HIP"), "hexad", job.id)
        job.fetch(place)
    except (hexad.HexadError, ValueError) as fault:
        hou.ui.displayMessage(str(fault), severity=hou.severityType.Error)
        return
    file = source.parent().createNode("file", f"{source.name()}_points")
    file.parm("file").set(os.path.join(place, "points.ply"))
    file.setSelected(True, clear_all_selected=True)
    file.setDisplayFlag(True)
