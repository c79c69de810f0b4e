# SPDX-License-Identifier: Apache-2.0
"""VTK's Poisson-disk sampler, on ten times as many random points as are asked for."""
import numpy
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

import volume

# Darts among so many candidates come out at the count that is asked for with this radius, in ideal spacings.
CANDIDATES, RADIUS = 10, 0.70


def main():
    prefix, count, spacing, seed, output = volume.arguments()
    candidates = volume.random_points(prefix, CANDIDATES * count, seed)
    points, cloud = vtk.vtkPoints(), vtk.vtkPolyData()
    points.SetDataTypeToDouble()
    points.SetData(numpy_to_vtk(candidates, deep=True))
    cloud.SetPoints(points)
    # the filter of VTK 9.1 reads normals without asking whether there are any
    cloud.GetPointData().SetNormals(numpy_to_vtk(numpy.zeros(candidates.shape, numpy.float32), deep=True))
    poisson = vtk.vtkPoissonDiskSampler()
    poisson.SetRadius(RADIUS * spacing)
    poisson.SetInputData(cloud)
    poisson.Update()
    vtk_to_numpy(poisson.GetOutput().GetPoints().GetData()).astype(float).tofile(output)


main()
