// SPDX-License-Identifier: Apache-2.0
/* passes: changes of particles between rounds. A pass acts on s->state.p once, calls no other pass, and gives
 * the same result for any number of threads. It sets *changed to true if particles must converge again, and
 * never to false. A pass that may change particles each time it is called needs a bound: repair_defects and
 * equalise_cells count their calls in solver_state, the others are bounded by the continuations of the
 * driver. A pass that relocates a particle resets its damping and hint and calls solver_mark_displaced.
 * Errors: limit_memory, cancelled. The folder also contains relax (sweeps) and refine (the particles of
 * the next level), which are not passes. */
#ifndef HEXAD_SAMPLING_SOLVER_PASSES_PASSES_H
#define HEXAD_SAMPLING_SOLVER_PASSES_PASSES_H

#include "surface/field/projection.h"
#include "sampling/solver/solver_state.h"

/* Removes defects by local changes that keep the count (repair_defects.c). */
bool solver_repair_defects(solver *s, bool *changed, error *e);

/* After defect repair: sets amplitudes with which the Voronoi cells converge to the requested areas
 * (repair_defects.c). */
bool solver_equalise_cells(solver *s, bool *changed, error *e);

/* Projects every particle onto the surface to rounding, and relocates particles for which that fails
 * (project.c). */
bool solver_project(solver *s, bool *changed, error *e);

/* Surfaces with patches: relocates over-dense particles to gaps, which are places that are too far from all
 * points of all patches. The limit is 1 spacing; only random places are tested. On surfaces of many connected
 * parts (field_patches.has_many_parts) the limit is 0.97 spacings, and all test places (coverage.h) are
 * tested (fill_gaps.c). */
bool solver_fill_gaps(solver *s, bool *changed, error *e);

/* Surfaces without patches: if a place is farther than 1.2 spacings from all points, as on a connected part
 * without a point, relocates over-dense particles to all places farther than 0.97 spacings (fill_gaps.c).
 * Lists are stale if *changed. */
bool solver_fill_parts(solver *s, bool *changed, error *e);

/* Meshes (near curves are merged): moves a particle by 0.3 spacings if it is within 0.27 spacings of one of
 * another patch that is connected to its own by curves, as where patches pass through each other, or at the
 * same place as one of its own patch. Fixes it at its new position (separate_patches.c). */
bool solver_separate_patches(solver *s, bool *changed, error *e);

/* Under-resolved surfaces: relocates over-dense particles to gaps in coverage (fill_gaps.c). */
bool solver_spread_points(solver *s, bool *changed, error *e);

/* ---- shared functions, which are not passes */

/* Limits of a projection to rounding, for the spacing h. */
projection_limits solver_rounding(double h);

/* Moves *x onto the zero set of f to rounding, no farther than `farthest`; `h` scales the tolerance. False,
 * outputs untouched, if that fails. *hint: see `sample_near` in field_ops. */
bool solver_project_point(const field *f, double h, double farthest, uint32_t *hint, vec3 *x, vec3 *normal);

/* Moves the nearest particle to each place and fixes it there, see solver_pin. *pinned: the number of fixed
 * particles (pin.c). Errors: limit_memory, cancelled. */
bool solver_pin_near(solver *s, const vec3 *place, size_t count, size_t *pinned, error *e);

/* Sets *is_under_resolved if the spacing does not resolve the surface. The particles have nearly converged.
 * Not computed, and *is_under_resolved unchanged, on surfaces with patches, without the fast kernel, or if
 * few normals diverge (fill_gaps.c). Errors: limit_memory, cancelled. */
bool solver_is_under_resolved(solver *s, bool *is_under_resolved, error *e);

#endif
