// SPDX-License-Identifier: Apache-2.0
/* description: computes the result of a solve (solver_points). */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/core/elementary.h"
#include "base/core/memory.h"
#include "geometry/space/point_tree.h"
#include "sampling/packing/point_flags.h"
#include "sampling/voronoi/resolution.h"
#include "sampling/solver/solver_state.h"

/* Exponent of the spacing over the amplitude under a common support (13). Measured on the quartic: 0.181 with
 * d = 1, 0.171 with d = 3. A mean-field estimate is the inverse of the slope of E_ideal, 0.21. */
static const double ALPHA_EXPONENT = 0.18;

/* The spacing of each particle: the sizing field, or the spacing that results from its amplitude. In the
 * latter case the scale makes the areas of the ideal Voronoi cells sum to the surface area. */
static void requested_spacing(solver *s, double *spacing)
{
    double squares = 0;
    if (s->setup.params.sizing) {
        solver_spacings(s, spacing);
        return;
    }
    for (size_t i = 0; i < s->state.p->count; i++) {
        spacing[i] =
            s->setup.params.graded ? elementary_pow(particles_amplitude(s->state.p, i), ALPHA_EXPONENT) : 1;
        squares += spacing[i] * spacing[i];
    }
    double scale = s->state.spacing / sqrt(squares / (double)s->state.p->count);
    for (size_t i = 0; i < s->state.p->count; i++) spacing[i] *= scale;
}

/* Sets the normal of particle i after a projection without verification (project.c, smooth fields). Returns
 * its residual over h; 0 if the gradient vanishes. */
static double complete_smooth_projection(solver *s, size_t i, const field_sample *sample)
{
    const double length = vec3_norm(sample->gradient), h = s->state.spacing * particles_size(s->state.p, i);
    if (!(length > 0)) return 0;
    s->state.p->normal[i] = vec3_scale(sample->gradient, 1 / length);
    return fabs(sample->value) / length / h;
}

static void curvature_chunk(void *context, int worker, size_t begin, size_t end)
{
    solver *s = context;
    double *kappa = solver_column(s, COLUMN_KAPPA), *kappa1 = solver_column(s, COLUMN_KAPPA1),
           *kappa2 = solver_column(s, COLUMN_KAPPA2), *kappa_scale = solver_column(s, COLUMN_KAPPA_SCALE);
    uint32_t last = FIELD_NO_HINT;
    double worst = 0;
    const bool smooth = solver_ends_smoothly(s);
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        uint32_t *hint = s->state.p->patch ? &s->state.p->hint[i] : &last;
        field_sample sample;
        double over1, over2;
        if (s->setup.params.curvature)
            kappa_scale[i] =
                scaled_curvature_at(s->setup.params.curvature, s->state.p->position[i], s->state.p->normal[i],
                                    particles_patch(s->state.p, i), &over1, &over2);
        const field *f = particles_field(s->state.p, s->setup.field, i);
        if (!field_sample_near(f, s->state.p->position[i], FIELD_HESSIAN, hint, &sample)) continue;
        kappa[i] = field_curvature(&sample, &kappa1[i], &kappa2[i]);
        if (smooth) worst = fmax(worst, complete_smooth_projection(s, i, &sample));
    }
    s->scratch.worst[begin / THREADS_GRAIN] = worst;
}

/* Computes the curvatures and, for smooth fields, the normals and residuals. */
static bool describe_curvature(solver *s, error *e)
{
    const size_t n = s->state.p->count, chunks = n / THREADS_GRAIN + 1;
    s->scratch.worst = mem_array(chunks, sizeof *s->scratch.worst, "the result", e);
    const bool ok = s->scratch.worst != NULL;
    if (ok) threads_run(s->setup.pool, n, THREADS_GRAIN, curvature_chunk, s);
    for (size_t k = 0; ok && k < chunks; k++)
        s->record.out.max_residual = fmax(s->record.out.max_residual, s->scratch.worst[k]);
    free(s->scratch.worst);
    s->scratch.worst = NULL;
    return ok;
}

/* Computes the values that need neighbour lists, then releases the lists before other arrays are allocated:
 * this reduces the peak memory of a job. */
static bool describe_energies(solver *s, error *e)
{
    if (!solver_refresh_lists(s, e)) return false;
    const relax_steps left = s->state.regime->is_under_resolved || s->setup.params.blue_noise
                                 ? (relax_steps){NAN, NAN}
                                 : solver_steps_left(s, false);
    s->record.out.mean_energy = relax_mean_energy(s->scratch.relax, s->state.p, s->state.sigma);
    s->record.out.mean_neighbours = relax_mean_neighbours(s->scratch.relax, s->state.p, s->state.sigma);
    s->record.out.step_left = s->state.p->patch ? left.without_kinks : left.all;
    s->record.out.step_without_kinks = left.without_kinks;
    relax_free(s->scratch.relax);
    s->scratch.relax = NULL;
    return true;
}

/* Maximum distance from a patch, in spacings, of a point that lies on it. */
static const double ON_PATCH = 1e-6;

/* Whether copy i lies on its patch. A sample of a curve that represents a near curve, too, has copies of patches
 * that do not contain it (near_curves.h). */
static bool is_on_its_patch(const solver *s, size_t i)
{
    const particles *p = s->state.p;
    const field *f = particles_field(p, s->setup.field, i);
    const double h = s->state.spacing * particles_size(p, i);
    field_sample sample;
    uint32_t hint = FIELD_NO_HINT;
    return field_sample_near(f, p->position[i], FIELD_GRADIENT, &hint, &sample) &&
           fabs(sample.value) <= ON_PATCH * h * vec3_norm(sample.gradient) &&
           field_is_within_near(f, p->position[i], &hint);
}

#define NO_PARTICLE UINT32_MAX

/* Finds the first copy of each point on a curve, of those that lie on their patches if there is one. *beside: of
 * each particle: it is a copy that does not lie on its patch, and another one of its point does. */
static void choose_first_copies(const solver *s, uint32_t *first, bool *beside)
{
    const particles *p = s->state.p;
    for (size_t i = 0; i < p->count; i++) first[i] = NO_PARTICLE;
    for (uint32_t i = 0; i < p->count; i++) {
        if (!particles_is_on_curve(p, i)) continue;
        uint32_t *of_point = &first[p->place[i]];
        beside[i] = !is_on_its_patch(s, i);
        if (*of_point == NO_PARTICLE || (beside[*of_point] && !beside[i])) *of_point = i;
    }
    for (size_t i = 0; i < p->count; i++)
        if (particles_is_on_curve(p, i)) beside[i] = beside[i] && !beside[first[p->place[i]]];
}

/* Reorders the particles: the first copy of each point, then further copies. Sets point, feature, replaced
 * and flags. `first`: see choose_first_copies; `index`: an entry for each particle. */
static bool arrange_copies(solver *s, uint32_t *order, const uint32_t *first, uint32_t *index, error *e)
{
    const particles *p = s->state.p;
    size_t next = 0, copies = solver_point_count(s);
    for (uint32_t i = 0; i < p->count; i++)
        if (!particles_is_on_curve(p, i) || first[p->place[i]] == i) {
            index[i] = s->record.point[next] = (uint32_t)next;
            order[next++] = i;
        }
    for (uint32_t i = 0; i < p->count; i++)
        if (particles_is_on_curve(p, i) && first[p->place[i]] != i) {
            s->record.point[copies] = index[first[p->place[i]]];
            order[copies++] = i;
        }
    assert(next == solver_point_count(s) && copies == p->count);
    for (size_t k = 0; k < next; k++) {
        s->scratch.lost[k] = s->record.replaced[order[k]];
        const curve_samples *samples = &s->state.plan.quotas[s->state.level].samples;
        s->record.feature[k] = !particles_is_on_curve(p, order[k])     ? SOLVER_ON_PATCH
                               : p->place[order[k]] < samples->corners ? SOLVER_ON_CORNER
                                                                       : SOLVER_ON_CURVE;
    }
    for (size_t k = 0; k < next; k++) s->record.replaced[k] = s->scratch.lost[k];
    if (!particles_arrange(s->state.p, order, s->setup.pool, e)) return false;
    particles_flags(p, s->record.flags);
    return true;
}

/* Minimum cosine (60 degrees) of the normals that are averaged for a point on a curve. Otherwise it has
 * the normal of its first copy. */
static const double MERGED_COSINE = 0.5;

/* `order`: of arrange_copies; `beside`: of the particles before. */
static void merge_normals(solver *s, const uint32_t *order, const bool *beside)
{
    const particles *p = s->state.p;
    size_t points = solver_point_count(s);
    memcpy(s->record.normal, p->normal, points * sizeof *p->normal);
    for (size_t k = points; k < p->count; k++) {
        uint32_t point = s->record.point[k];
        if (!beside[order[k]] && vec3_dot(p->normal[k], p->normal[point]) >= MERGED_COSINE)
            s->record.normal[point] = vec3_add(s->record.normal[point], p->normal[k]);
    }
    for (size_t k = 0; k < points; k++)
        if (s->record.flags[k] & PACKING_FIXED) s->record.normal[k] = vec3_unit(s->record.normal[k]);
}

/* Cosine between the surfaces that meet at the curve of particle k: of the normals of its copies or, if that is
 * smaller, of the faces at its curve. Normals of patches are averaged over a neighbourhood: at a sharp edge their
 * cosine is larger than that of the faces. A copy for a patch beyond a merged curve is on the far side of a narrow
 * face, where both surfaces may be parallel. */
static double wedge_cosine(const solver *s, size_t k)
{
    const particles *p = s->state.p;
    const curve_samples *samples = &s->state.plan.quotas[s->state.level].samples;
    const double of_faces = s->setup.field->patches->curve[samples->curve[p->place[k]]].cosine,
                 cosine = vec3_dot(p->normal[k], p->normal[s->record.point[k]]);
    return cosine > RESOLUTION_PARALLEL ? fmin(cosine, of_faces) : of_faces;
}

/* Distance from an edge, in spacings, within which its surfaces are closer than RESOLUTION_GAP spacings. One
 * spacing is added, since curve samples are at discrete places of the edge. */
static double wedge_reach(double cosine)
{
    const double c = fmax(cosine, RESOLUTION_PARALLEL);
    return RESOLUTION_GAP / sqrt(1 - c * c) + 1;
}

/* Marks the particles near edges at which surfaces that face each other meet. */
static bool mark_wedges(solver *s, error *e)
{
    const particles *p = s->state.p;
    size_t fixed = 0, count = 0;
    for (size_t k = 0; k < p->count; k++) fixed += particles_is_on_curve(p, k);
    vec3 *at = mem_array(fixed, sizeof *at, "the result", e);
    double *reach = mem_array(fixed, sizeof *reach, "the result", e);
    bool ok = at && reach;
    for (size_t k = 0; ok && k < p->count; k++) {
        const double cosine = particles_is_on_curve(p, k) ? wedge_cosine(s, k) : 1;
        if (cosine > RESOLUTION_OPPOSITE) continue;
        reach[count] = wedge_reach(cosine);
        at[count++] = p->position[k];
    }
    point_tree *tree = ok && count > 0 ? point_tree_new(at, count, e) : NULL;
    for (size_t i = 0; tree && i < p->count; i++) {
        double distance;
        const uint32_t nearest = point_tree_nearest(tree, p->position[i], 0, &distance);
        if (distance < reach[nearest] * s->state.spacing * particles_size(p, i))
            s->record.flags[i] |= PACKING_AT_WEDGE;
    }
    ok = ok && (count == 0 || tree);
    point_tree_free(tree);
    free(at);
    free(reach);
    return ok;
}

/* Merges the particles of each point on a curve (solver_patch_points). */
static bool merge_copies(solver *s, error *e)
{
    const char *what = "the result";
    size_t n = s->state.p->count, points = solver_point_count(s);
    if (!s->state.p->patch) return true;
    uint32_t *order = mem_array(n, sizeof *order, what, e), *first = mem_array(n, sizeof *first, what, e),
             *index = mem_array(n, sizeof *index, what, e);
    bool *beside = mem_array(n, sizeof *beside, what, e);
    s->record.point = mem_array(n, sizeof *s->record.point, what, e);
    s->record.flags = mem_array(n, sizeof *s->record.flags, what, e);
    s->record.normal = mem_array(points, sizeof *s->record.normal, what, e);
    s->record.feature = mem_array(points, sizeof *s->record.feature, what, e);
    s->scratch.lost = mem_array(points, sizeof *s->scratch.lost, what, e);
    bool ok = order && first && index && beside && s->record.point && s->record.flags && s->record.normal &&
              s->record.feature && s->scratch.lost;
    if (ok) choose_first_copies(s, first, beside);
    ok = ok && arrange_copies(s, order, first, index, e);
    if (ok) merge_normals(s, order, beside);
    ok = ok && mark_wedges(s, e);
    free(order);
    free(first);
    free(index);
    free(beside);
    free(s->scratch.lost);
    s->scratch.lost = NULL;
    return ok;
}

static void describe_patch_points(solver *s, const double *spacing)
{
    const particles *p = s->state.p;
    solver_points *out = &s->record.out;
    out->patch_points = (solver_patch_points){p->count, p->position,     p->normal, spacing,
                                              p->patch, s->record.point, p->place,  s->record.flags};
    out->feature = s->record.feature;
    out->patch = p->patch;
    out->hint = p->hint;
    if (p->patch) out->curve = s->state.plan.quotas[s->state.level].samples.curve;
}

static bool describe_points(solver *s, error *e)
{
    size_t n = s->state.p->count;
    s->record.column = mem_array((s->setup.params.curvature ? COLUMNS : COLUMN_KAPPA_SCALE) * n,
                                 sizeof *s->record.column, "the result", e);
    if (!s->record.column || !describe_curvature(s, e)) return false;
    double *spacing = solver_column(s, COLUMN_SPACING), *energy = solver_column(s, COLUMN_ENERGY);
    requested_spacing(s, spacing);
    for (size_t i = 0; i < n; i++) energy[i] = (double)s->state.p->energy[i];
    if (!particles_add_amplitudes(s->state.p, e)) return false;
    s->record.out.count = solver_point_count(s);
    describe_patch_points(s, spacing);
    s->record.out.position = s->state.p->position;
    s->record.out.normal = s->state.p->patch ? s->record.normal : s->state.p->normal;
    s->record.out.replaced = s->record.replaced;
    s->record.out.kappa = solver_column(s, COLUMN_KAPPA);
    s->record.out.kappa1 = solver_column(s, COLUMN_KAPPA1);
    s->record.out.kappa2 = solver_column(s, COLUMN_KAPPA2);
    if (s->setup.params.curvature) s->record.out.kappa_scale = solver_column(s, COLUMN_KAPPA_SCALE);
    s->record.out.alpha = s->state.p->alpha;
    s->record.out.energy = energy;
    s->record.out.spacing = spacing;
    s->record.out.sigma = s->state.sigma;
    s->record.out.ideal_energy = s->setup.params.energy->ideal;
    return true;
}

void solver_release_description(solver *s)
{
    free(s->record.point);
    free(s->record.flags);
    free(s->record.normal);
    free(s->record.feature);
    free(s->record.column);
    s->record.point = NULL;
    s->record.flags = s->record.feature = NULL;
    s->record.normal = NULL;
    s->record.column = NULL;
    s->record.out = (solver_points){0};
}

const solver_points *solver_result_points(const solver *s)
{
    return &s->record.out;
}

vec3 *solver_result_positions(solver *s)
{
    return s->state.p->position;
}

bool solver_describe(solver *s, error *e)
{
    solver_renew_sizes(s);
    if (!describe_energies(s, e) || !merge_copies(s, e) || !describe_points(s, e) ||
        !s->setup.method->describe(s, e))
        return false;
    return threads_may_go_on(s->setup.pool, e);
}
