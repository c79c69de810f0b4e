# SPDX-License-Identifier: Apache-2.0
"""Level sets to sample, written by OpenVDB's own Python module: of a mesh, and of a torus by its formula."""
import numpy

import meshes

# Voxels on each side of the surface: beyond them nothing is known, and nobody's spline may feel that.
BAND = 6


def write_mesh(mesh_path, voxels, path):
    """The mesh with `voxels` voxels along its longest side."""
    import pyopenvdb
    mesh = meshes.read(mesh_path)
    size = float(numpy.ptp(mesh.vertices, axis=0).max() / voxels)
    grid = pyopenvdb.FloatGrid.createLevelSetFromPolygons(
        mesh.vertices.astype(numpy.float32), triangles=mesh.triangles.astype(numpy.uint32),
        transform=pyopenvdb.createLinearTransform(voxelSize=size), halfWidth=BAND)
    grid.name = "surface"
    pyopenvdb.write(str(path), grids=[grid])


def write_array(distance, corner, voxel, path):
    """Distances in world units at the voxels from index `corner` on; what is beyond the band is cut off."""
    import pyopenvdb
    grid = pyopenvdb.FloatGrid(BAND * voxel)
    grid.copyFromArray(numpy.clip(distance, -BAND * voxel, BAND * voxel).astype(numpy.float32),
                       ijk=tuple(int(k) for k in corner))
    grid.transform = pyopenvdb.createLinearTransform(voxelSize=voxel)
    grid.gridClass = pyopenvdb.GridClass.LEVEL_SET
    grid.name = "surface"
    pyopenvdb.write(str(path), grids=[grid])


def write_torus(major, minor, voxel, path):
    """Distances from the torus about the origin and z."""
    reach = numpy.ceil((numpy.array([major + minor, major + minor, minor]) / voxel) + BAND + 1).astype(int)
    x, y, z = (numpy.arange(-k, k + 1) * voxel for k in reach)
    out = numpy.hypot(x[:, None, None], y[None, :, None]) - major
    write_array(numpy.hypot(out, z[None, None, :]) - minor, -reach, voxel, path)


def write(description, shared, path):
    """`description`: {"mesh": file below shared, "voxels"} or {"torus": [major, minor], "voxel"}."""
    if "mesh" in description:
        write_mesh(shared / description["mesh"], description["voxels"], path)
    else:
        write_torus(*description["torus"], description["voxel"], path)
