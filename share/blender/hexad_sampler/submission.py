# SPDX-License-Identifier: Apache-2.0
"""The part of the add-on that needs no Blender."""
import hexad


def submit(client, name, corners, faces, count):
    """Sends a mesh to the service and submits a job that samples it; returns the job.

    corners: its vertices as sequences of three numbers
    faces: their indices, at least three for each face
    """
    path = client.upload(hexad.obj_of(corners, faces), ".obj")
    return client.submit({
        "name": name,
        "surface": {"mesh": {"path": path}},
        "sampling": {"count": count},
        "output": {"preview": False, "ply": {"properties": "blender"}},
        "queue": {"labels": ["blender"]},
    })
