# SPDX-License-Identifier: Apache-2.0
"""Open3D's Poisson-disk sampling of triangles: sample elimination from five times as many."""
import numpy
import open3d

import volume


def main():
    prefix, count, _, seed, output = volume.arguments()
    vertices, triangles = volume.read_triangles(prefix)
    mesh = open3d.geometry.TriangleMesh(open3d.utility.Vector3dVector(vertices),
                                        open3d.utility.Vector3iVector(triangles))
    open3d.utility.random.seed(seed)
    numpy.asarray(mesh.sample_points_poisson_disk(count, init_factor=5).points).tofile(output)


main()
