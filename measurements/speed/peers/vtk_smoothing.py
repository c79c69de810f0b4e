# SPDX-License-Identifier: Apache-2.0
"""VTK's point smoothing from random points, back onto the surface after every block of iterations; its defaults do
not converge."""
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

import volume

ITERATIONS, BLOCK = 1000, 10


def main():
    prefix, count, spacing, seed, output = volume.arguments()
    surface = volume.Volume(prefix)
    places = volume.random_points(prefix, count, seed)
    smoothing = vtk.vtkPointSmoothingFilter()
    smoothing.SetSmoothingModeToUniform()
    smoothing.SetNeighborhoodSize(12)
    smoothing.SetNumberOfIterations(BLOCK)
    smoothing.SetNumberOfSubIterations(BLOCK)
    smoothing.SetMaximumStepSize(0.03 * spacing)
    smoothing.SetConvergence(0)
    smoothing.ComputePackingRadiusOff()
    smoothing.SetPackingRadius(spacing)
    smoothing.EnableConstraintsOff()
    for _ in range(ITERATIONS // BLOCK):
        points, cloud = vtk.vtkPoints(), vtk.vtkPolyData()
        points.SetDataTypeToDouble()
        points.SetData(numpy_to_vtk(places, deep=True))
        cloud.SetPoints(points)
        smoothing.SetInputData(cloud)
        smoothing.Update()
        places = surface.project(vtk_to_numpy(smoothing.GetOutput().GetPoints().GetData()).astype(float))
    surface.project(places).tofile(output)


main()
