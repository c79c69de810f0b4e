# SPDX-License-Identifier: Apache-2.0
"""The measures of a set of points, from the points alone and the surface that they should lie on.

Neighbours are those of measurements/common/measure.py's restricted Delaunay triangulation, normals the surface's own. Where there
are more points than one triangulation is made of, windows are measured instead: boxes about points drawn at random."""
import numpy
from scipy.spatial import cKDTree

from prepared_inputs import measure

# Points beyond which windows are measured, how many windows, and how many points one has.
MOST, WINDOWS, IN_WINDOW = 2_000_000, 10, 40_000
# So many points are asked for their normals at a time, and for their distance from the surface at all.
ASKED = 100_000
MEASURES = ("hex_fraction", "edge_cv", "energy_excess", "min_spacing_ratio", "grading_cv")


def normals(surface, places):
    parts = numpy.array_split(places, 1 + len(places) // ASKED)
    return numpy.concatenate([surface.truth.normal(part) for part in parts])


def point_set(surface, places, count, spacing=None):
    if spacing is None:
        spacing = surface.requested(places, count)
    return measure.PointSet(places, normals(surface, places), spacing, numpy.ones(len(places)), {})


def of_windows(surface, places):
    """Means over the windows, weighted by their points."""
    rng = numpy.random.default_rng(1)
    tree, found, weight = cKDTree(places), [], []
    for centre in places[rng.choice(len(places), WINDOWS, replace=False)]:
        half = tree.query(centre, IN_WINDOW, p=numpy.inf)[0].max()
        inside = places[tree.query_ball_point(centre, half, p=numpy.inf)]
        points = point_set(surface, inside, len(places))
        # the area that makes the ideal spacing of all the points that of the window's
        area = surface.area * len(inside) / len(places)
        found.append(measure.measure(points, area, window=(centre - half, centre + half)))
        weight.append(found[-1]["inner"].sum())
    return {k: float(numpy.average([f[k] for f in found], weights=weight)) for k in MEASURES}


def of(surface, places, requested=None):
    """`requested`: the spacing that a sampler says it was asked for, for one more measure, `told_cv`."""
    windows = len(places) > MOST
    if windows:
        found = of_windows(surface, places)
    else:
        points = point_set(surface, places, len(places))
        whole = measure.measure(points, surface.area)
        found = {k: whole[k] for k in MEASURES}
        if surface.graded and requested is not None:
            found["told_cv"] = float((whole["local"] / requested).std() / (whole["local"] / requested).mean())
    asked = places[:: 1 + len(places) // ASKED]
    found["residual"] = float(surface.truth.distance(asked).max() / measure.ideal_spacing(surface.area, len(places)))
    found["windows"] = windows
    return found
