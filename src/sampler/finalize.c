/* finalize: the end of a sampler's run, see sampler_finalize. */
#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "field/projection.h"
#include "geometry/moving_points.h"
#include "geometry/point_tree.h"
#include "packing/packing.h"
#include "voronoi/quality.h"
#include "particles/random_streams.h"
#include "sampler/sampler_internal.h"

static const double ALPHA_EXPONENT = 0.18;
/* A finished particle is on the surface to this fraction of h, or it is replaced. */
static const double WORST_RESIDUAL = 1e-6;
static const int REPLACEMENT_DRAWS = 30;
/* A free particle this near to a curve of its patch, in spacings, is in the row there; it goes where there is so much room. */
static const double IN_ROW = 0.3, LEAST_ROOM = 0.6;
/* Where there is no such room, it goes off the row, away from it by so much, as the free ones within AROUND_ROW spacings say. */
static const double AROUND_ROW = 1.5;
static const int SETTLE_STEPS = 20;
static const double SETTLE_FARTHEST = 0.05;

/* What the grading asks for; or what (13) makes of an amplitude under a common support: the spacing goes as
 * alpha^0.18 (measured on the quartic: 0.181 with d = 1, 0.171 with d = 3; a mean-field estimate gives the
 * inverse of E_ideal's slope, 0.21). The scale keeps the sum of the ideal cells equal to the area. */
static void requested_spacing(sampler *s, double *spacing)
{
    double squares = 0;
    if (s->setup.params.sizing) {
        sampler_tell_spacings(s, spacing);
        return;
    }
    for (size_t i = 0; i < s->state.p->count; i++) {
        spacing[i] = s->setup.params.graded ? pow(particles_amplitude(s->state.p, i), ALPHA_EXPONENT) : 1;
        squares += spacing[i] * spacing[i];
    }
    double scale = s->state.spacing / sqrt(squares / (double)s->state.p->count);
    for (size_t i = 0; i < s->state.p->count; i++) spacing[i] *= scale;
}

/* To rounding: a Newton step from 1e-7 h leaves less than doubles resolve. */
static projection_limits to_rounding(double h)
{
    return (projection_limits){SETTLE_STEPS, 1e-9 * h, 1e-7 * h, WORST_RESIDUAL * h};
}

/* A relaxed particle is within 0.01 h of the surface; one that would have to go much farther sits where Newton's method goes
 * astray. */
bool sampler_land(const field *f, double h, double farthest, vec3 *x, vec3 *normal)
{
    const projection_limits limits = to_rounding(h);
    vec3 q = *x, n = *normal;
    if (projection_find(f, &limits, &q, &n) && vec3_norm(vec3_sub(q, *x)) <= farthest) {
        *x = q;
        *normal = n;
        return true;
    }
    return projection_bisect(f, *normal, farthest, x, normal);
}

/* The same, with the sample there. */
static bool land_particle(const field *f, double h, vec3 along, uint32_t *hint, vec3 *x, field_sample *sample)
{
    const projection_limits limits = to_rounding(h);
    const double farthest = SETTLE_FARTHEST * h;
    vec3 q = *x;
    if (projection_land(f, &limits, hint, &q, sample) && vec3_norm(vec3_sub(q, *x)) <= farthest) {
        *x = q;
        return true;
    }
    return projection_bisect(f, along, farthest, x, &along) &&
           field_sample_near(f, *x, FIELD_GRADIENT, hint, sample);
}

/* Of h and of a cell: where F bends smoothly a Newton step from there leaves 1e-10 of these at most, and its end needs no look. */
static const double SMOOTH_SHORTCUT = 1e-5;

/* Residuals and normals are told with curvatures then, see curvature_chunk. */
static bool ends_smoothly(const sampler *s)
{
    return !s->state.p->patch && !s->setup.params.graded && !s->setup.field->sharp;
}

/* The same where F bends smoothly: *normal is of a place as near. */
static bool land_smoothly(const field *f, double h, uint32_t *hint, vec3 *x, vec3 *normal)
{
    projection_limits limits = to_rounding(h);
    limits.shortcut = SMOOTH_SHORTCUT * fmin(h, f->cell_size);
    vec3 q = *x, n;
    if (!projection_find_near(f, &limits, hint, &q, &n) || vec3_norm(vec3_sub(q, *x)) > SETTLE_FARTHEST * h)
        return false;
    *x = q;
    *normal = n;
    return true;
}

/* Puts particle i on the surface to rounding, or notes that it is lost. Returns its residual, |F| / |grad F| over h; 0 where it
 * is lost or held, or told later. */
static double finalize_particle(sampler *s, size_t i, uint32_t *last)
{
    uint32_t *hint = s->state.p->patch ? &s->state.p->hint[i] : last;
    vec3 x = s->state.p->position[i];
    const field *f = particles_field(s->state.p, s->setup.field, i);
    field_sample sample;
    s->scratch.lost[i] = !particles_is_fixed(s->state.p, i);
    if (!s->scratch.lost[i]) return 0;
    double h = s->state.spacing * particles_size(s->state.p, i);
    if (ends_smoothly(s) && land_smoothly(f, h, hint, &x, &s->state.p->normal[i])) {
        s->scratch.lost[i] = false;
        s->state.p->position[i] = x;
        return 0;
    }
    if (!land_particle(f, h, s->state.p->normal[i], hint, &x, &sample) ||
        (s->state.p->patch && !field_is_within_near(f, x, hint)))
        return 0;
    double length = vec3_norm(sample.gradient), residual = fabs(sample.value) / length / h;
    if (!(residual < WORST_RESIDUAL)) return 0;
    s->scratch.lost[i] = false;
    s->state.p->position[i] = x;
    s->state.p->normal[i] = vec3_scale(sample.gradient, 1 / length);
    if (s->setup.params.graded)
        sampler_amplitude_at(s, f, particles_patch(s->state.p, i), x, s->state.p->normal[i],
                             &s->state.p->alpha[i]);
    return residual;
}

enum { CHUNK = 256 };

static void finalize_chunk(void *context, int worker, size_t begin, size_t end)
{
    sampler *s = context;
    uint32_t hint = FIELD_NO_HINT;
    double worst = 0;
    (void)worker;
    for (size_t i = begin; i < end; i++) worst = fmax(worst, finalize_particle(s, i, &hint));
    s->scratch.worst[begin / CHUNK] = worst;
}

/* Whether a free particle has come to rest in the row of a curve, between two that are held there: those behind push it out, and
 * it cannot leave its patch. */
static bool is_in_row(const sampler *s, size_t i)
{
    const particles *p = s->state.p;
    if (!p->patch || particles_is_fixed(p, i)) return false;
    double distance = curve_distance_at(s->state.plan.curves, p->patch[i], p->position[i]);
    return distance < IN_ROW * s->state.spacing * particles_size(p, i);
}

/* Of a chunk's worst residual: it is to be looked for once more. */
static const double UNKNOWN = -1;

/* One that is put elsewhere, after all others. */
static void finalize_alone(sampler *s, size_t i)
{
    finalize_particle(s, i, &(uint32_t){FIELD_NO_HINT});
    s->scratch.worst[i / CHUNK] = UNKNOWN;
}

/* Of particles where finalize_particle has put them. */
static double worst_residual(const sampler *s, size_t begin, size_t end)
{
    double worst = 0;
    for (size_t i = begin; i < end; i++) {
        const double h = s->state.spacing * particles_size(s->state.p, i);
        field_sample sample;
        if (s->scratch.lost[i] || particles_is_fixed(s->state.p, i) ||
            !field_sample_at(particles_field(s->state.p, s->setup.field, i), s->state.p->position[i],
                             FIELD_GRADIENT, &sample))
            continue;
        worst = fmax(worst, fabs(sample.value) / vec3_norm(sample.gradient) / h);
    }
    return worst;
}

bool sampler_merges_rows(const sampler *s)
{
    return s->setup.field->patches && s->setup.field->patches->merges_near_rows;
}

void sampler_stir(sampler *s, size_t i)
{
    if (!s->state.p->patch || sampler_merges_rows(s)) relax_stir(s->scratch.relax, s->state.p, i);
}

/* Puts particle i on a new place of the surface, or of its patch: of several drawn the one that is farthest from its nearest
 * particle, and farther than `least`. False where there is none. */
static bool replace(sampler *s, const moving_points *all, uint32_t i, double least, rng *r)
{
    const double *weight = sizing_field_weight(s->setup.params.sizing, s->setup.scan);
    const field *f = particles_field(s->state.p, s->setup.field, i);
    uint32_t patch = s->state.p->patch ? s->state.p->patch[i] : 0;
    double best = least < 0 ? -1 : least * least;
    bool found = false;
    vec3 x = s->state.p->position[i], normal = s->state.p->normal[i];
    for (int draw = 0; draw < REPLACEMENT_DRAWS; draw++) {
        vec3 q, n = {0, 0, 1};
        if (!surface_patch_point(s->setup.scan, weight, patch, rng_uniform(r), r, &q) ||
            !sampler_land(f, s->state.spacing, s->setup.field->cell_size, &q, &n))
            continue;
        const double nearest2 = moving_points_nearest2(all, q, i);
        if (nearest2 <= best) continue;
        best = nearest2;
        found = true;
        x = q;
        normal = n;
    }
    if (!found) return false;
    sampler_stir(s, i);
    s->state.p->position[i] = x;
    s->state.p->normal[i] = normal;
    s->record.removed++;
    s->record.replaced[i] = true;
    finalize_alone(s, i);
    return true;
}

/* Puts a particle that is in a row, and for which there is no better place, off it, towards the free ones of its patch. */
static void leave_row(sampler *s, size_t i)
{
    const particles *p = s->state.p;
    const field *f = particles_field(p, s->setup.field, i);
    const double h = s->state.spacing * particles_size(p, i), around = AROUND_ROW * h;
    vec3 x = p->position[i], normal = p->normal[i], inwards = {0, 0, 0};
    for (size_t j = 0; j < p->count; j++) {
        vec3 side = vec3_sub(p->position[j], x);
        if (p->patch[j] == p->patch[i] && !particles_is_fixed(p, j) && vec3_norm2(side) < around * around)
            inwards = vec3_add(inwards, side);
    }
    inwards = vec3_axpy(-vec3_dot(inwards, normal), normal, inwards);
    x = vec3_axpy(IN_ROW * h, vec3_unit(inwards), x);
    if (!sampler_land(f, s->state.spacing, IN_ROW * h, &x, &normal) || !field_is_within(f, x)) return;
    sampler_stir(s, i);
    s->state.p->position[i] = x;
    s->state.p->normal[i] = normal;
    finalize_alone(s, i);
}

/* Relocates the particles that are not on the surface or lie among curve samples. On a mesh, a particle for which there is no other place
 * stays among the curve samples once no recall is left. */
static bool replace_lost(sampler *s, error *e)
{
    const particles *p = s->state.p;
    const bool may_stay = sampler_merges_rows(s) && s->state.recalls >= SAMPLER_RECALLS;
    uint32_t *moving = mem_array(p->count, sizeof *moving, "the result", e);
    size_t count = 0;
    for (uint32_t i = 0; moving && i < p->count; i++)
        if (s->scratch.lost[i] || (!may_stay && is_in_row(s, i))) moving[count++] = i;
    moving_points *all =
        count > 0 ? moving_points_new(p->position, p->count, moving, count, s->setup.pool, e) : NULL;
    rng r = rng_seed(s->setup.params.seed, RANDOM_STREAM_REPLACEMENT);
    for (size_t k = 0; all && k < count && !threads_stopped(s->setup.pool); k++) {
        const uint32_t i = moving[k];
        const double room = LEAST_ROOM * s->state.spacing * particles_size(p, i);
        if (!replace(s, all, i, s->scratch.lost[i] ? -1 : room, &r) && !s->scratch.lost[i]) leave_row(s, i);
    }
    const bool ok = moving && (count == 0 || all);
    moving_points_free(all);
    free(moving);
    return ok;
}

static void count_lost(sampler *s)
{
    const size_t n = s->state.p->count;
    s->record.out.lost = 0;
    s->record.out.max_residual = 0;
    for (size_t i = 0; i < n; i++) s->record.out.lost += s->scratch.lost[i];
    for (size_t k = 0; k < n / CHUNK + 1; k++) {
        const size_t begin = k * CHUNK, end = begin + CHUNK < n ? begin + CHUNK : n;
        const double worst =
            s->scratch.worst[k] == UNKNOWN ? worst_residual(s, begin, end) : s->scratch.worst[k];
        s->record.out.max_residual = fmax(s->record.out.max_residual, worst);
    }
}

/* What land_smoothly left open of particle i; one that is lost may have no normal. */
static double end_smoothly(sampler *s, size_t i, const field_sample *sample)
{
    const double length = vec3_norm(sample->gradient), h = s->state.spacing * particles_size(s->state.p, i);
    if (!(length > 0)) return 0;
    s->state.p->normal[i] = vec3_scale(sample->gradient, 1 / length);
    return fabs(sample->value) / length / h;
}

static void curvature_chunk(void *context, int worker, size_t begin, size_t end)
{
    sampler *s = context;
    double *kappa = sampler_column(s, COLUMN_KAPPA), *kappa1 = sampler_column(s, COLUMN_KAPPA1),
           *kappa2 = sampler_column(s, COLUMN_KAPPA2), *over = sampler_column(s, COLUMN_KAPPA_SCALE);
    uint32_t last = FIELD_NO_HINT;
    double worst = 0;
    const bool smooth = ends_smoothly(s);
    (void)worker;
    for (size_t i = begin; i < end; i++) {
        uint32_t *hint = s->state.p->patch ? &s->state.p->hint[i] : &last;
        field_sample sample;
        double over1, over2;
        if (s->setup.params.curvature)
            over[i] =
                scaled_curvature_at(s->setup.params.curvature, s->state.p->position[i], s->state.p->normal[i],
                                    particles_patch(s->state.p, i), &over1, &over2);
        const field *f = particles_field(s->state.p, s->setup.field, i);
        if (!field_sample_near(f, s->state.p->position[i], FIELD_HESSIAN, hint, &sample)) continue;
        kappa[i] = field_curvature(&sample, &kappa1[i], &kappa2[i]);
        if (smooth) worst = fmax(worst, end_smoothly(s, i, &sample));
    }
    s->scratch.worst[begin / CHUNK] = worst;
}

/* Also the normals and residuals that are still to be told. */
static bool describe_curvature(sampler *s, error *e)
{
    const size_t n = s->state.p->count, chunks = n / CHUNK + 1;
    s->scratch.worst = mem_array(chunks, sizeof *s->scratch.worst, "the result", e);
    const bool ok = s->scratch.worst != NULL;
    if (ok) threads_run(s->setup.pool, n, CHUNK, curvature_chunk, s);
    for (size_t k = 0; ok && k < chunks; k++)
        s->record.out.max_residual = fmax(s->record.out.max_residual, s->scratch.worst[k]);
    free(s->scratch.worst);
    s->scratch.worst = NULL;
    return ok;
}

/* Newton's step says nothing of the Gaussian, which bends the wrong way near its centre. */
relax_steps sampler_steps_left(const sampler *s, bool watch)
{
    if (s->setup.params.energy == &energy_gaussian) return (relax_steps){NAN, NAN};
    return relax_rms_steps_left(s->scratch.relax, s->state.p, s->state.sigma, s->state.spacing, watch);
}

/* Lists of the particles where they are. */
static bool bring_lists(sampler *s, error *e)
{
    return relax_refresh(s->scratch.relax, s->state.p, s->state.sigma) ||
           relax_build(s->scratch.relax, s->state.p, s->state.sigma, 0, e);
}

bool sampler_steps_settled(sampler *s, relax_steps *left, error *e)
{
    sampler_resize(s);
    if (!bring_lists(s, e)) return false;
    *left = sampler_steps_left(s, false);
    return true;
}

/* Energies need the lists, which are given up before there is anything else: together they would be the most
 * memory that a job takes. */
static bool describe_energies(sampler *s, error *e)
{
    if (!bring_lists(s, e)) return false;
    const relax_steps left = s->state.coarse ? (relax_steps){NAN, NAN} : sampler_steps_left(s, false);
    s->record.out.mean_energy = relax_mean_energy(s->scratch.relax, s->state.p, s->state.sigma);
    s->record.out.mean_neighbours = relax_mean_neighbours(s->scratch.relax, s->state.p, s->state.sigma);
    s->record.out.step_left = s->state.p->patch ? left.to_rest : left.all;
    s->record.out.step_to_rest = left.to_rest;
    relax_free(s->scratch.relax);
    s->scratch.relax = NULL;
    return true;
}

size_t sampler_point_count(const sampler *s)
{
    const allotment *a = s->state.plan.allotments;
    if (!a) return s->state.p->count;
    const curve_rows *rows = &a[s->state.level].rows;
    return s->state.p->count - rows->stands + rows->count;
}

/* The first particle of each point before the others. */
static bool arrange_stands(sampler *s, uint32_t *order, uint32_t *first, error *e)
{
    const particles *p = s->state.p;
    size_t next = 0, copies = sampler_point_count(s);
    for (uint32_t i = 0; i < p->count; i++) {
        bool copy = particles_is_on_curve(p, i) && first[p->place[i]] > 0;
        if (particles_is_on_curve(p, i) && !copy) first[p->place[i]] = (uint32_t)next + 1;
        s->record.point[copy ? copies : next] = copy ? first[p->place[i]] - 1 : (uint32_t)next;
        order[copy ? copies++ : next++] = i;
    }
    assert(next == sampler_point_count(s) && copies == p->count);
    for (size_t k = 0; k < next; k++) {
        s->scratch.lost[k] = s->record.replaced[order[k]];
        const curve_rows *rows = &s->state.plan.allotments[s->state.level].rows;
        s->record.feature[k] = !particles_is_on_curve(p, order[k])  ? SAMPLER_ON_PATCH
                               : p->place[order[k]] < rows->corners ? SAMPLER_ON_CORNER
                                                                    : SAMPLER_ON_CURVE;
    }
    for (size_t k = 0; k < next; k++) s->record.replaced[k] = s->scratch.lost[k];
    if (!particles_arrange(s->state.p, order, s->setup.pool, e)) return false;
    particles_flags(p, s->record.flags);
    return true;
}

/* Where normals of patches agree to 60 degrees a point has their mean, else that of the first. */
static const double AGREEING = 0.5;

static void merge_normals(sampler *s)
{
    const particles *p = s->state.p;
    size_t points = sampler_point_count(s);
    memcpy(s->record.normal, p->normal, points * sizeof *p->normal);
    for (size_t k = points; k < p->count; k++) {
        uint32_t point = s->record.point[k];
        if (vec3_dot(p->normal[k], p->normal[point]) >= AGREEING)
            s->record.normal[point] = vec3_add(s->record.normal[point], p->normal[k]);
    }
    for (size_t k = 0; k < points; k++)
        if (s->record.flags[k] & PACKING_FIXED) s->record.normal[k] = vec3_unit(s->record.normal[k]);
}

/* At an edge the cosine of its patches' normals, which are means of what is around, is larger than of its faces. */
static const double SHARP = 0;

/* The cosine of the sheets that meet in the row of particle k: of the faces of its curve, or of its normal and that of the
 * particle that it is a copy of. Above QUALITY_SHEET_FACING: they do not face each other. */
static double wedge_at(const sampler *s, size_t k)
{
    const particles *p = s->state.p;
    const curve_rows *rows = &s->state.plan.allotments[s->state.level].rows;
    const double cosine = vec3_dot(p->normal[k], p->normal[s->record.point[k]]),
                 of_faces = s->setup.field->patches->curve[rows->curve[p->place[k]]].cosine;
    return cosine < SHARP ? fmin(fmin(cosine, of_faces), QUALITY_SHEET_FACING) : of_faces;
}

/* Marks the particles near edges at which sheets meet that face each other. */
static bool mark_wedges(sampler *s, error *e)
{
    const particles *p = s->state.p;
    size_t fixed = 0, count = 0;
    for (size_t k = 0; k < p->count; k++) fixed += particles_is_on_curve(p, k);
    vec3 *at = mem_array(fixed, sizeof *at, "the result", e);
    double *reach = mem_array(fixed, sizeof *reach, "the result", e);
    bool ok = at && reach;
    for (size_t k = 0; ok && k < p->count; k++) {
        const double cosine = particles_is_on_curve(p, k) ? wedge_at(s, k) : 1;
        if (cosine > QUALITY_SHEET_FACING) continue;
        reach[count] = quality_wedge_reach(cosine);
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

/* What a point on curves is told from its particles, see sampler_stands. */
static bool merge_stands(sampler *s, error *e)
{
    const char *what = "the result";
    size_t n = s->state.p->count, points = sampler_point_count(s);
    if (!s->state.p->patch) return true;
    uint32_t *order = mem_array(n, sizeof *order, what, e), *first = mem_array(n, sizeof *first, what, e);
    s->record.point = mem_array(n, sizeof *s->record.point, what, e);
    s->record.flags = mem_array(n, sizeof *s->record.flags, what, e);
    s->record.normal = mem_array(points, sizeof *s->record.normal, what, e);
    s->record.feature = mem_array(points, sizeof *s->record.feature, what, e);
    s->scratch.lost = mem_array(points, sizeof *s->scratch.lost, what, e);
    bool ok = order && first && s->record.point && s->record.flags && s->record.normal && s->record.feature &&
              s->scratch.lost && arrange_stands(s, order, first, e);
    if (ok) merge_normals(s);
    ok = ok && mark_wedges(s, e);
    free(order);
    free(first);
    free(s->scratch.lost);
    s->scratch.lost = NULL;
    return ok;
}

static void describe_stands(sampler *s, const double *spacing)
{
    const particles *p = s->state.p;
    sampler_points *out = &s->record.out;
    out->stands = (sampler_stands){p->count, p->position,     p->normal, spacing,
                                   p->patch, s->record.point, p->place,  s->record.flags};
    out->feature = s->record.feature;
    out->patch = p->patch;
    if (p->patch) out->curve = s->state.plan.allotments[s->state.level].rows.curve;
}

static bool describe_points(sampler *s, error *e)
{
    size_t n = s->state.p->count;
    s->record.column = mem_array((s->setup.params.curvature ? COLUMNS : COLUMN_KAPPA_SCALE) * n,
                                 sizeof *s->record.column, "the result", e);
    if (!s->record.column || !describe_curvature(s, e)) return false;
    double *spacing = sampler_column(s, COLUMN_SPACING), *energy = sampler_column(s, COLUMN_ENERGY);
    requested_spacing(s, spacing);
    for (size_t i = 0; i < n; i++) energy[i] = (double)s->state.p->energy[i];
    if (!particles_add_amplitudes(s->state.p, e)) return false;
    s->record.out.count = sampler_point_count(s);
    describe_stands(s, spacing);
    s->record.out.position = s->state.p->position;
    s->record.out.normal = s->state.p->patch ? s->record.normal : s->state.p->normal;
    s->record.out.replaced = s->record.replaced;
    s->record.out.kappa = sampler_column(s, COLUMN_KAPPA);
    s->record.out.kappa1 = sampler_column(s, COLUMN_KAPPA1);
    s->record.out.kappa2 = sampler_column(s, COLUMN_KAPPA2);
    if (s->setup.params.curvature) s->record.out.kappa_scale = sampler_column(s, COLUMN_KAPPA_SCALE);
    s->record.out.alpha = s->state.p->alpha;
    s->record.out.energy = energy;
    s->record.out.spacing = spacing;
    s->record.out.sigma = s->state.sigma;
    s->record.out.ideal_energy = s->setup.params.energy->ideal;
    return true;
}

void sampler_take_back(sampler *s)
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
    s->record.out = (sampler_points){0};
}

bool sampler_settle(sampler *s, error *e)
{
    size_t n = s->state.p->count;
    s->scratch.worst = mem_array(n / CHUNK + 1, sizeof *s->scratch.worst, "the result", e);
    s->scratch.lost = mem_array(n, sizeof *s->scratch.lost, "the result", e);
    if (!s->record.replaced) s->record.replaced = mem_array(n, sizeof *s->record.replaced, "the result", e);
    s->state.settled = s->scratch.worst && s->scratch.lost && s->record.replaced;
    if (s->state.settled) {
        threads_run(s->setup.pool, n, CHUNK, finalize_chunk, s);
        s->state.settled = replace_lost(s, e);
    }
    if (s->state.settled) count_lost(s);
    free(s->scratch.worst);
    free(s->scratch.lost);
    s->scratch.worst = NULL;
    s->scratch.lost = NULL;
    return s->state.settled;
}

bool sampler_finalize(sampler *s, error *e)
{
    while (s->state.level < s->state.plan.count - 1) /* stopped early: the count is exact all the same */
        if (!sampler_refine(s, e)) return false;
    if (!s->state.settled && !sampler_settle(s, e)) return false;
    sampler_resize(s);
    if (!describe_energies(s, e) || !merge_stands(s, e) || !describe_points(s, e) ||
        !s->setup.method->describe(s, e))
        return false;
    return !threads_stopped(s->setup.pool) || error_set(e, ERROR_CANCELLED, "stopped");
}

const sampler_points *sampler_result_points(const sampler *s)
{
    return &s->record.out;
}

vec3 *sampler_result_positions(sampler *s)
{
    return s->state.p->position;
}
