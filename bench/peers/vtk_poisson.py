"""VTK's Poisson-disk sampler, on ten times as many random points as are asked for."""
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

import volume

# Darts among so many candidates come out at the count that is asked for with this radius, in ideal spacings.
CANDIDATES, RADIUS = 10, 0.70


def main():
    prefix, count, spacing, seed, output = volume.arguments()
    points, cloud = vtk.vtkPoints(), vtk.vtkPolyData()
    points.SetDataTypeToDouble()
    points.SetData(numpy_to_vtk(volume.random_points(prefix, CANDIDATES * count, seed), deep=True))
    cloud.SetPoints(points)
    poisson = vtk.vtkPoissonDiskSampler()
    poisson.SetRadius(RADIUS * spacing)
    poisson.SetInputData(cloud)
    poisson.Update()
    vtk_to_numpy(poisson.GetOutput().GetPoints().GetData()).astype(float).tofile(output)


main()
