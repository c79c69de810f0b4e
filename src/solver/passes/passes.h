/* passes: what changes particles between rounds. A pass acts on s->state.p once, calls no other pass, and gives the same result for
 * any number of threads. It sets *changed to true if particles have to converge again, and never to false. A pass after convergence is called after every
 * convergence: it counts its calls in solver_state and changes nothing once they are spent. A pass that relocates a particle resets its
 * damping and hint and calls solver_mark_displaced. Errors: limit_memory, cancelled. The folder also has relax and refine, which
 * are no passes: they move all particles of a level, and make those of the next. */
#ifndef HEXAD_SOLVER_PASSES_PASSES_H
#define HEXAD_SOLVER_PASSES_PASSES_H

#include "solver/solver_state.h"

/* Removes defects by local changes that keep the count (repair_defects.c). */
bool solver_repair_defects(solver *s, bool *changed, error *e);

/* After repair: amplitudes under which Voronoi cells get the requested areas (repair_defects.c). */
bool solver_equalise_cells(solver *s, bool *changed, error *e);

/* Puts every particle onto the surface to rounding, and relocates those for which that fails (project.c). */
bool solver_project(solver *s, bool *changed, error *e);

/* Surfaces with patches: relocates over-dense particles to places farther than the spacing from all points, of whatever patch
 * (fill_gaps.c). */
bool solver_fill_gaps(solver *s, bool *changed, error *e);

/* Surfaces without patches: gives particles to connected parts that have none (fill_gaps.c). Lists are stale if *changed. */
bool solver_fill_parts(solver *s, bool *changed, error *e);

/* Under-resolved surfaces: relocates over-dense particles to uncovered places, and projects them (fill_gaps.c). */
bool solver_spread_points(solver *s, bool *changed, error *e);

/* ---- not passes: what passes and the driver share */

/* Moves *x onto the zero set of f to rounding, no farther than `farthest`; `h` scales the tolerance. False, outputs untouched, if that
 * fails. */
bool solver_project_point(const field *f, double h, double farthest, vec3 *x, vec3 *normal);

/* Moves the nearest particle of its patch to each place and pins it there, see solver_pin. Returns how many are pinned (pin.c). */
size_t solver_pin_near(solver *s, const vec3 *place, size_t count);

/* Whether the spacing does not resolve the surface, by particles that have nearly converged; unchanged otherwise (fill_gaps.c). Error:
 * limit_memory. */
bool solver_is_under_resolved(solver *s, bool *is_under_resolved, error *e);

#endif
